"""Units of pressure: fields are in kPa, files and messages also in psi.

An error of a pressure carries what it says for any unit, so a file in psi is told of its own fields and numbers, and
counts, times and texts in the same message stay as they are.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, Self

from taichi_sim.base.checks import finite, number, positive, shown

KPA_PER_UNIT = {"kpa": 1.0, "psi": 6.894757293168361}
UNIT_SPELLING = {"kpa": "kPa", "psi": "psi"}
ABSOLUTE_VACUUM = -101.4  # a little below the gauge pressure of empty space, which people round: -14.7 psi [kPa]


@dataclass(frozen=True)
class Unit:
    """A unit of pressure in which people give pressures and are told of them.

    Attributes:
        name: one of ``KPA_PER_UNIT``.
    """

    name: str

    @property
    def spelling(self) -> str:
        """As people write it."""
        return UNIT_SPELLING[self.name]

    def field(self, name: str) -> str:
        """What a field that is named in kPa is called in this unit."""
        return name.replace("_kpa", f"_{self.name}")

    def kpa(self, value: Any) -> Any:
        """What is given in this unit in kPa, also in lists; what is no finite number stays as it is."""
        if self.name == "kpa":  # also whether numbers are whole
            return value
        if isinstance(value, list):
            return [self.kpa(part) for part in value]
        return value * KPA_PER_UNIT[self.name] if finite(value) is not None else value

    def text(self, kpa: float) -> str:
        """A pressure in this unit, without the unit."""
        return f"{kpa:g}" if self.name == "kpa" else f"{kpa / KPA_PER_UNIT[self.name]:.5g}"

    def shown(self, value: Any) -> str:
        """What was given for pressures, were they right or not: numbers [kPa] in this unit, all else as it is."""
        if self.name != "kpa" and isinstance(value, list | tuple):
            return f"[{', '.join(map(self.shown, value))}]"
        return self.text(value) if self.name != "kpa" and finite(value) is not None else shown(value)


KPA = Unit("kpa")


class PressureError(ValueError):
    """Refuses pressures in one line, in kPa; ``tell`` says the same in another unit."""

    def __init__(self, tell: Callable[[Unit], str]) -> None:
        """Refuse with the text that a function makes for a unit."""
        self.tell = tell
        super().__init__(tell(KPA))

    def __reduce__(self) -> tuple[type[ValueError], tuple[str]]:
        """Between processes its text alone is handed on."""
        return ValueError, (str(self),)

    def of(self, what: str) -> Self:
        """The same, with what it is about in front."""
        return type(self)(lambda unit: f"{what}: {self.tell(unit)}")


def refused(field: str, kpa: float, why: Callable[[Unit], str]) -> PressureError:
    """The error of a pressure [kPa] that does not fit the others, with why, which may name pressures in the unit."""
    return PressureError(lambda unit: f"{unit.field(field)}: {unit.text(kpa)} is not allowed; {why(unit)}")


class PressureCheck:
    """A check of a field in kPa, as :func:`taichi_sim.base.checks.check_fields` takes it."""

    def __init__(self, check: Callable[..., float], **limits: float) -> None:
        """Take a check of numbers and its limits [kPa]."""
        self.check, self.limits = check, limits

    def __call__(self, field: str, value: object) -> float:
        """The value, if it is allowed.

        Raises:
            PressureError: otherwise.
        """
        try:
            return self.check(field, value, **self.limits)
        except ValueError:
            raise PressureError(partial(self._refusal, field, value)) from None

    def _refusal(self, field: str, value: object, unit: Unit) -> str:
        limits = {name: limit / KPA_PER_UNIT[unit.name] for name, limit in self.limits.items()}
        try:
            self.check(unit.field(field), _AsWritten(unit.shown(value)), **limits)
        except ValueError as error:
            return str(error)
        raise AssertionError(f"{field}: a text was taken for a number")


class _AsWritten:
    """A text that messages show without quotes, and that no check takes for a number."""

    def __init__(self, text: str) -> None:
        self.text = text

    def __repr__(self) -> str:
        return self.text


PRESSURE = PressureCheck(number)
Pressure = Annotated[float, PRESSURE]
PositivePressure = Annotated[float, PressureCheck(positive)]
NotNegativePressure = Annotated[float, PressureCheck(number, low=0.0)]
Vacuum = Annotated[float, PressureCheck(number, low=ABSOLUTE_VACUUM, high=0.0)]
