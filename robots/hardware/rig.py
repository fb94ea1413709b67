"""The pneumatic rig: what its lines can do.

Source: Powers 2021 dissertation, ch. 5, "Transferring to a physical robot" and "Experiments with the physical robot";
Shah, Powers et al., Nature Machine Intelligence 3, 51-59, 2021.
"""

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from types import MappingProxyType
from typing import Self

from robots.hardware.line_map import LineMap
from robots.inflatable.schedule import BLADDERS, FEET, GaitSchedule
from taichi_sim.base.checks import number

CHANNELS = ("core", *GaitSchedule.row_names)
KPA_PER_UNIT = {"kpa": 1.0, "psi": 6.894757293168361}


@dataclass(frozen=True)
class Channel:
    """One pneumatic line; gauge pressures.

    Attributes:
        rise_s: time from off to on [s]; a smaller step is given as long.
        fall_s: time from on to off [s].
        minimum_kpa: lowest pressure allowed [kPa], at most 0, as lines start vented.
        maximum_kpa: highest pressure allowed [kPa], at least 0.
        slew_kpa_per_s: fastest change of pressure allowed [kPa/s].
        valve_delay_s: from the command until the pressure begins to change [s].
    """

    rise_s: float
    fall_s: float
    minimum_kpa: float
    maximum_kpa: float
    slew_kpa_per_s: float
    valve_delay_s: float = 0.0

    def __post_init__(self) -> None:
        for entry in fields(self):
            object.__setattr__(self, entry.name, number(entry.name, getattr(self, entry.name)))
        for name in ("rise_s", "fall_s", "slew_kpa_per_s"):
            if getattr(self, name) <= 0:
                raise ValueError(f"{name}: {getattr(self, name):g} is not allowed; it must be positive")
        if self.valve_delay_s < 0:
            raise ValueError(f"valve_delay_s: {self.valve_delay_s:g} is not allowed; it must not be negative")
        if self.minimum_kpa >= self.maximum_kpa:
            limit = f"it must be below maximum_kpa, {self.maximum_kpa:g}"
            raise ValueError(f"minimum_kpa: {self.minimum_kpa:g} is not allowed; {limit}")
        if self.minimum_kpa > 0:
            raise ValueError(f"minimum_kpa: {self.minimum_kpa:g} is not allowed; lines are vented, give at most 0")
        if self.maximum_kpa < 0:
            raise ValueError(f"maximum_kpa: {self.maximum_kpa:g} is not allowed; lines are vented, give at least 0")


# Published: 50 and -80 kPa on the lines of core and feet; the core takes 11.5 s to become round and 4.7 s to become
# flat. This lab's own, as nothing was published: the times of bladders and feet, and all limits of rate.
_CORE = Channel(11.5, 4.7, -80.0, 50.0, 30.0)
_BLADDER = Channel(2.0, 2.0, 0.0, 20.0, 15.0)
_FOOT = Channel(1.0, 1.0, -80.0, 50.0, 150.0)


@dataclass(frozen=True)
class PneumaticRig:
    """The lines that drive the robot. The defaults are the dissertation's rig.

    Attributes:
        name: for people.
        supply_kpa: pressure of the supply; no line can exceed it [kPa].
        vacuum_kpa: pressure of the vacuum, negative, or 0 without one; no line can fall below it [kPa].
        channels: in the order of ``CHANNELS``: core, bladders 1 to 8, feet 1 and 2.
        shortest_state_s: duration of a state in which nothing changes [s].
        line_map: pressures that lines take for what is simulated.
    """

    name: str = "dissertation"
    supply_kpa: float = 50.0
    vacuum_kpa: float = -80.0
    channels: tuple[Channel, ...] = (_CORE,) + (_BLADDER,) * BLADDERS + (_FOOT,) * FEET
    shortest_state_s: float = 0.1
    line_map: LineMap = field(default_factory=LineMap)

    def __post_init__(self) -> None:
        if not (isinstance(self.name, str) and self.name.isprintable()):
            raise ValueError(f"name: {self.name!r} is not allowed; give a text of one line")
        for name in ("supply_kpa", "vacuum_kpa", "shortest_state_s"):
            object.__setattr__(self, name, number(name, getattr(self, name)))
        for name in ("supply_kpa", "shortest_state_s"):
            if getattr(self, name) <= 0:
                raise ValueError(f"{name}: {getattr(self, name):g} is not allowed; it must be positive")
        if self.vacuum_kpa > 0:
            raise ValueError(f"vacuum_kpa: {self.vacuum_kpa:g} is not allowed; it must not be positive")
        object.__setattr__(self, "channels", tuple(self.channels))
        if (given := len(self.channels)) != len(CHANNELS):
            raise ValueError(f"channels: {given} are not allowed; give {len(CHANNELS)}")
        for name, channel in zip(CHANNELS, self.channels, strict=True):
            if channel.maximum_kpa > self.supply_kpa:
                limit = f"the supply has {self.supply_kpa:g} kPa"
                raise ValueError(f"{name}: maximum_kpa: {channel.maximum_kpa:g} is not allowed; {limit}")
            if channel.minimum_kpa < self.vacuum_kpa:
                limit = f"the vacuum has {self.vacuum_kpa:g} kPa"
                raise ValueError(f"{name}: minimum_kpa: {channel.minimum_kpa:g} is not allowed; {limit}")

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the rig as TOML.

        Raises:
            ValueError: in one line, if the file cannot be written.
        """
        from robots.hardware.rig_files import write_rig

        write_rig(self, path)

    @classmethod
    def load(cls, source: str | os.PathLike[str]) -> Self:
        """Read a rig from TOML, or take a preset by its name; what a file leaves out is the default.

        Raises:
            ValueError: in one line, for an unreadable file, an unknown name or a value that is not allowed.
        """
        from robots.hardware.rig_files import read_rig

        rig = PRESETS[str(source)] if str(source) in PRESETS else read_rig(source)
        return cls(**{entry.name: getattr(rig, entry.name) for entry in fields(rig)})


# "Gentle" drives the core with what the text calls necessary on hardware: 35 kPa.
_DISSERTATION = PneumaticRig()
_GENTLE = replace(
    _DISSERTATION,
    name="dissertation-gentle",
    channels=(replace(_CORE, maximum_kpa=35.0), *_DISSERTATION.channels[1:]),
    line_map=LineMap(core_kpa=35.0),
)
PRESETS: Mapping[str, PneumaticRig] = MappingProxyType({rig.name: rig for rig in (_DISSERTATION, _GENTLE)})
