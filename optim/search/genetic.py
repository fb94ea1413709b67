"""A genetic algorithm over mixed variables: tournaments, crossover, mutation, elites.

Sources: Goldberg & Deb, Foundations of Genetic Algorithms 1, 1991 (tournament selection); Syswerda, Proc. ICGA 1989
(uniform crossover); Eshelman & Schaffer, Foundations of Genetic Algorithms 2, 1993 (BLX-alpha); Mühlenbein, Proc.
PPSN 1992 (mutation of one variable in D).
"""

from dataclasses import dataclass

import numpy as np

from optim.problem import Evaluation
from optim.search.base import number, whole
from optim.search.method import MOST_POINTS, below_all
from optim.search.neighbourhood import Neighbourhood
from optim.search.population import PopulationSearch
from optim.search.variation import around_start, mutation_steps, ranking
from taichi_sim.base.arrays import Floats, Indices

ALPHA = 0.5  # of BLX: how far beyond its parents a child may lie, of their distance


@dataclass(eq=False, kw_only=True)
class GeneticSearch(PopulationSearch):
    """Search by a genetic algorithm: N members have N children per generation, of parents that win tournaments.

    Generation 0 evaluates random starts, of which the best N are the population. The next population is the best N of
    all children and of the ``elites`` best members; of equals a child goes first, so that the population moves on
    plateaus, and a failure comes last.

    Attributes:
        start: values by name of the first member; the others start with these mutated by a step of the variable (a
            tenth of the range if it has none), and with random values of the other variables.
        tournament: members drawn for a parent, of which the best becomes it.
        crossover: probability that a child has two parents, not one.
        mutation: probability that a variable of a child mutates; one in D if None.
        resetting: probability that a variable which mutates is drawn anew from all of its range ("random
            resetting", Eiben & Smith, Introduction to Evolutionary Computing, 2015, 4.3.1), where steps lead
            nowhere.
        patches: probability that a child mutates in a patch of cells instead, where variables have places: one
            variable of cells side by side changes by the same step, or cells are added or removed together, inside
            or at the surface.
        elites: members that compete with the children for a place: 0, none survives its generation; N, the best
            of parents and children do ("mu + lambda"); a tenth of N, at least 1, if None.
        starts: points of generation 0, at least N, which is meant by None. Many find what is rare.
    """

    population: int = whole(60, 2, MOST_POINTS)
    tournament: int = whole(2, 1, 1000)
    crossover: float = number(0.9, 0.0, 1.0)
    mutation: float | None = number(None, 0.0, 1.0)
    resetting: float = number(0.0, 0.0, 1.0)
    patches: float = number(0.0, 0.0, 1.0)
    elites: int | None = whole(None, 0)
    starts: int | None = whole(None, "population", MOST_POINTS)

    def __post_init__(self) -> None:
        super().__post_init__()
        count = self.population
        self.first = count if self.starts is None else self.starts
        self.rate = 1 / self.space.size if self.mutation is None else self.mutation
        self.survivors = max(1, count // 10) if self.elites is None else min(self.elites, count)
        self.steps = mutation_steps(self.space)
        self.whole = self.space.integers
        self.binary = self.whole & ~self.space.relaxed().integers
        self.neighbourhood = Neighbourhood(self.space) if self.patches else None

    def ask(self) -> Floats:
        """Return the starting points, and later N children, shape (N, D)."""
        return self._starts() if self.generation == 0 else self._children(self._generator())

    def _take(self, points: Floats, evaluation: Evaluation) -> None:
        """Keep the best of the children and the elites, or of the starting points."""
        if self.generation == 0:
            best = np.sort(ranking(evaluation.objectives[:, 0])[: self.population])
            self.points, self.objectives = points[best], evaluation.objectives[best]
            return
        elite = ranking(self.objectives[:, 0])[: self.survivors]
        points = np.concatenate([points, self.points[elite]])
        objectives = np.concatenate([evaluation.objectives, self.objectives[elite]])
        kept = ranking(objectives[:, 0])[: self.population]
        self.points, self.objectives = points[kept], objectives[kept]

    def _starts(self) -> Floats:
        rng = self._generator()
        points = self.space.sample(rng, self.first)
        return self.space.reflect(self.space.round(around_start(self.space, points, self.given, rng)))

    def _children(self, rng: np.random.Generator) -> Floats:
        """One child for each member, shape (N, D); none equals its first parent, but for chance in mutating."""
        first, second = self.points[self._parents(rng)], self.points[self._parents(rng)]
        children = np.where(rng.random((self.population, 1)) < self.crossover, self._crossed(rng, first, second), first)
        chosen = rng.random(children.shape) < self.rate
        alone = rng.integers(0, self.space.size, self.population)
        clones = (children == first).all(axis=1) | (children == second).all(axis=1)
        chosen[np.arange(self.population), alone] |= clones & ~chosen.any(axis=1)
        mutants = self._mutated(rng, children)
        if self.resetting:
            anew = rng.random(children.shape) < self.resetting
            mutants = np.where(anew, self.space.sample(rng, self.population), mutants)
        if self.neighbourhood is not None:
            rows = np.flatnonzero(rng.random(self.population) < self.patches)
            chosen[rows] = self.neighbourhood.patches(rng, children[rows])
            mutants[rows] = self._moved(children[rows], rng.standard_normal((len(rows), 1)))
        return self.space.reflect(self.space.round(np.where(chosen, mutants, children)))

    def _parents(self, rng: np.random.Generator) -> Indices:
        """The winners of N tournaments, shape (N,)."""
        drawn = rng.integers(0, self.population, (self.population, self.tournament))
        won = below_all(self.objectives[:, 0])[drawn].argmax(axis=1)
        return drawn[np.arange(self.population), won]

    def _crossed(self, rng: np.random.Generator, first: Floats, second: Floats) -> Floats:
        """Numbers between the parents and around (BLX-alpha), of angles the short way; whole numbers of either."""
        away = self.space.offset(second, first) * self.space.span
        share = rng.uniform(-ALPHA, 1 + ALPHA, first.shape)
        blended = self.space.reflect(first + share * away)
        return np.where(self.whole, np.where(rng.random(first.shape) < 0.5, first, second), blended)

    def _mutated(self, rng: np.random.Generator, points: Floats) -> Floats:
        """All variables changed, each by a deviate of its own."""
        return self._moved(points, rng.standard_normal(points.shape))

    def _moved(self, points: Floats, deviates: Floats) -> Floats:
        """All variables changed: by normal deviates, whole numbers by at least 1, binary ones to the other value."""
        away = self.steps * deviates
        least = np.where(away < 0, -1.0, 1.0)
        whole = np.where(abs(away) < 1, least, np.rint(away))
        return np.where(self.binary, 1 - points, points + np.where(self.whole, whole, away))
