"""Differential evolution: steps are differences between members of the population.

Sources: Storn & Price, J. Global Optim. 11, 1997 (rand/1/bin, best/1/bin, rand/2/bin); Das & Suganthan, IEEE Trans.
Evol. Comput. 15, 2011 (survey; dither of the weight); Zhang & Sanderson, IEEE Trans. Evol. Comput. 13, 2009
(current-to-pbest); Lampinen & Zelinka, Mendel 1999 (mixed variables: whole numbers are rounded to be judged only).
"""

from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np

from optim.problem import Evaluation
from optim.search.base import number, whole
from optim.search.method import MOST_POINTS, below_all
from optim.search.population import PopulationSearch
from optim.search.variation import Bounds, around_start, draw_inside, ranking
from optim.space import Space
from taichi_sim.base import checks
from taichi_sim.base.arrays import Bools, Floats, Indices

Strategy = Literal["rand/1/bin", "rand/2/bin", "best/1/bin", "current-to-pbest/1/bin"]
OTHERS = {"rand/1/bin": 3, "rand/2/bin": 5, "best/1/bin": 3, "current-to-pbest/1/bin": 3}  # members drawn for a trial
PBEST = 0.1  # p of current-to-pbest: the part of the population that counts as best

USUAL_DITHER = 0.3  # how far weights of trials are drawn from the weight


@dataclass(eq=False, kw_only=True)
class DifferentialEvolution(PopulationSearch):
    """Search by differential evolution: each of N members is replaced by a trial point that is at least as good.

    Generation 0 evaluates random starts. Equals replace so that the population moves on plateaus; a trial that
    failed replaces none but a member that failed too. Members keep real values of their whole numbers, from half
    below ``low`` to half above ``high`` (of a binary: from 0 to 1), which are rounded to be judged only: differences
    between members then do not die out as soon as their whole numbers agree. Differences of angles are taken the
    short way round. Trials are reflected at the bounds.

    The default strategy is greedier than ``"rand/2/bin"``, and needs fewer evaluations.

    With ``trials`` the population is not replaced by generations: T members, drawn anew every time, get a trial each.
    Then no generation judges all starts; a start is judged beside every trial of it, until one replaces it.

    Attributes:
        population: number N of members, at least 4, and 6 for ``"rand/2/bin"``.
        start: values by name of the first member; the others start with these mutated by a step of the
            variable, and with random values of the other variables.
        strategy: where a mutant comes from, see :meth:`_mutants`.
        weight: F, the factor of the differences.
        dither: F of a trial is drawn evenly from ``weight - dither`` to ``weight + dither``.
        crossover: CR, the probability that a variable of the trial comes from the mutant; one always does.
        trials: T, the number of trials of a generation, at most N; 0: generation 0 judges the starts, then every
            member gets one.
        bounds: ``"reflect"``, or ``"random"``: what lies beyond a bound is drawn evenly between member and bound.
    """

    arrays: ClassVar[tuple[str, ...]] = ("values",)

    population: int = whole(60, 4, MOST_POINTS)
    strategy: Strategy = "current-to-pbest/1/bin"
    weight: float = number(0.5, 0.0, 2.0)
    dither: float = number(USUAL_DITHER, 0.0, "weight")
    crossover: float = number(0.5, 0.0, 1.0)
    trials: int = whole(0, 0, "population")
    bounds: Bounds = "reflect"

    def __post_init__(self) -> None:
        is_number = isinstance(self.weight, int | float)
        if is_number and self.dither == USUAL_DITHER > self.weight >= 0:  # it is the weight that was given
            allowed = f"give dither from 0 to {self.weight:g}, too"
            raise ValueError(f"weight: {self.weight:g} is not allowed with a dither of {self.dither:g}; {allowed}")
        super().__post_init__()
        checks.integer("population", self.population, OTHERS[self.strategy] + 1, MOST_POINTS)
        self.inner = _widened(self.space)
        self.values = np.full(self.points.shape, np.nan)
        if self.trials:
            self.values, self.points = self._first_values(), self._starts()

    def ask(self) -> Floats:
        """Return the starts, then a trial for each member, shape (N, D); or T trials, and members not yet evaluated."""
        targets = self._targets()
        return np.concatenate([self._rounded(self._trials(targets)), self.points[targets[self._unjudged(targets)]]])

    def _take(self, points: Floats, evaluation: Evaluation) -> None:
        """Replace the members whose trials are at least as good."""
        targets = self._targets()
        trials, rivals = self._trials(targets), self.objectives[targets]
        scores, rivals[self._unjudged(targets)] = np.split(evaluation.objectives, [len(targets)])
        taken = (below_all(scores) >= below_all(rivals))[:, 0]
        members = targets[taken]
        self.values[members], self.points[members] = trials[taken], points[: len(trials)][taken]
        self.objectives[members] = scores[taken]

    def _targets(self) -> Indices:
        """The members that get a trial, shape (N,) or (T,)."""
        everyone = np.arange(self.population)
        return self._generator(1).choice(everyone, self.trials, replace=False) if self.trials else everyone

    def _unjudged(self, targets: Indices) -> Bools:
        """Which of these have no score yet to compare their trials with, shape (N,) or (T,)."""
        return np.isnan(self.objectives[targets, 0]) & (self.trials > 0)  # in generations only what failed has none

    def _starts(self) -> Floats:
        return self._rounded(self._first_values())

    def _first_values(self) -> Floats:
        rng = self._generator()
        values = self.inner.sample(rng, self.population)
        return self.inner.reflect(around_start(self.space, values, self.given, rng))

    def _rounded(self, values: Floats) -> Floats:
        return self.space.clip(self.space.round(values))

    def _trials(self, targets: Indices) -> Floats:
        """Real values of the starts, shape (N, D), or of a trial for each target, shape (N, D) or (T, D)."""
        if self.generation == 0 and not self.trials:
            return self._first_values()
        rng = self._generator()
        weights = self.weight + self.dither * rng.uniform(-1, 1, (len(targets), 1))
        mutants = self._mutants(rng, weights, targets)
        crossed = rng.random(mutants.shape) < self.crossover
        crossed[np.arange(len(targets)), rng.integers(0, self.space.size, len(targets))] = True
        trials = np.where(crossed, mutants, self.values[targets])
        if self.bounds == "reflect":
            return self.inner.reflect(trials)
        return draw_inside(self.inner, trials, self.values[targets], rng)

    def _mutants(self, rng: np.random.Generator, weights: Floats, targets: Indices) -> Floats:
        """Base + F (difference), shape (T, D), not yet brought into the bounds.

        With r1 to r5 others than the member x and each other, all drawn evenly:

        - rand/1: r1 + F (r2 - r3)
        - rand/2: r1 + F (r2 - r3) + F (r4 - r5)
        - best/1: best + F (r2 - r3)
        - current-to-pbest/1: x + F (p - x) + F (r2 - r3), p drawn from the best tenth
        """
        others = self.values[distinct_others(rng, targets, self.population, OTHERS[self.strategy])]
        base, difference = others[0], self._difference(others[1], others[2])
        if self.strategy == "rand/2/bin":
            difference = difference + self._difference(others[3], others[4])
        elif self.strategy == "best/1/bin":
            base = self.values[ranking(self.objectives[:, 0])[:1]]
        elif self.strategy == "current-to-pbest/1/bin":
            elite = ranking(self.objectives[:, 0])[: max(1, round(PBEST * self.population))]
            base = self.values[targets]
            difference = difference + self._difference(self.values[rng.choice(elite, len(targets))], base)
        return base + weights * difference

    def _difference(self, values: Floats, origin: Floats) -> Floats:
        return self.inner.offset(values, origin) * self.inner.span


def distinct_others(rng: np.random.Generator, members: Indices, population: int, count: int) -> Indices:
    """Draw for each of T members ``count`` other members, which differ from each other, shape (count, T)."""
    taken = members[None]
    for _ in range(count):
        drawn = rng.integers(0, population - len(taken), len(members))  # among those that are not taken
        for before in np.sort(taken, axis=0):
            drawn = drawn + (drawn >= before)
        taken = np.concatenate([taken, drawn[None]])
    return taken[1:]


def _widened(space: Space) -> Space:
    """The space of real values whose rounding is evenly spread over the points of a space."""
    relaxed = (
        replace(v, kind="continuous", low=v.low - 0.5, high=v.high + 0.5) if v.kind == "integer" else v
        for v in space.relaxed().variables
    )
    return Space(tuple(relaxed))
