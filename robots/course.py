"""Courses: stretches of different ground one after the other along the way, drawn from a seed."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from taichi_sim.base.arrays import Floats, Ints

KINDS = ("level", "slope", "ridges", "slippery")  # of stretches; every second one is level
RIDGE = 0.04  # m: from one ridge to the next
TIE = 1e-9  # of a cell or in m: nodes so little before an edge are on it, as rounding would decide else
SHORTEST, LONGEST = 0.75, 1.25  # stretches, in their mean length


def hashed(cells: NDArray[np.uint64], seed: float) -> Floats:
    """A number from 0 to 1 for every whole number, always the same: a hash of 32 bits (after Wellons, lowbias32)."""
    mask = np.uint64(0xFFFFFFFF)
    h = (cells ^ np.uint64(int(seed) * 83492791)) & mask
    for shift, factor in ((16, 0x7FEB352D), (15, 0x846CA68B)):
        h = ((h ^ (h >> np.uint64(shift))) * np.uint64(factor)) & mask
    return np.asarray((h ^ (h >> np.uint64(16))) / 2.0**32, float)


@dataclass(frozen=True)
class Course:
    """Stretches of ground along x: level ones, and between them slopes, ridges and slippery ones in random order.

    Ground goes on at the height where a slope ends. Lengths are whole numbers of ridges, of ``SHORTEST`` to ``LONGEST``
    mean lengths.

    Attributes:
        seed: a whole number.
        length: mean of stretches [m].
        degrees: of slopes.
        ridge: height of ridges [m], which are ``RIDGE`` apart.
        factor: of friction on slippery stretches.
        reach: how far stretches go on from x = 0 [m], at least.
    """

    seed: float
    length: float
    degrees: float
    ridge: float
    factor: float
    reach: float = 4.0

    @cached_property
    def kinds(self) -> Ints:
        """The kind of every stretch, numbers in ``KINDS``, shape (S,)."""
        drawn = 1 + np.floor((len(KINDS) - 1) * self._drawn(0)).astype(int)
        return np.where(np.arange(len(drawn)) % 2 == 0, 0, np.minimum(drawn, len(KINDS) - 1))

    @cached_property
    def ends(self) -> Floats:
        """Where every stretch ends [m], shape (S,); the first begins at 0, and before it the ground is level."""
        lengths = self.length * (SHORTEST + (LONGEST - SHORTEST) * self._drawn(1))
        return np.asarray(np.cumsum(RIDGE * np.maximum(np.round(lengths / RIDGE), 1.0)), float)

    def _drawn(self, which: int) -> Floats:
        """A number from 0 to 1 for every stretch, of two sequences."""
        shortest = RIDGE * max(round(SHORTEST * self.length / RIDGE), 1)
        most = math.ceil(self.reach / shortest)
        cells = np.arange(2 * most).astype(np.uint64) * np.uint64(73856093)
        return hashed(cells, self.seed)[which::2]

    def stretch(self, x: Floats) -> Ints:
        """The number of the stretch at places along the way [m]."""
        return np.minimum(np.searchsorted(self.ends, x + TIE, side="right"), len(self.ends) - 1)

    def kind(self, x: Floats) -> Ints:
        """The kind of ground at places along the way [m], numbers in ``KINDS``."""
        return np.asarray(self.kinds[self.stretch(x)], int)

    def height(self, x: Floats) -> Floats:
        """Height at places along the way [m]."""
        begins = np.append(0.0, self.ends[:-1])
        rises = np.where(self.kinds == KINDS.index("slope"), self.ends - begins, 0.0)
        base = np.interp(x, np.append(0.0, self.ends), np.append(0.0, np.cumsum(rises)))
        waves = 0.5 * self.ridge * (1 - np.cos(2 * math.pi * (x - begins[self.stretch(x)]) / RIDGE))
        on_ridges = self.kind(x) == KINDS.index("ridges")
        return np.asarray(math.tan(math.radians(self.degrees)) * base + np.where(on_ridges, waves, 0.0), float)

    def friction(self, x: Floats) -> Floats:
        """Factor of friction at places along the way."""
        return np.where(self.kind(x) == KINDS.index("slippery"), self.factor, 1.0)
