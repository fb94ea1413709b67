"""Uniform random search, the baseline that every other method has to beat."""

from collections.abc import Mapping
from dataclasses import dataclass

from optim.search.base import hidden
from optim.search.independent import IndependentSearches
from taichi_sim.base.arrays import Floats


@dataclass(eq=False, kw_only=True)
class RandomSearch(IndependentSearches):
    """Search at random: C independent searches, each of which draws a uniform point in every generation."""

    start: Mapping[str, float] | None = hidden(None)

    def ask(self) -> Floats:
        """Return a new random point for each search, shape (C, D)."""
        return self._random_starts(self.space, range(self.climbers))
