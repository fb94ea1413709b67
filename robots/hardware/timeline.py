"""What the lines of a rig are told, state by state, and when: pressures over time.

A state is what all lines are told at once. It lasts until its slowest changing channel is done: its valve's delay and
its stroke (Powers 2021 dissertation, ch. 5: bladders inflate at different rates); then it dwells, if it shall. A gait
with the published times leaves time to the rig; one with times of its own dwells as it does in the simulation.

Sections are those of controllers that loop a trajectory: a *prefix* that shapes the body and plays the columns once
from there, a *main* that begins as it ends and can be looped, and a *suffix* that vents the lines.
"""

import math
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from robots.hardware.line_map import LineMap
from robots.hardware.rig import CHANNELS, PneumaticRig
from robots.inflatable.actuation import ACTUATION
from robots.inflatable.body import PUBLISHED
from robots.inflatable.design import InflatableDesign
from robots.inflatable.schedule import BLADDERS, ROWS
from robots.inflatable.timing import durations
from taichi_sim.base.arrays import Floats

TIME_STEP = PUBLISHED.time_step  # in which gaits count their times [s]
SECTIONS = ("prefix", "main", "suffix")
_CLOSEST = 6  # decimals of a time [s] that tell corners apart


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
        """Number of columns of the schedule."""
        return len(self.targets) // 2 - 1

    @property
    def before(self) -> Floats:
        """Pressures with which states begin [kPa], shape (S, 11); all lines start vented."""
        return np.vstack([np.zeros(len(CHANNELS)), self.targets[:-1]])

    def within(self, low: Floats, high: Floats) -> Self:
        """The same with pressures cut to limits [kPa], shape (11,) each."""
        return replace(self, targets=np.clip(self.targets, low, high))

    def strokes(self, rig: PneumaticRig, keep_slew: bool) -> Floats:
        """How long lines take to their targets; with ``keep_slew`` not faster than their limits [s], shape (S, 11)."""
        rise, fall, slew = np.array([(c.rise_s, c.fall_s, c.slew_kpa_per_s) for c in rig.channels]).T
        times = np.where(self.targets > self.before, rise, fall) * self.portions
        return np.maximum(times, np.abs(self.targets - self.before) / slew) if keep_slew else times


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


@dataclass(frozen=True)
class State:
    """One state in time.

    Attributes:
        number: counted from 0, the shaping of the body.
        section: one of ``SECTIONS``.
        start_s: of the state [s], with the main played once.
        end_s: [s].
        slowest: the channel that it waits for; empty if nothing changes.
        changes: channels that change.
    """

    number: int
    section: str
    start_s: float
    end_s: float
    slowest: str
    changes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Timeline:
    """Commands over time.

    Attributes:
        states: in order.
        times: of the rows [s], shape (N,); increasing, but for the first row of a section, which is the last of the
            section before.
        numbers: of the states that rows belong to, shape (N,).
        pressures: [kPa], shape (N, 11).
    """

    states: tuple[State, ...]
    times: Floats
    numbers: np.ndarray
    pressures: Floats


def section_of(state: int, columns: int) -> str:
    """The section of a state: shaping and the first pass, the second pass, venting."""
    return SECTIONS[0] if state <= columns else SECTIONS[1] if state <= 2 * columns else SECTIONS[2]


def timeline(commands: Commands, rig: PneumaticRig, rate: float | None = None, keep_slew: bool = False) -> Timeline:
    """Go from vented lines to one row of targets after the other.

    Args:
        commands: for the states.
        rig: gives the times.
        rate: rows per second; states then last whole samples. None: rows at the corners, which straight lines join.
        keep_slew: slow strokes down that are faster than the rig allows.
    """
    delays = np.array([channel.valve_delay_s for channel in rig.channels])
    strokes, ticks, start = commands.strokes(rig, keep_slew), 0, 0.0
    states: list[State] = []
    times, numbers, rows = [0.0], [0], [commands.before[0]]
    for number, (before, target, stroke) in enumerate(zip(commands.before, commands.targets, strokes, strict=True)):
        section = section_of(number, commands.columns)
        if states and section != states[-1].section:
            times, numbers, rows = [*times, start], [*numbers, number], [*rows, before]
        changing = np.flatnonzero(target != before)
        done = (delays + stroke)[changing]
        moving, resting = commands.moving_s[number], commands.resting_s[number]
        if changing.size:
            length = max(float(done.max()), moving) + resting
        else:
            length = max(rig.shortest_state_s, moving + resting)
        if rate is None:
            length = max(length, 10.0**-_CLOSEST)
            passed = np.unique(np.round([*stroke[changing], length], _CLOSEST))
            passed = passed[passed > 0]
            moments = start + passed
        else:
            count = max(1, math.ceil(length * rate * (1 - 1e-12)))
            moments = (ticks + np.arange(1, count + 1)) / rate
            passed, ticks = np.arange(1, count + 1) / rate, ticks + count
        times.extend(moments.tolist())
        numbers.extend([number] * len(moments))
        rows.extend(before + (target - before) * np.minimum(passed[:-1, None] / stroke, 1.0))
        rows.append(target)  # free of rounding
        slowest = CHANNELS[changing[np.argmax(done)]] if changing.size else ""
        names = tuple(CHANNELS[index] for index in changing)
        states.append(State(number, section, start, times[-1], slowest, names))
        start = times[-1]
    return Timeline(tuple(states), np.array(times), np.array(numbers), np.array(rows))
