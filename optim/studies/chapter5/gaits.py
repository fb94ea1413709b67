"""Gaits on terrains, each played by several copies of the robot: contact makes long runs chaotic.

Where the copies agree, their mean is the speed of the gait; where they spread, contact decides between outcomes, and
any single run, a published one too, is one draw of them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike

from optim.experiments.allowed import Allowed
from optim.experiments.data import Data
from optim.experiments.results import Progress, computed_arrays
from optim.experiments.study import Settings, Whole
from robots.inflatable import simulation
from robots.inflatable.actuation import ACTUATION, InflatableActuation
from robots.inflatable.body import PUBLISHED, InflatableGeometry
from robots.inflatable.design import InflatableDesign
from robots.inflatable.robustness import NOISE
from robots.robot import KINDS
from robots.world import FRICTION_OF_PARTS, STEEPEST, Terrain
from taichi_sim.base import checks
from taichi_sim.base.arrays import Floats
from taichi_sim.base.compute import Precision
from taichi_sim.base.results_folder import ResultsFolder

BATCH = 16  # robots of a part of a study at least, if there are any more: they fill the lanes of two threads in f64
Uphill = Annotated[float, partial(checks.number, low=0.1, high=STEEPEST, unit="degrees")]  # slope of a hill


@dataclass(frozen=True)
class Case:
    """A gait on a terrain."""

    design: InflatableDesign
    terrain: Terrain

    def describe(self) -> dict[str, Any]:
        """Gait and terrain, as JSON values."""
        schedule = self.design.schedule
        return {
            "pressure": self.design.pressure,
            "orientation": self.design.orientation,
            "schedule": schedule.to_text(),
            "repeats": schedule.repeats,
            "terrain": KINDS["inflatable"].world_record(self.terrain),
        }


@dataclass(frozen=True)
class GaitRuns(Settings):
    """The robot that plays the gaits, and how it is simulated."""

    geometry: InflatableGeometry = PUBLISHED  # shape and materials
    actuation: InflatableActuation = ACTUATION  # rates, timing and friction
    precision: Precision = "f64"
    copies: Annotated[int, partial(checks.integer, low=1, high=1000)] = 8  # of each gait
    noise: float = NOISE  # standard deviation of the noise on the start positions [m]
    seed: Whole = 0  # of the noise

    def __post_init__(self) -> None:
        super().__post_init__()
        checks.number("noise", self.noise, 0.0, self.geometry.voxel_size, "m")

    def describe(self) -> dict[str, Any]:
        """All that results depend on, as JSON values; what version 1.0 did not know only where it is given."""
        described = super().describe()
        for name in ("closed", "bladders"):
            if getattr(self.geometry, name) == getattr(PUBLISHED, name):
                del described["geometry"][name]
        for name in ("ramp_steps", *FRICTION_OF_PARTS):
            if getattr(self.actuation, name) is None:
                del described["actuation"][name]
        return described

    def speeds(self, cases: Sequence[Case], threads: int | None = None, progress: Progress = None) -> Floats:
        """Published speeds of all cases in one batch [body lengths/s], shape (cases, copies); NaN of what diverged."""
        return np.asarray(self.play(cases, threads, progress).speed, float).reshape(len(cases), self.copies)

    def play(
        self, cases: Sequence[Case], threads: int | None = None, progress: Progress = None
    ) -> simulation.InflatableResult:
        """Play all cases as one batch, the copies of each beside each other."""
        each = [case for case in cases for _ in range(self.copies)]
        return simulation.simulate(
            [case.design for case in each],
            [case.terrain for case in each],
            geometry=self.geometry,
            actuation=self.actuation,
            precision=self.precision,
            perturbation=self.noise,
            seed=self.seed,
            threads=threads,
            progress=progress,
        )

    def speeds_in_parts(
        self, cases: Sequence[Case], folder: ResultsFolder, threads: int | None = None, progress: Progress = None
    ) -> Floats:
        """Play cases in batches whose speeds are kept in a folder: a kill loses at most one batch."""
        size = -(-BATCH // self.copies)
        batches = [cases[first : first + size] for first in range(0, len(cases), size)]
        parts = {f"speeds_{n}": partial(self.speeds, batch, threads) for n, batch in enumerate(batches)}
        allowed = {f"speeds_{n}": self.allowed_speeds(len(batch)) for n, batch in enumerate(batches)}
        return np.concatenate(computed_arrays(folder, "speeds", parts, progress, allowed))

    def allowed_speeds(self, cases: int) -> Allowed:
        """What kept speeds of so many cases may be, see :meth:`speeds`."""
        return Allowed((cases, self.copies), failed=np.nan)


def kept_speeds(data: Data, cases: int) -> Floats:
    """Read the speeds of so many cases that :meth:`GaitRuns.speeds_in_parts` has kept, shape (cases, copies).

    Raises ValueError if a part is missing, or they are those of other cases.
    """
    parts: list[Floats] = []
    while sum(map(len, parts)) < cases:
        parts.append(data.array(f"speeds_{len(parts)}", "speeds", "f2"))
    count, copies = sum(map(len, parts)), {part.shape[1] for part in parts}
    if count != cases or len(copies) > 1:
        numbers = " or ".join(map(str, sorted(copies)))
        raise ValueError(
            f"{data.folder}: its parts have {count} cases of {numbers} copies; give {cases} of as many each"
        )
    return np.concatenate(parts)


def repeated(design: InflatableDesign, repeats: int) -> InflatableDesign:
    """A copy of a design whose columns are played so often."""
    return replace(design, schedule=design.schedule.cut(None, repeats))


def spread(speeds: ArrayLike) -> dict[str, float | int | None]:
    """Mean, deviation and range of copies, shape (copies,), None where too few are left, and how many diverged."""
    speeds = np.asarray(speeds, float)
    valid = speeds[~np.isnan(speeds)]
    return {
        "mean": float(valid.mean()) if valid.size else None,
        "deviation": float(valid.std(ddof=1)) if valid.size > 1 else None,
        "lowest": float(valid.min()) if valid.size else None,
        "highest": float(valid.max()) if valid.size else None,
        "copies": int(speeds.size),
        "diverged": int(speeds.size - valid.size),
    }


def shown(speeds: Mapping[str, float | int | None]) -> str:
    """A :func:`spread` as text, such as ``0.0603 ± 0.0002``."""
    if speeds["mean"] is None:
        return "all diverged"
    text = f"{speeds['mean']:.4f}"
    if speeds["deviation"] is not None:
        text += f" ± {speeds['deviation']:.4f}"
    return f"{text} ({speeds['diverged']} of {speeds['copies']} diverged)" if speeds["diverged"] else text
