"""CMA-ES with margin whose mean is led by gradients."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from optim.problem import Evaluation
from optim.search.base import hidden, number, whole
from optim.search.cma import CMAESWithMargin
from optim.search.method import LARGEST, MOST_POINTS, Wants, below_all, check_slopes
from optim.search.step_rules import LBFGS
from taichi_sim.base.arrays import Floats

LENGTHS = (0.25, 1.0, 2.0)  # of the step: the points that are tried along it
UNIT = 40.0  # standard deviations in a unit of the quasi-Newton rule, which goes a quarter of one at most


@dataclass(eq=False, kw_only=True)
class CMAGradient(CMAESWithMargin):
    """Search by CMA-ES with margin, whose mean also follows gradients every few generations.

    After every ``every`` generations of points comes one of gradients, at the mean of the distribution with its
    binary variables relaxed, or around it. They give a quasi-Newton step of the mean: L-BFGS over the slopes at the
    means before, with the covariance C of the distribution for the first inverse Hessian, so that the step is the
    natural gradient C g as long as it knows nothing else. Points at ``LENGTHS`` of the step take the places of as
    many that would have been drawn, and are told to the strategy as any others (injection: Hansen, arXiv:1110.4181;
    differs: the step is limited to ten standard deviations along each axis, not in its length). If one of them beats
    all that were drawn, the mean goes all the way to it; paths and covariance stay as they were told.

    No step is taken on the word of a gradient alone, nor is a relaxed point ever the best. Integers have no slope;
    only their correlations move them. Where the objective is smooth in continuous variables, about half of the
    evaluations are saved, or more; with many binary ones it is quicker at first, and no surer in the end. Relaxed
    points are not sharpened: they are judged near true ones, between which the distribution chooses.

    Attributes:
        every: generations of points before one of gradients.
        samples: antithetic pairs of relaxed points, drawn from the distribution, whose mean gradient is taken; 0
            for the gradient at the mean alone.
        rate: first step, along the longest of the distribution's axes in it [standard deviations].
    """

    through_mixtures = True
    takes_gradients = True

    arrays: ClassVar[tuple[str, ...]] = ("anchor", "slope", "moved", "change", "step")

    random_mean: bool = hidden(False)
    separable: bool | None = hidden(False)
    every: int = whole(1, 1)
    samples: int = whole(0, 0, MOST_POINTS // 2)
    rate: float = number(4.0, 1e-3, UNIT / 4)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_slopes(self.space)
        self.relaxed = self.space.relaxed()
        self.sloped = ~self.relaxed.integers
        self._forget()

    def _forget(self) -> None:
        """Forget all that was learnt from gradients."""
        self.anchor, self.slope = np.full((2, self.space.size), np.nan)  # the last mean, and objective per range there
        self.moved, self.change = LBFGS(1, self.space.size, self.rate).arrays.values()
        self.step = np.zeros(self.space.size)  # to be tried next [ranges]; zeros for none

    @property
    def wants(self) -> Wants:
        """Points; after ``every`` generations of these, gradients once."""
        return "gradients" if self.generation % (self.every + 1) == self.every else "points"

    def ask(self) -> Floats:
        """Return N points, shape (N, D); or relaxed ones: the mean, (1, D), or samples around it, (2 * samples, D)."""
        if self.wants == "points":
            return super().ask()
        return self.relaxed.round(self.relaxed.reflect(self.space.low + self._around() * self.space.span))

    def _take(self, points: Floats, evaluation: Evaluation) -> None:
        """Take in scores as without gradients; then move the mean to a point on the step that beat all others."""
        tried, restarts = self._tried(), self.restarts
        scores = below_all(evaluation.objectives[:, 0])
        best = int(np.argmax(scores))
        super()._take(points, evaluation)
        if self.restarts > restarts:
            self._forget()
        elif scores[best] > scores[len(tried) :].max():
            self.strategy["mean"] = tried[best].copy()
        self.step = np.zeros(self.space.size)

    def _draw(self) -> tuple[Any, Floats, Floats]:
        """Draw points as without gradients, but with those on the step first."""
        strategy, places, raw = super()._draw()
        tried, mean = self._tried(), self.strategy["mean"]
        places[: len(tried)] = tried
        raw[: len(tried)] = mean + (tried - mean) / self._margin()  # as drawn before the margin widened it
        return strategy, places, raw

    def _tried(self) -> Floats:
        """Points on the step, shape (len(LENGTHS), D) or (0, D), discrete variables not yet rounded."""
        lengths = np.array(LENGTHS if self.step.any() else ()).reshape(-1, 1)
        return self._inside(self.strategy["mean"] + lengths * self.step)

    def _around(self) -> Floats:
        """Where gradients are taken: the mean, or antithetic pairs around it."""
        if not self.samples:
            return self._inside(self.strategy["mean"][None])
        deviates = self._generator(0).standard_normal((self.samples, self.space.size)) @ self._axes().T
        return self._inside(self.strategy["mean"] + np.concatenate([deviates, -deviates]))

    def _inside(self, places: Floats) -> Floats:
        return np.where(self.discrete, np.clip(places, 0.0, 1.0), places)

    def _margin(self) -> Floats:
        """Factors by which the margin widens the variables, shape (D,)."""
        return self.strategy.get("A", np.ones(self.space.size))

    def _axes(self) -> Floats:
        """Principal axes of the distribution, each as long as its standard deviation, shape (D, D), in columns."""
        squares, directions = np.linalg.eigh(self.strategy["C"] * np.outer(self._margin(), self._margin()))
        tiny = np.finfo(float).eps * squares.max()
        return self.strategy["sigma"] * directions * np.sqrt(np.maximum(squares, tiny))

    def _mean_slope(self, slopes: Floats) -> Floats:
        """Mean of the slopes of the points that did not fail [objective per range], shape (D,); else NaN."""
        # Beyond a bound, or an even number of ranges further, the reflection turns the slope round.
        turned = (np.mod(self._around(), 2) > 1) & ~self.space.angles & ~self.discrete
        finite = np.isfinite(slopes).all(axis=1)
        slopes = np.where(self.sloped, slopes, 0.0) * np.where(turned, -1, 1)
        valid = finite & (abs(slopes) < LARGEST).all(axis=1)
        return slopes[valid].mean(axis=0) if valid.any() else np.full(self.space.size, np.nan)

    def _follow(self, slopes: Floats) -> None:
        """Remember how the mean slope changed since the last mean, and step."""
        one, mean, slope = np.array([True]), self.strategy["mean"], self._mean_slope(slopes)
        if np.isnan(slope).any():
            return
        memory = self._rule(self.moved, self.change)
        if not np.isnan(self.slope).any():
            memory.learn(one, (mean - self.anchor)[None], (slope - self.slope)[None])
        self.moved, self.change = memory.arrays["moved"], memory.arrays["change"]
        self.anchor, self.slope = mean.copy(), slope

        axes = UNIT * self._axes()  # in their coordinates the covariance is that of the rule: of equal sides
        rule = self._rule(np.linalg.solve(axes, self.moved[0].T).T[None], self.change @ axes)
        steps = rule.steps(one, (slope @ axes)[None], np.ones((1, self.space.size), bool))
        self.step = axes @ steps[0]

    def _rule(self, moved: Floats, change: Floats) -> LBFGS:
        rule = LBFGS(1, self.space.size, self.rate / UNIT)
        rule.arrays = {"moved": moved, "change": change}
        return rule
