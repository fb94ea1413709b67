"""The base class of methods that run several searches side by side."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from optim.problem import Evaluation
from optim.search.base import Search, table, whole
from optim.search.method import MOST_POINTS, SearchResult, below_all, generator, single_objective, with_values
from optim.space import Space
from taichi_sim.base.arrays import Bools, Floats


@dataclass(eq=False, kw_only=True)
class IndependentSearches(Search):
    """Base class of methods that run C independent searches, each evaluating one point per generation.

    A new point replaces a search's best if it is strictly better. NaN never does; a best point that failed is
    replaced by any that did not. A method whose searches share anything says so: ``independent_climbers = False``.

    Attributes:
        climbers: number C of searches.
        seed: seed of all random numbers.
        start: values by name with which every search starts; the other variables start at random.
    """

    independent_climbers = True

    arrays: ClassVar[tuple[str, ...]] = ("points", "scores")

    climbers: int = whole(60, 1, MOST_POINTS)
    seed: int = whole(0, 0, 2**63 - 1)
    start: Mapping[str, float] | None = table()

    def __post_init__(self) -> None:
        super().__post_init__()
        self.points = np.full((self.climbers, self.space.size), np.nan)
        self.scores = np.full(self.climbers, np.nan)

    def tell(self, points: Floats, evaluation: Evaluation) -> None:
        """Keep the points that are better than the best so far of their search; there must be one objective."""
        self._keep(points, single_objective(evaluation, self.climbers))
        self.generation += 1

    def _keep(self, points: Floats, scores: Floats) -> Bools:
        """Take over the points, one a search, that are better; which those are, shape (C,)."""
        better = (scores > self.scores) | (np.isnan(self.scores) & ~np.isnan(scores))
        taken = better | np.isnan(self.points).any(axis=1)  # the first always is
        self.points = np.where(taken[:, None], points, self.points)
        self.scores = np.where(taken, scores, self.scores)
        return better

    def result(self) -> SearchResult:
        """Return the best point of all searches (the first of equals), and the best point of each."""
        best = int(np.argmax(below_all(self.scores)))
        objectives = self.scores[:, None].copy()
        return SearchResult(self.points[best].copy(), float(self.scores[best]), self.points.copy(), objectives)

    def _random_starts(self, space: Space, climbers: Iterable[int], count: int = 1, *stream: int) -> Floats:
        """``count`` points of the space for each of some climbers: random but for the values that are given."""
        rngs = [generator(self.seed, self.generation, climber, *stream) for climber in climbers]
        points = [space.sample(rng, count) for rng in rngs]
        return with_values(space, np.reshape(points, (-1, space.size)), self.start)


def best_of_each(points: Floats, scores: Floats, climbers: int) -> tuple[Floats, Floats]:
    """Select the best point of each climber, shape (C, D), and its score, shape (C,); the first of equals."""
    grouped = below_all(scores).reshape(climbers, -1)
    best = np.arange(climbers) * grouped.shape[1] + grouped.argmax(axis=1)
    return points[best], scores[best]
