"""The Borg MOEA, a search for a front of several objectives with adaptive operators and restarts.

Source: Hadka & Reed, Borg: an auto-adaptive many-objective evolutionary computing framework, Evolutionary Computation
21(2), 2013.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from optim.measures.pareto import dominates
from optim.problem import Evaluation
from optim.search.base import table, whole
from optim.search.borg_operators import OPERATORS, OperatorParameters, breed, uniform_mutation
from optim.search.epsilon_archive import EpsilonArchive
from optim.search.method import Kept
from optim.search.population import PopulationSearch
from taichi_sim.base import checks
from taichi_sim.base.arrays import Floats, Ints

RATIO = 4.0  # gamma: members of the population for each of the archive
TOLERANCE = 0.25  # by how much the population may differ from that
TOURNAMENT = 0.02  # tau: of the population takes part in a tournament
NOBODY = -1  # label of what no operator made


@dataclass(eq=False, kw_only=True)
class Borg(PopulationSearch):
    """Search by the Borg MOEA for a front of several objectives, with a population and an epsilon-box archive.

    A child has one parent from the archive; the others win tournaments of the population (by dominance). Operators
    are drawn in proportion to how many members of the archive they made, plus one. A child replaces a member of the
    population that it dominates, or, where nothing dominates it, any. The population restarts, from the archive and
    mutants of it, if no new box was reached in a while, or if it is not about four times as large as the archive.

    Differs from the paper: all children of a generation (N, unless set) are bred from the same population and archive,
    and then taken in one after the other; an operator gives one child; restarts are considered between generations,
    once ``window`` evaluations have passed since the last time or since the mutants of a restart are judged; at least
    one variable is drawn anew by uniform mutation; failures are left out of everything, and while the population is
    short of members, every success joins it; the population never becomes smaller than N.

    Attributes:
        population: number N of points at first, and the smallest size of the population.
        epsilons: sides of the archive's boxes, one for all objectives or one for each, in their units; smaller
            differences of objectives do not matter.
        window: evaluations after which the search restarts if no new box was reached.
        children: points asked for at a time after the starts; N if None. The paper breeds one at a time.
        operators: parameters of the operators by name, see ``OperatorParameters``, that replace the published ones.
    """

    several_objectives: ClassVar[bool] = True
    kind: ClassVar[Kept] = "front"
    archived: ClassVar[tuple[str, ...]] = ("archive_points", "archive_objectives", "archive_labels")
    counters: ClassVar[tuple[str, ...]] = ("size", "missing", "restarts", "progress", "passed")
    arrays: ClassVar[tuple[str, ...]] = ("members", "member_objectives", *counters, *archived)

    epsilons: float | Sequence[float] = 0.01
    window: int = whole(200, 1)
    children: int | None = whole(None, 1)
    operators: Mapping[str, float] | None = table()

    def __post_init__(self) -> None:
        super().__post_init__()
        for epsilon in self.epsilons if isinstance(self.epsilons, Sequence) and self.epsilons else [self.epsilons]:
            checks.number("epsilons", epsilon, 1e-12, 1e12)
        known = OperatorParameters.__dataclass_fields__
        for name in self.operators or {}:
            if name not in known:
                raise ValueError(f"operators: {name!r} is unknown; its parameters are {', '.join(known)}")
        self.sides = np.array(self.epsilons, float)
        self.parameters = OperatorParameters(**dict(self.operators or {}))  # type: ignore[arg-type]
        self.brood = self.children or self.population
        self._begin(max(self.sides.size, 1))

    def _begin(self, count: int) -> None:
        """Set up an empty population and archive for ``count`` objectives."""
        if self.sides.size not in (1, count):
            raise ValueError(f"epsilons: {self.sides.size} given for {count} objectives; give one, or one for each")
        self.archive_points, self.archive_objectives = np.empty((0, self.space.size)), np.empty((0, count))
        self.archive_labels = np.empty(0, np.int64)
        self.members, self.member_objectives = self.archive_points.copy(), self.archive_objectives.copy()
        self.size = self.population  # that the population shall have
        self.missing = 0  # mutants of a restart yet to be asked for
        self.restarts, self.progress, self.passed = 0, 0, 0

    @property
    def archive(self) -> EpsilonArchive:
        """Archive of the points on the front, at most one per box of objectives."""
        epsilons = np.broadcast_to(self.sides, self.archive_objectives.shape[1]).copy()
        return EpsilonArchive(epsilons, self.archive_points, self.archive_objectives, self.archive_labels)

    def ask(self) -> Floats:
        """Return the starting points, shape (N, D); later mutants of a restart, if any are missing, and children."""
        if self.generation == 0:
            return self._starts()
        if not len(self.archive_points):
            return self.space.sample(self._generator(), self.brood)
        makers, rng = self._makers(), self._generator(1)
        points = np.empty((self.brood, self.space.size))
        points[makers == NOBODY] = uniform_mutation(self.space, self._archived(np.sum(makers == NOBODY), rng), rng)
        for k, operator in enumerate(OPERATORS):
            rng, mine = self._generator(2, k), makers == k
            if mine.any():
                parents = self._parents(self.parameters.count(operator), int(mine.sum()), rng)
                points[mine] = breed(self.space, operator, parents, self.parameters, rng)
        return points

    def probabilities(self) -> Floats:
        """Probability with which each of ``OPERATORS`` is drawn, shape (6,) (paper, section 3, with zeta = 1)."""
        made = self.archive_labels[self.archive_labels != NOBODY]
        counts = np.bincount(made, minlength=len(OPERATORS)) + 1.0
        return counts / counts.sum()

    def _makers(self) -> Ints:
        """Operator that makes each point of this generation, shape (M,); mutants, which ``NOBODY`` made, come first."""
        count = self.population if self.generation == 0 else self.brood
        makers = self._generator(3).choice(len(OPERATORS), count, p=self.probabilities())
        nobody = self.missing if len(self.archive_points) else count
        return np.where(np.arange(count) < nobody, NOBODY, makers)

    def _parents(self, count: int, matings: int, rng: np.random.Generator) -> Floats:
        """The parents of each mating, shape (count, M, D), the one from the archive first."""
        first = self._archived(matings, rng)
        entrants = max(2, int(TOURNAMENT * len(self.members)))
        winners, *others = rng.integers(len(self.members), size=(entrants, count - 1, matings))
        for other in others:
            better = dominates(self.member_objectives[other], self.member_objectives[winners])
            winners = np.where(better, other, winners)
        return np.concatenate([first[None], self.members[winners]])

    def _archived(self, count: int, rng: np.random.Generator) -> Floats:
        """Points of the archive drawn at random, shape (count, D)."""
        return self.archive_points[rng.integers(len(self.archive_points), size=count)]

    def _take(self, points: Floats, evaluation: Evaluation) -> None:
        """Offer the successes to the archive and the population, one after the other; then restart if need be."""
        if self.generation == 0:
            self._begin(evaluation.objectives.shape[1])
        makers, rng, archive = self._makers(), self._generator(4), self.archive
        for point, objectives, maker in zip(points, evaluation.objectives, makers.tolist(), strict=True):
            if not np.isnan(objectives).any():
                archive, progressed = archive.with_point(point, objectives, maker)
                self.progress += progressed
                self._join(point, objectives, rng)
        self.archive_points, self.archive_objectives = archive.points, archive.objectives
        self.archive_labels = archive.labels
        mutants = min(self.missing, len(points))
        self.missing, self.passed = self.missing - mutants, self.passed + len(points) - mutants
        if not self.missing and self.passed >= self.window and len(archive.points):
            self._consider_restart()

    def _join(self, point: Floats, objectives: Floats, rng: np.random.Generator) -> None:
        """Put a success into the population if it deserves it (paper, section 3)."""
        if len(self.members) < self.size:
            self.members = np.concatenate([self.members, point[None]])
            self.member_objectives = np.concatenate([self.member_objectives, objectives[None]])
            return
        beaten = np.flatnonzero(dominates(objectives, self.member_objectives))
        if not beaten.size and dominates(self.member_objectives, objectives).any():
            return
        left = int(rng.choice(beaten)) if beaten.size else int(rng.integers(len(self.members)))
        self.members[left], self.member_objectives[left] = point, objectives

    def _consider_restart(self) -> None:
        """Begin again from the archive if the search stands still, or the population has the wrong size."""
        archived = len(self.archive_points)
        wanted = max(self.population, int(RATIO * archived))
        if not self.progress or abs(self.size - wanted) > TOLERANCE * wanted:
            self.members, self.member_objectives = self.archive_points.copy(), self.archive_objectives.copy()
            self.size, self.missing = wanted, max(0, wanted - archived)
            self.restarts += 1
        self.progress, self.passed = 0, 0

    def _kept(self) -> tuple[Floats, Floats]:
        """The archive; none of its points dominates another."""
        return self.archive_points, self.archive_objectives

    def _numbers(self) -> Mapping[str, float | int | None]:
        """Sizes of archive and population, restarts, and the probabilities of the operators."""
        sizes = {"front": len(self.archive_points), "population": len(self.members), "restarts": self.restarts}
        return sizes | dict(zip(OPERATORS, self.probabilities().tolist(), strict=True))
