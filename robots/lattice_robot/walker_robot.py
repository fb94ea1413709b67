"""What soft walkers offer to commands, searches, views and reports: a lattice of bodies, and one body of it."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from robots.control.cyclic import Cycle, Cyclic
from robots.lattice_robot import walker
from robots.lattice_robot.links import facts_of_links
from robots.lattice_robot.robot import LatticeRobot
from robots.lattice_robot.walker import ACTIVE, ANTIPHASE, KINDS, WalkerActuation, WalkerDesign, WalkerTissue
from robots.lattice_robot.walker_encoding import WalkerEncoding, encoding_of
from robots.outcome import recorded
from robots.robot import HERE, Facts, Measure, Outcome, Parameter, Picture, Replay, Robot, Trial, World
from robots.world import Terrain, terrain_of
from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import choice, whole_number
from taichi_sim.base.compute import Compute
from taichi_sim.base.short_text import counted
from taichi_sim.lattice.body import LINK_LAWS, USUAL_LINKS

if TYPE_CHECKING:
    from robots.view.motion import Motion

KIND_COLOURS = ("#f3f1ec", "#b9b4a8", "#0072B2", "#D55E00")  # in the order of KINDS


@dataclass(frozen=True, eq=False, repr=False)
class WalkerRobot(Cyclic, Robot):
    """A lattice in which a search puts bodies together; or one body, of which nothing is free.

    Attributes:
        shape: (X, Y, Z) of the lattice.
        encoding: how a point says a body: ``"direct"``, the material of each voxel, or ``"pattern"``, a network.
        actuation: of active voxels, and how long.
        body: the one body, or None if it is free.
        name: what people call it.
        links: law of the links between voxels, see ``LatticeBody``.
    """

    shape: tuple[int, ...] = (4, 4, 3)
    encoding: str = "direct"
    actuation: WalkerActuation = field(default_factory=WalkerActuation)
    body: WalkerDesign | None = None
    name: str = "soft walker"
    links: str = USUAL_LINKS

    kind = "walker"
    measures = (
        Measure("speed", "lattices/s", "speed along x, in lengths of the lattice"),
        Measure("distance", "m", "distance along x"),
        Measure("voxels", "", "voxels of the body"),
    )
    worlds = (Terrain(),)
    changeable = ("links",)

    def __post_init__(self) -> None:
        shape = tuple(self.shape)
        if len(shape) != 3:
            raise ValueError(f"shape: {shape} is not allowed; give (X, Y, Z)")
        object.__setattr__(self, "shape", tuple(whole_number("shape", side, 1) for side in shape))
        choice("links", self.links, LINK_LAWS)
        _ = self._encoding

    @cached_property
    def _encoding(self) -> WalkerEncoding:
        return encoding_of(self.encoding, self.shape)

    @property
    def _tissue(self) -> WalkerTissue:
        return WalkerTissue(links=self.links)

    @property
    def parameters(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        """The genes of the body, if it is free."""
        return () if self.body else tuple(self._encoding.variables())

    @property
    def footprint(self) -> tuple[float, float]:
        """Rear and front of its lattice along the heading [m], whose first voxels are about the origin."""
        edge = self._tissue.voxel_size
        return -edge / 2, (self.shape[0] - 0.5) * edge

    @property
    def start(self) -> Floats:
        """A block whose front and rear swell in turn, for a look at what moves; no search begins there."""
        if self.body or self.encoding != "direct":
            return super().start
        materials = np.full(self.shape, ANTIPHASE)
        materials[self.shape[0] // 2 :] = ACTIVE
        return materials.ravel().astype(float)

    def bodies(self, points: ArrayLike) -> list[WalkerDesign]:
        """The bodies of points, shape (N, P)."""
        points = self.points(points)
        return [self.body or self._encoding.design(point) for point in points]

    def design(self, point: ArrayLike) -> "WalkerRobot":
        """The walker of a point, shape (P,)."""
        return replace(self, body=self.bodies(point)[0], name="walker")

    def run(self, points: Floats, trial: Trial) -> Outcome:
        """Let the bodies of N points walk."""
        return self.run_in(points, (trial.world,), trial)[0]

    def run_in(
        self, points: Floats, worlds: Sequence[World], trial: Trial, variants: "Sequence[WalkerRobot]" = ()
    ) -> list[Outcome]:
        """Let the bodies of N points walk in several worlds; each body is one batch in all that can share it."""
        if variants:
            return super().run_in(points, worlds, trial, variants)
        designs = self.bodies(points)
        voxels = np.array([len(design.connected[1]) for design in designs], float)
        return [
            Outcome(
                {"speed": found.speed, "distance": found.distance, "voxels": voxels},
                found.status,
                found.reason,
                found.steps,
                {},
                recorded(found.frames[0]),
                found,
            )
            for found in walker.simulate_in(designs, worlds, trial, self._tissue, self.actuation)
        ]

    @property
    def cycle(self) -> Cycle:
        """Timing of the actuation."""
        return walker.walker_cycle(self.actuation, self._tissue)

    def motion(self, outcome: Outcome, world: World, name: str) -> "Motion":
        """The motion of the body."""
        from robots.lattice_robot.motion import lattice_robot_motion

        return lattice_robot_motion(outcome.result, self._as_lattice_robot, terrain_of(world), name=name)

    def save_parts(self, path: Path, mould: str | None = None) -> list[str]:
        """Write surfaces of the body for printers, or a mould, as a lattice robot does."""
        return self._as_lattice_robot.save_parts(path, mould)

    def save_voxels(self, path: Path) -> None:
        """Write the walker for VoxCAD, or its body for Voxelyze, as a lattice robot does."""
        self._as_lattice_robot.save_voxels(path)

    @property
    def _as_lattice_robot(self) -> LatticeRobot:
        return walker.walker_robot(self.bodies(())[0], self._tissue, self.actuation)

    def command_options(self) -> dict[str, Any]:
        """The actuation and the links, which files of bodies do not hold."""
        usual = asdict(WalkerActuation()) | {"links": USUAL_LINKS}
        own = asdict(self.actuation) | {"links": self.links}
        return {name: value for name, value in own.items() if value != usual[name]}

    def save(self, point: ArrayLike, path: Path) -> None:
        """Write the body of a point, for ``load_walker``."""
        walker.save_walker(self.bodies(point)[0], path)

    def describe(self) -> dict[str, Any]:
        """All that results depend on, as JSON values: lattice, encoding, actuation, and links if unusual."""
        found = {"shape": list(self.shape), "encoding": self.encoding, "actuation": asdict(self.actuation)}
        return found if self.links == USUAL_LINKS else {**found, "links": self.links}

    def facts(self) -> Facts:
        """Lattice, encoding and actuation."""
        drive, cycles = self.actuation, counted(self.actuation.cycles, "cycle")
        return [
            ("Robot", f"soft voxel walker in a lattice of {' x '.join(map(str, self.shape))} voxels"),
            ("Encoding", self.encoding),
            *facts_of_links(self.links),
            (
                "Actuation",
                f"{100 * drive.amplitude:g} % of the edges at {drive.frequency:g} Hz, {cycles}",
            ),
        ]

    def facts_of(self, point: ArrayLike) -> Facts:
        """The voxels of a body."""
        body = self.bodies(point)[0]
        counts = np.bincount(body.materials.ravel(), minlength=len(KINDS))
        found = [(f"{kind.capitalize()} voxels", str(count)) for kind, count in zip(KINDS, counts, strict=True)]
        return [*found, ("That walk, joined in one piece", str(len(body.connected[1])))]

    def columns(self, points: ArrayLike) -> dict[str, list[str]]:
        """How many voxels."""
        return {"Voxels": [str(int((body.materials > 0).sum())) for body in self.bodies(points)]}

    def pictures(self, point: ArrayLike, replays: Sequence[Replay] = (), compute: Compute = HERE) -> list[Picture]:
        """The layers of a body."""
        materials = self.bodies(point)[0].materials
        words = "Its layers from the lowest, on the left, to the highest; x to the right."
        return [Picture(words, lambda axes: _draw_layers(axes, materials), (5.0, 1.9), "narrow")]


def _draw_layers(axes: Any, materials: np.ndarray) -> None:
    """Draw the layers of a body side by side."""
    from matplotlib.colors import ListedColormap, NoNorm

    width, depth, height = materials.shape
    gap, cells = 0.4, {"cmap": ListedColormap(KIND_COLOURS), "norm": NoNorm(), "interpolation": "nearest"}
    for layer in range(height):
        left = layer * (width + gap)
        axes.imshow(materials[:, :, layer].T, origin="lower", extent=(left, left + width, 0, depth), **cells)
    for kind, colour in list(zip(KINDS, KIND_COLOURS, strict=True))[1:]:
        axes.plot([], [], "s", color=colour, label=kind)
    axes.set(xlim=(0, height * (width + gap)), ylim=(0, depth), aspect="equal")
    axes.axis("off")
