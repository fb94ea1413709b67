"""From a gait to the table of a rig: what its lines are told, state by state, and when, within its limits.

A state is what all lines are told at once. It lasts until its slowest changing channel is done: its valve's delay and
its stroke (Powers 2021 dissertation, ch. 5: bladders inflate at different rates); then it dwells, if it shall. A gait
with the published times leaves time to the rig; one with times of its own dwells as it does in the simulation.

Bladders burst when overdriven (Powers 2021, ch. 5), so what exceeds a limit of the rig is named, refused, or clipped.
"""

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from robots.hardware.line_map import LineMap
from robots.hardware.rig import ROUNDING, PneumaticRig
from robots.hardware.rig_table import State, section_of, write_csv
from robots.hardware.table import TIME_STEP, GaitTable, on_lines
from robots.hardware.units import KPA_PER_UNIT, UNIT_SPELLING
from robots.inflatable.actuation import ACTUATION
from robots.inflatable.design import InflatableDesign
from robots.inflatable.schedule import BLADDERS, ROWS
from robots.inflatable.timing import durations
from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import choice, number, whole_number

POLICIES = ("refuse", "clip")
SLOWEST_RATE, FASTEST_RATE = 0.1, 1000.0  # rows per second
_CLOSEST = 6  # decimals of a time [s] that tell corners apart


@dataclass(frozen=True, eq=False)
class Commands:
    """What all L lines, those of cores first, are told in S states: shaping of the body, the columns twice, venting.

    Attributes:
        targets: pressures [kPa], shape (S, L).
        portions: of the rig's time of a whole stroke that each line takes, shape (S, L): how far an actuator goes
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
        """Pressures with which states begin [kPa], shape (S, L); all lines start vented."""
        return np.vstack([np.zeros(self.targets.shape[1]), self.targets[:-1]])

    def within(self, low: Floats, high: Floats) -> Self:
        """The same with pressures cut to limits [kPa], shape (L,) each."""
        return replace(self, targets=np.clip(self.targets, low, high))

    def strokes(self, rig: PneumaticRig, keep_slew: bool) -> Floats:
        """How long lines take to their targets; with ``keep_slew`` not faster than their limits [s], shape (S, L)."""
        steps = self.targets - self.before
        times = rig.stroke_times(steps) * self.portions
        return np.maximum(times, rig.least_times(steps)) if keep_slew else times


def commands_of(design: InflatableDesign, line_map: LineMap, cores: int = 1) -> Commands:
    """The commands of a gait.

    Args:
        design: with one core pressure, or one for each of several lines.
        cores: lines for them.
        line_map: from simulated to line pressures.
    """
    schedule = design.schedule
    shaping = (np.arange(ROWS) >= BLADDERS).astype(float)  # the feet grip
    levels = np.column_stack([shaping, schedule.levels, schedule.levels])
    core, times = np.empty((cores, levels.shape[1])), np.zeros((schedule.columns, 2))
    core.T[:] = design.pressure
    if schedule.core_pressure is not None:
        core[:, 1:] = np.tile(schedule.core_pressure, 2)
    if schedule.has_own_times:
        times = np.array(durations(schedule, ACTUATION))[: schedule.columns] * TIME_STEP
    states = line_map.lines(core, levels)
    portions = np.ones((len(states) + 1, states.shape[1]))
    ways = np.abs(np.diff(levels, axis=1)).T
    portions[1:-1, cores:] = np.where(ways > 0, ways, 1.0)
    if schedule.pace is not None:  # a stroke takes the longer, the slower it is
        portions[1:-1, cores : cores + BLADDERS] /= np.tile(schedule.pace, 2).T
    moving, resting = np.pad(np.tile(times.T, 2), ((0, 0), (1, 1)))
    return Commands(np.vstack([states, np.zeros(states.shape[1])]), portions, moving, resting)


@dataclass(frozen=True, eq=False)
class Timeline:
    """Commands over time.

    Attributes:
        states: in order.
        times: of the rows [s], shape (N,); increasing, but for the first row of a section, which is the last of the
            section before.
        numbers: of the states that rows belong to, shape (N,).
        pressures: [kPa], shape (N, L).
    """

    states: tuple[State, ...]
    times: Floats
    numbers: np.ndarray
    pressures: Floats


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
    for place, (before, target, stroke) in enumerate(zip(commands.before, commands.targets, strokes, strict=True)):
        section = section_of(place, commands.columns)
        if states and section != states[-1].section:
            times, numbers, rows = [*times, start], [*numbers, place], [*rows, before]
        changing = np.flatnonzero(target != before)
        done = (delays + stroke)[changing]
        moving, resting = commands.moving_s[place], commands.resting_s[place]
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
        numbers.extend([place] * len(moments))
        with np.errstate(over="ignore"):  # of strokes that take next to no time
            rows.extend(before + (target - before) * np.minimum(passed[:-1, None] / stroke, 1.0))
        rows.append(target)  # free of rounding
        slowest = rig.channel_names[changing[np.argmax(done)]] if changing.size else ""
        names = tuple(rig.channel_names[index] for index in changing)
        states.append(State(place, section, start, times[-1], slowest, names))
        start = times[-1]
    return Timeline(tuple(states), np.array(times), np.array(numbers), np.array(rows))


@dataclass(frozen=True)
class Violation:
    """One limit exceeded once.

    Attributes:
        channel: one of the rig's.
        time_s: when the command passes the limit of pressure, or begins to change too fast [s].
        value: asked for, in the unit.
        limit: of the rig, in the same unit.
        unit: the rig's own, ``"kPa"`` or ``"psi"``, of a rate ``"kPa/s"`` or ``"psi/s"``.
    """

    channel: str
    time_s: float
    value: float
    limit: float
    unit: str

    def __str__(self) -> str:
        at = f"{self.value:g} {self.unit} at {self.time_s:g} s"
        return f"{self.channel}: {at} is not allowed; the rig's limit is {self.limit:g} {self.unit}"


class RigViolation(ValueError):
    """A gait exceeds limits of the rig; its text is one line.

    Attributes:
        violations: all of them, in order of time.
    """

    def __init__(self, violations: Sequence[Violation]) -> None:
        """Refuse a gait for at least one violation."""
        self.violations = tuple(violations)
        more = len(self.violations) - 1
        super().__init__(f"{self.violations[0]}" + (f" ({more} more; a dry run names all)" if more else ""))


def violations(commands: Commands, states: Sequence[State], rig: PneumaticRig) -> list[Violation]:
    """What commands would exceed the rig's limits, in order of time.

    Args:
        commands: for the states.
        states: when they are, with strokes as fast as the rig's times tell.
        rig: with the limits.
    """
    found: list[Violation] = []
    unit, factor = UNIT_SPELLING[rig.units], KPA_PER_UNIT[rig.units]
    before, rates = commands.before, np.abs(commands.targets - commands.before) / commands.strokes(rig, False)
    for place, index in np.argwhere(commands.targets != before):
        name, channel, start = rig.channel_names[index], rig.channels[index], states[place].start_s
        first, last, rate = (float(each[place, index]) for each in (before, commands.targets, rates))
        if rate > channel.slew_kpa_per_s * (1 + ROUNDING):
            found.append(Violation(name, start, rate / factor, channel.slew_kpa_per_s / factor, f"{unit}/s"))
        limit = min(max(last, channel.minimum_kpa), channel.maximum_kpa)
        if limit != last:
            inside = channel.minimum_kpa <= first <= channel.maximum_kpa
            passed = abs(limit - first) / rate if inside else 0.0
            found.append(Violation(name, start + passed, last / factor, limit / factor, unit))
    return sorted(found, key=lambda violation: violation.time_s)


def gait_table(
    design: InflatableDesign,
    rig: PneumaticRig | None = None,
    units: str = "kpa",
    *,
    rate: float | None = None,
    on_violation: str = "refuse",
    seed: int | None = None,
) -> GaitTable:
    """The pressures that play a design on a rig, within the rig's limits.

    All lines start vented. The core goes to the line pressure of the design's; a flat body (pressure 0) is drawn flat
    by vacuum. The feet grip meanwhile, as in the simulation's initialisation.

    Args:
        design: pressure [Pa], one for each of the rig's lines for cores where they differ, orientation [degrees] and
            schedule.
        rig: the dissertation's if None.
        units: ``"kpa"`` or ``"psi"``.
        rate: rows per second, and states last whole samples; None: rows at the corners of the pressures.
        on_violation: of the rig's limits: ``"refuse"``, or ``"clip"``: pressures stop at limits, and strokes take as
            long as the limit of rate asks.
        seed: of the search that found the design, for the header.

    Raises:
        RigViolation: a ValueError, if a pressure or a rate exceeds the rig's limits and is not clipped.
        ValueError: for any other value that is not allowed.
    """
    choice("units", units, KPA_PER_UNIT)
    choice("on_violation", on_violation, POLICIES)
    rig = PneumaticRig() if rig is None else rig
    if not isinstance(rig, PneumaticRig):
        raise ValueError(f"rig: {rig!r} is not allowed; give a PneumaticRig, such as PneumaticRig.load('dissertation')")
    if rate is not None:
        number("rate", rate, SLOWEST_RATE, FASTEST_RATE, "Hz")
    seed = None if seed is None else whole_number("seed", seed, 0)
    design = on_lines(design, rig)
    after = design.schedule.core_pressure
    pressures = np.append(design.pressure, [] if after is None else after)
    line_map, clip = rig.line_map.without_unused_ramp(pressures), on_violation == "clip"
    commands = commands_of(design, line_map, rig.cores)
    found = violations(commands, timeline(commands, rig).states, rig)
    if found and not clip:
        raise RigViolation(found)
    if found:
        low, high = rig.pressure_limits
        line_map = line_map.within(low[rig.cores :], high[rig.cores :])
        commands = commands_of(design, line_map, rig.cores).within(low, high)
    line = timeline(commands, rig, rate, keep_slew=clip)
    if found:  # rounding of rows on the way to a limit
        line = replace(line, pressures=np.clip(line.pressures, low, high))
    return GaitTable(
        line.times,
        line.numbers,
        line.pressures / KPA_PER_UNIT[units],
        units,
        design,
        line_map,
        seed,
        rig.name,
        rate,
        tuple(map(str, found)),
        line.states,
    )


def export_csv(
    design: InflatableDesign,
    path: str | os.PathLike[str],
    rig: PneumaticRig | None = None,
    units: str = "kpa",
    *,
    rate: float | None = None,
    on_violation: str = "refuse",
    seed: int | None = None,
) -> GaitTable:
    """Write the gait table of a design as CSV, replacing the file in one step.

    Args:
        design: pressure [Pa], orientation [degrees] and schedule.
        path: of the CSV file.
        rig, units, rate, on_violation, seed: see :func:`robots.hardware.gait_table`.

    Returns:
        The table that was written.

    Raises:
        ValueError: if the rig's limits refuse the gait or the file cannot be written.
    """
    table = gait_table(design, rig, units, rate=rate, on_violation=on_violation, seed=seed)
    write_csv(table, path)
    return table
