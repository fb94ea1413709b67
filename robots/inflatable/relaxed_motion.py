"""How bladders move when they are told to inflate by parts.

A bladder told u goes towards the thickness empty + u (full - empty) at the rate of the published robot, and shortens
its last step so that it arrives exactly. Empty and full are where full strokes of the published rule end; where u is 0
or 1 and the stroke is full, the published rule counts its steps. As published, a bladder at or below ``deflated`` is
not deflated further.
"""

from dataclasses import dataclass, replace

import numpy as np

from robots.inflatable.actuation import (
    ACTUATION,
    PUBLISHED_COLUMNS,
    Column,
    InflatableActuation,
    nominal_steps,
    play,
    stroke,
)
from robots.inflatable.body import BLADDER_COUNT
from robots.inflatable.relaxed_schedule import RelaxedSchedule
from taichi_sim.autodiff.dual import Dual, Real, value_of, where
from taichi_sim.base.arrays import Bools, Floats, Ints

ROUNDING = 1e-6  # of a step: more than a sum of thousands of steps is off
MOST_COLUMNS = 2000  # that are played to fill time; shorter ones hardly move, and programs of more grow long


@dataclass(frozen=True, eq=False)
class Approach:
    """How bladders go from one thickness to another, shape (8,) each; see ``Column``."""

    ends: Dual
    direction: Floats
    moving: Ints
    arrival: Dual
    arrives: Bools


def rest_levels(actuation: InflatableActuation) -> tuple[float, float]:
    """Thickness of an empty and of a full bladder: 0.1997 and 2.5001, the ends of full strokes, as published."""
    _, full = stroke(actuation, actuation.deflated, True)
    return stroke(actuation, full, False)[1], full


def full_stroke_steps(actuation: InflatableActuation) -> int:
    """Steps of the longer of the two full strokes, up and down."""
    empty, full = rest_levels(actuation)
    return max(stroke(actuation, empty, True)[0], stroke(actuation, full, False)[0])


def approach(levels: Real, told: Dual, actuation: InflatableActuation) -> Approach:
    """The motion of bladders of these thicknesses, told to inflate by 0 to 1, shape (8,) each."""
    empty, full = rest_levels(actuation)
    rate = actuation.inflation_rate
    target = (1.0 - told) * empty + told * full
    now = value_of(levels)
    gap = np.where(np.abs(target.value - now) < ROUNDING * rate, 0.0, target.value - now)
    stays = np.where(now == actuation.deflated, gap <= 0, (gap < 0) & (now < actuation.deflated))
    direction = np.where(stays, 0.0, np.sign(gap))
    time = direction * (target - levels) / rate
    moving = np.floor(time.value).astype(np.int64)
    arrival, ends = (time - moving.astype(float)).value, np.where(stays, now, target.value)
    for i in np.flatnonzero(_strokes(now, told.value, actuation)):
        (moving[i], ends[i]), arrival[i] = stroke(actuation, float(now[i]), bool(told.value[i])), 0.0
    end_slopes = where(stays, levels, target)
    assert isinstance(end_slopes, Dual)
    return Approach(Dual(ends, end_slopes.slope), direction, moving, Dual(arrival, time.slope), ~stays)


def _strokes(levels: Floats, told: Floats, a: InflatableActuation) -> Bools:
    """Which bladders do what the published rule says: those empty or full, and told 0 or 1."""
    rests = np.array([*rest_levels(a), a.deflated])
    resting = (np.abs(levels[:, None] - rests) < ROUNDING * a.inflation_rate).any(axis=1)
    decided: Bools = (told == 0) | (told == 1)
    return resting & decided


def play_relaxed(
    inflation: Dual,
    grip: Dual,
    pressures: Dual | None,
    pressure: Dual,
    gait: RelaxedSchedule,
    a: InflatableActuation,
    levels: Real | None = None,
) -> tuple[list[Column], int]:
    """The columns of a relaxed gait in the order played, and the steps of the whole gait.

    Args:
        inflation: of the bladders, shape (8, T).
        grip: of the feet, shape (2, T).
        pressures: of the core at the end of each column's motion [Pa], shape (T,); None to keep that of the design.
        pressure: of the core before the gait [Pa], shape ().
        gait: says how long columns last.
        a: rates and times.
        levels: thickness of the bladders before the gait, shape (8,); those of a new robot by default.
    """
    columns, step = [], 0
    levels = np.full(BLADDER_COUNT, a.deflated) if levels is None else levels
    for number, (least, settle) in enumerate(durations(gait, a)):
        t = number % gait.columns
        motion = approach(levels, inflation[:, t], a)
        after = pressure if pressures is None else pressures[t]
        column = Column(
            start=step,
            motion_steps=max(least, int(motion.moving.max()) + 1),
            inflation=inflation[:, t],
            grip=grip[:, t],
            levels=levels,
            ends=motion.ends,
            direction=motion.direction,
            moving=motion.moving,
            arrives=motion.arrives,
            lands=np.ones(BLADDER_COUNT, bool),
            arrival=motion.arrival,
            pressures=None if pressures is None else (pressure, after),
        )
        columns.append(column)
        levels, pressure, step = motion.ends, after, step + column.motion_steps + settle
    return columns, step


def durations(gait: RelaxedSchedule, a: InflatableActuation) -> list[tuple[int, int]]:
    """Least steps of motion and steps of settling of every column played.

    Where the gait has no times of its own, columns last as long as those of the published gait that is on where this
    one is at least 1/2. A column in which that moves no bladder lasts as long as a full stroke: unlike there, bladders
    may move in it.
    """
    if gait.motion_steps is None:
        published = play(gait.decided(), a)[0]
        least = [c.motion_steps if c.moving.any() else full_stroke_steps(a) + 1 for c in published]
    else:
        least = gait.motion_steps.tolist() * gait.repeats
    settle = [a.settle_steps] * gait.columns if gait.settle_steps is None else gait.settle_steps.tolist()
    return list(zip(least, settle * gait.repeats, strict=True))


def relaxed_columns(gait: RelaxedSchedule, a: InflatableActuation = ACTUATION) -> tuple[list[Column], int]:
    """The columns of a gait in the order played, without what its core pressure does, and the steps of all; cheap."""
    inflation, grip = (Dual(levels, np.zeros((*levels.shape, 0))) for levels in (gait.inflation, gait.grip))
    return play_relaxed(inflation, grip, None, Dual(np.zeros(()), np.zeros(0)), gait, a)


def gait_steps(gait: RelaxedSchedule, a: InflatableActuation = ACTUATION) -> int:
    """Time steps of a gait; cheap."""
    return relaxed_columns(gait, a)[1]


def cycle_starts(gait: RelaxedSchedule, a: InflatableActuation = ACTUATION) -> list[int]:
    """Steps of a gait at which it begins its columns anew; cheap."""
    return [column.start for column in relaxed_columns(gait, a)[0][:: gait.columns]]


def stage_starts(cycles: list[int], steps: int, warm_up: int, stages: int) -> list[int]:
    """Steps of a gait at which the stages that count begin.

    After a warm-up whole cycles count, of which every stage has as many: else a stroke forward counts that is not
    taken back. Where there are too few cycles, and without a warm-up, stages are equally long in time.

    Args:
        cycles: steps at which cycles begin.
        steps: of the gait.
        warm_up: that do not count; the cycle in which they end does not, either.
        stages: how many.
    """
    later = [start for start in cycles if start >= warm_up] if warm_up else []
    if each := len(later) // stages:
        return later[len(later) - each * stages :: each]
    first = later[0] if later else warm_up
    return [first + (steps - first) * part // stages for part in range(stages)]


def most_repeats(gait: RelaxedSchedule, steps: int, a: InflatableActuation = ACTUATION) -> int:
    """How often a gait's columns can be played in so many time steps, at least once; ``MOST_COLUMNS`` at most."""
    lengths = [gait_steps(replace(gait, repeats=count), a) for count in (1, 2, 3)]
    if lengths[1] > steps:
        return 1
    count = min(2 + (steps - lengths[1]) // (lengths[2] - lengths[1]), max(MOST_COLUMNS // gait.columns, 1))
    while count > 1 and gait_steps(replace(gait, repeats=count), a) > steps:  # strokes are rounded to whole steps
        count -= 1
    return count


def nominal_gait_steps(gait: RelaxedSchedule, steps: int, a: InflatableActuation = ACTUATION) -> int:
    """Steps that the speed of a gait of so many ``steps`` is counted by.

    Those of as many published columns. With times of its own, those of 16 published columns, or its own if it takes
    longer: it is not faster for that.
    """
    if not gait.timed:
        return nominal_steps(gait.columns * gait.repeats, a)
    return max(nominal_steps(PUBLISHED_COLUMNS, a), steps)
