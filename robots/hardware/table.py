"""Gaits as tables of line pressures over time, and what such a table plays."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from robots.hardware.limits import POLICIES, RigViolation, violations
from robots.hardware.line_map import LineMap
from robots.hardware.rig import CHANNELS, KPA_PER_UNIT, PneumaticRig
from robots.hardware.timeline import TIME_STEP, State, commands_of, section_of, timeline
from robots.inflatable.design import InflatableDesign, common_pressure, kilopascals
from robots.inflatable.schedule import ROWS, GaitSchedule
from taichi_sim.base.arrays import Floats, Ints
from taichi_sim.base.checks import choice, number, whole_number

SLOWEST_RATE, FASTEST_RATE = 0.1, 1000.0  # rows per second
ARRIVED = 1e-3  # of a line: how far off it may be [kPa]


@dataclass(frozen=True, eq=False)
class GaitTable:
    """Commands over time, as a rig plays them.

    Attributes:
        times: of the rows [s], shape (N,), with the main played once; between rows pressures change linearly. They
            increase, but a section begins with the row that ends the one before.
        states: numbers of the states that rows belong to, shape (N,): 0 shapes the body, then the columns come
            twice, in prefix and main, then lines are vented.
        pressures: gauge pressures of ``CHANNELS`` in ``units``, shape (N, 11).
        units: ``"kpa"`` or ``"psi"``.
        design: that it was made of, exactly.
        line_map: from simulated to line pressures, as played (after clipping).
        seed: of the search that found the design; None if not known.
        rig: name of the rig.
        rate: rows per second; None for rows at corners.
        clipped: what was clipped, a line each.
        timing: of the states; empty in a table that was read.
    """

    times: Floats
    states: np.ndarray
    pressures: Floats
    units: str
    design: InflatableDesign
    line_map: LineMap
    seed: int | None = None
    rig: str = ""
    rate: float | None = None
    clipped: tuple[str, ...] = ()
    timing: tuple[State, ...] = ()

    channels = CHANNELS

    @property
    def loops(self) -> int:
        """How often the main is played: once less than the columns are, as the prefix plays them too."""
        return self.design.schedule.repeats - 1

    @cached_property
    def sections(self) -> tuple[str, ...]:
        """The section of every row."""
        return tuple(section_of(int(state), self.design.schedule.columns) for state in self.states)

    @property
    def durations(self) -> Mapping[str, float]:
        """Length of each section [s], played once."""
        rows = np.array(self.sections)
        return {name: float(np.ptp(self.times[rows == name])) for name in dict.fromkeys(self.sections)}

    @property
    def seconds(self) -> float:
        """How long the gait takes, with its loops [s]."""
        lengths = self.durations
        return lengths["prefix"] + self.loops * lengths["main"] + lengths["suffix"]

    def schedule(self) -> GaitSchedule:
        """The schedule that the table was made of."""
        return self.design.schedule

    def played(self) -> InflatableDesign:
        """What the rows play, by the inverse of the map.

        The header only says whether the gait is on and off, changes its core pressure and has times of its own, and the
        orientation, of which lines know nothing. Where the gait is on and off, an actuator is on above the middle
        between its two pressures. How long states of a gait with times of its own last after all lines have arrived is
        how long it settles.

        Raises:
            ValueError: if the rows play no schedule.
        """
        last = np.append(np.flatnonzero(np.diff(self.states)), len(self.states) - 1)
        lines = self.pressures[last] * KPA_PER_UNIT[self.units]
        core, levels = self.line_map.simulated(lines[:-1])  # the last state vents
        given = self.design.schedule
        if given.skip_idle:
            levels = np.round(levels)
        if np.ptp(core) > 0 and given.core_pressure is None:
            raise ValueError(f"core: {core.min():g} to {core.max():g} Pa are not allowed; a gait has one core pressure")
        first, second = np.array_split(np.vstack([levels, core])[:, 1:], 2, axis=1)
        if not np.array_equal(first, second):
            raise ValueError("gait table: the columns of its prefix differ from those of its main")
        told = None if given.core_pressure is None else second[ROWS]
        gait = GaitSchedule(second[:ROWS], self.loops + 1, told, skip_idle=given.skip_idle)
        if given.has_own_times:
            moved = np.zeros(gait.columns, int) if told is None else self._steps(slice(0, 1))[:, 0]
            gait = replace(gait, motion_steps=moved, settle_steps=self._steps(slice(None))[:, 1])
        return InflatableDesign(float(core[0]), self.design.orientation, gait)

    def _steps(self, lines: slice) -> Ints:
        """Time steps of each column until some lines have arrived, and from there to its end, shape (T, 2).

        As the main has it, but where that is not played, the prefix.
        """
        pressures, found = self.pressures[:, lines] * KPA_PER_UNIT[self.units], []
        columns = self.design.schedule.columns
        for state in np.arange(1, columns + 1) + (columns if self.loops else 0):
            place = np.flatnonzero(self.states == state)
            begin, end = place[0] - 1, place[-1]
            on_the_way = np.flatnonzero((np.abs(pressures[begin:end] - pressures[end]) > ARRIVED).any(axis=1))
            arrival = begin + (on_the_way[-1] + 1 if on_the_way.size else 0)
            found.append(np.diff(self.times[[begin, arrival, end]]))
        return np.round(np.array(found) / TIME_STEP).astype(int)


def with_one_pressure(design: InflatableDesign) -> InflatableDesign:
    """The design with the one core pressure that the rig's one line for the core stands for.

    Raises:
        ValueError: for a design with several cores that are not alike.
    """
    if (pressure := common_pressure(design.pressure)) is None:
        told = kilopascals(design.pressure)
        raise ValueError(f"pressure: {told} are not allowed; a rig has one line for the core, so give all cores one")
    return InflatableDesign(pressure, design.orientation, design.schedule)


def design_hash(design: InflatableDesign) -> str:
    """A short fingerprint of a robot's design, equal for equal designs on every machine."""
    played, schedule = with_one_pressure(design), design.schedule
    content = [played.pressure, played.orientation, schedule.to_text(), schedule.repeats]
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()[:16]


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
        design: pressure [Pa], the same of all cores, orientation [degrees] and schedule.
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
    design = with_one_pressure(design)
    line_map, clip = rig.line_map, on_violation == "clip"
    commands = commands_of(design, line_map)
    found = violations(commands, timeline(commands, rig).states, rig)
    if found and not clip:
        raise RigViolation(found)
    if found:
        low, high = np.array([(channel.minimum_kpa, channel.maximum_kpa) for channel in rig.channels]).T
        line_map = line_map.within(low[1:], high[1:])
        commands = commands_of(design, line_map).within(low, high)
    line = timeline(commands, rig, rate, keep_slew=clip)
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
