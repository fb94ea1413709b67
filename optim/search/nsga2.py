"""NSGA-II, a genetic algorithm for a front of several objectives, by the operators of pymoo.

Sources: Deb, Pratap, Agarwal & Meyarivan, A fast and elitist multiobjective genetic algorithm: NSGA-II, IEEE
Transactions on Evolutionary Computation 6(2), 2002; Blank & Deb, pymoo, IEEE Access 8, 2020.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np

from optim.measures.pareto import non_dominated
from optim.problem import Evaluation
from optim.search.base import number
from optim.search.method import Kept
from optim.search.population import PopulationSearch
from optim.search.unit_cube import into_cube, mutate_in_cube, out_of_cube
from taichi_sim.base.arrays import Floats
from taichi_sim.base.foreign import needing

LAST = 1_000_000  # rank of a failure


@dataclass(eq=False, kw_only=True)
class NSGA2(PopulationSearch):
    """Search by NSGA-II for a front of several objectives: of N points and their N children the best N survive.

    A point is better if it lies in an earlier non-dominated front, or in the same and less crowded. Parents win
    binary tournaments; children come by simulated binary crossover and polynomial mutation in the unit cube, where
    angles wrap and whole numbers are rounded. Failures survive only where successes are too few.
    The front is that of the last population: more than N points that nobody dominates are thinned out by crowding, so
    that points evaluated before may dominate some of it, and the best point need not be in it.
    Defaults are those of Deb et al. 2002, section IV.
    (differs: a child that is a copy of a point has at least one variable mutated, and a mutated whole number changes
    by at least one, or evaluations would be wasted.)

    Attributes:
        crossover_probability: probability that two parents are crossed; otherwise their children are copies, which
            are then mutated.
        crossover_index: distribution index of the crossover; the larger, the closer children are to parents.
        mutation_index: distribution index of the mutation, which changes one variable in D on average.
    """

    several_objectives: ClassVar[bool] = True
    kind: ClassVar[Kept] = "front"
    arrays: ClassVar[tuple[str, ...]] = ("ranks", "crowding")

    crossover_probability: float = number(0.9, 0, 1)
    crossover_index: float = number(20.0, 0, 1000)
    mutation_index: float = number(20.0, 0, 1000)

    def __post_init__(self) -> None:
        super().__post_init__()
        with needing("method", "pymoo, which nsga2 needs,", "moo"):
            from pymoo.util import default_random_state  # noqa: F401  older ones take no generators
        self.ranks, self.crowding = np.zeros(self.population, int), np.zeros(self.population)

    def ask(self) -> Floats:
        """Return the starting points, and later N children, shape (N, D)."""
        if self.generation == 0:
            return self._starts()
        rng = self._generator(1)
        crossed = self._crossed(self._parents(rng), rng)
        children, others = (
            mutate_in_cube(self.space, crossed, partial(self._mutated, rng=rng, at_least_once=forced))
            for forced in (False, True)
        )
        copies = (children[:, None] == self.points).all(axis=2).any(axis=1)
        return np.where(copies[:, None], others, children)

    def _parents(self, rng: np.random.Generator) -> Floats:
        """Winners of binary tournaments, two for each mating, shape (2, M, D). Everyone takes part about twice."""
        matings = -(-self.population // 2)
        draws = -(-4 * matings // self.population)
        entrants = np.concatenate([rng.permutation(self.population) for _ in range(draws)])[: 4 * matings]
        a, b = entrants.reshape(-1, 2).T
        earlier = self.ranks[b] < self.ranks[a]
        rarer = (self.ranks[b] == self.ranks[a]) & (self.crowding[b] > self.crowding[a])
        return self.points[np.where(earlier | rarer, b, a)].reshape(2, matings, self.space.size)

    def _crossed(self, parents: Floats, rng: np.random.Generator) -> Floats:
        """Two children of each mating, the last left out if N is odd, shape (N, D)."""
        from pymoo.operators.crossover.sbx import cross_sbx

        _, matings, size = parents.shape
        unit = into_cube(self.space, parents, parents[0])
        crossed = rng.random((matings, 1)) < self.crossover_probability
        children = cross_sbx(
            unit,
            np.zeros(size),
            np.ones(size),
            np.full((matings, 1), self.crossover_index),
            np.where(crossed, 0.5, 0.0),  # each variable with probability 1/2
            np.full((matings, 1), 0.5),
            random_state=rng,
        )
        changed = np.where(children == unit, parents, out_of_cube(self.space, children, parents[0]))
        return changed.reshape(-1, size)[: self.population]

    def _mutated(self, unit: Floats, rng: np.random.Generator, at_least_once: bool) -> Floats:
        """Points of the unit cube after polynomial mutation."""
        from pymoo.operators.mutation.pm import mut_pm

        count, size = unit.shape
        index, probability = np.full(count, self.mutation_index), np.full(count, 1 / size)
        return mut_pm(unit, np.zeros(size), np.ones(size), index, probability, at_least_once, random_state=rng)

    def _take(self, points: Floats, evaluation: Evaluation) -> None:
        """Let the best N of parents and children survive."""
        objectives = evaluation.objectives
        if self.generation:
            points = np.concatenate([self.points, points])
            objectives = np.concatenate([self.objectives, objectives])
        succeeded, failed = (np.flatnonzero(np.isnan(objectives).any(axis=1) == wrong) for wrong in (False, True))
        chosen, ranks, crowding = self._survivors(objectives[succeeded])
        spare = self.population - len(chosen)
        kept = np.concatenate([succeeded[chosen], failed[:spare]])
        self.points, self.objectives = points[kept], objectives[kept]
        self.ranks = np.append(ranks, np.full(spare, LAST))
        self.crowding = np.append(crowding, np.zeros(spare))

    def _survivors(self, objectives: Floats) -> tuple[Floats, Floats, Floats]:
        """Rows, at most N, of successes that survive, the ranks of their fronts, and their crowding distances."""
        from pymoo.core.population import Population
        from pymoo.core.problem import Problem
        from pymoo.operators.survival.rank_and_crowding import RankAndCrowding

        if not len(objectives):
            return np.empty(0, int), np.empty(0, int), np.empty(0)
        everyone = Population.new("F", -objectives)  # pymoo minimises
        rows = RankAndCrowding().do(
            Problem(n_var=self.space.size, n_obj=objectives.shape[1]),
            everyone,
            n_survive=self.population,
            random_state=self._generator(2),
            return_indices=True,
        )
        survivors = everyone[rows]
        return np.array(rows), survivors.get("rank").astype(int), survivors.get("crowding").astype(float)

    def _kept(self) -> tuple[Floats, Floats]:
        """The points that nobody in the population dominates."""
        front = non_dominated(self.objectives)
        return self.points[front], self.objectives[front]

    def _numbers(self) -> Mapping[str, float | int | None]:
        """Size of the front."""
        return {"front": int(non_dominated(self.objectives).sum())}
