"""Named numbers that a search may change."""

import math
from dataclasses import dataclass, field
from typing import Literal, get_args

Kind = Literal["continuous", "integer", "angle", "binary"]


@dataclass(frozen=True)
class Variable:
    """A number that a search may change: one coordinate of a space.

    Attributes:
        name: what logs and design files call it.
        low: smallest value, included.
        high: largest value, included (for an angle the same direction as ``low``).
        kind: ``"continuous"``; ``"integer"``, rounded; ``"angle"``, which wraps round from ``high`` to
            ``low``; ``"binary"``, an integer from 0 to 1.
        step: standard deviation of a mutation, in the unit of the variable; 0 names none, and of a robot's parameters a
            tenth of the range is used, of whole numbers at least 0.5.
        unit: unit of the values, such as ``Pa``; empty for a plain number.
        start: the value before any search; None is the middle.
        place: coordinates of the cell that it belongs to, if any: variables of one place belong to one cell, and cells
            at most 1 apart are neighbours. Methods that know no neighbours ignore it, and no file keeps it.
        mixes: whether relaxed points are mixtures of designs on account of it, though it is not binary; a search then
            lets them become sharper.

    Raises:
        ValueError: for an unknown kind, or bounds, a step or a start that are not allowed.
    """

    name: str
    low: float
    high: float
    kind: Kind = "continuous"
    step: float = 0.0
    unit: str = ""
    start: float | None = None
    place: tuple[float, ...] | None = field(default=None, repr=False)
    mixes: bool = field(default=False, repr=False)

    def __post_init__(self) -> None:
        if self.kind not in get_args(Kind):
            raise ValueError(
                f"kind: {self.kind!r} of {self.name} is unknown; choose one of {', '.join(get_args(Kind))}"
            )
        finite = math.isfinite(self.low) and math.isfinite(self.high)
        for fits, allowed in (
            (finite and self.low < self.high, "low must be below high"),
            (not self.is_integer or not (self.low % 1 or self.high % 1), "give whole numbers"),
            (self.kind != "binary" or (self.low, self.high) == (0, 1), "a binary runs from 0 to 1"),
        ):
            if not fits:
                raise ValueError(f"{self.name}: bounds {self.low} to {self.high} are not allowed; {allowed}")
        if not (math.isfinite(self.step) and self.step >= 0):
            raise ValueError(f"{self.name}: step {self.step} is not allowed; give a finite number, at least 0")
        if self.start is not None and not self.low <= self.start <= self.high:
            raise ValueError(
                f"{self.name}: start {self.start} is not allowed; give a number from {self.low:g} to {self.high:g}"
            )

    @property
    def is_integer(self) -> bool:
        """Whether the variable takes only whole numbers: it is an integer or binary."""
        return self.kind in ("integer", "binary")

    @property
    def first(self) -> float:
        """Value before any search: ``start``, or the middle of the bounds, rounded down for whole numbers."""
        if self.start is not None:
            return self.start
        middle = (self.low + self.high) / 2
        return float(math.floor(middle)) if self.is_integer else middle

    @property
    def allowed(self) -> str:
        """Description of the allowed values as text, such as ``a number from 0 to 1``."""
        return f"{'a whole number' if self.is_integer else 'a number'} from {self.low:g} to {self.high:g}"
