"""What a robot moves on."""

from dataclasses import dataclass
from typing import Self

from robots.checks import number

STEEPEST = 45.0  # degrees, either way


@dataclass(frozen=True)
class Terrain:
    """A plane, level or tilted, with the friction of the robot's own materials unless overridden.

    Attributes:
        slope: [degrees], positive is uphill, -45 to 45.
        high_friction: Coulomb coefficient that replaces the robot's 2.0 (skin, gripping feet); None keeps it.
        low_friction: Coulomb coefficient that replaces the robot's 1e-4 (sliding feet); None keeps it.
    """

    slope: float = 0.0
    high_friction: float | None = None
    low_friction: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "slope", number("slope", self.slope, -STEEPEST, STEEPEST, "degrees"))
        for field in ("high_friction", "low_friction"):
            if (value := getattr(self, field)) is not None:
                object.__setattr__(self, field, number(field, value, 0.0))
        low, high = self.low_friction, self.high_friction
        if low is not None and high is not None and low > high:
            raise ValueError(f"low_friction: {low} is not allowed; give at most high_friction, {high}")

    @property
    def name(self) -> str:
        """``"flat"`` or ``"hill:15"``, as :meth:`parse` reads it; friction is not part of the name."""
        return f"hill:{self.slope!r}".removesuffix(".0") if self.slope else "flat"

    @classmethod
    def parse(cls, text: str) -> Self:
        """The terrain of a name: ``"flat"``, or ``"hill:DEGREES"`` such as ``"hill:15"``."""
        kind, _, degrees = text.partition(":")
        if text == "flat":
            return cls()
        try:
            slope = float(degrees if kind == "hill" else "")
        except ValueError:
            raise ValueError(f'terrain: {text!r} is unknown; give "flat" or "hill:15" (degrees)') from None
        return cls(slope)
