"""What methods share that run C searches side by side, each knowing only its own best point."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from optim.problem import Evaluation
from optim.search.method import MOST_POINTS, SearchResult, Wants, generator, single_objective, with_values
from optim.space import Space
from taichi_sim.base import checks
from taichi_sim.base.arrays import Arrays, Bools, Floats


class IndependentSearches(ABC):
    """C searches, one evaluation each per generation, all of them in one batch.

    A new point replaces a search's best if it is strictly better. NaN never does; a best point that failed is
    replaced by any that did not.
    """

    several_objectives: ClassVar[bool] = False

    def __init__(self, space: Space, *, climbers: int = 60, seed: int = 0) -> None:
        """Set up the searches.

        Args:
            space: what may be changed.
            climbers: C, the number of searches.
            seed: of all random numbers.
        """
        checks.integer("climbers", climbers, 1, MOST_POINTS)
        checks.integer("seed", seed, 0, 2**63 - 1)
        self.space, self.climbers, self.seed = space, climbers, seed
        self.generation = 0
        self.points = np.full((climbers, space.size), np.nan)
        self.scores = np.full(climbers, np.nan)

    @property
    def wants(self) -> Wants:
        """Points of the space."""
        return "points"

    @property
    def sharpness(self) -> float:
        """Of no meaning for points of the space."""
        return 0.0

    @abstractmethod
    def ask(self) -> Floats:
        """One point per search, shape (C, D)."""

    def tell(self, points: Floats, evaluation: Evaluation) -> None:
        """Keep what is better; ``evaluation`` has a single objective."""
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
        """The best point of all searches (the first of equals) and of each."""
        best = int(np.argmax(np.where(np.isnan(self.scores), -np.inf, self.scores)))
        objectives = self.scores[:, None].copy()
        return SearchResult(self.points[best].copy(), float(self.scores[best]), self.points.copy(), objectives)

    def state(self) -> Arrays:
        """Generation, best points and scores."""
        return {
            "generation": np.array(self.generation),
            "points": self.points.copy(),
            "scores": self.scores.copy(),
        }

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Continue from :meth:`state`."""
        if state["points"].shape != self.points.shape:
            raise ValueError(f"state: points of shape {state['points'].shape}, expected {self.points.shape}")
        self.generation = int(state["generation"])
        self.points, self.scores = state["points"].copy(), state["scores"].copy()


def random_starts(
    space: Space, seed: int, generation: int, climbers: Sequence[int], start: Mapping[str, float]
) -> Floats:
    """A point for each of the climbers, shape (len(climbers), D): random but for the values given by name."""
    rngs = [generator(seed, generation, climber) for climber in climbers]
    return with_values(space, np.concatenate([space.sample(rng, 1) for rng in rngs]), start)
