"""Pressure tables for robots that repeat a cycle: commands to a rig's lines that play the channels' waves.

A table has the form of a gait table, with a state for each straight piece of a wave: the prefix brings vented lines to
where the cycle begins and plays it once, the main is one cycle, to be looped, and the suffix vents the lines. Channels
are on lines of their names, or on those of bladders in order (``own_lines.lines_of``); lines without a channel stay
vented. Delays of valves shift all of a wave alike, so no state waits for them; where they are not alike, lines play out
of phase, which is warned of.
"""

import json
import math
import os
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from robots.hardware.headroom import RigReport, uses_of
from robots.hardware.lines import channel_lines
from robots.hardware.own_lines import lines_of
from robots.hardware.rig import PneumaticRig
from robots.hardware.rig_table import CHANNELS_SCHEMA as SCHEMA
from robots.hardware.rig_table import (
    LINES,
    RigTable,
    State,
    rate_of,
    rate_text,
    read_content,
    read_table,
    seed_of,
    seed_text,
)
from robots.hardware.timeline import Commands, RigViolation, Violation, asked, timeline, violations
from robots.hardware.units import KPA_PER_UNIT
from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import number, whole_number
from taichi_sim.base.parsing import parse_json
from taichi_sim.base.short_text import counted

_SHORTEST = 1e-6  # of a state [s]
_IN_PHASE = 0.02  # of a cycle: delays of lines may differ by so much without a word
_TIMES = 1e-6  # to which times of rows are rounded [s]


@dataclass(frozen=True)
class PressureScale:
    """The straight line between a quantity and the pressure on its line.

    Attributes:
        low: value of the quantity where the line has ``low_kpa``.
        high: value where it has ``high_kpa``.
        low_kpa: [kPa].
        high_kpa: [kPa].
    """

    low: float
    high: float
    low_kpa: float
    high_kpa: float

    def __post_init__(self) -> None:
        for name in ("low", "high", "low_kpa", "high_kpa"):
            number(name, getattr(self, name))
        if self.low >= self.high or self.low_kpa == self.high_kpa:
            raise ValueError(f"high: {self.low:g} to {self.high:g} is not allowed; it must be above low")

    def kpa(self, values: Floats) -> Floats:
        """Pressures of values."""
        share = (np.asarray(values) - self.low) / (self.high - self.low)
        return self.low_kpa + share * (self.high_kpa - self.low_kpa)

    def values(self, kpa: Floats) -> Floats:
        """Values of pressures."""
        share = (np.asarray(kpa) - self.low_kpa) / (self.high_kpa - self.low_kpa)
        return self.low + share * (self.high - self.low)


@dataclass(frozen=True, eq=False)
class Wave:
    """A periodic course that one line of a rig is to play.

    Attributes:
        name: of the channel.
        values: of its quantity at equal times of a cycle, which straight lines join and close to a ring, shape (N,).
        calibration: from values to pressures.
        about: what else the robot needs to build its channel again, as values that fit JSON.
    """

    name: str
    values: Floats
    calibration: PressureScale
    about: Mapping[str, Any]


@dataclass(frozen=True)
class Rhythm:
    """When waves are played.

    Attributes:
        frequency: cycles per second [Hz].
        loops: how often the main is played, after the cycle of the prefix.
        settling: time in which lines go to where the cycle begins, at least [s].
        nodes: of a cycle.
    """

    frequency: float
    loops: int
    settling: float
    nodes: int


@dataclass(frozen=True, eq=False, repr=False)
class ChannelTable(RigTable):
    """Table of commands to a rig's lines over time, which play the waves of a robot's channels.

    Attributes:
        times, states, pressures, units, rig, rate, clipped, timing: see ``RigTable``.
        robot: name of the robot.
        rhythm: requested timing of the waves; rows are slower where limits of rate were kept.
        waves: requested waves, in the order of channels; in a table that was read, what its rows play.
        seed: seed of the search that found the robot; None if not known.
        own_names: of the lines, if the rig names them itself; else empty.
        played_by: names of the lines that play the waves, in their order.
    """

    times: Floats
    states: np.ndarray
    pressures: Floats
    units: str
    robot: str
    rhythm: Rhythm
    waves: tuple[Wave, ...]
    seed: int | None = None
    rig: str = ""
    rate: float | None = None
    clipped: tuple[str, ...] = ()
    timing: tuple[State, ...] = ()
    own_names: tuple[str, ...] = ()
    played_by: tuple[str, ...] = ()

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of all lines, in the order of their pressures."""
        return self.own_names or super().channels

    @property
    def columns(self) -> int:
        """Number of straight pieces in a cycle."""
        return self.rhythm.nodes

    @property
    def loops(self) -> int:
        """Times that the main section is played: as often as cycles count; the prefix plays the one before them."""
        return self.rhythm.loops

    def header(self) -> list[tuple[str, str]]:
        """Header of the table's file: the rhythm, and the channel and calibration of each line."""
        lines = [
            {"line": line, "channel": wave.name, **asdict(wave.calibration), **wave.about}
            for line, wave in zip(self.played_by, self.waves, strict=True)
        ]
        return [
            ("schema", SCHEMA),
            ("units", self.units),
            ("robot", json.dumps(self.robot)),
            ("seed", seed_text(self.seed)),
            *((name, repr(value)) for name, value in asdict(self.rhythm).items()),
            ("rig", self.rig),
            *([(LINES, ",".join(self.own_names))] if self.own_names else []),
            ("rate_hz", rate_text(self.rate)),
            *(("channel", json.dumps(line)) for line in lines),
            *(("clipped", line) for line in self.clipped),
        ]

    @property
    def played_frequency(self) -> float:
        """Frequency that the rows play [Hz]: the requested one, unless they last longer than rounding explains."""
        length, nodes = self.durations["main"], self.columns
        asked = self.rhythm.frequency
        return asked if abs(length - 1 / asked) <= (nodes + 1) * _TIMES else 1 / length

    def played(self) -> tuple[Wave, ...]:
        """Waves that the rows of the main section play, at equal times, by the inverse of each calibration."""
        rows = np.flatnonzero(np.array(self.sections) == "main")
        times = self.times[rows] - self.times[rows[0]]
        kpa = self.pressures[rows] * KPA_PER_UNIT[self.units]
        if self.played_frequency == self.rhythm.frequency:  # rounded times of states: their ends are the nodes
            ends = np.append(np.flatnonzero(np.diff(self.states[rows])), len(rows) - 1)
            nodes = np.vstack([kpa[:1], kpa[ends[:-1]]])
        else:
            moments = np.arange(self.columns) / self.columns * times[-1]
            nodes = np.column_stack([np.interp(moments, times, line) for line in kpa.T])
        places = map(self.channels.index, self.played_by)
        return tuple(
            replace(wave, values=wave.calibration.values(nodes[:, place]))
            for place, wave in zip(places, self.waves, strict=True)
        )


def channel_table(
    robot: str,
    waves: Sequence[Wave],
    rhythm: Rhythm,
    rig: PneumaticRig | None = None,
    units: str | None = None,
    *,
    rate: float | None = None,
    on_violation: str = "refuse",
    seed: int | None = None,
) -> ChannelTable:
    """The pressures that play waves on a rig, within the rig's limits.

    Args:
        robot: its name.
        waves: of its channels, at most as many as the rig has lines for them.
        rhythm: when they are played.
        rig: the dissertation's if None.
        units: ``"kpa"`` or ``"psi"``; None: those of the rig.
        rate: rows per second, and states last whole samples; None: rows at the nodes of the waves.
        on_violation: of the rig's limits: ``"refuse"``, or ``"clip"``: pressures stop at limits, and a piece of the
            cycle takes as long as the limit of rate asks.
        seed: of the search that found the robot, for the header.

    Raises:
        RigViolation: a ValueError, if a pressure or a rate exceeds the rig's limits and is not clipped.
        ValueError: for any other value that is not allowed.
    """
    rig, units, clip, seed = asked(rig, units, rate, on_violation, seed)
    commands, quick = _commands(waves, rhythm, rig, keep_slew=False), _without_waits(rig)
    found = violations(commands, timeline(commands, quick).states, rig)
    if found and not clip:
        most = _highest_frequency(waves, rhythm, rig, found)
        raise RigViolation(found, f"a frequency of at most {most:.3g} Hz is allowed" if most else "")
    if found:
        commands = _commands(waves, rhythm, rig, keep_slew=True)
    line = timeline(commands, quick, rate)
    told, pressures = tuple(map(str, found)), line.pressures / KPA_PER_UNIT[units]
    table = ChannelTable(line.times, line.numbers, pressures, units, robot, rhythm, tuple(waves), seed, rig.name, rate)
    lines = tuple(each.name for each in lines_of([wave.name for wave in waves], rig.channel_lines))
    table = replace(table, clipped=told, timing=line.states, own_names=rig.own_names, played_by=lines)
    if late := _out_of_phase(table, rig):
        warnings.warn(late, stacklevel=2)
    return table


def _out_of_phase(table: ChannelTable, rig: PneumaticRig) -> str:
    """By how much a rig's valves put the lines of a table out of phase; empty if by next to nothing."""
    delays = {
        name: channel.valve_delay_s
        for name, channel, commands in zip(rig.channel_names, rig.channels, table.pressures.T, strict=True)
        if name in channel_lines(rig.own_names) and np.ptp(commands) > 0
    }
    if not delays:
        return ""
    first, last = min(delays, key=delays.__getitem__), max(delays, key=delays.__getitem__)
    late = delays[last] - delays[first]
    if late <= _IN_PHASE * (cycle := table.durations["main"]):
        return ""
    return (
        f"rig: {last} answers {late:g} s later than {first}, {late / cycle:.3g} cycles, and rows make up for no delay, "
        "so lines are out of phase by as much; give their valves equal delays, or play more slowly"
    )


def _highest_frequency(
    waves: Sequence[Wave], rhythm: Rhythm, rig: PneumaticRig, found: Sequence[Violation]
) -> float | None:
    """The highest frequency at which a rig plays waves [Hz], to three digits; None if it refuses them at any."""
    rates = [each.limit / each.value for each in found if each.unit.endswith("/s")]
    if not rates:
        return None
    exact = rhythm.frequency * min(rates)
    digit = 10.0 ** (math.floor(math.log10(exact)) - 2)
    slower = replace(rhythm, frequency=math.floor(exact / digit) * digit)
    commands = _commands(waves, slower, rig, keep_slew=False)
    refused = violations(commands, timeline(commands, _without_waits(rig)).states, rig)
    return None if refused else slower.frequency


def channel_report(waves: Sequence[Wave], rhythm: Rhythm, rig: PneumaticRig | None = None) -> RigReport:
    """What waves ask of a rig, the dissertation's if None; also of one that refuses them."""
    rig = rig or PneumaticRig()
    commands = _commands(waves, rhythm, rig, keep_slew=False)
    line = timeline(commands, _without_waits(rig))
    lasting = [state.end_s - state.start_s for state in line.states][1 : rhythm.nodes + 1]
    states, playing = rhythm.nodes * (1 + rhythm.loops), sum(lasting) * (1 + rhythm.loops)
    shaping = line.states[0].end_s
    return RigReport(uses_of(commands, line, rig), shaping, playing, states, min(lasting), max(lasting))


def too_few_lines(channels: int, rig: PneumaticRig) -> str:
    """What a rig lacks for so many channels; empty if it has lines for them, of bladders or those that it names."""
    if channels <= (lines := len(rig.channel_lines)):
        return ""
    return f"the rig {rig.name} has {counted(lines, 'line')} for them: let regions share a wave, or give a rig of more"


def read_channels(path: str | os.PathLike[str]) -> ChannelTable:
    """Read a ``ChannelTable`` that ``write_csv`` wrote; its waves are what the rows play.

    Raises:
        ValueError: if the file is damaged; tells what is wrong, and where.
    """
    return read_table(path, _read)


def _read(lines: Sequence[str]) -> ChannelTable:
    content = read_content(lines, SCHEMA, may_name_lines=True)
    header = content.header
    try:
        rhythm = Rhythm(
            number("frequency", float(header["frequency"]), 1e-9),
            whole_number("loops", int(header["loops"]), 0),
            number("settling", float(header["settling"]), 0.0),
            whole_number("nodes", int(header["nodes"]), 1),
        )
        records = [parse_json(value) for name, value in content.pairs if name == "channel"]
        played_by = tuple(record.pop("line") for record in records)
        waves = [_wave(record, rhythm.nodes) for record in records]
        seed, rate, rig = seed_of(header["seed"]), rate_of(header["rate_hz"]), header["rig"]
        robot = str(parse_json(header["robot"]))
    except KeyError as missing:
        raise ValueError(f"{missing.args[0]} is missing in the header") from None
    except (ValueError, TypeError, AttributeError) as error:
        raise ValueError(f"header is damaged ({error})") from None
    known = channel_lines(content.own_names)
    if not 0 < len(waves) <= len(known):
        raise ValueError(f"header is damaged ({len(waves)} channels)")
    for place, line in enumerate(played_by):
        if line not in known or line in played_by[:place]:
            raise ValueError(f"header is damaged (channel {waves[place].name} on line {line!r})")
    times, states, pressures = content.rows(rhythm.nodes)
    table = ChannelTable(times, states, pressures, content.units, robot, rhythm, tuple(waves), seed, rig, rate)
    table = replace(table, clipped=content.clipped, own_names=content.own_names, played_by=played_by)
    return replace(table, waves=table.played())


def _wave(record: dict[str, Any], nodes: int) -> Wave:
    told = dict(record)
    name, calibration = told.pop("channel"), PressureScale(**{field: told.pop(field) for field in _CALIBRATION})
    return Wave(str(name), np.zeros(nodes), calibration, told)


_CALIBRATION = ("low", "high", "low_kpa", "high_kpa")


def _without_waits(rig: PneumaticRig) -> PneumaticRig:
    """The rig with valves that have no delay, so that states last as long as the pieces of waves."""
    channels = tuple(replace(channel, valve_delay_s=0.0) for channel in rig.channels)
    return replace(rig, channels=channels, shortest_state_s=_SHORTEST)


def _commands(waves: Sequence[Wave], rhythm: Rhythm, rig: PneumaticRig, keep_slew: bool) -> Commands:
    """Commands to the lines of a rig: to where the cycle begins, its pieces twice, vented.

    Args:
        waves: of the channels.
        rhythm: when they are played.
        rig: with limits, and with times of whole strokes, which lines take to begin and to vent.
        keep_slew: keep pressures and rates within the limits.
    """
    if why := too_few_lines(len(waves), rig) if waves else "give one at least":
        raise ValueError(f"channels: {len(waves)} are not allowed; {why}")
    if rig.cores > 1:
        raise ValueError(f"rig: {rig.cores} lines for cores are not allowed for channels; give a rig with one")
    ring = np.zeros((rhythm.nodes, len(rig.channels)))
    whole = np.full(len(rig.channels), np.inf)  # change of pressure of a whole stroke, of lines that change
    for line, wave in zip(lines_of([wave.name for wave in waves], rig.channel_lines), waves, strict=True):
        ring[:, line.place] = wave.calibration.kpa(wave.values)
        whole[line.place] = abs(line.on_kpa - line.off_kpa)
    if keep_slew:
        low, high = rig.pressure_limits
        ring = np.clip(ring, low, high)
    cycle = np.roll(ring, -1, axis=0)
    vented = np.zeros((1, len(rig.channels)))
    targets = np.vstack([ring[:1], cycle, cycle, vented])
    steps = np.diff(np.vstack([vented, targets]), axis=0)
    strokes = rig.stroke_times(steps)
    lengths = np.full(len(targets), 1 / (rhythm.frequency * rhythm.nodes))
    # Beginning and venting take the rig's time of a stroke, by the part of it that is gone.
    gentle = (np.abs(steps) / whole * strokes).max(axis=1)
    slowest = rig.least_times(steps).max(axis=1)
    lengths[0], lengths[-1] = max(rhythm.settling, gentle[0], slowest[0]), max(gentle[-1], slowest[-1], _SHORTEST)
    if keep_slew:
        lengths = np.maximum(lengths, slowest)
    lengths = np.maximum(lengths, _SHORTEST)
    return Commands(targets, lengths[:, None] / strokes, lengths, np.zeros(len(targets)))
