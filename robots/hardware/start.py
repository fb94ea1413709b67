"""Where lines are as a gait begins: vented ones that were brought to a shape, or where the gait before has ended."""

import json
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from robots.hardware.lines import ACTUATORS, BLADDERS, FEET
from robots.inflatable.design import InflatableDesign, Pressure, checked_pressure
from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import number
from taichi_sim.base.parsing import parse_json

_NAMES = {"pressure", "levels"}


@dataclass(frozen=True)
class Start:
    """What state 0 of a table brings the lines to, and state 1 begins from.

    Attributes:
        pressure: of the cores, one for all or each [Pa].
        levels: of bladders 1 to 8 and feet 1 and 2, from 0 (off) to 1 (on), 10 values.

    Raises:
        ValueError: for a value that is not allowed.
    """

    pressure: Pressure
    levels: tuple[float, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "pressure", checked_pressure(self.pressure))
        levels = tuple(number("levels", level, 0.0, 1.0) for level in self.levels)
        if len(levels) != ACTUATORS:
            raise ValueError(f"levels: {len(levels)} are not allowed; give {ACTUATORS}, bladders then feet")
        object.__setattr__(self, "levels", levels)

    @classmethod
    def of(cls, design: InflatableDesign) -> Self:
        """Where a table of its own begins a gait: bladders are empty, feet grip."""
        return cls(design.pressure, (0.0,) * BLADDERS + (1.0,) * FEET)

    @classmethod
    def after(cls, design: InflatableDesign) -> Self:
        """Where the last column of a gait leaves the lines."""
        core, levels = design.schedule.core_pressure, design.schedule.levels[:, -1]
        pressure = design.pressure if core is None else core[..., -1].tolist()
        return cls(pressure, tuple(np.asarray(levels, float).tolist()))

    def cores(self, lines: int) -> Floats:
        """Pressures of so many lines for cores [Pa].

        Raises:
            ValueError: for several pressures that are not as many.
        """
        given = np.atleast_1d(self.pressure)
        if len(given) not in (1, lines):
            raise ValueError(f"start: {len(given)} core pressures are not allowed; the rig has {lines} lines for cores")
        return np.broadcast_to(given, lines)

    def to_text(self) -> str:
        """Write it as one line, for the header of a table."""
        return json.dumps({"pressure": self.pressure, "levels": self.levels})

    @classmethod
    def from_text(cls, text: str) -> Self:
        """Read it from a line that :meth:`to_text` wrote.

        Raises:
            ValueError: if it is damaged.
        """
        data: Any = parse_json(text)
        if not isinstance(data, dict) or set(data) != _NAMES or not isinstance(data["levels"], list):
            raise ValueError("start: give a JSON object with pressure and levels")
        return cls(data["pressure"], tuple(data["levels"]))
