"""The map between simulated core pressures and levels, and pressures on the lines of a rig.

A line has not the pressure that is simulated: the core of the physical robot is round at 50 kPa, the simulated one at
12 kPa, and bladders and feet are simulated as on or off. Source: Powers 2021 dissertation, ch. 5, "Simulation
environment" (12 kPa), "Experiments with the physical robot" (50 and -80 kPa, of the core and of the feet). An actuator
that is on by parts has a pressure as far between its two.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import Annotated, Any, Self

import numpy as np
from numpy.typing import ArrayLike

from robots.hardware.lines import ACTUATOR_LINES, ACTUATORS, BLADDERS, FEET
from robots.hardware.units import PRESSURE, PositivePressure, PressureError, Unit, Vacuum
from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import NotNegative, Positive, check_fields
from taichi_sim.base.parsing import parse_json

RAMP_PA = 1000.0  # of the presets of rigs; this lab's choice, as only vacuum and 50 kPa were published
PRESSURE_DECIMALS = 3  # decimals of a simulated pressure [Pa] that survive the nine digits of a table
LEVEL_DECIMALS = 6  # and of a level
_ADDED = {"ramp_pa"}  # fields that earlier tables lack; their defaults do what those do, and are not written


def _each_actuator(field: str, value: Any) -> tuple[float, ...]:
    """Check the pressures of the ten actuators."""
    if not isinstance(value, list | tuple) or len(value) != ACTUATORS:
        allowed = f"give {ACTUATORS} pressures, bladders then feet"
        raise PressureError(lambda unit: f"{unit.field(field)}: {unit.shown(value)} is not allowed; {allowed}")
    return tuple(PRESSURE(field, part) for part in value)


Actuators = Annotated[tuple[float, ...], _each_actuator]


def _not_below(name: str, off: float, on: float) -> PressureError:
    def tell(unit: Unit) -> str:
        limit = f"it must be below its {unit.field('on_kpa')}, {unit.text(on)}"
        return f"{unit.field('off_kpa')}: {unit.text(off)} of {name} is not allowed; {limit}"

    return PressureError(tell)


@dataclass(frozen=True)
class LineMap:
    """The map from simulated core pressures and actuator levels to gauge pressures on the lines of a rig.

    The outer bladders' pressures are this lab's own, as none was published: the study cites less than 20 kPa for
    similar ones.

    Attributes:
        simulated_pa: core pressure in the simulation [Pa] that ``core_kpa`` stands for; others in proportion.
        core_kpa: line pressure of the core at that simulated pressure [kPa].
        flat_kpa: line pressure of the core of a flat body, simulated at 0 Pa: vacuum, or vented at 0 [kPa].
        on_kpa: line pressures of bladders 1 to 8 inflated and of feet 1 and 2 gripping [kPa], 10 values.
        off_kpa: line pressures of bladders deflated and of feet sliding [kPa], 10 values.
        ramp_pa: simulated core pressure [Pa] up to which the line goes linearly from ``flat_kpa`` to what is in
            proportion; 0 jumps there, as tables did that do not say it. Presets of rigs have ``RAMP_PA``.

    Raises:
        ValueError: for a pressure that is not allowed, or an actuator whose off pressure is not below its on pressure.
    """

    simulated_pa: Positive = 12e3
    core_kpa: PositivePressure = 50.0
    flat_kpa: Vacuum = -80.0
    on_kpa: Actuators = (20.0,) * BLADDERS + (50.0,) * FEET
    off_kpa: Actuators = (0.0,) * BLADDERS + (-80.0,) * FEET
    ramp_pa: NotNegative = 0.0

    def __post_init__(self) -> None:
        check_fields(self)
        for name, on, off in zip(ACTUATOR_LINES, self.on_kpa, self.off_kpa, strict=True):
            if off >= on:
                raise _not_below(name, off, on)

    def lines(self, pressures: ArrayLike, levels: ArrayLike) -> Floats:
        """Compute the line pressures [kPa] of S simulated states.

        Args:
            pressures: simulated core pressures [Pa], one or shape (S,); for C cores shape (C, S).
            levels: levels of the ten actuators in each state, from 0 (off) to 1 (on), shape (10, S).

        Returns:
            Pressures of the lines of the cores, then of the actuators, shape (S, C + 10).
        """
        simulated, told = np.asarray(pressures, float), np.asarray(levels, float).T
        core = np.where(simulated == 0, self.flat_kpa, self.core_kpa * simulated / self.simulated_pa)
        if self.ramp_pa > 0:
            core = np.where(simulated < self.ramp_pa, np.interp(simulated, (0.0, self.ramp_pa), self._ramp), core)
        actuators = (1.0 - told) * self.off_kpa + told * self.on_kpa
        return np.column_stack([np.broadcast_to(core, (*core.shape[:-1], len(told))).T, actuators])

    def simulated(self, lines: ArrayLike) -> tuple[Floats, Floats]:
        """Compute the simulated states of line pressures [kPa], the inverse of :meth:`lines`.

        Beyond its two pressures an actuator is off or on.

        Returns:
            Core pressures [Pa], shape (S,), of several cores shape (C, S), and levels of the actuators, shape (10, S).
        """
        core, levels = self.as_read(lines)
        return np.round(core, PRESSURE_DECIMALS), np.round(levels, LEVEL_DECIMALS)

    def as_read(self, lines: ArrayLike) -> tuple[Floats, Floats]:
        """Compute simulated states like :meth:`simulated`, without rounding off the digits of a table."""
        given, off = np.asarray(lines, np.float64), np.array(self.off_kpa)
        told = given[:, :-ACTUATORS].T if given.shape[1] > ACTUATORS + 1 else given[:, 0]
        core = np.maximum(told, 0.0) * self.simulated_pa / self.core_kpa
        if self.ramp_pa > 0:
            core = np.where(told < self._ramp[1], np.interp(told, self._ramp, (0.0, self.ramp_pa)), core)
        levels = (given[:, -ACTUATORS:] - off) / (np.array(self.on_kpa) - off)
        return core, np.clip(levels, 0.0, 1.0).T

    def without_unused_ramp(self, pressures: ArrayLike) -> Self:
        """Return this map as the header of a table states it: without the ramp if no core pressure [Pa] lies on it.

        Earlier versions, which know no ramp, read such a header, too.
        """
        given = np.asarray(pressures, float)
        return self if ((given > 0) & (given < self.ramp_pa)).any() else replace(self, ramp_pa=0.0)

    @property
    def _ramp(self) -> tuple[float, float]:
        """Line pressures of the core at the two ends of the ramp [kPa]."""
        return self.flat_kpa, self.core_kpa * self.ramp_pa / self.simulated_pa

    def within(self, low: ArrayLike, high: ArrayLike) -> Self:
        """Return the map with the pressures of actuators cut to limits [kPa], each of shape (10,).

        Raises:
            ValueError: if the limits leave an actuator one pressure for both states.
        """
        on, off = (np.clip(side, low, high) for side in (self.on_kpa, self.off_kpa))
        if (same := np.flatnonzero(on <= off)).size:
            name = ACTUATOR_LINES[same[0]]
            raise ValueError(f"{name}: clipping leaves {on[same[0]]:g} kPa for both on and off; widen its limits")
        return replace(self, on_kpa=tuple(on.tolist()), off_kpa=tuple(off.tolist()))

    def to_text(self) -> str:
        """Write the map as one line, for the header of a table."""
        default = type(self)()
        unused = {name for name in _ADDED if getattr(self, name) == getattr(default, name)}
        return json.dumps({name: value for name, value in asdict(self).items() if name not in unused})

    @classmethod
    def from_text(cls, text: str) -> Self:
        """Read the map from a line that :meth:`to_text` wrote.

        Raises:
            ValueError: if it is damaged.
        """
        data: Mapping[str, Any] = parse_json(text)
        if not isinstance(data, dict) or set(data) | _ADDED != {field.name for field in fields(cls)}:
            raise ValueError("map: give a JSON object with all of its fields")
        return cls(**data)
