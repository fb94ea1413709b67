"""Senses of any robot: what each is, how it is read, and the memory from one reading to the next.

A kind of robot has a table of its senses, and a ``SenseReader`` that knows what they read. So a new sense is one entry
of that table, wherever robots feel: in reflexes, on their way back, and in environments.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from taichi_sim.autodiff.arrays import trace
from taichi_sim.base.arrays import Floats


@dataclass(frozen=True)
class Sense:
    """One thing that robots can feel.

    Attributes:
        description: what is felt, with its unit.
        width: how many numbers it is, from what a kind of robot knows of the robot.
        read: those numbers, from a reading of the kind's own type, shape (B, width); its arrays may be traced.
    """

    description: str
    width: Callable[[Any], int]
    read: Callable[[Any], Any]


def width_of(table: Mapping[str, Sense], names: Iterable[str], robot: Any) -> int:
    """How many numbers these senses feel of a robot."""
    return sum(table[name].width(robot) for name in names)


def way_gained(number: int, now: Any, before: Any, earlier: Any, sooner: float = 1.0) -> Any:
    """By how much more places moved since the reading before than until then, 0 at the first two readings.

    Before them there are no two ways of equal time: robots were put down, and settled.

    Args:
        number: of the reading, from 0.
        now, before, earlier: places at this reading and at the two before it, of equal shapes.
        sooner: how many times as long as the way since the reading before the one until then took; the way since then
            counts that many times, as if both had taken equally long.
    """
    return np.zeros(now.shape) if number < 2 else (now - before) * sooner - (before - earlier)


class SenseReader:
    """Reads senses of B robots one reading after the other, and takes derivatives back through what was felt.

    It alone remembers where robots were at the last two readings. Reading number 0 forgets what was before.

    Attributes:
        table: senses of this kind of robot, by name.
        place: which array of a reading says where robots are.
        names: of the senses that are read, in order.
        first: where robots were put, in the shape of their places.
        keeps: whether it notes what derivatives need.
        moved: how far robots went between the last two readings.
    """

    table: ClassVar[Mapping[str, Sense]]
    place: ClassVar[str]

    def __init__(self, names: Iterable[str], first: Floats, keeps: bool = True) -> None:
        """Set up, with no reading yet."""
        self.names, self.first, self.keeps = tuple(names), first, keeps
        self._kept: dict[int, dict[str, Floats]]  # what was read, by the number of the reading
        self._before: Floats
        self._earlier: Floats
        self._begin()

    def reading(self, number: int, arrays: dict[str, Any]) -> Any:
        """What senses read at a reading; ``arrays`` are ``before``, ``earlier`` and all that was read, by name."""
        raise NotImplementedError

    def read_arrays(self, number: int, now: Mapping[str, Floats]) -> Floats:
        """What is felt at reading 0, 1, ..., shape (B, width); NaN of robots that diverged is read as 0."""
        if number == 0:
            self._begin()
        read = {name: np.nan_to_num(each) for name, each in now.items()}
        arrays = {"before": self._before, "earlier": self._earlier, **read}
        if self.keeps:
            self._kept[number] = arrays
        felt: Floats = self._feel(number, arrays)
        self._before, self._earlier = read[self.place], self._before
        self.moved = self._before - self._earlier
        return felt

    def pull_back_arrays(self, number: int, by_felt: Floats | None) -> dict[str, Floats]:
        """Derivatives by what was read, from those by what was felt; all readings in turn, the last one first.

        Args:
            number: of the reading.
            by_felt: shape (B, width); None where nothing depends on it.
        """
        if number == len(self._kept) - 1:
            self._owed = self._nothing_owed()
        arrays, (by_now, by_before) = self._kept[number], self._owed
        if by_felt is None:
            found = {name: np.zeros(each.shape) for name, each in arrays.items()}
        else:
            _, way = trace(lambda *each: self._feel(number, dict(zip(arrays, each, strict=True))), *arrays.values())
            found = dict(zip(arrays, way(by_felt), strict=True))
        self._owed = found.pop("before") + by_before, found.pop("earlier")
        found[self.place] = found[self.place] + by_now
        return found

    @property
    def by_first(self) -> Floats:
        """Derivatives by where robots were put, once all readings were taken back, in the shape of their places."""
        before, earlier = self._owed
        return before + earlier

    def _begin(self) -> None:
        self._before, self._earlier, self.moved = self.first, self.first, np.zeros(self.first.shape)
        self._kept = {}
        self._owed = self._nothing_owed()

    def _nothing_owed(self) -> tuple[Floats, Floats]:
        """What later readings owe to the places at this one and at the one before it."""
        return np.zeros(self.first.shape), np.zeros(self.first.shape)

    def _feel(self, number: int, arrays: dict[str, Any]) -> Any:
        reading = self.reading(number, arrays)
        return np.concatenate([self.table[name].read(reading) for name in self.names], axis=1)
