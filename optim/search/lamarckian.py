"""Evolution and learning: a genetic algorithm whose children follow gradients before they compete.

Sources: Hinton & Nowlan, Complex Systems 1, 1987 (learning guides evolution); Whitley, Gordon & Mathias, Proc. PPSN
1994 (Lamarckian: what a member learns in its life is inherited); Kingma & Ba, ICLR 2015 (Adam).
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from optim.problem import Evaluation
from optim.search import method
from optim.search.base import hidden, number, positive, whole
from optim.search.genetic import GeneticSearch
from optim.search.step_rules import Adam, free_variables
from taichi_sim.base.arrays import Arrays, Floats


@dataclass(eq=False, kw_only=True)
class LamarckianSearch(GeneticSearch):
    """Search by evolution and learning: whole numbers evolve, and continuous variables of each child follow gradients.

    A life is ``learning`` steps of Adam, each from the gradient at a true point, whose whole numbers stay. A child is
    the best point of its life, and competes as such: a new body is not judged before it has learnt to move. What it
    has learnt its children inherit, unless ``inherit`` is false: then learning only tells what a child is worth
    (Baldwin's effect). A failure is taken half way back to the last point that did not fail.

    A child has the whole numbers of both parents, and all else of the first; with ``patches`` it has a patch of cells
    of the second, with all that these have learnt, and most else of the first.

    Attributes:
        mutation: probability that a variable of a child mutates; if None, one in as many as there are whole numbers,
            or others, for each of these.
        elites: members that compete with the children for a place; all if None ("mu + lambda").
        learning: gradient steps in a life, which costs as many gradients and one evaluation.
        learning_rate: typical step of the boldest child [ranges of the variables].
        caution: step of the most cautious child, as a part of ``learning_rate``; each child draws its own between both.
        clip: length to which longer gradients are shortened [objective per range].
        inherit: whether children begin with the values that their parents learnt, or that these were born with.
    """

    takes_gradients = True

    arrays: ClassVar[tuple[str, ...]] = ("learners", "anchor", "lived", "lived_scores", "age", "lives")

    starts: int | None = hidden(None)
    learning: int = whole(8, 1)
    learning_rate: float = positive(0.05, 1.0)
    caution: float = number(0.2, 1e-6, 1.0)
    clip: float = positive(1.0, 1e12)
    inherit: bool = True

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.whole.all():
            raise ValueError(f"{self.space.names[0]}: an integer has no gradient, nor has any other; use genetic")
        if self.mutation is None:
            share = self.whole.mean()
            self.rate = 1 / (self.space.size * np.where(self.whole, share, 1 - share))
        if self.elites is None:
            self.survivors = self.population
        shape = self.points.shape
        self.rule = Adam(*shape, 1.0, self.clip)
        self.learners = self._starts()
        self.birth: Arrays = {} if self.inherit else {"points": self.learners.copy()}
        self.anchor = np.full(shape, np.nan)  # of each, the last point that did not fail
        self.lived, self.lived_scores = (
            np.full(shape, np.nan),
            np.full(len(self.learners), np.nan),
        )  # the best of a life
        self.age, self.lives = 0, 0

    @property
    def wants(self) -> method.Wants:
        """Gradients of true points; at the end of a life only their scores."""
        return "gradients" if self.age < self.learning else "points"

    @property
    def sharpness(self) -> float:
        """Sharpness of the points: infinite, as gradients are taken at true points."""
        return math.inf

    def ask(self) -> Floats:
        """Return the children at their present stage of learning, shape (N, D)."""
        return self.learners.copy()

    def tell(self, points: Floats, evaluation: Evaluation) -> None:
        """Let the children learn from their gradients, or compete for survival at the end of their lives."""
        scores = method.single_objective(evaluation, len(points))
        if self.wants == "gradients":
            slopes = method.slopes_per_range(evaluation, self.space, len(points))
            self._live(points, scores)
            self._learn(scores, slopes)
            self.age += 1
        else:
            self._live(points, scores)
            lasting = self.lived if self.inherit else self.birth["points"]
            self._take(lasting.copy(), Evaluation(self.lived_scores))
            self._bear()
        self.generation += 1

    def _live(self, points: Floats, scores: Floats) -> None:
        """Remember the best point of each life, and of all."""
        self._remember(points, scores)
        better = (method.below_all(scores) > method.below_all(self.lived_scores)) | (self.age == 0)
        self.lived = np.where(better[:, None], points, self.lived)
        self.lived_scores = np.where(better, scores, self.lived_scores)

    def _learn(self, scores: Floats, slopes: Floats) -> None:
        """Move learners by a step of Adam of what is not whole, or half way back from a failure."""
        here = self.learners
        valid = method.sound(scores, slopes)
        slopes = np.where(valid[:, None] & ~self.whole, slopes, 0.0)
        steps = self._boldness() * self.rule.steps(valid, slopes, free_variables(self.space, here, slopes))
        steps = np.where(self.whole, 0.0, steps)
        back = self.space.offset(self.anchor, here) / 2
        moved = np.where(valid[:, None], steps, np.where(np.isnan(back), 0.0, back))
        self.anchor = np.where(valid[:, None], here, self.anchor)
        self.learners = np.where(moved == 0, here, self.space.bound(here + moved * self.space.span))

    def _boldness(self) -> Floats:
        """Learning rate of each child, shape (N, 1), the same all its life."""
        drawn = method.generator(self.seed, self.lives, 1).random((self.population, 1))
        return np.asarray(self.learning_rate * self.caution**drawn)

    def _bear(self) -> None:
        """Begin the lives of the next children."""
        self.learners = self._children(self._generator())
        if not self.inherit:
            self.birth["points"] = self.learners.copy()
        self.rule.forget(np.ones(self.population, bool))
        self.anchor = np.full(self.points.shape, np.nan)
        self.age, self.lives = 0, self.lives + 1

    def _take(self, points: Floats, evaluation: Evaluation) -> None:
        if self.lives:
            super()._take(points, evaluation)
        else:
            self.points, self.objectives = points, evaluation.objectives.copy()

    def _crossed(self, rng: np.random.Generator, first: Floats, second: Floats) -> Floats:
        """The first parents, with whole numbers or patches of cells of the second ones."""
        if self.neighbourhood is None:
            taken = (rng.random(first.shape) < 0.5) & self.whole
        else:
            taken = self.neighbourhood.balls(rng, len(first))
        return np.where(taken, second, first)

    def _kept(self) -> tuple[Floats, Floats]:
        """The population, or the first lives so far."""
        return (self.points, self.objectives) if self.lives else (self.lived, self.lived_scores[:, None])

    def _numbers(self) -> Mapping[str, float | int | None]:
        """Whole lives."""
        return {"lives": self.lives}

    def _groups(self) -> Mapping[str, Arrays]:
        return {"rule": self.rule.arrays, "birth": self.birth}
