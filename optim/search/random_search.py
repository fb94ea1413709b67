"""Uniform random search: the yardstick that every other method has to beat."""

from collections.abc import Mapping
from dataclasses import dataclass

from optim.search.base import hidden
from optim.search.independent import IndependentSearches
from taichi_sim.base.arrays import Floats


@dataclass(eq=False, kw_only=True)
class RandomSearch(IndependentSearches):
    """C searches that draw a uniform point of the space in every generation."""

    start: Mapping[str, float] | None = hidden(None)

    def ask(self) -> Floats:
        """One fresh point per search, shape (C, D)."""
        return self._random_starts(self.space, range(self.climbers))
