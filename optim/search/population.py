"""The base class of methods that keep a population of points."""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from optim.problem import Evaluation
from optim.search import method
from optim.search.base import Search, table, whole
from taichi_sim.base.arrays import Floats, mean_of


@dataclass(eq=False, kw_only=True)
class PopulationSearch(Search):
    """Base class of methods that keep a population of N points, and the best point evaluated so far.

    A method defines ``ask`` and ``_take``, and names in ``arrays`` what else of it changes.

    Attributes:
        population: number N of points.
        seed: seed of all random numbers.
        start: values by name with which the search begins; the other variables start at random.
    """

    kind: ClassVar[method.Kept] = "population"  # what the points of the result are
    arrays: ClassVar[tuple[str, ...]] = ("points", "objectives", "best_point", "best_score")

    population: int = whole(60, 1, method.MOST_POINTS)
    seed: int = whole(0, 0, 2**63 - 1)
    start: Mapping[str, float] | None = table()

    def __post_init__(self) -> None:
        super().__post_init__()
        self.given: dict[str, float] = dict(self.start or {})
        method.with_values(self.space, self.space.low[None], self.given)
        self.points = np.full((self.population, self.space.size), np.nan)
        self.objectives = np.full((self.population, 1), np.nan)
        self.best_point, self.best_score = np.full(self.space.size, np.nan), np.nan

    def tell(self, points: Floats, evaluation: Evaluation) -> None:
        """Learn from the evaluation of the points asked for, and remember the best; or learn from their gradients."""
        if not self.several_objectives:
            method.single_objective(evaluation, len(points))
        elif len(evaluation.objectives) != len(points):
            given = f"{len(evaluation.objectives)} given for {len(points)} points"
            raise ValueError(f"evaluation: {given}; give one for each")
        if self.wants == "gradients":
            self._follow(method.slopes_per_range(evaluation, self.space, len(points)))
        else:
            self._remember(points, mean_of(evaluation.objectives, axis=1))
            self._take(points, evaluation)
        self.generation += 1

    def _remember(self, points: Floats, scores: Floats) -> None:
        """Keep the best of all points judged so far, the first of equals."""
        best = int(np.argmax(method.below_all(scores)))
        if self.generation == 0 or method.below_all(scores)[best] > method.below_all(self.best_score):
            self.best_point, self.best_score = points[best].copy(), float(scores[best])

    @abstractmethod
    def _take(self, points: Floats, evaluation: Evaluation) -> None:
        """Take in the judgement of the points asked for, before the generation is counted."""

    def _follow(self, slopes: Floats) -> None:
        """Take in the gradients of the points asked for [objective per range], if the method wants any."""

    def result(self) -> method.SearchResult:
        """Return the best point evaluated so far (the first of equals), and the points that the search keeps."""
        points, objectives = (values.copy() for values in self._kept())
        return method.SearchResult(
            self.best_point.copy(), self.best_score, points, objectives, self._numbers(), self.kind, self._grid()
        )

    def _grid(self) -> method.Grid | None:
        """The cells of elites."""
        return None

    def _kept(self) -> tuple[Floats, Floats]:
        """The points of the result and their objectives: the population."""
        return self.points, self.objectives

    def _numbers(self) -> Mapping[str, float | int | None]:
        """Further numbers for the log."""
        return {}

    def _starts(self) -> Floats:
        """The first population, shape (N, D): random but for the values given by name."""
        return method.with_values(self.space, self.space.sample(self._generator(), self.population), self.given)

    def _complete_start(self) -> Floats:
        """The start itself, shape (1, D), in generation 0 of a distribution around it; else none, shape (0, D).

        It is judged beside the points drawn, so that no search ends below where it began; the distribution is not told.
        Nor is anything judged where ``start`` leaves variables open.
        """
        complete = self.generation == 0 and set(self.given) == set(self.space.names)
        return method.with_values(self.space, self.space.low[None], self.given)[: int(complete)]

    def _generator(self, *stream: int) -> np.random.Generator:
        """Random numbers of this generation, the same however often they are asked for."""
        return method.generator(self.seed, self.generation, *stream)
