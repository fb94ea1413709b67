"""How the course of a gait table over time differs from the gait as the simulator plays it.

The rows of a table may have the right levels at the end of every state and still play another gait: lines take
longer than the simulator's strokes, not all alike, and a foot that grips at once in the simulator takes a stroke.
"""

from dataclasses import dataclass

import numpy as np

from robots.hardware.rig_play import commanded
from robots.hardware.table import TIME_STEP, GaitTable
from robots.inflatable.actuation import ACTUATION, InflatableActuation
from robots.inflatable.design import InflatableDesign
from robots.inflatable.schedule import GaitSchedule
from robots.inflatable.timing import play, rest_levels
from taichi_sim.base.arrays import Floats

SAMPLES = 50  # of every state


@dataclass(frozen=True)
class CourseDifference:
    """What sampling the states of a table beside those of its gait finds.

    Attributes:
        stretch: how many times as long the table takes as the simulated gait.
        mean: difference of the levels of bladders and feet, 0 to 1, at equal shares of the states; mean of all.
        largest: of these differences.
        actuator: that has the largest, such as ``"foot1"``.
    """

    stretch: float
    mean: float
    largest: float
    actuator: str

    def __str__(self) -> str:
        return (
            f"its rows take {self.stretch:.2f} times as long, and levels on the way differ by {self.mean:.3f} on "
            f"average, at most {self.largest:.2f} ({self.actuator})"
        )


def course_difference(
    table: GaitTable, actuation: InflatableActuation = ACTUATION, time_step: float = TIME_STEP
) -> CourseDifference:
    """Compare the course of a table's rows with that of the gait in its header, state by state.

    Args:
        table: with rows and header.
        actuation: how the simulated robot is driven.
        time_step: of its simulation [s], shorter for a stiffer robot than the published.
    """
    shares = (np.arange(SAMPLES) + 0.5) / SAMPLES
    designed, seconds = designed_course(table.design, shares, actuation, time_step)
    rows, lasting = table_course(table, shares)
    off = np.abs(rows - designed)
    worst = int(off.max(axis=(0, 1)).argmax())
    name = GaitSchedule.row_names[worst]
    return CourseDifference(float(lasting / seconds), float(off.mean()), float(off.max()), name)


def designed_course(
    design: InflatableDesign, shares: Floats, actuation: InflatableActuation, time_step: float = TIME_STEP
) -> tuple[Floats, float]:
    """Levels of bladders and feet in the simulator at shares of columns, shape (N, S, 10); how long they take [s]."""
    columns, steps = play(design.schedule, actuation)
    empty, full = rest_levels(actuation)
    edges = np.array([*(column.start for column in columns), steps])
    found = []
    for column, length in zip(columns, np.diff(edges), strict=True):
        motion, passed = column.motion, shares[:, None] * length
        gone = np.minimum(passed * motion.rate, np.abs(motion.ends - motion.levels))
        bladders = (motion.levels + motion.direction * gone - empty) / (full - empty)
        grips = np.broadcast_to(np.asarray(column.grip, float), (len(shares), len(column.grip)))
        found.append(np.concatenate([np.clip(bladders, 0.0, 1.0), grips], axis=1))
    return np.array(found), float(steps * time_step)


def table_course(table: GaitTable, shares: Floats) -> tuple[Floats, float]:
    """Levels that the rows of a table tell at shares of states after shaping, shape (N, S, 10); the time [s]."""
    times, pressures, shaped, _ = commanded(table)
    ends = np.array([table.times[table.states == state].max() for state in range(2 * table.columns + 1)])
    main, length = ends[table.columns + 1 :], table.durations.get("main", 0.0)
    edges = np.concatenate([ends[: table.columns + 1], *(main + loop * length for loop in range(table.loops))])
    moments = edges[:-1, None] + shares * np.diff(edges)[:, None]
    lines = np.column_stack([np.interp(moments.ravel(), times, line) for line in pressures.T])
    levels = table.line_map.simulated(lines)[1].T
    return levels.reshape(*moments.shape, -1), float(edges[-1] - shaped)
