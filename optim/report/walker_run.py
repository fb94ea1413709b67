"""Reports of soft voxel walkers: where they walk, and the best body layer by layer."""

import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from optim.problems.walker import WalkerProblem
from optim.report.charts import chart
from optim.report.kinds import Best, Progress, Replay, finite
from optim.report.markup import Text, facts, number, picture, table
from optim.runs.generation import Generation
from optim.wording import counted
from robots.hardware import PneumaticRig
from robots.lattice_robot import walker
from robots.lattice_robot.walker import WalkerDesign, WalkerTissue
from robots.lattice_robot.walker_body import KINDS
from robots.view.motion import record_every
from taichi_sim.base.arrays import Floats

UNIT = "lattices/s"
KIND_COLOURS = ("#f3f1ec", "#b9b4a8", "#0072B2", "#D55E00")  # of KINDS


@dataclass(frozen=True)
class WalkerRun:
    """A run that designs the body of a soft voxel walker."""

    problem: WalkerProblem

    @classmethod
    def of(cls, description: Mapping[str, Any]) -> Self:
        """The run of a problem as described."""
        return cls(WalkerProblem.from_description(description))

    @property
    def task(self) -> str:
        """Where it walks."""
        return f"voxel walker, {self.problem.terrain.spoken}"

    @property
    def score(self) -> tuple[str, str]:
        """Speed."""
        return "speed", UNIT

    @property
    def facts(self) -> list[tuple[str, Text]]:
        """Lattice, terrain, actuation, and the simulation."""
        problem, drive = self.problem, self.problem.actuation
        return [
            ("Robot", f"soft voxel walker in a lattice of {' x '.join(map(str, problem.shape))} voxels"),
            ("Terrains", problem.terrain.name),
            ("Objective", f"speed along x, in lengths of the lattice a second ({UNIT})"),
            ("Free", f"the body, encoded as {problem.encoding}"),
            (
                "Actuation",
                f"{100 * drive.amplitude:g} % of the edges at {drive.frequency:g} Hz, {counted(drive.cycles, 'cycle')}",
            ),
            ("Simulation", f"{problem.precision} on {problem.device}"),
        ]

    @property
    def curves(self) -> Mapping[str, str]:
        """None beside the score."""
        return {}

    def replay(self, point: Floats, frames: int, progress: Progress) -> Replay:
        """Let a design walk again."""
        from robots.view.soft_motion import walker_motion

        problem, design = self.problem, self.problem.design(point)
        drive = problem.actuation
        seconds = (drive.cycles + 1) / drive.frequency
        steps = seconds / drive.time_step(WalkerTissue().on(problem.terrain).time_step)
        result = walker.simulate(
            design,
            problem.terrain,
            actuation=drive,
            precision=problem.precision,
            device=problem.device,
            threads=problem.threads,
            record_every=record_every(steps, frames),
            progress=progress,
        )
        name = f"best walker {problem.terrain.spoken}"
        return Replay(
            [walker_motion(result, design, problem.terrain, actuation=drive, name=name)],
            [finite(float(result.speed[0]))],
        )

    def best(self, last: Generation, point: Floats, replay: Replay, rig: PneumaticRig | None) -> Best:
        """Its numbers, and the layers of its body."""
        del rig  # nothing inflates
        design, details, where = self.problem.design(point), last.best_details or {}, self.problem.terrain
        again = replay.numbers[0] if replay.numbers else None
        speeds = {"speed": last.best, "distance": details.get("distance"), "replayed": again}
        header = ["Terrain", f"Speed [{UNIT}]", "Distance [m]"] + [f"Replayed here [{UNIT}]"] * bool(replay.numbers)
        row = list(map(number, speeds.values()))[: len(header) - 1]
        counts = np.bincount(design.materials.ravel(), minlength=len(KINDS))
        body = [(f"{kind.capitalize()} voxels", str(count)) for kind, count in zip(KINDS, counts, strict=True)]
        content = [
            table("The best design", header, [[where.spoken, *row]]),
            facts("Its body", [*body, ("That walk, joined in one piece", str(details.get("voxels", "")))]),
            picture(
                _layers(design), "Its layers from the lowest, on the left, to the highest; x to the right.", "narrow"
            ),
        ]
        return Best(content, [], {"terrains": [{"terrain": where.name, **speeds}]})

    def columns(self, points: Floats) -> dict[str, list[Text]]:
        """How many voxels."""
        return {"Voxels": [int((self.problem.design(point).materials > 0).sum()) for point in points]}

    def commands(self, folder: Path) -> list[tuple[str, str]]:
        """Watching the best design."""
        return [("Watch it", f"morpholab view {shlex.quote(str(folder))} --out best.html")]


def _layers(design: WalkerDesign) -> Any:
    """The body as a chart, layers side by side."""
    from matplotlib.colors import ListedColormap, NoNorm

    width, depth, height = design.materials.shape
    gap, cells = 0.4, {"cmap": ListedColormap(KIND_COLOURS), "norm": NoNorm(), "interpolation": "nearest"}

    def draw(axes: Any) -> None:
        for layer in range(height):
            left = layer * (width + gap)
            axes.imshow(design.materials[:, :, layer].T, origin="lower", extent=(left, left + width, 0, depth), **cells)
        for kind, colour in list(zip(KINDS, KIND_COLOURS, strict=True))[1:]:
            axes.plot([], [], "s", color=colour, label=kind)
        axes.set(xlim=(0, height * (width + gap)), ylim=(0, depth), aspect="equal")
        axes.axis("off")

    return chart(draw, f"The body's {height} layers of {width} x {depth} voxels", size=(5.0, 1.9))
