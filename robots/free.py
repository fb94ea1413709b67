"""Free numbers of robots, which a search may change."""

from dataclasses import dataclass

from taichi_sim.base.checks import number


@dataclass(frozen=True)
class Free:
    """A free number of a robot: a search may change it between two bounds.

    Attributes:
        low: smallest value.
        high: largest value.
        start: value before any search; by default the middle.

    Raises:
        ValueError: unless the numbers are finite, low below high, and the start between them.
    """

    low: float
    high: float
    start: float | None = None

    def __post_init__(self) -> None:
        low, high = number("low", self.low), number("high", self.high)
        if not low < high:
            raise ValueError(f"low: {low:g} to {high:g} is not allowed; low must be below high")
        if self.start is not None:
            number("start", self.start, low, high)

    @property
    def middle(self) -> float:
        """Value before any search: the start, or the middle of the bounds by default."""
        return (self.low + self.high) / 2 if self.start is None else self.start
