"""What methods share that move one population of points."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from optim.problem import Evaluation
from optim.search.method import MOST_POINTS, Kept, SearchResult, Wants, generator, single_objective, with_values
from optim.space import Space
from taichi_sim.base import checks
from taichi_sim.base.arrays import Arrays, Floats


class PopulationSearch(ABC):
    """N points that a method keeps, and the best point that it ever met.

    A method defines ``ask`` and ``_take``, and names in ``arrays`` what else of it changes.
    """

    several_objectives: ClassVar[bool] = False
    kind: ClassVar[Kept] = "population"  # what the points of the result are
    arrays: ClassVar[tuple[str, ...]] = ()  # attributes, arrays all of them, that change beside those below

    def __init__(
        self, space: Space, *, population: int = 60, seed: int = 0, start: Mapping[str, float] | None = None
    ) -> None:
        """Set up the search.

        Args:
            space: what may be changed.
            population: N, the number of points.
            seed: of all random numbers.
            start: values by name with which the search begins; the other variables start at random.
        """
        checks.integer("population", population, self._smallest(), MOST_POINTS)
        checks.integer("seed", seed, 0, 2**63 - 1)
        self.space, self.population, self.seed = space, population, seed
        self.start = dict(start or {})
        self.generation = 0
        self.points = np.full((population, space.size), np.nan)
        self.objectives = np.full((population, 1), np.nan)
        self.best_point, self.best_score = np.full(space.size, np.nan), np.array(np.nan)
        self._starts()

    @classmethod
    def _smallest(cls) -> int:
        """The smallest population allowed."""
        return 1

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
        """The points to evaluate next, shape (M, D)."""

    def tell(self, points: Floats, evaluation: Evaluation) -> None:
        """Remember the best, and move on."""
        if not self.several_objectives:
            single_objective(evaluation, len(self.ask()))
        elif len(evaluation.objectives) != len(points):
            raise ValueError(
                f"evaluation: {len(evaluation.objectives)} given for {len(points)} points; give one for each"
            )
        scores = evaluation.objectives.mean(axis=1)
        best = int(np.argmax(below_all(scores)))
        if self.generation == 0 or below_all(scores)[best] > below_all(self.best_score):
            self.best_point, self.best_score = points[best].copy(), np.array(scores[best])
        self._take(points, evaluation)
        self.generation += 1

    @abstractmethod
    def _take(self, points: Floats, evaluation: Evaluation) -> None:
        """Take in the judgement of the points asked for, before the generation is counted."""

    def result(self) -> SearchResult:
        """The best point ever met (the first of equals) and what the search keeps."""
        points, objectives = (values.copy() for values in self._kept())
        return SearchResult(
            self.best_point.copy(), float(self.best_score), points, objectives, self._numbers(), self.kind
        )

    def _kept(self) -> tuple[Floats, Floats]:
        """The points of the result and their objectives: the population."""
        return self.points, self.objectives

    def _numbers(self) -> Mapping[str, float | int | None]:
        """What the log shall tell of the search beside its points."""
        return {}

    def state(self) -> Arrays:
        """Generation, population, the best point ever, and what else changes."""
        names = ("points", "objectives", "best_point", "best_score", *self.arrays)
        return {"generation": np.array(self.generation)} | {name: getattr(self, name).copy() for name in names}

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Continue from :meth:`state`."""
        if state["points"].shape != self.points.shape:
            raise ValueError(f"state: points of shape {state['points'].shape}, expected {self.points.shape}")
        self.generation = int(state["generation"])
        for name in ("points", "objectives", "best_point", "best_score", *self.arrays):
            setattr(self, name, state[name].copy())

    def _starts(self) -> Floats:
        """The first population, shape (N, D): random but for the values given by name."""
        return with_values(self.space, self.space.sample(self._generator(), self.population), self.start)

    def _given(self) -> Floats:
        """The start itself, shape (1, D), in generation 0 of a distribution around it; else none, shape (0, D).

        It is judged beside the points drawn, so that no search ends below where it began; the distribution is not told.
        Nor is anything judged where ``start`` leaves variables open.
        """
        complete = self.generation == 0 and set(self.start) == set(self.space.names)
        return with_values(self.space, self.space.low[None], self.start)[: int(complete)]

    def _generator(self, *stream: int) -> np.random.Generator:
        """Random numbers of this generation; the same as often as asked."""
        return generator(self.seed, self.generation, *stream)


def below_all(scores: Floats) -> Floats:
    """Scores in which a failure (NaN) is below every success."""
    return np.where(np.isnan(scores), -np.inf, scores)
