"""How the speed of a gait counts where a search plays a part of a gait: by its slowest stage, over a set time.

One definition, for the search, for the robot that it finds, and for its judgement, pictures and reports.
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from robots.inflatable.actuation import PUBLISHED_COLUMNS, InflatableActuation
from robots.inflatable.schedule import GaitSchedule
from robots.inflatable.timing import WHOLE, Counting, cycle_starts, gait_steps, nominal_steps, stage_starts
from taichi_sim.base.arrays import Floats, Ints

if TYPE_CHECKING:
    from robots.inflatable.body import InflatableGeometry
    from robots.inflatable.simulation import InflatableResult


@dataclass(frozen=True)
class SpeedConvention:
    """The speed of a gait with times of its own: as if every stage went as far as the slowest one.

    Attributes:
        counting: which part of the gait counts, and its stages; simulations that are to be counted take it.
        steps: time steps of a gait, over which its distance counts at least; None is those of a published gait. After
            a warm-up, those of what is left count instead.
    """

    counting: Counting = WHOLE
    steps: int | None = None

    @property
    def spoken(self) -> str:
        """Over which time and by what speeds count, in words."""
        counting, time = self.counting, "in the time of a published gait"
        if self.steps is not None:
            time = f"of {self.steps:,} time steps"
        if counting.warm_up:
            unit = " time steps" if self.steps is None else ""
            time = f"{'' if self.steps is None else time + ' '}after a warm-up of {counting.warm_up:,}{unit}"
        return time + (f", by the slowest of {counting.stages} stages" if counting.stages > 1 else "")

    def least_steps(self, actuation: InflatableActuation) -> int:
        """Time steps by which the speed of a whole gait counts, unless it takes more."""
        return nominal_steps(PUBLISHED_COLUMNS, actuation) if self.steps is None else self.steps

    def counted(self, result: "InflatableResult", actuation: InflatableActuation) -> Ints:
        """Time steps by which the speeds of a batch count, shape (N,)."""
        if self.counting.warm_up:  # whole cycles that follow it
            return result.steps
        return np.asarray(np.maximum(result.steps, self.least_steps(actuation)))

    def counted_of(self, schedule: GaitSchedule, actuation: InflatableActuation) -> int:
        """The same of a gait that was not simulated; cheap."""
        steps, warm_up = gait_steps(schedule, actuation), self.counting.warm_up
        if not warm_up:
            return max(steps, self.least_steps(actuation))
        return steps - stage_starts(cycle_starts(schedule, actuation), steps, warm_up, self.counting.stages)[0]

    def speeds(
        self, result: "InflatableResult", geometry: "InflatableGeometry", actuation: InflatableActuation
    ) -> Floats:
        """Speeds of a batch [body lengths/s], shape (N,).

        Raises:
            ValueError: for a result of another number of stages, of which the slowest is not known.
        """
        stages, found = self.counting.stages, result.stages.shape[1]
        if found != stages:
            raise ValueError(f"stages: {found} of a result are not allowed; simulate with counting, {stages} stages")
        lengths = stages * result.stages.min(axis=1) / geometry.body_length
        return np.asarray(lengths / (self.counted(result, actuation) * result.time_step))

    def slower(self, times: int) -> "SpeedConvention":
        """The convention where time steps are so many times shorter."""
        counting = replace(self.counting, warm_up=times * self.counting.warm_up)
        return SpeedConvention(counting, None if self.steps is None else times * self.steps)


def counting_of(convention: SpeedConvention | None) -> Counting:
    """Which part of a gait counts by a convention; all by the published one, which is None."""
    return WHOLE if convention is None else convention.counting


def speeds_by(
    convention: SpeedConvention | None,
    result: "InflatableResult",
    geometry: "InflatableGeometry",
    actuation: InflatableActuation,
) -> Floats:
    """Speeds of a batch by a convention; those of the result by the published one, which is None."""
    return result.speed if convention is None else convention.speeds(result, geometry, actuation)
