"""What lines are told, state by state, and how long it shall last.

A gait with the published times leaves time to the rig: a state lasts as long as its slowest line. A gait with times of
its own dwells as it does in the simulation.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from robots.hardware.line_map import LineMap
from robots.inflatable.actuation import ACTUATION
from robots.inflatable.body import PUBLISHED
from robots.inflatable.design import InflatableDesign
from robots.inflatable.schedule import BLADDERS, ROWS
from robots.inflatable.timing import durations
from taichi_sim.base.arrays import Floats

TIME_STEP = PUBLISHED.time_step  # in which gaits count their times [s]


@dataclass(frozen=True, eq=False)
class Commands:
    """What all lines are told in S states: shaping of the body, the columns twice, venting.

    Attributes:
        targets: pressures [kPa], shape (S, 11).
        portions: of the rig's time of a whole stroke that each line takes, shape (S, 11): how far an actuator goes
            between off and on; 1 for the core, for shaping and for venting.
        moving_s: that states take at least before they dwell [s], shape (S,).
        resting_s: that they dwell once all lines are done [s], shape (S,).
    """

    targets: Floats
    portions: Floats
    moving_s: Floats
    resting_s: Floats

    @property
    def columns(self) -> int:
        """Of the schedule."""
        return len(self.targets) // 2 - 1

    def within(self, low: Floats, high: Floats) -> Self:
        """The same with pressures cut to limits [kPa], shape (11,) each."""
        return replace(self, targets=np.clip(self.targets, low, high))


def commands_of(design: InflatableDesign, line_map: LineMap) -> Commands:
    """The commands of a gait.

    Args:
        design: with one core pressure.
        line_map: from simulated to line pressures.
    """
    schedule = design.schedule
    shaping = (np.arange(ROWS) >= BLADDERS).astype(float)  # the feet grip
    levels = np.column_stack([shaping, schedule.levels, schedule.levels])
    core, times = np.full(levels.shape[1], design.pressure), np.zeros((schedule.columns, 2))
    if schedule.core_pressure is not None:
        core[1:] = np.tile(schedule.core_pressure, 2)
    if schedule.has_own_times:
        times = np.array(durations(schedule, ACTUATION))[: schedule.columns] * TIME_STEP
    states = line_map.lines(core, levels)
    portions = np.ones((len(states) + 1, states.shape[1]))
    ways = np.abs(np.diff(levels, axis=1)).T
    portions[1:-1, 1:] = np.where(ways > 0, ways, 1.0)
    moving, resting = np.pad(np.tile(times.T, 2), ((0, 0), (1, 1)))
    return Commands(np.vstack([states, np.zeros(states.shape[1])]), portions, moving, resting)
