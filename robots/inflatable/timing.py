"""When the inflatable robot does what: strokes of its bladders, columns in time, and the steps by which speeds count.

A bladder told a level u goes towards the thickness empty + u (full - empty) at the rate of the published robot, or at
a part of it, its pace, and shortens its last step so that it arrives exactly. Empty and full are where full strokes of
the published rule end; where u is 0 or 1 and the stroke is full, the published rule counts its steps. As published, a
bladder at or below ``deflated`` is not deflated further.

Source: Powers 2021 dissertation, ch. 5, "Simulation environment" and "Optimization", as the experiment ran it.
"""

import math
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Annotated

import numpy as np

from robots.inflatable.actuation import ACTUATION, PUBLISHED_COLUMNS, InflatableActuation
from robots.inflatable.body import BLADDER_COUNT
from robots.inflatable.design import InflatableDesign, highest_pressure
from robots.inflatable.schedule import BLADDERS, ROWS, GaitSchedule
from taichi_sim.autodiff.arrays import Array, TracedArray, revalued, value_of
from taichi_sim.base.arrays import Bools, Floats, Ints
from taichi_sim.base.checks import check_fields, whole_number

ROUNDING = 1e-6  # of a step: more than a sum of thousands of steps is off
MOST_COLUMNS = 2000  # that are played to fill time; shorter ones hardly move, and programs of more grow long


@dataclass(frozen=True)
class Counting:
    """Settings of how the distance of a gait is counted: after a warm-up, in stages, and over a window.

    Attributes:
        warm_up: time steps of the gait before its distance begins to count, and the rest of the cycle in which they
            end.
        stages: number of equally long parts whose distances are measured, see :func:`stage_starts`.
        window: cycles at the end of a gait by which its distance is differentiated, all if it has fewer; 0 is all that
            counts, see ``differentiate``.

    Raises:
        ValueError: for a number that is not allowed.
    """

    warm_up: Annotated[int, partial(whole_number, low=0)] = 0
    stages: Annotated[int, partial(whole_number, low=1)] = 1
    window: Annotated[int, partial(whole_number, low=0)] = 0

    def __post_init__(self) -> None:
        check_fields(self)


WHOLE = Counting()


@lru_cache(maxsize=4096)
def stroke(actuation: InflatableActuation, level: float, inflate: bool) -> tuple[int, float]:
    """Steps that a bladder of this thickness still changes when told to inflate or deflate, and its last thickness.

    Counted by repeated addition, as the experiment did: rounding decides between 7667 and 7668 steps.
    """
    if (level >= actuation.inflated) if inflate else (level <= actuation.deflated):
        return 0, level
    rate = actuation.inflation_rate if inflate else -actuation.inflation_rate
    span = actuation.inflated - level if inflate else level - actuation.deflated
    path = np.full(math.ceil(span / actuation.inflation_rate) + 3, rate)
    path[0] = level
    path = np.add.accumulate(path)
    steps = int(np.argmax(path >= actuation.inflated if inflate else path <= actuation.deflated))
    return steps, float(path[steps])


@lru_cache(maxsize=256)
def rest_levels(actuation: InflatableActuation) -> tuple[float, float]:
    """Thickness of an empty and of a full bladder: 0.1997 and 2.5001, the ends of full strokes, as published."""
    _, full = stroke(actuation, actuation.deflated, True)
    return stroke(actuation, full, False)[1], full


def full_stroke_steps(actuation: InflatableActuation) -> int:
    """Steps of the longer of the two full strokes, up and down."""
    empty, full = rest_levels(actuation)
    return max(stroke(actuation, empty, True)[0], stroke(actuation, full, False)[0])


@dataclass(frozen=True, eq=False)
class Strokes:
    """How bladders go from one thickness to another, shape (8,) each. Arrays may be traced to carry derivatives.

    Attributes:
        levels: thickness at the beginning.
        ends: thickness at the end.
        direction: 1 for bladders that grow, -1 for those that shrink, 0 for those that stay.
        moving: steps in which each bladder changes at the full rate.
        arrival: part of a further step that each bladder needs to arrive.
        arrives: bladders that are set to their ``ends`` after that.
        rate: at which bladders change per step, shape (8,), or one for all.
    """

    levels: Array
    ends: Array
    direction: Floats
    moving: Ints
    arrival: Array
    arrives: Bools
    rate: float | Array


@dataclass(frozen=True, eq=False)
class Column:
    """One column of a schedule as it is played: motion, then settling.

    Attributes:
        start: step of the gait at which it begins.
        motion_steps: steps until it settles.
        inflation: what the bladders are told, from 0 (deflate) to 1 (inflate), shape (8,).
        grip: of the feet, from 0 (slide) to 1 (grip), shape (2,).
        motion: of the bladders.
        pressures: of all cores, or of each, shape (N,), when it begins and when it settles [Pa]; None where the
            design's is kept.
    """

    start: int
    motion_steps: int
    inflation: Array
    grip: Array
    motion: Strokes
    pressures: tuple[float | Array, float | Array] | None = None


def approach(
    levels: Array, told: Array, strokes_only: bool, actuation: InflatableActuation, pace: Array | None = None
) -> Strokes:
    """The motion of bladders of a thickness that are told to inflate by 0 to 1, shape (8,) each.

    With ``strokes_only``, all are told 0 or 1 and the published rule counts all steps; it has no ``pace``, which is
    the part of the rate at which each bladder moves.
    """
    empty, full = rest_levels(actuation)
    rate = actuation.inflation_rate if pace is None else pace * actuation.inflation_rate
    target = (1.0 - told) * empty + told * full
    now, goal, wanted = value_of(levels), value_of(target), value_of(told)
    gap = np.where(np.abs(goal - now) < ROUNDING * value_of(rate), 0.0, goal - now)
    stays = np.where(now == actuation.deflated, gap <= 0, (gap < 0) & (now < actuation.deflated))
    direction = np.where(stays, 0.0, np.sign(gap))
    time = direction * (target - levels) / rate
    moving = np.floor(value_of(time)).astype(np.int64)
    arrival, ends = value_of(time) - moving.astype(float), np.where(stays, now, goal)
    counted = np.full(BLADDER_COUNT, True) if strokes_only else _are_strokes(now, wanted, actuation)
    if pace is not None:
        counted &= value_of(pace) == 1
    for i in np.flatnonzero(counted):
        (moving[i], ends[i]), arrival[i] = stroke(actuation, float(now[i]), bool(wanted[i])), 0.0
    last = revalued(np.where(stays, levels, target), ends)
    return Strokes(levels, last, direction, moving, revalued(time, arrival), ~stays, rate)


def _are_strokes(levels: Floats, told: Floats, a: InflatableActuation) -> Bools:
    """Which bladders do what the published rule says: those empty or full, and told 0 or 1."""
    rests = np.array([*rest_levels(a), a.deflated])
    resting: Bools = (np.abs(levels[:, None] - rests) < ROUNDING * a.inflation_rate).any(axis=1)
    return resting & ((told == 0) | (told == 1))


def play(
    schedule: GaitSchedule,
    actuation: InflatableActuation = ACTUATION,
    *,
    targets: Array | None = None,
    core: tuple[float | Array, Array] | None = None,
    pace: Array | None = None,
    levels: Array | None = None,
) -> tuple[list[Column], int]:
    """The columns of a schedule in the order played, and the steps of the whole gait.

    Args:
        schedule: what is played.
        actuation: rates and times.
        targets: the levels of the schedule as numbers with derivatives, shape (10, T).
        core: pressure before the gait, shape (), and at the end of each column's motion, shape (T,) [Pa]; of several
            cores (N,) and (N, T); None keeps that of the design.
        pace: that of the schedule as numbers with derivatives, shape (8, T).
        levels: thickness of the bladders before the gait, shape (8,); those of a new robot by default.
    """
    columns, step = [], 0
    targets = schedule.levels if targets is None else targets
    pace = schedule.pace if pace is None else pace
    levels = np.full(BLADDER_COUNT, actuation.deflated) if levels is None else levels
    pressure = None if core is None else core[0]
    plain = not any(isinstance(each, TracedArray) for each in (targets, pace, levels))
    known = dict[tuple[int, bytes], Strokes]()  # cycles soon repeat
    for number, (least, settle) in enumerate(durations(schedule, actuation)):
        t = number % schedule.columns
        own = None if pace is None else pace[:, t]
        motion = known.get((t, value_of(levels).tobytes())) if plain else None
        if motion is None:
            motion = approach(levels, targets[:BLADDERS, t], schedule.skip_idle, actuation, own)
            if plain:
                known[t, value_of(levels).tobytes()] = motion
        after = None if core is None else core[1][..., t]
        column = Column(
            start=step,
            # A bladder is found done in a step in which it no longer changes, and that step is run too.
            motion_steps=max(least, int(motion.moving.max()) + 1),
            inflation=targets[:BLADDERS, t],
            grip=targets[BLADDERS:, t],
            motion=motion,
            pressures=None if pressure is None or after is None else (pressure, after),
        )
        columns.append(column)
        levels, pressure, step = motion.ends, after, step + column.motion_steps + settle
    return columns, step


def durations(schedule: GaitSchedule, a: InflatableActuation) -> list[tuple[int, int]]:
    """Least steps of motion, and steps of settling, of every column played.

    Without times of their own, columns last as long as their strokes if the schedule skips idle columns. Else they last
    as long as those of the schedule that is on where this one is at least 1/2, and as long as a full stroke where that
    moves no bladder: unlike there, bladders may move.
    """
    count = schedule.columns * schedule.repeats
    if schedule.motion_steps is not None:
        least = schedule.motion_steps.tolist() * schedule.repeats
    elif schedule.skip_idle:
        least = [1] * count
    else:
        published = play(schedule.decided(), a)[0]
        least = [c.motion_steps if c.motion.moving.any() else full_stroke_steps(a) + 1 for c in published]
    if schedule.settle_steps is None:
        settle = [a.settle_steps] * count
    else:
        settle = schedule.settle_steps.tolist() * schedule.repeats
    return list(zip(least, settle, strict=True))


@dataclass(frozen=True, eq=False)
class GaitTimeline:
    """When a gait does what: its columns in the order played, N of them.

    Attributes:
        edges: time steps at which columns begin, and at which the last ends, shape (N + 1,).
        settles: time steps at which the motion of columns ends, shape (N,).
        levels: that bladders and feet are told, from 0 (off) to 1 (on), shape (10, N).
        pressures: of the core when columns begin, and when the last ends [Pa], shape (N + 1,); it changes linearly
            until the motion ends. Of a design with several, those of its cores, shape (N + 1, cores).
    """

    edges: Ints
    settles: Ints
    levels: Floats
    pressures: Floats

    @property
    def steps(self) -> int:
        """Time steps of the whole gait."""
        return int(self.edges[-1])


def gait_timeline(design: InflatableDesign, actuation: InflatableActuation = ACTUATION) -> GaitTimeline:
    """When a gait does what; cheap."""
    gait = design.schedule
    columns, steps = play(gait, actuation)
    before, after = np.array(design.pressure), gait.core_pressure
    if after is None:
        after = np.repeat(before[None], gait.columns, axis=0)
    elif after.ndim == 2:
        before, after = np.broadcast_to(before, len(after)), after.T
    return GaitTimeline(
        edges=np.array([*(column.start for column in columns), steps]),
        settles=np.array([column.start + column.motion_steps for column in columns]),
        levels=gait.played,
        pressures=np.concatenate([before[None], *([after] * gait.repeats)]),
    )


def gait_steps(schedule: GaitSchedule, actuation: InflatableActuation = ACTUATION) -> int:
    """Time steps of a gait, without those of the initialisation; cheap."""
    return play(schedule, actuation)[1]


def predicted_steps(design: InflatableDesign, actuation: InflatableActuation = ACTUATION) -> int:
    """Count the time steps of simulating a design, initialisation included, without simulating it."""
    return actuation.initial_steps(highest_pressure(design.pressure)) + gait_steps(design.schedule, actuation)


@lru_cache(maxsize=256)
def nominal_steps(columns: int, actuation: InflatableActuation = ACTUATION) -> int:
    """Steps of a gait in which every column moves a full stroke: 186,719 for the published 16 columns."""
    alternating = np.zeros((ROWS, columns), bool)
    alternating[0, ::2] = True
    return gait_steps(GaitSchedule(alternating, repeats=1), actuation)


def counted_steps(schedule: GaitSchedule, actuation: InflatableActuation = ACTUATION) -> int:
    """Time steps by which ``InflatableResult.speed`` counts the speed of a gait; cheap.

    Those of as many published columns, or with times of its own those of 16 published columns. With times or paces of
    its own, the gait's own steps if these are more.
    """
    columns = PUBLISHED_COLUMNS if schedule.has_own_times else schedule.columns * schedule.repeats
    nominal = nominal_steps(columns, actuation)
    if schedule.has_own_times or schedule.pace is not None:
        return max(nominal, gait_steps(schedule, actuation))
    return nominal


def cycle_starts(schedule: GaitSchedule, actuation: InflatableActuation = ACTUATION) -> list[int]:
    """Steps of a gait at which it begins its columns anew; cheap."""
    return [column.start for column in play(schedule, actuation)[0][:: schedule.columns]]


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


def most_repeats(schedule: GaitSchedule, steps: int, actuation: InflatableActuation = ACTUATION) -> int:
    """How often a gait's columns can be played in so many time steps, at least once; ``MOST_COLUMNS`` at most."""
    most = max(MOST_COLUMNS // schedule.columns, 1)
    ends = _cycle_ends(replace(schedule, repeats=min(3, most)), actuation)
    if most > 3 and ends[1] <= steps:
        count = min(2 + (steps - ends[1]) // (ends[2] - ends[1]), most)
        ends = _cycle_ends(replace(schedule, repeats=count), actuation)
    return max(sum(end <= steps for end in ends), 1)  # strokes are whole steps, so the last cycle may not fit


def _cycle_ends(schedule: GaitSchedule, actuation: InflatableActuation) -> list[int]:
    """Steps of a gait at which its first, second, ... cycle ends."""
    columns, steps = play(schedule, actuation)
    return [*(column.start for column in columns[schedule.columns :: schedule.columns]), steps]
