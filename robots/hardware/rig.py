"""The pneumatic rig: its lines, with their pressures, rates and delays.

Source: Powers 2021 dissertation, ch. 5, "Transferring to a physical robot" and "Experiments with the physical robot";
Shah, Powers et al., Nature Machine Intelligence 3, 51-59, 2021.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, TypeVar

import numpy as np
import tomli_w

from robots.hardware.line_map import RAMP_PA, LineMap
from robots.hardware.lines import (
    ACTUATORS,
    BLADDER_LINES,
    BLADDERS,
    CHANNELS,
    FEET,
    FOOT_LINES,
    SHARED,
    channel_lines,
    channel_names,
    core_count,
    own_names,
)
from robots.hardware.own_lines import ChannelLine, OwnLines
from robots.hardware.units import (
    KPA_PER_UNIT,
    NotNegativePressure,
    PositivePressure,
    Pressure,
    PressureError,
    Unit,
    Vacuum,
    refused,
)
from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import Positive, check_fields, choice, number, whole_number
from taichi_sim.base.files import read_text, write_text
from taichi_sim.base.parsing import parse_toml
from taichi_sim.base.short_text import ShortText

Described = TypeVar("Described", "Channel", LineMap)
LONGEST_LAG = 3600.0  # [s]
LONGEST_DELAY = 10.0  # of a valve [s]; more is one in milliseconds
IDEAL = "ideal"  # what commands call a rig whose lines have at any time what they are told
ROUNDING = 1e-9  # of a limit, as part of it: what is exactly at a limit survives rounding
MOST_CORES = 7  # lines for cores: as many as the published pouch has room for


@dataclass(frozen=True)
class Channel:
    """One pneumatic line of a rig: its times, limits and response; all pressures are gauge pressures.

    Attributes:
        rise_s: time from off to on [s]; a smaller step is given as long.
        fall_s: time from on to off [s].
        minimum_kpa: lowest pressure allowed [kPa], at most 0, as lines start vented.
        maximum_kpa: highest pressure allowed [kPa], at least 0.
        slew_kpa_per_s: fastest change of pressure allowed [kPa/s].
        valve_delay_s: time from the command until the pressure begins to change [s], at most ``LONGEST_DELAY``.
        lag_s: time constant with which the bladder behind the line follows it, as a first-order system [s]; 0 is none.
            Tables are made without it; ``simulate --table`` plays them with it.
        resolution_kpa: steps in which its regulator takes commands [kPa]; 0 is none. Tables are made without it, too.

    Raises:
        ValueError: for a value that is not allowed.
    """

    rise_s: Positive
    fall_s: Positive
    minimum_kpa: Pressure
    maximum_kpa: Pressure
    slew_kpa_per_s: PositivePressure
    valve_delay_s: Annotated[float, partial(number, low=0.0, high=LONGEST_DELAY, unit="s")] = 0.0
    lag_s: Annotated[float, partial(number, low=0.0, high=LONGEST_LAG, unit="s")] = 0.0
    resolution_kpa: NotNegativePressure = 0.0

    def __post_init__(self) -> None:
        check_fields(self)
        if self.minimum_kpa >= self.maximum_kpa:
            raise refused(
                "minimum_kpa",
                self.minimum_kpa,
                lambda unit: f"it must be below {unit.field('maximum_kpa')}, {unit.text(self.maximum_kpa)}",
            )
        if self.minimum_kpa > 0:
            raise refused("minimum_kpa", self.minimum_kpa, lambda _: "lines are vented, give at most 0")
        if self.maximum_kpa < 0:
            raise refused("maximum_kpa", self.maximum_kpa, lambda _: "lines are vented, give at least 0")


# Published: 50 and -80 kPa on the lines of core and feet; the core takes 11.5 s to become round and 4.7 s to become
# flat. This lab's own, as nothing was published: the times of bladders and feet, and all limits of rate.
_CORE = Channel(11.5, 4.7, -80.0, 50.0, 30.0)
_BLADDER = Channel(2.0, 2.0, 0.0, 20.0, 15.0)
_FOOT = Channel(1.0, 1.0, -80.0, 50.0, 150.0)
_MAP = LineMap(ramp_pa=RAMP_PA)


@dataclass(frozen=True, repr=False)
class PneumaticRig(ShortText):
    """A pneumatic rig, whose lines drive the inflatable robot, or are others with names of their own.

    The defaults are the dissertation's rig.

    Attributes:
        name: name of the rig for people.
        supply_kpa: pressure of the supply, or 0 where vacuum alone drives; no line can exceed it [kPa].
        vacuum_kpa: pressure of the vacuum, negative, or 0 without one; no line can fall below it, nor it below
            that of empty space [kPa].
        channels: in the order of :attr:`channel_names`: core, or several cores, bladders 1 to 8, feet 1 and 2; or those
            of ``lines``.
        shortest_state_s: duration of a state in which nothing changes [s].
        line_map: pressures that lines take for what is simulated of the inflatable robot.
        units: ``"kpa"`` or ``"psi"``, the unit of messages and tables; all fields are in kPa.
        lines: that the rig has in place of core, bladders and feet, for robots of one's own; None for none.

    Raises:
        ValueError: for a value that is not allowed, or pressures of a line beyond supply or vacuum.
    """

    name: str = "dissertation"
    supply_kpa: NotNegativePressure = 50.0
    vacuum_kpa: Vacuum = -80.0
    channels: tuple[Channel, ...] = (_CORE,) + (_BLADDER,) * BLADDERS + (_FOOT,) * FEET
    shortest_state_s: Positive = 0.1
    line_map: LineMap = _MAP
    units: str = field(default="kpa", compare=False)
    lines: OwnLines | None = None

    def __post_init__(self) -> None:
        if not (isinstance(self.name, str) and self.name.isprintable()):
            raise ValueError(f"name: {self.name!r} is not allowed; give a text of one line")
        choice("units", self.units, KPA_PER_UNIT)
        check_fields(self)
        if self.supply_kpa == self.vacuum_kpa:  # both 0
            raise refused("supply_kpa", 0, lambda unit: f"give it or {unit.field('vacuum_kpa')}, as both are 0")
        object.__setattr__(self, "channels", tuple(self.channels))
        given = len(self.channels)
        if self.lines is not None and given != len(self.lines.names):
            raise ValueError(f"channels: {given} are not allowed; give one for each of {len(self.lines.names)} lines")
        if self.cores > MOST_CORES:
            raise ValueError(f"channels: {given} are not allowed; give {len(CHANNELS)} to {ACTUATORS + MOST_CORES}")
        for name, channel in zip(self.channel_names, self.channels, strict=True):
            if channel.maximum_kpa > self.supply_kpa:
                error = refused(
                    "maximum_kpa",
                    channel.maximum_kpa,
                    lambda unit: f"the supply has {unit.text(self.supply_kpa)} {unit.spelling}",
                )
                raise error.of(name)
            if channel.minimum_kpa < self.vacuum_kpa:
                error = refused(
                    "minimum_kpa",
                    channel.minimum_kpa,
                    lambda unit: f"the vacuum has {unit.text(self.vacuum_kpa)} {unit.spelling}",
                )
                raise error.of(name)
        for line in () if self.lines is None else self.lines.channel_lines:
            _check_within(line, self.channels[line.place])

    @property
    def cores(self) -> int:
        """Number of lines that drive cores."""
        return core_count(len(self.channels)) if self.lines is None else 0

    @property
    def channel_names(self) -> tuple[str, ...]:
        """Names of the cores, bladders and feet that the lines drive, or those of its own lines, in order."""
        return self.own_names or channel_names(self.cores)

    @property
    def own_names(self) -> tuple[str, ...]:
        """Names that the rig gives its lines itself; empty if they are core, bladders and feet."""
        return () if self.lines is None else self.lines.names

    @property
    def channel_lines(self) -> tuple[ChannelLine, ...]:
        """The lines that channels of robots of one's own are on, in order."""
        if self.lines is not None:
            return self.lines.channel_lines
        names, bladders = self.channel_names, channel_lines(())
        pressures = zip(bladders, self.line_map.off_kpa, self.line_map.on_kpa, strict=False)
        return tuple(ChannelLine(names.index(name), name, off, on) for name, off, on in pressures)

    def check_names(self, names: Sequence[str]) -> None:
        """Check that a table has the lines of this rig.

        Raises:
            ValueError: if it has others.
        """
        ours = self.channel_names
        if len(names) != len(ours):
            raise ValueError(f"rig: {self.name} has {len(ours)} lines, the table has {len(names)}")
        for own, other in zip(ours, names, strict=True):
            if own != other:
                told = f"{self.name} has the line {own} where the table has {other}"
                raise ValueError(f"rig: {told}; give the rig that the table is for")

    def check_plays_gaits(self) -> None:
        """Check that the rig has the lines of the inflatable robot.

        Raises:
            ValueError: if it has lines of its own.
        """
        if self.lines is not None:
            told = f"{self.name} has lines of its own, {self.lines.names[0]} and on"
            allowed = "a gait of the inflatable robot needs core, bladders and feet, so give a rig without lines ="
            raise ValueError(f"rig: {told}; {allowed}")

    @property
    def pressure_limits(self) -> tuple[Floats, Floats]:
        """Lowest and highest allowed pressures of the L lines [kPa], shape (L,) each."""
        low, high = np.array([(channel.minimum_kpa, channel.maximum_kpa) for channel in self.channels]).T
        return low, high

    def stroke_times(self, steps: Floats) -> Floats:
        """Return the times of whole strokes [s], up or down by the sign of the pressure change, shape (..., L)."""
        rise, fall = np.array([(channel.rise_s, channel.fall_s) for channel in self.channels]).T
        return np.where(steps > 0, rise, fall)

    def least_times(self, steps: Floats) -> Floats:
        """Return the shortest times [s] of pressure changes [kPa] within the limits of rate, shape (..., L)."""
        return np.abs(steps) / np.array([channel.slew_kpa_per_s for channel in self.channels])

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the rig as TOML, every channel for itself, in kPa.

        Raises:
            ValueError: if the file cannot be written.
        """
        channels = {name: asdict(channel) for name, channel in zip(self.channel_names, self.channels, strict=True)}
        data = {name: getattr(self, name) for name in _SIMPLE}
        data |= {"cores": self.cores} if self.cores > 1 else {}
        map_of_file: dict[str, Any] = asdict(self.line_map if self.lines is None else self.lines)
        if self.lines is not None:
            data["lines"] = map_of_file.pop("names")
        content = {"units": "kpa", **data, "map": map_of_file, "channels": channels}
        write_text(path, tomli_w.dumps(content))

    @staticmethod
    def load(source: str | os.PathLike[str]) -> "PneumaticRig":
        """Read a rig from TOML, or take a preset by its name; what a file leaves out is the default.

        In a file ``[channels.bladder]`` is all bladders, ``[channels.bladder3]`` what differs in the third.
        With ``cores = 2`` it has two lines for cores: ``[channels.core]`` is both, ``[channels.core1]`` the first.
        With ``lines = ["v1", "v2"]`` it has these in place of all others: ``[channels.default]`` is both; what that
        leaves out is as in the dissertation's bladders.

        A file that gives no name is named as it is called, and none may take that of a preset with other values: tables
        know their rig by its name.

        Raises:
            ValueError: for an unreadable file, an unknown name or a value that is not allowed.
        """
        if str(source) in PRESETS:
            return PRESETS[str(source)]
        if Path(source).suffix.lower() != ".toml":
            raise ValueError(f"rig: '{source}' is neither a preset ({', '.join(PRESETS)}) nor a .toml file")
        text = read_text(source)
        try:
            rig = _rig({"name": Path(source).stem} | parse_toml(text))
            if PRESETS.get(rig.name, rig) != rig:
                told = "it is a preset with other values, write another name = into the file"
                raise ValueError(f"name: {rig.name!r} is not allowed; {told}")
            return rig
        except ValueError as error:  # syntax errors too
            raise ValueError(f"{source}: {error}") from None


# "Gentle" drives the core with what the text calls necessary on hardware: 35 kPa.
_DISSERTATION = PneumaticRig()
_GENTLE = replace(
    _DISSERTATION,
    name="dissertation-gentle",
    channels=(replace(_CORE, maximum_kpa=35.0), *_DISSERTATION.channels[1:]),
    line_map=LineMap(core_kpa=35.0, ramp_pa=RAMP_PA),
)
# No lag was published, only how long the core takes. This lab's assumption: a line told its target at once would be
# 95 % there, three time constants, after the time of its faster stroke above; of the core that time is published.
_LAGGED = replace(
    _DISSERTATION,
    name="dissertation-lag",
    channels=tuple(replace(c, lag_s=min(c.rise_s, c.fall_s) / 3) for c in _DISSERTATION.channels),
)
PRESETS: Mapping[str, PneumaticRig] = MappingProxyType({rig.name: rig for rig in (_DISSERTATION, _GENTLE, _LAGGED)})

_SEVERAL = {"bladder": BLADDER_LINES, "foot": FOOT_LINES}  # tables that speak of several channels
_NOT_SIMPLE = ("channels", "line_map", "units", "lines")
_SIMPLE = tuple(each.name for each in fields(PneumaticRig) if each.name not in _NOT_SIMPLE)
_NAMES = ("units", *_SIMPLE, "map", "channels", "cores", "lines")


def _check_within(line: ChannelLine, limits: Channel) -> None:
    """Refuse pressures of an own line beyond its limits, with which no size or temperature could be played."""
    for field_name, kpa in (("off_kpa", line.off_kpa), ("on_kpa", line.on_kpa)):
        if not limits.minimum_kpa <= kpa <= limits.maximum_kpa:

            def why(unit: Unit) -> str:
                return f"its limits are {unit.text(limits.minimum_kpa)} and {unit.text(limits.maximum_kpa)}"

            raise refused(field_name, kpa, why).of(line.name)


def _rig(data: dict[str, Any]) -> PneumaticRig:
    units = data.get("units", "kpa")
    if not isinstance(units, str) or units not in KPA_PER_UNIT:
        raise ValueError(f"units: {units!r} is not allowed; give one of {', '.join(KPA_PER_UNIT)}")
    unit = Unit(units)
    try:
        return _built(data, unit)
    except PressureError as error:
        raise ValueError(error.tell(unit)) from None


def _built(given: dict[str, Any], unit: Unit) -> PneumaticRig:
    """The rig of a file's content, whose pressures are in a unit."""
    data = _in_kpa(given, "rig", _NAMES, unit)
    default = PneumaticRig()
    simple = {name: value for name, value in data.items() if name in _SIMPLE}
    if "lines" in data:
        return replace(default, units=unit.name, **simple, **_own_lines(data, unit))
    cores = whole_number("cores", data.pop("cores", 1), 1, MOST_CORES)
    names = channel_names(cores)
    channels = dict(zip(names, default.channels[:1] * cores + default.channels[1:], strict=True))
    several = _SEVERAL if cores == 1 else {**_SEVERAL, "core": names[:cores]}
    tables = _in_kpa(data.pop("channels", {}), "channels", (*several, *names), unit)
    for table in sorted(tables, key=lambda name: name not in several):  # one channel's own table wins
        for name in several.get(table, (table,)):
            channels[name] = _changed(channels[name], table, tables[table], unit)
    line_map = _changed(LineMap(), "map", data.pop("map", {}), unit)  # files that say no ramp have none
    return replace(default, channels=tuple(channels.values()), line_map=line_map, units=unit.name, **simple)


def _own_lines(data: Mapping[str, Any], unit: Unit) -> dict[str, Any]:
    """The lines that a file names itself and their channels, as fields of a rig."""
    names = own_names("lines", data["lines"])
    if "cores" in data:
        raise ValueError("cores: it is not allowed beside lines, which names all that the rig has; leave it out")
    tables = _in_kpa(data.get("channels", {}), "channels", (SHARED, *names), unit)
    shared = _changed(_BLADDER, SHARED, tables.get(SHARED, {}), unit)
    channels = [_changed(shared, name, tables.get(name, {}), unit) for name in names]
    told = _in_kpa(data.get("map", {}), "map", ("off_kpa", "on_kpa"), unit)
    limits = [(channel.minimum_kpa, channel.maximum_kpa) for channel in channels]
    try:
        lines = OwnLines.within(names, limits, **told)
    except PressureError as error:
        raise error.of("map") from None
    return {"channels": tuple(channels), "lines": lines}


def _changed(given: Described, what: str, table: object, unit: Unit) -> Described:
    """A channel or a map with the values of a table."""
    changes = _in_kpa(table, what, [entry.name for entry in fields(given)], unit)
    try:
        return replace(given, **changes)
    except PressureError as error:
        raise error.of(what) from None
    except ValueError as error:
        raise ValueError(f"{what}: {error}") from None


def _in_kpa(data: object, what: str, names: Sequence[str], unit: Unit) -> dict[str, Any]:
    """A table that has no other than these names, with those of pressures, such as ``maximum_psi``, in kPa."""
    known = {unit.field(name): name for name in names}
    if not isinstance(data, dict):
        raise ValueError(f"{what}: give a table with {', '.join(known)}")
    for name in sorted(set(data) - set(known)):
        if unit.field(name) != name:
            raise ValueError(f"{name}: is not allowed, as the units are {unit.name}; give {unit.field(name)}")
        raise ValueError(f"{what}: {name!r} is unknown; give {', '.join(known)}")
    return {known[name]: unit.kpa(value) if "_kpa" in known[name] else value for name, value in data.items()}
