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
    channel_names,
    core_count,
)
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
from taichi_sim.base.checks import NotNegative, Positive, check_fields, choice, number, whole_number
from taichi_sim.base.files import read_text, write_text
from taichi_sim.base.parsing import parse_toml
from taichi_sim.base.short_text import ShortText

Described = TypeVar("Described", "Channel", LineMap)
LONGEST_LAG = 3600.0  # [s]
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
        valve_delay_s: time from the command until the pressure begins to change [s].
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
    valve_delay_s: NotNegative = 0.0
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
    """A pneumatic rig, whose lines drive the inflatable robot. The defaults are the dissertation's rig.

    Attributes:
        name: name of the rig for people.
        supply_kpa: pressure of the supply; no line can exceed it [kPa].
        vacuum_kpa: pressure of the vacuum, negative, or 0 without one; no line can fall below it, nor it below
            that of empty space [kPa].
        channels: in the order of :attr:`channel_names`: core, or several cores, bladders 1 to 8, feet 1 and 2.
        shortest_state_s: duration of a state in which nothing changes [s].
        line_map: pressures that lines take for what is simulated.
        units: ``"kpa"`` or ``"psi"``, the unit of messages and tables; all fields are in kPa.

    Raises:
        ValueError: for a value that is not allowed, or pressures of a line beyond supply or vacuum.
    """

    name: str = "dissertation"
    supply_kpa: PositivePressure = 50.0
    vacuum_kpa: Vacuum = -80.0
    channels: tuple[Channel, ...] = (_CORE,) + (_BLADDER,) * BLADDERS + (_FOOT,) * FEET
    shortest_state_s: Positive = 0.1
    line_map: LineMap = _MAP
    units: str = field(default="kpa", compare=False)

    def __post_init__(self) -> None:
        if not (isinstance(self.name, str) and self.name.isprintable()):
            raise ValueError(f"name: {self.name!r} is not allowed; give a text of one line")
        choice("units", self.units, KPA_PER_UNIT)
        check_fields(self)
        object.__setattr__(self, "channels", tuple(self.channels))
        if self.cores > MOST_CORES:
            given = len(self.channels)
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

    @property
    def cores(self) -> int:
        """Number of lines that drive cores."""
        return core_count(len(self.channels))

    @property
    def channel_names(self) -> tuple[str, ...]:
        """Names of the cores, bladders and feet that the lines drive, in order."""
        return channel_names(self.cores)

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
        content = {"units": "kpa", **data, "map": asdict(self.line_map), "channels": channels}
        write_text(path, tomli_w.dumps(content))

    @staticmethod
    def load(source: str | os.PathLike[str]) -> "PneumaticRig":
        """Read a rig from TOML, or take a preset by its name; what a file leaves out is the default.

        In a file ``[channels.bladder]`` is all bladders, ``[channels.bladder3]`` what differs in the third.
        With ``cores = 2`` it has two lines for cores: ``[channels.core]`` is both, ``[channels.core1]`` the first.

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
_SIMPLE = tuple(each.name for each in fields(PneumaticRig) if each.name not in ("channels", "line_map", "units"))
_NAMES = ("units", *_SIMPLE, "map", "channels", "cores")


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
    cores = whole_number("cores", data.pop("cores", 1), 1, MOST_CORES)
    names = channel_names(cores)
    channels = dict(zip(names, default.channels[:1] * cores + default.channels[1:], strict=True))
    several = _SEVERAL if cores == 1 else {**_SEVERAL, "core": names[:cores]}
    tables = _in_kpa(data.pop("channels", {}), "channels", (*several, *names), unit)
    for table in sorted(tables, key=lambda name: name not in several):  # one channel's own table wins
        for name in several.get(table, (table,)):
            channels[name] = _changed(channels[name], table, tables[table], unit)
    line_map = _changed(LineMap(), "map", data.pop("map", {}), unit)  # files that say no ramp have none
    simple = {name: value for name, value in data.items() if name in _SIMPLE}
    return replace(default, channels=tuple(channels.values()), line_map=line_map, units=unit.name, **simple)


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
