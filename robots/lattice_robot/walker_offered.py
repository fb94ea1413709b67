"""What soft walkers offer to commands, searches, views and reports: a lattice of bodies, and one body of it."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from robots.lattice_robot.walker import KINDS, WalkerActuation, WalkerDesign, save_walker, simulate, walker_robot
from robots.lattice_robot.walker_encoding import WalkerEncoding, encoding_of
from robots.robot import FRAMES, HERE, Facts, Measure, Outcome, Parameter, Picture, Progress, Replay, Robot, World
from robots.world import Terrain, terrain_of
from taichi_sim.base.checks import whole_number
from taichi_sim.base.compute import Compute

KIND_COLOURS = ("#f3f1ec", "#b9b4a8", "#0072B2", "#D55E00")  # in the order of KINDS
MEASURES = (
    Measure("speed", "lattices/s", "speed along x, in lengths of the lattice"),
    Measure("distance", "m", "distance along x"),
    Measure("voxels", "", "voxels of the body"),
)


@dataclass(frozen=True, eq=False)
class WalkerBodies(Robot):
    """A lattice in which a search puts bodies together.

    Attributes:
        shape: (X, Y, Z) of the lattice.
        encoding: how a point says a body: ``"direct"``, the material of each voxel, or ``"pattern"``, a network.
        actuation: of active voxels, and how long.
    """

    shape: tuple[int, ...] = (4, 4, 3)
    encoding: str = "direct"
    actuation: WalkerActuation = field(default_factory=WalkerActuation)

    kind = "walker"
    measures = MEASURES
    worlds = (Terrain(),)

    def __post_init__(self) -> None:
        shape = tuple(self.shape)
        if len(shape) != 3:
            raise ValueError(f"shape: {shape} is not allowed; give (X, Y, Z)")
        object.__setattr__(self, "shape", tuple(whole_number("shape", side, 1) for side in shape))
        _ = self._body

    @cached_property
    def _body(self) -> WalkerEncoding:
        return encoding_of(self.encoding, self.shape)

    @property
    def parameters(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        """The genes of the body."""
        return tuple(self._body.variables())

    def walker(self, point: ArrayLike) -> WalkerDesign:
        """The body of a point, shape (P,)."""
        return self._body.design(self.points(point)[0])

    def design(self, point: ArrayLike) -> "Walker":
        """The walker of a point, shape (P,)."""
        return Walker(self.walker(point), self.actuation)

    def simulate(
        self,
        points: ArrayLike,
        world: World,
        *,
        compute: Compute = HERE,
        record_every: int | None = None,
        progress: Progress | None = None,
    ) -> Outcome:
        """Let the bodies of N points walk."""
        designs = [self.walker(point) for point in self.points(points)]
        return tried(designs, self.actuation, world, compute, record_every, progress)

    def replay(self, point: ArrayLike, world: World, **settings: Any) -> Replay:
        """Let one body walk."""
        return self.design(point).replay((), world, **settings)

    def command_options(self) -> dict[str, Any]:
        """The actuation, which files of bodies do not hold."""
        usual = asdict(WalkerActuation())
        return {name: value for name, value in asdict(self.actuation).items() if value != usual[name]}

    def save(self, point: ArrayLike, path: Path) -> None:
        """Write the body of a point, for ``load_walker``."""
        save_walker(self.walker(point), path)

    def describe(self) -> dict[str, Any]:
        """Lattice, encoding and actuation."""
        return {"shape": list(self.shape), "encoding": self.encoding, "actuation": asdict(self.actuation)}

    def facts(self) -> Facts:
        """Lattice, encoding and actuation."""
        return [
            ("Robot", f"soft voxel walker in a lattice of {' x '.join(map(str, self.shape))} voxels"),
            ("Encoding", self.encoding),
            *actuation_facts(self.actuation),
        ]

    def facts_of(self, point: ArrayLike) -> Facts:
        """The voxels of a body."""
        return self.design(point).facts_of(())

    def columns(self, points: ArrayLike) -> dict[str, list[str]]:
        """How many voxels."""
        return {"Voxels": [str(int((self.walker(point).materials > 0).sum())) for point in self.points(points)]}

    def pictures(self, point: ArrayLike, replays: Sequence[Replay] = (), compute: Compute = HERE) -> list[Picture]:
        """The layers of a body."""
        return self.design(point).pictures((), replays)


@dataclass(frozen=True, eq=False)
class Walker(Robot):
    """One walker: nothing of it is free.

    Attributes:
        body: its voxels.
        actuation: of active voxels, and how long.
        title: what people call it.
    """

    body: WalkerDesign
    actuation: WalkerActuation = field(default_factory=WalkerActuation)
    title: str = "walker"

    kind = "walker"
    measures = MEASURES
    worlds = (Terrain(),)

    @property
    def name(self) -> str:
        """What people call it."""
        return self.title

    def simulate(
        self,
        points: ArrayLike,
        world: World,
        *,
        compute: Compute = HERE,
        record_every: int | None = None,
        progress: Progress | None = None,
    ) -> Outcome:
        """Let it walk, as often as there are points."""
        return tried([self.body] * len(self.points(points)), self.actuation, world, compute, record_every, progress)

    def replay(
        self,
        point: ArrayLike,
        world: World,
        *,
        frames: int = FRAMES,
        name: str = "",
        compute: Compute = HERE,
        progress: Progress | None = None,
    ) -> Replay:
        """Let it walk, and build its motion."""
        from robots.view.motion import record_every
        from robots.view.soft_motion import lattice_robot_motion

        if self.body.fault:
            raise ValueError(f"source: {name or self.name} is no robot: {self.body.fault}")
        terrain, robot = terrain_of(world), walker_robot(self.body, actuation=self.actuation)
        every = record_every(robot.cycle.end - robot.cycle.begin, frames)
        outcome = self.simulate((), terrain, compute=compute, record_every=every, progress=progress)
        return Replay(outcome, lattice_robot_motion(outcome.result, robot, terrain, name=name or self.name))

    def save(self, point: ArrayLike, path: Path) -> None:
        """Write the body, for ``load_walker``."""
        save_walker(self.body, path)

    def describe(self) -> dict[str, Any]:
        """Body and actuation."""
        return {"materials": self.body.materials.tolist(), "actuation": asdict(self.actuation)}

    def facts(self) -> Facts:
        """Actuation."""
        return [("Robot", "soft voxel walker"), *actuation_facts(self.actuation)]

    def facts_of(self, point: ArrayLike) -> Facts:
        """The voxels."""
        counts = np.bincount(self.body.materials.ravel(), minlength=len(KINDS))
        found = [(f"{kind.capitalize()} voxels", str(count)) for kind, count in zip(KINDS, counts, strict=True)]
        return [*found, ("That walk, joined in one piece", str(len(self.body.connected[1])))]

    def pictures(self, point: ArrayLike, replays: Sequence[Replay] = (), compute: Compute = HERE) -> list[Picture]:
        """The layers of the body."""
        words = "Its layers from the lowest, on the left, to the highest; x to the right."
        return [Picture(words, self._draw_layers, (5.0, 1.9), "narrow")]

    def _draw_layers(self, axes: Any) -> None:
        """Layers side by side."""
        from matplotlib.colors import ListedColormap, NoNorm

        width, depth, height = self.body.materials.shape
        gap, cells = 0.4, {"cmap": ListedColormap(KIND_COLOURS), "norm": NoNorm(), "interpolation": "nearest"}
        for layer in range(height):
            left = layer * (width + gap)
            extent = (left, left + width, 0, depth)
            axes.imshow(self.body.materials[:, :, layer].T, origin="lower", extent=extent, **cells)
        for kind, colour in list(zip(KINDS, KIND_COLOURS, strict=True))[1:]:
            axes.plot([], [], "s", color=colour, label=kind)
        axes.set(xlim=(0, height * (width + gap)), ylim=(0, depth), aspect="equal")
        axes.axis("off")


def actuation_facts(actuation: WalkerActuation) -> Facts:
    """Rows for a report about the actuation."""
    cycles = "1 cycle" if actuation.cycles == 1 else f"{actuation.cycles} cycles"
    told = f"{100 * actuation.amplitude:g} % of the edges at {actuation.frequency:g} Hz, {cycles}"
    return [("Actuation", told)]


def tried(
    designs: Sequence[WalkerDesign],
    actuation: WalkerActuation,
    world: World,
    compute: Compute,
    record_every: int | None,
    progress: Progress | None,
) -> Outcome:
    """Let designs walk: their measures, and frames of the first."""
    terrain = terrain_of(world)
    more = {"record_every": record_every, "progress": progress}
    result = simulate(designs, terrain, actuation=actuation, **more, **compute.options)  # type: ignore[arg-type]
    voxels = np.array([len(design.connected[1]) for design in designs], float)
    measures = {"speed": result.speed, "distance": result.distance, "voxels": voxels}
    frames = vars(result.frames[0]) if result.frames[0] is not None else {}
    return Outcome(measures, result.status, result.reason, result.steps, {}, frames, result)
