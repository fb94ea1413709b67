"""Factors on what a file's robot is made of, by names or patterns of names: given, or free to be searched."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from robots.free import Free
from taichi_sim.base import checks
from taichi_sim.base.arrays import Floats
from taichi_sim.base.names import choices_of
from taichi_sim.base.variables import Variable

BEYOND = 2.0  # times as small or large a point may be, as differences at the bounds need
USUAL = Free(0.5, 2.0, 1.0)
STEP = 0.1  # of a mutation, of the range

Factor = float | Free
Given = Mapping[str, Factor]


@dataclass(frozen=True)
class Scale:
    """A kind of factor, such as the sizes of bodies: how users name it, and its bounds.

    Attributes:
        field: name of the field and the option that gives them.
        noun: what has a factor, for messages.
        part: the same in a word, for the parameter of all of them.
        word: what a factor is called; parameters end with it.
        least: smallest factor.
        most: largest one.
    """

    field: str
    noun: str
    part: str
    word: str
    least: float
    most: float

    def parse(self, text: str) -> dict[str, Factor]:
        """Parse factors, such as ``thigh*``, ``thigh*=0.5:2`` or ``torso=1.2``; without a range 0.5 to 2.

        Raises:
            ValueError: for anything else.
        """
        name, given, value = text.rpartition("=") if "=" in text else (text, "", "")
        try:
            parts = [float(part) for part in value.split(":")] if given else []
            if len(parts) > 2:
                raise ValueError
        except ValueError:
            parts, name = [], ""
        if not name:
            told = f"give NAME, NAME=LOW:HIGH or NAME={self.word.upper()}, as thigh*=0.5:2"
            raise ValueError(f"{self.field}: {text!r} is not allowed; {told}")
        return {name: USUAL if not parts else parts[0] if len(parts) == 1 else self._free(name, *parts)}

    def checked(self, given: object) -> dict[str, Factor]:
        """Factors by names or patterns: each a number, or free between two.

        Raises:
            ValueError: for anything else.
        """
        if not isinstance(given, Mapping) or not all(isinstance(name, str) for name in given):
            told = f"give {self.field.rpartition('_')[2]} by names of bodies, as thigh*: Free(0.5, 2)"
            raise ValueError(f"{self.field}: {given!r} is not allowed; {told}")
        return {name: self._checked(name, factor) for name, factor in given.items()}

    def _checked(self, name: str, factor: object) -> Factor:
        if isinstance(factor, list | tuple) and len(factor) in (2, 3):
            return self._free(name, *factor)
        if isinstance(factor, Free):
            return self._free(name, factor.low, factor.high, factor.start)
        return checks.number(f"{self.field} of {name}", factor, self.least, self.most)

    def _free(self, name: str, low: Any, high: Any, start: Any = None) -> Free:
        """A free factor, which starts at 1 if that is between its bounds."""
        field = f"{self.field} of {name}"
        low, high = (checks.number(field, each, self.least, self.most) for each in (low, high))
        if low >= high:
            raise ValueError(f"{field}: {low:g} to {high:g} is not allowed; give the lower one first, as 0.5 to 2")
        usual = 1.0 if low <= 1 <= high else None
        return Free(low, high, usual if start is None else checks.number(f"{field}: start", start, low, high))


def record_of(given: Given) -> dict[str, Any]:
    """Describe factors as JSON values, for :meth:`Scale.checked`; free ones as lowest, highest and start."""
    return {name: [f.low, f.high, f.middle] if isinstance(f, Free) else f for name, f in given.items()}


@dataclass(frozen=True, eq=False)
class Factors:
    """Factors of one kind on the parts of a robot, given or free.

    Attributes:
        scale: their kind.
        given: factors by names or patterns, see :meth:`Scale.checked`.
        which: number in ``given`` of the factor of each part; -1 for none.
    """

    scale: Scale
    given: Given
    which: tuple[int, ...]

    @classmethod
    def of(cls, scale: Scale, names: Sequence[str], given: Given) -> "Factors":
        """Find the parts of names and patterns among all, of which those without a name have no factor.

        Raises:
            ValueError: for names of no part, and two for one part.
        """
        return cls(scale, given, tuple(choices_of(scale.field, scale.noun, names, given)))

    @property
    def free(self) -> list[Free]:
        """The free ones, in the order of their parameters."""
        return [factor for factor in self.given.values() if isinstance(factor, Free)]

    @property
    def parameters(self) -> tuple[Variable, ...]:
        """One for each name or pattern whose factor is free: ``thigh_size`` for ``thigh*``."""
        patterns = [pattern for pattern, factor in self.given.items() if isinstance(factor, Free)]
        short = [re.sub(r"\[[^]]*\]|[*?]", "", each).strip(" _-.") or self.scale.part for each in patterns]
        names = [name if short.count(name) == 1 else each for name, each in zip(short, patterns, strict=True)]
        return tuple(
            Variable(f"{name}_{self.scale.word}", f.low, f.high, step=STEP * (f.high - f.low), start=f.middle)
            for name, f in zip(names, self.free, strict=True)
        )

    @property
    def spoken(self) -> str:
        """What is given, for people."""
        return ", ".join(
            f"{name} {f.low:g} to {f.high:g}" if isinstance(f, Free) else f"{name} {f:g}"
            for name, f in self.given.items()
        )

    def settled(self, values: Floats) -> dict[str, float]:
        """What is given, with some values, (K,), in place of the free ones."""
        left = iter(values.tolist())
        return {name: next(left) if isinstance(f, Free) else f for name, f in self.given.items()}

    def of_parts(self, values: Floats) -> list[float]:
        """The factor of each part, of some values of the free ones, (K,)."""
        each = list(self.settled(values).values())
        return [1.0 if number < 0 else each[number] for number in self.which]

    def check(self, values: Floats) -> None:
        """Refuse values, (K,), far beyond the bounds, by a ValueError."""
        for parameter, value in zip(self.parameters, values.tolist(), strict=True):
            checks.number(parameter.name, value, self.scale.least / BEYOND, self.scale.most * BEYOND)
