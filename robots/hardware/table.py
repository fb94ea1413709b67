"""Gaits as tables of line pressures over time, and what such a table plays."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from robots.checks import number, whole_number
from robots.hardware.limits import POLICIES, RigViolation, violations
from robots.hardware.line_map import Array, LineMap
from robots.hardware.rig import CHANNELS, KPA_PER_UNIT, PneumaticRig
from robots.hardware.timeline import State, section_of, timeline
from robots.schedule import BLADDERS, ROWS, GaitSchedule

FASTEST_RATE = 1000.0  # rows per second


class Design(Protocol):
    """What is needed of a design: pressure [Pa], orientation [degrees], schedule."""

    @property
    def pressure(self) -> float: ...  # noqa: D102
    @property
    def orientation(self) -> float: ...  # noqa: D102
    @property
    def schedule(self) -> GaitSchedule: ...  # noqa: D102


@dataclass(frozen=True)
class PlayedDesign:
    """A design as a table knows it.

    Attributes:
        pressure: simulated, of the core [Pa].
        orientation: [degrees].
        schedule: of the actuators.
    """

    pressure: float
    orientation: float
    schedule: GaitSchedule


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

    times: Array
    states: np.ndarray
    pressures: Array
    units: str
    design: PlayedDesign
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

    def played(self) -> PlayedDesign:
        """What the rows play, by the inverse of the map, whatever the header says of the design.

        The orientation is the header's: lines know nothing of it.

        Raises:
            ValueError: in one line, when the rows play no schedule.
        """
        last = np.append(np.flatnonzero(np.diff(self.states)), len(self.states) - 1)
        lines = self.pressures[last] * KPA_PER_UNIT[self.units]
        core, bits = self.line_map.simulated(lines[:-1])  # the last state vents
        if np.ptp(core) > 0:
            raise ValueError(f"core: {core.min():g} to {core.max():g} Pa are not allowed; a gait has one core pressure")
        first, second = np.array_split(bits[:, 1:], 2, axis=1)
        if not np.array_equal(first, second):
            raise ValueError("gait table: the columns of its prefix differ from those of its main")
        return PlayedDesign(float(core[0]), self.design.orientation, GaitSchedule(second, self.loops + 1))


def design_hash(design: Design) -> str:
    """A short fingerprint of a robot's design, equal for equal designs on every machine."""
    schedule = design.schedule
    content = [float(design.pressure), float(design.orientation), schedule.to_text(), schedule.repeats]
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()[:16]


def gait_table(
    design: Design,
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
        design: pressure [Pa], orientation [degrees] and schedule.
        rig: the dissertation's if None.
        units: ``"kpa"`` or ``"psi"``.
        rate: rows per second, and states last whole samples; None: rows at the corners of the pressures.
        on_violation: of the rig's limits: ``"refuse"``, or ``"clip"``: pressures stop at limits, and strokes take as
            long as the limit of rate asks.
        seed: of the search that found the design, for the header.

    Raises:
        RigViolation: a ValueError in one line, when a pressure or a rate exceeds the rig's limits and is not clipped.
        ValueError: in one line, for any other value that is not allowed.
    """
    for name, value, known in (("units", units, tuple(KPA_PER_UNIT)), ("on_violation", on_violation, POLICIES)):
        if value not in known:
            raise ValueError(f"{name}: {value!r} is unknown; give one of {', '.join(known)}")
    rig = PneumaticRig() if rig is None else rig
    if rate is not None and number("rate", rate, 0.0, FASTEST_RATE, "Hz") == 0:
        raise ValueError("rate: 0 is not allowed; it must be positive")
    seed = None if seed is None else whole_number("seed", seed, 0)
    pressure = number("pressure", design.pressure, 0.0, unit="Pa")
    columns = design.schedule.columns
    targets = state_targets(design.schedule, pressure, rig.line_map)
    line_map, clip = rig.line_map, on_violation == "clip"
    found = violations(targets, timeline(targets, columns, rig).states, rig)
    if found and not clip:
        raise RigViolation(found)
    if found:
        low, high = np.array([(channel.minimum_kpa, channel.maximum_kpa) for channel in rig.channels]).T
        line_map, targets = line_map.within(low[1:], high[1:]), np.clip(targets, low, high)
    line = timeline(targets, columns, rig, rate, keep_slew=clip)
    return GaitTable(
        line.times, line.numbers, line.pressures / KPA_PER_UNIT[units], units,
        PlayedDesign(pressure, float(design.orientation), design.schedule), line_map, seed, rig.name, rate,
        tuple(map(str, found)), line.states,
    )  # fmt: skip


def state_targets(schedule: GaitSchedule, pressure: float, line_map: LineMap) -> Array:
    """Line pressures of the states [kPa], shape (2 T + 2, 11): shaping, the columns twice, venting."""
    shaping = np.arange(ROWS) >= BLADDERS  # the feet grip
    states = line_map.lines(pressure, np.column_stack([shaping, schedule.bits, schedule.bits]))
    return np.vstack([states, np.zeros(states.shape[1])])
