"""The schedule of a gait: how far every actuator of the inflatable robot is on, column by column.

Source: Powers 2021 dissertation, ch. 5, "Optimization": a binary matrix of ten actuators and T columns, and per
actuator a code of a frequency f and an offset phi. Levels between 0 and 1, core pressures of columns and times of
their own go beyond it.
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from robots.hardware import lines
from taichi_sim.base.arrays import Bools, Floats, Ints
from taichi_sim.base.checks import number, numbers, on_off, shown, whole_number
from taichi_sim.base.parsing import RepeatedNameError, parse_json

BLADDERS, FEET = lines.BLADDERS, lines.FEET
ROWS = lines.ACTUATORS
MOST_COLUMNS, MOST_REPEATS = 10_000, 100_000  # published gaits have 8, played twice
# Safety limit of the core in the simulator [Pa]. The search space ends at 12 kPa; published evaluations reach 13,281.
MAXIMUM_PRESSURE = 15e3
LONGEST_COLUMN = 1_000_000  # time steps of its motion, and as many of settling
NO_SHARPENING = 1e-8  # sharpness below which sharpening changes no digit
LEAST_PACE = 0.1
TABLES = ("inflation", "grip", "core_pressure", "motion_steps", "settle_steps", "pace")  # in files, in this order


@dataclass(frozen=True, eq=False, repr=False)
class GaitSchedule:
    """Schedule of a gait: levels of ten actuators, 0 (off) to 1 (on), in T columns played one after the other.

    Equal, and of equal hash, when all fields are.

    Attributes:
        levels: shape (10, T), T at least 1, 0 to 1, read-only: rows are bladders 1 to 8 and feet 1 and 2, columns are
            actuation states in order of time. A bladder goes that fraction of the way from empty to full; the friction
            of a foot is that fraction of the way from low to high.
        repeats: how often the columns are played.
        core_pressure: of all cores at the end of each column's motion [Pa], shape (T,), or of each of N cores, shape
            (N, T), read-only; it changes linearly in time. None keeps the pressure of the design.
        motion_steps: time steps that each column's motion lasts, or as many more as its slowest bladder needs, shape
            (T,), read-only; None is as published.
        settle_steps: time steps between the end of each column's motion and the next column, shape (T,), read-only;
            None is as published.
        pace: at which each bladder moves in each column, as a part of the robot's inflation rate, 0.1 to 1, shape
            (8, T), read-only: so a stroke takes a time of its own. None is 1.
        skip_idle: whether a column in which no bladder is switched ends after one step of motion, as published; else
            it lasts as long as a full stroke. Only a schedule of on and off without the four tables above can skip
            columns (others get False), because only there such a column moves nothing.

    Raises:
        ValueError: for a table or number that is not allowed.
    """

    levels: Floats
    repeats: int = 2
    core_pressure: Floats | None = None
    motion_steps: Ints | None = None
    settle_steps: Ints | None = None
    pace: Floats | None = None
    skip_idle: bool = True

    row_names: ClassVar[tuple[str, ...]] = lines.ACTUATOR_LINES

    def __post_init__(self) -> None:
        levels = _table("schedule", on_off(self.levels), 1.0, "T", self.row_names)
        columns = levels.shape[1]
        object.__setattr__(self, "levels", levels)
        object.__setattr__(self, "repeats", whole_number("repeats", self.repeats, 1, MOST_REPEATS))
        if self.core_pressure is not None:
            cores = [f"core {number + 1}" for number in range(len(self.core_pressure))]
            several = cores if np.ndim(self.core_pressure) == 2 else ()
            core = _table("core_pressure", self.core_pressure, MAXIMUM_PRESSURE, columns, several)
            object.__setattr__(self, "core_pressure", core[0] if len(several) == 1 else core)
        if self.pace is not None:
            pace = _table("pace", self.pace, 1.0, columns, self.row_names[:BLADDERS], LEAST_PACE)
            object.__setattr__(self, "pace", pace)
        for field in ("motion_steps", "settle_steps"):
            if getattr(self, field) is not None:
                table = _table(field, getattr(self, field), LONGEST_COLUMN, columns)
                steps = np.array([whole_number(field, float(count), 0) for count in table])
                steps.setflags(write=False)
                object.__setattr__(self, field, steps)
        plain = not self.has_own_times and self.core_pressure is None and self.pace is None and self.is_on_off
        object.__setattr__(self, "skip_idle", bool(self.skip_idle) and plain)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, GaitSchedule):
            return NotImplemented
        return self.repeats == other.repeats and self.to_text() == other.to_text()

    def __hash__(self) -> int:
        return hash((self.to_text(), self.repeats))

    def __repr__(self) -> str:
        return f"GaitSchedule.from_text({self.to_text()!r}, repeats={self.repeats})"

    def emptied(self, bladders: Bools) -> Self:
        """Return the schedule with some bladders left empty, a mask of shape (8,); feet and times stay."""
        if not self.inflation[bladders].any():
            return self
        levels = self.levels.copy()
        levels[:BLADDERS][bladders] = 0.0
        return replace(self, levels=levels)

    @property
    def columns(self) -> int:
        """Number T of different columns."""
        return self.levels.shape[1]

    @property
    def inflation(self) -> Floats:
        """Levels of the bladders, shape (8, T)."""
        return self.levels[:BLADDERS]

    @property
    def grip(self) -> Floats:
        """Levels of the feet, shape (2, T)."""
        return self.levels[BLADDERS:]

    @property
    def is_on_off(self) -> bool:
        """Whether all levels are 0 or 1."""
        return bool(((self.levels == 0) | (self.levels == 1)).all())

    @property
    def has_own_times(self) -> bool:
        """Whether the schedule sets how long columns last, in time steps of the published robot."""
        return self.motion_steps is not None or self.settle_steps is not None

    @cached_property
    def bits(self) -> Bools:
        """Levels of an on/off schedule as booleans, shape (10, T), read-only.

        Raises:
            ValueError: if a level lies between 0 and 1.
        """
        if not self.is_on_off:
            raise ValueError("schedule: levels between 0 and 1 are no bits; take levels, or project() first")
        bits = self.levels == 1
        bits.setflags(write=False)
        return bits

    @property
    def played(self) -> Floats:
        """Levels of all columns in the order played, shape (10, T * repeats)."""
        return np.tile(self.levels, self.repeats)

    @property
    def indecision(self) -> float:
        """Mean of 4 u (1 - u) over all levels u: 0 for on and off, 1 where all are halfway."""
        return float((4 * self.levels * (1 - self.levels)).mean())

    def cut(self, columns: int | None, repeats: int | None) -> Self:
        """Return the schedule of the first ``columns`` columns, played ``repeats`` times; None keeps what there is.

        Raises:
            ValueError: for more columns than there are, or less than one.
        """
        if columns is not None and whole_number("columns", columns, 1) > self.columns:
            raise ValueError(f"columns: {columns} is not allowed; the gait has {self.columns}")
        names = ("levels", "core_pressure", "motion_steps", "settle_steps", "pace")
        tables = {name: table[..., :columns] for name in names if (table := getattr(self, name)) is not None}
        return replace(self, **tables, repeats=self.repeats if repeats is None else repeats)

    def in_steps_of(self, ratio: float) -> Self:
        """Return the schedule for time steps ``ratio`` times as long: its own times stay the same in seconds.

        They are rounded to steps, and to the longest that a column may have.
        """
        if ratio == 1:
            return self
        given = {name: getattr(self, name) for name in ("motion_steps", "settle_steps")}
        steps = {name: np.rint(times / ratio) for name, times in given.items() if times is not None}
        return replace(self, **{name: np.minimum(times, LONGEST_COLUMN) for name, times in steps.items()})

    def project(self, threshold: float = 0.5) -> Self:
        """Round to an on/off schedule, which is on where the levels are at or above the threshold.

        Raises:
            ValueError: if columns have core pressures or times of their own, which on and off cannot say.
        """
        if self.has_own_times:
            raise ValueError("steps: times of its own are not allowed; on and off have the published ones")
        if self.core_pressure is not None:
            raise ValueError("core_pressure: one per column is not allowed; on and off keep that of the design")
        if self.pace is not None:
            raise ValueError("pace: one per stroke is not allowed; on and off keep that of the robot")
        return self.decided(threshold)

    def decided(self, threshold: float = 0.5) -> Self:
        """Round to an on/off schedule like :meth:`project`, but drop core pressures, times and pace."""
        return type(self)((self.levels >= number("threshold", threshold, 0.0, 1.0)).astype(float), self.repeats)

    def sharpened(self, sharpness: float) -> Self:
        """Push every level u away from 1/2, further for larger sharpness; 0, 1/2 and 1 stay.

        u' = (tanh(b/2) + tanh(b (u - 1/2))) / (2 tanh(b/2)), the projection of topology optimisation (Wang, Lazarov &
        Sigmund, Structural and Multidisciplinary Optimization 43, 767-784, 2011) about 1/2; b = 0 is its limit u' = u.
        """
        b = number("sharpness", sharpness, 0.0)
        if b < NO_SHARPENING:
            return self
        edge, u = math.tanh(b / 2), self.levels
        levels = np.clip((edge + np.tanh(b * (u - 0.5))) / (2 * edge), 0.0, 1.0)
        return replace(self, levels=np.where(np.isin(u, (0.0, 0.5, 1.0)), u, levels))  # rounding must not move them

    def sharpening_slope(self, sharpness: float) -> Floats:
        """Compute the derivative of the :meth:`sharpened` levels by the levels, shape (10, T)."""
        b = number("sharpness", sharpness, 0.0)
        if b < NO_SHARPENING:
            return np.ones_like(self.levels)
        return b * (1 - np.tanh(b * (self.levels - 0.5)) ** 2) / (2 * math.tanh(b / 2))

    @classmethod
    def from_codes(cls, f: ArrayLike, phi: ArrayLike, columns: int = 8, repeats: int = 2) -> Self:
        """Decode a schedule: row r is on in every (f[r] + 1)-th column, column phi[r] + 1 among them.

        The pattern continues backwards too: counted from 1, the columns phi + 1 + k (f + 1) that exist, for
        every integer k (as the published experiments ran; the text has nothing before column phi + 1). So
        f = 0 is always on, and f = phi = ``columns`` never.

        Args:
            f: columns between activations, shape (10,), whole numbers from 0 to ``columns``.
            phi: offsets [columns], shape (10,), whole numbers from 0 to ``columns``.
            columns: number T of columns.
            repeats: how often the columns are played.
        """
        columns = whole_number("columns", columns, 1, MOST_COLUMNS)
        period = _codes("f", f, columns)[:, None] + 1
        offset = _codes("phi", phi, columns)[:, None]
        return cls((np.arange(columns) - offset) % period == 0, repeats)

    def to_codes(self) -> tuple[Ints, Ints]:
        """Encode as (f, phi), each of shape (10,): for every row the smallest f, then the smallest phi.

        Raises:
            ValueError: if a row has no code, because its activations are not evenly spaced from one end of the
                schedule to the other, or lie between on and off.
        """
        codes = np.array([_row_code(row, name) for row, name in zip(self.bits, self.row_names, strict=True)])
        return codes[:, 0], codes[:, 1]

    @property
    def tables(self) -> dict[str, Any]:
        """Tables of the schedule by name (those of ``TABLES`` that it has), as lists of numbers."""
        given = {name: getattr(self, name) for name in TABLES}
        return {name: table.tolist() for name, table in given.items() if table is not None}

    @classmethod
    def from_tables(cls, tables: Mapping[str, Any], repeats: int = 2) -> Self:
        """Build a schedule from tables as :attr:`tables` gives them; only inflation and grip are needed.

        Raises:
            KeyError: with the name of a table that is missing.
            ValueError: if tables are unknown or not allowed.
        """
        if unknown := sorted(set(tables) - set(TABLES)):
            raise ValueError(f"{unknown[0]}: is unknown; a gait's tables are {', '.join(TABLES)}")
        inflation = _table("inflation", tables["inflation"], 1.0, "T", cls.row_names[:BLADDERS])
        grip = _table("grip", tables["grip"], 1.0, inflation.shape[1], cls.row_names[BLADDERS:])
        others = {name: tables.get(name) for name in TABLES[2:]}
        return cls(np.concatenate([inflation, grip]), repeats, **others, skip_idle=False)

    def to_text(self) -> str:
        """Write the schedule, without its repeats, as one line that :meth:`from_text` reads exactly.

        One that skips idle columns is its bits, rows joined by ``/``; others are their tables as JSON.
        """
        return "/".join(map(_row_text, self.bits)) if self.skip_idle else json.dumps(self.tables)

    @classmethod
    def from_text(cls, text: str, repeats: int = 2) -> Self:
        """Read a schedule from a line that :meth:`to_text` wrote, such as ten rows of 0 and 1 like ``"10/10/01/..."``.

        Raises:
            ValueError: if it is anything else.
        """
        if not isinstance(text, str):  # as a damaged file may have it
            raise ValueError(f"schedule: {shown(text)} is not allowed; give a text, such as rows of 0 and 1")
        if text.lstrip().startswith("{"):
            damaged = ValueError("schedule: its text is damaged; give the tables of a gait as JSON")
            try:
                tables = parse_json(text)
            except RepeatedNameError as error:
                raise ValueError(f"schedule: {error}") from None
            except ValueError:
                raise damaged from None
            try:
                return cls.from_tables(tables, repeats)
            except KeyError as missing:
                raise ValueError(f"schedule: {missing} is missing") from None
            except TypeError:
                raise damaged from None
        rows = [row.strip() for row in text.split("/")]
        if set("".join(rows)) - {"0", "1"} or len(set(map(len, rows))) != 1:
            raise ValueError(f"schedule: {text!r} is not allowed; give {ROWS} rows of 0 and 1, joined by /")
        return cls(np.array([[character == "1" for character in row] for row in rows]), repeats)


def _table(
    field: str, given: object, high: float, columns: int | str, rows: Sequence[str] = (), low: float = 0.0
) -> Floats:
    """A read-only copy of numbers from ``low`` to ``high``, one per column, or one per named row and column."""
    table = numbers(field, given, *([len(rows), columns] if rows else [columns]))
    wrong = np.argwhere(~((table >= low) & (table <= high)))
    if len(wrong):
        *row, column = wrong[0]
        place = f"{rows[row[0]]}, column {column + 1}" if row else f"column {column + 1}"
        allowed = f"give numbers from {low:g} to {high:g}"
        raise ValueError(f"{field}: {table[tuple(wrong[0])]} of {place} is not allowed; {allowed}")
    table[np.signbit(table)] = 0.0  # so that equal schedules have equal texts
    table.setflags(write=False)
    return table


def _codes(field: str, given: object, columns: int) -> Ints:
    """Check one half of a code, shape (10,)."""
    values = numbers(field, given, ROWS)
    for name, value in zip(GaitSchedule.row_names, values, strict=True):
        if not (0 <= value <= columns and value == np.rint(value)):
            allowed = f"give a whole number from 0 to {columns}"
            raise ValueError(f"{field}: {value:g} of {name} is not allowed; {allowed}")
    return values.astype(np.int64)


def _row_code(row: Bools, name: str) -> tuple[int, int]:
    """The smallest code (f, phi) of one row."""
    last = len(row) - 1
    on = np.flatnonzero(row)
    if on.size == 0:  # only the longest period leaves a residue that no column has
        return len(row), len(row)
    first = int(on[0])
    if on.size == 1:  # the shortest period that reaches past both ends
        return max(first, last - first), first
    period = int(on[1]) - first
    if first >= period or last - on[-1] >= period or np.any(np.diff(on) != period):
        raise ValueError(f"schedule: {_row_text(row)} of {name} has no (f, phi) code; its ones are uneven")
    return period - 1, first


def _row_text(row: Bools) -> str:
    return "".join("1" if bit else "0" for bit in row)
