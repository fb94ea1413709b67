"""Gaits between on and off, and with times of their own: bladders partly inflated, feet that grip a little."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from robots.inflatable.cores import MAXIMUM_PRESSURE, Pressure, checked_pressure
from robots.inflatable.robot import InflatableDesign
from robots.inflatable.schedule import BLADDERS, FEET, MOST_REPEATS, GaitSchedule
from taichi_sim.base.arrays import Floats, Ints
from taichi_sim.base.checks import number, whole_number

LONGEST_COLUMN = 1_000_000  # time steps of its motion, and as many of settling
IDENTITY = 1e-8  # sharpness below which sharpening changes no digit


# Tables of a gait in files, in the order written, and the fields that they are.
TABLES = {
    "inflation": "inflation",
    "grip": "grip",
    "core_pressure": "pressure",
    "motion_steps": "motion_steps",
    "settle_steps": "settle_steps",
}


@dataclass(frozen=True, eq=False)
class RelaxedSchedule:
    """A gait whose actuators may be anywhere between off (0) and on (1); equal when all of its numbers are.

    Attributes:
        inflation: of bladders 1 to 8, shape (8, T), T at least 1, read-only: the thickness that a bladder goes to is
            that fraction of the way from empty to full.
        grip: of feet 1 and 2, shape (2, T), read-only: their friction is that fraction of the way from low to high.
        repeats: how often the columns are played; 1 is a gait that is not periodic.
        pressure: of all cores at the end of each column's motion [Pa], shape (T,), read-only: the shape changes within
            the gait, linearly in time over the column's motion; None keeps the pressure of the design.
        motion_steps: time steps that each column's motion lasts, or as many more as its slowest bladder needs, shape
            (T,), read-only; None is as published, see ``play_relaxed``.
        settle_steps: time steps between the end of each column's motion and the next column, shape (T,), read-only;
            None is as published.
    """

    inflation: Floats
    grip: Floats
    repeats: int = 2
    pressure: Floats | None = None
    motion_steps: Ints | None = None
    settle_steps: Ints | None = None

    def __post_init__(self) -> None:
        inflation = _table("inflation", self.inflation, 1.0, (BLADDERS, None))
        columns = inflation.shape[1]
        object.__setattr__(self, "inflation", inflation)
        object.__setattr__(self, "grip", _table("grip", self.grip, 1.0, (FEET, columns)))
        object.__setattr__(self, "repeats", whole_number("repeats", self.repeats, 1, MOST_REPEATS))
        if self.pressure is not None:
            object.__setattr__(self, "pressure", _table("pressure", self.pressure, MAXIMUM_PRESSURE, (columns,)))
        for field in ("motion_steps", "settle_steps"):
            if (steps := getattr(self, field)) is not None:
                object.__setattr__(self, field, _step_counts(field, steps, columns))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, RelaxedSchedule):
            return NotImplemented
        return self.repeats == other.repeats and self.to_text() == other.to_text()

    def __hash__(self) -> int:
        return hash((self.to_text(), self.repeats))

    @property
    def timed(self) -> bool:
        """Whether columns last as long as the gait says, instead of as published."""
        return self.motion_steps is not None or self.settle_steps is not None

    @property
    def columns(self) -> int:
        """T, the number of different columns."""
        return self.inflation.shape[1]

    @property
    def levels(self) -> Floats:
        """Inflation, then grip, in the order of rows of ``GaitSchedule``, shape (10, T)."""
        return np.concatenate([self.inflation, self.grip])

    @property
    def indecision(self) -> float:
        """Mean of 4 u (1 - u) over all actuators and columns: 0 for on and off, 1 where all are halfway."""
        return float((4 * self.levels * (1 - self.levels)).mean())

    def cut(self, columns: int | None, repeats: int | None) -> Self:
        """The first so many columns, played so often; None keeps what there is."""
        tables = {
            field: table[..., :columns] for field in TABLES.values() if (table := getattr(self, field)) is not None
        }
        return replace(self, **tables, repeats=self.repeats if repeats is None else repeats)

    @property
    def tables(self) -> dict[str, Any]:
        """What there is of ``TABLES``, as lists of numbers."""
        given = {name: getattr(self, field) for name, field in TABLES.items()}
        return {name: table.tolist() for name, table in given.items() if table is not None}

    @classmethod
    def from_tables(cls, tables: Mapping[str, Any], repeats: int = 2) -> Self:
        """The gait of such tables; only inflation and grip are needed.

        Raises:
            KeyError: with the name of a table that is missing.
            ValueError: in one line, for tables that are unknown or not allowed.
        """
        if unknown := sorted(set(tables) - set(TABLES)):
            raise ValueError(f"{unknown[0]}: is unknown; a graded gait has {', '.join(TABLES)}")
        given = {field: tables.get(name) for name, field in TABLES.items()}
        return cls(**{**given, "inflation": tables["inflation"], "grip": tables["grip"]}, repeats=repeats)

    def to_text(self) -> str:
        """The tables in one line, as JSON; numbers are exact. :meth:`from_text` reads it."""
        return json.dumps(self.tables)

    @classmethod
    def from_text(cls, text: str, repeats: int = 2) -> Self:
        """The gait of such a line.

        Raises:
            ValueError: in one line, for anything else.
        """
        try:
            return cls.from_tables(json.loads(text), repeats)
        except KeyError as missing:
            raise ValueError(f"schedule: {missing} is missing") from None
        except (json.JSONDecodeError, TypeError):
            raise ValueError("schedule: its text is damaged; give the tables of a graded gait as JSON") from None

    @classmethod
    def from_schedule(cls, schedule: GaitSchedule) -> Self:
        """The same gait."""
        levels = schedule.levels
        return cls(levels[:BLADDERS], levels[BLADDERS:], schedule.repeats)

    def project(self, threshold: float = 0.5) -> GaitSchedule:
        """The gait whose actuators are on where this one's are at least at the threshold.

        Raises:
            ValueError: in one line, for a gait that changes its core pressure or has times of its own; on and off
                cannot say that.
        """
        if self.timed:
            raise ValueError("steps: times of its own are not allowed; a GaitSchedule has the published ones")
        if self.pressure is not None:
            raise ValueError("pressure: one per column is not allowed; a GaitSchedule keeps that of the design")
        return self.decided(threshold)

    def decided(self, threshold: float = 0.5) -> GaitSchedule:
        """Like :meth:`project`, whatever the core pressure does and how long columns last."""
        return GaitSchedule(self.levels >= number("threshold", threshold, 0.0, 1.0), self.repeats)

    def sharpened(self, sharpness: float) -> Self:
        """The gait with every u pushed away from 1/2, further for larger sharpness; 0, 1/2 and 1 stay.

        u' = (tanh(b/2) + tanh(b (u - 1/2))) / (2 tanh(b/2)), the projection of topology optimisation (Wang, Lazarov &
        Sigmund, Structural and Multidisciplinary Optimization 43, 767-784, 2011) about 1/2; b = 0 is its limit u' = u.
        """
        b = number("sharpness", sharpness, 0.0)
        if b < IDENTITY:
            return self
        edge, u = math.tanh(b / 2), self.levels
        levels = np.clip((edge + np.tanh(b * (u - 0.5))) / (2 * edge), 0.0, 1.0)
        levels = np.where(np.isin(u, (0.0, 0.5, 1.0)), u, levels)  # rounding must not move them
        return replace(self, inflation=levels[:BLADDERS], grip=levels[BLADDERS:])

    def sharpening_slope(self, sharpness: float) -> Floats:
        """Derivative of :meth:`sharpened` levels by the levels, shape (10, T)."""
        b = number("sharpness", sharpness, 0.0)
        if b < IDENTITY:
            return np.ones_like(self.levels)
        return b * (1 - np.tanh(b * (self.levels - 0.5)) ** 2) / (2 * math.tanh(b / 2))


Schedule = GaitSchedule | RelaxedSchedule


def schedule_of_text(text: str, repeats: int = 2) -> Schedule:
    """The schedule, of either kind, that ``to_text`` wrote.

    Raises:
        ValueError: in one line, for anything else.
    """
    kind = RelaxedSchedule if text.lstrip().startswith("{") else GaitSchedule
    return kind.from_text(text, repeats)


@dataclass(frozen=True)
class RelaxedDesign:
    """Shape, orientation and relaxed control of the robot.

    Attributes:
        pressure: of the core [Pa], 0 (flat) to 15,000, one for all cores or a tuple with one each, as of
            ``InflatableDesign``; before the gait, where that has pressures of its own, and then one.
        orientation: heading [degrees] from the rolling direction (0, along x) to the inching direction (90, along y).
        schedule: how far bladders inflate and feet grip.
    """

    pressure: Pressure
    orientation: float
    schedule: RelaxedSchedule

    def __post_init__(self) -> None:
        object.__setattr__(self, "pressure", checked_pressure(self.pressure))
        object.__setattr__(self, "orientation", number("orientation", self.orientation, 0.0, 90.0, "degrees"))
        if not isinstance(self.schedule, RelaxedSchedule):
            raise ValueError(f"schedule: {type(self.schedule).__name__} is not allowed; give a RelaxedSchedule")
        if isinstance(self.pressure, tuple) and self.schedule.pressure is not None:
            raise ValueError(
                f"pressure: {len(self.pressure)} values are not allowed with a gait that has core pressures of its "
                "columns; give one"
            )

    @classmethod
    def from_design(cls, design: InflatableDesign) -> Self:
        """The same design."""
        return cls(design.pressure, design.orientation, RelaxedSchedule.from_schedule(design.schedule))

    def project(self, threshold: float = 0.5) -> InflatableDesign:
        """The design with the projected gait, see ``RelaxedSchedule.project``."""
        return InflatableDesign(self.pressure, self.orientation, self.schedule.project(threshold))


def _step_counts(field: str, given: ArrayLike, columns: int) -> Ints:
    """A read-only copy of whole numbers, one per column."""
    table = _table(field, given, float(LONGEST_COLUMN), (columns,))
    wrong = table[table != np.rint(table)]
    if wrong.size:
        raise ValueError(f"{field}: {wrong[0]} is not allowed; give whole numbers")
    steps = table.astype(np.int64)
    steps.setflags(write=False)
    return steps


def _table(field: str, given: ArrayLike, high: float, shape: tuple[int | None, ...]) -> Floats:
    """A read-only copy of numbers from 0 to ``high``; None in the shape is any length of at least 1."""
    allowed = f"give shape ({', '.join('T' if n is None else str(n) for n in shape)}{',' * (len(shape) == 1)})"
    try:
        table = np.array(given, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{field}: {type(given).__name__} is not allowed; {allowed}") from None
    if len(table.shape) != len(shape) or any(
        n < 1 or m not in (None, n) for n, m in zip(table.shape, shape, strict=True)
    ):
        raise ValueError(f"{field}: shape {table.shape} is not allowed; {allowed}")
    wrong = table[~((table >= 0) & (table <= high))]
    if wrong.size:
        raise ValueError(f"{field}: {wrong[0]} is not allowed; give numbers from 0 to {high:g}")
    table[np.signbit(table)] = 0.0  # so that equal gaits have equal texts
    table.setflags(write=False)
    return table
