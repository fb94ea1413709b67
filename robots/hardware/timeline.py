"""What the lines of a rig are told, state by state, and when, within its limits.

A state is what all lines are told at once. It lasts until its slowest changing channel is done: its valve's delay and
its stroke (Powers 2021 dissertation, ch. 5: bladders inflate at different rates); then it dwells, if it shall.

Bladders burst when overdriven (Powers 2021, ch. 5), so what exceeds a limit of the rig is named, refused, or clipped.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np

from robots.hardware.rig import ROUNDING, PneumaticRig
from robots.hardware.rig_table import State, section_of
from robots.hardware.units import KPA_PER_UNIT, UNIT_SPELLING
from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import choice, number, whole_number

POLICIES = ("refuse", "clip")
SLOWEST_RATE, FASTEST_RATE = 0.1, 1000.0  # rows per second
_CLOSEST = 6  # decimals of a time [s] that tell corners apart


class Asked(NamedTuple):
    """How a table shall be written, checked.

    Attributes:
        rig: that plays it.
        units: of its pressures.
        clips: whether what exceeds the rig's limits is cut; else it is refused.
        seed: of the search that found what is played, for the header; None if there was none.
    """

    rig: PneumaticRig
    units: str
    clips: bool
    seed: int | None


def asked(
    rig: PneumaticRig | None, units: str | None, rate: float | None, on_violation: str, seed: int | None
) -> Asked:
    """Check how a table shall be written: a rig of the dissertation and the rig's units, where none are given.

    Raises:
        ValueError: for what is not allowed.
    """
    choice("on_violation", on_violation, POLICIES)
    rig = PneumaticRig() if rig is None else rig
    if not isinstance(rig, PneumaticRig):
        raise ValueError(f"rig: {rig!r} is not allowed; give a PneumaticRig, such as PneumaticRig.load('dissertation')")
    units = choice("units", rig.units if units is None else units, KPA_PER_UNIT)
    if rate is not None:
        number("rate", rate, SLOWEST_RATE, FASTEST_RATE, "Hz")
    seed = None if seed is None else whole_number("seed", seed, 0)
    return Asked(rig, units, on_violation == "clip", seed)


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

    def rates(self, rig: PneumaticRig) -> Floats:
        """How fast pressures change as the rig's times tell [kPa/s], shape (S, L); free of the rounding of rows."""
        return np.abs(self.targets - self.before) / self.strokes(rig, keep_slew=False)


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
    """A limit of a rig that a gait exceeds at one time.

    Attributes:
        channel: name of the rig's channel.
        time_s: when the command passes the limit of pressure, or begins to change too fast [s].
        value: value that the gait needs, in ``unit``.
        limit: limit of the rig, in the same unit.
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
    """Error of a gait that exceeds limits of the rig; its message is one line.

    Attributes:
        violations: all limits that are exceeded, in order of time.
        advice: what the rig can play instead.
    """

    def __init__(self, violations: Sequence[Violation], slower: str = "") -> None:
        """Refuse a gait for at least one violation; ``slower`` says how slow the rig could play it, if that helps."""
        self.violations = tuple(violations)
        more = len(self.violations) - 1
        self.advice = f"{slower}, or " if slower else ""
        self.advice += "--on-violation clip keeps the limits"
        told = f"{self.violations[0]}" + (f" ({more} more; a dry run names all)" if more else "")
        super().__init__(f"{told}; {self.advice}")


def violations(commands: Commands, states: Sequence[State], rig: PneumaticRig) -> list[Violation]:
    """What commands would exceed the rig's limits, in order of time.

    Args:
        commands: for the states.
        states: when they are, with strokes as fast as the rig's times tell.
        rig: with the limits.
    """
    found: list[Violation] = []
    unit, factor = UNIT_SPELLING[rig.units], KPA_PER_UNIT[rig.units]
    before, rates = commands.before, commands.rates(rig)
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
