"""When the actuators of the inflatable robot are on.

Source: Powers 2021 dissertation, ch. 5, "Optimization": a binary matrix of ten actuators and T columns, and
per actuator a code of a frequency f and an offset phi.
"""

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from taichi_sim.base.arrays import Bools, Floats, Ints
from taichi_sim.base.checks import whole_number

BLADDERS = 8
FEET = 2
ROWS = BLADDERS + FEET
MOST_COLUMNS, MOST_REPEATS = 10_000, 100_000  # published gaits have 8, played twice


@dataclass(frozen=True, eq=False, repr=False)
class GaitSchedule:
    """A gait as a binary matrix; equal, and of equal hash, when bits and repeats are.

    Attributes:
        bits: shape (10, T), T at least 1, read-only: rows are bladders 1 to 8 (inflated) and feet 1 and 2
            (gripping), columns are actuation states in order of time.
        repeats: how often the columns are played.
    """

    bits: Bools
    repeats: int = 2

    row_names: ClassVar[tuple[str, ...]] = (
        *(f"bladder{i + 1}" for i in range(BLADDERS)),
        *(f"foot{i + 1}" for i in range(FEET)),
    )

    def __post_init__(self) -> None:
        try:
            given = np.asarray(self.bits)
        except ValueError:
            raise ValueError(f"schedule: rows differ in length; give {ROWS} equally long rows") from None
        if given.ndim != 2 or given.shape[0] != ROWS or given.shape[1] < 1:
            raise ValueError(
                f"schedule: shape {given.shape} is not allowed; give ({ROWS}, T), T at least 1: "
                f"{BLADDERS} bladders, then {FEET} feet"
            )
        if given.dtype.kind not in "biuf":
            raise ValueError(f"schedule: values of type {given.dtype} are not allowed; give 0 and 1")
        wrong = np.argwhere((given != 0) & (given != 1))
        if wrong.size:
            row, column = wrong[0]
            place = f"{self.row_names[row]}, column {column + 1}"
            raise ValueError(f"schedule: {given[row, column]} of {place} is not allowed; give 0 or 1")
        bits = given.astype(np.bool_)
        bits.setflags(write=False)
        object.__setattr__(self, "bits", bits)
        object.__setattr__(self, "repeats", whole_number("repeats", self.repeats, 1, MOST_REPEATS))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, GaitSchedule):
            return NotImplemented
        return self.repeats == other.repeats and np.array_equal(self.bits, other.bits)

    def __hash__(self) -> int:
        return hash((self.to_text(), self.repeats))

    def __repr__(self) -> str:
        return f"GaitSchedule.from_text({self.to_text()!r}, repeats={self.repeats})"

    @property
    def columns(self) -> int:
        """T, the number of different columns."""
        return len(self.bits[0])

    @property
    def levels(self) -> Floats:
        """The bits as numbers, shape (10, T)."""
        return self.bits.astype(float)

    @property
    def played(self) -> Bools:
        """The columns as they are played, shape (10, T * repeats)."""
        return np.tile(self.bits, self.repeats)

    def cut(self, columns: int | None, repeats: int | None) -> Self:
        """The first so many columns, played so often; None keeps what there is."""
        return replace(self, bits=self.bits[:, :columns], repeats=self.repeats if repeats is None else repeats)

    @classmethod
    def from_codes(cls, f: ArrayLike, phi: ArrayLike, columns: int = 8, repeats: int = 2) -> Self:
        """The schedule of a code: row r is on in every (f[r] + 1)-th column, column phi[r] + 1 among them.

        The pattern continues backwards too: counted from 1, the columns phi + 1 + k (f + 1) that exist, for
        every integer k (as the published experiments ran; the text has nothing before column phi + 1). So
        f = 0 is always on, and f = phi = ``columns`` never.

        Args:
            f: columns between activations, shape (10,), whole numbers from 0 to ``columns``.
            phi: offsets [columns], shape (10,), whole numbers from 0 to ``columns``.
            columns: T.
            repeats: how often the columns are played.
        """
        columns = whole_number("columns", columns, 1, MOST_COLUMNS)
        period = _codes("f", f, columns)[:, None] + 1
        offset = _codes("phi", phi, columns)[:, None]
        return cls((np.arange(columns) - offset) % period == 0, repeats)

    def to_codes(self) -> tuple[Ints, Ints]:
        """The code (f, phi), each of shape (10,): for every row the smallest f, then the smallest phi.

        Raises:
            ValueError: when a row has no code, because its activations are not evenly spaced from one end of
                the schedule to the other.
        """
        codes = np.array([_row_code(row, name) for row, name in zip(self.bits, self.row_names, strict=True)])
        return codes[:, 0], codes[:, 1]

    @classmethod
    def from_text(cls, text: str, repeats: int = 2) -> Self:
        """The schedule of ten rows of 0 and 1 separated by ``/``, such as ``"10/10/01/..."``.

        Raises:
            ValueError: in one line, for any other text.
        """
        rows = [row.strip() for row in text.split("/")]
        if set("".join(rows)) - {"0", "1"} or len(set(map(len, rows))) != 1:
            raise ValueError(f"schedule: {text!r} is not allowed; give {ROWS} rows of 0 and 1, joined by /")
        return cls(np.array([[character == "1" for character in row] for row in rows]), repeats)

    def to_text(self) -> str:
        """The bits as text, rows joined by ``/``; :meth:`from_text` reads it."""
        return "/".join(map(_row_text, self.bits))


def _codes(field: str, given: ArrayLike, columns: int) -> Ints:
    """Check one half of a code, shape (10,)."""
    try:
        values = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"{field}: {given!r} is not allowed; give {ROWS} whole numbers") from None
    if values.shape != (ROWS,):
        raise ValueError(f"{field}: shape {values.shape} is not allowed; give ({ROWS},), one per actuator")
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
