"""Differential evolution whose best members also follow the gradient.

Sources: Moscato, Caltech Concurrent Computation Program report 826, 1989 (memetic algorithms); Whitley, Gordon &
Mathias, Proc. PPSN 1994 (Lamarckian: what a member learns in its life is inherited); Nocedal & Wright 2006, algorithm
7.4 (L-BFGS); Bernstein et al., arXiv:1802.04434 (steps by the signs of the gradient).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from optim.problem import Evaluation
from optim.search.base import hidden, number, whole
from optim.search.differential_evolution import DifferentialEvolution
from optim.search.method import LARGEST, Wants, check_slopes
from optim.search.step_rules import LBFGS, free_variables
from optim.search.variation import Bounds, ranking
from taichi_sim.base.arrays import Arrays, Bools, Floats, Indices


@dataclass(eq=False, kw_only=True)
class MemeticSearch(DifferentialEvolution):
    """Search by differential evolution, in which the best members follow gradients in every k-th generation.

    What a gradient leads to is rounded and judged in the next generation, as the trial of its member: the member
    becomes it if it is at least as good, and stays otherwise. So only true points have a score. A member's step
    halves where it did not help, and doubles again, up to the full one, where it did.

    Gradients are taken, unsharpened, at the real values that a member keeps of its binary variables, so that steps
    too small to flip a bit add up: the rounded point is the same, and equals replace. Whole numbers have no gradient
    and stay; binary variables take steps of the same length, up or down; the others those of L-BFGS, which learns
    from the places where a member has been, and from a neighbour.

    Attributes:
        every: number k, at least 2; the last of k generations asks for gradients.
        refine: number of best members that follow gradients; a multiple of 16 is cheap in the simulator, N is the most.
        learning_rate: longest coordinate of a first step, and length of those of binary variables [ranges].
    """

    through_mixtures = True
    takes_gradients = True

    arrays: ClassVar[tuple[str, ...]] = ("refined", "anchor", "slopes", "scale")

    trials: int = hidden(0)
    bounds: Bounds = hidden("reflect")
    every: int = whole(4, 2)
    refine: int = whole(16, 1)
    learning_rate: float = number(0.3, 1e-6, 1.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_slopes(self.space)
        self.refine = min(self.refine, self.population)
        self.relaxed = self.space.relaxed()
        self.integer = self.relaxed.integers
        self.binary = self.space.integers & ~self.integer
        self.rule = LBFGS(self.population, self.space.size, self.learning_rate)
        shape = self.points.shape
        self.refined = np.full(shape, np.nan)  # where gradients lead to, NaN in the rows of the others
        self.anchor, self.slopes = np.full(shape, np.nan), np.full(shape, np.nan)  # of the last gradients
        self.scale = np.ones(self.population)  # of a step

    @property
    def wants(self) -> Wants:
        """Points of the space; in every k-th generation gradients."""
        return "gradients" if self.generation % self.every == self.every - 1 else "points"

    def ask(self) -> Floats:
        """Return the starts, later a trial per member, shape (N, D); or the best members, relaxed, shape (R, D)."""
        return self._relaxed_members()[self._best_members()] if self.wants == "gradients" else super().ask()

    def _take(self, points: Floats, evaluation: Evaluation) -> None:
        super()._take(points, evaluation)
        tried = ~np.isnan(self.refined[:, 0])
        helped = (self.values == self.refined).all(axis=1)
        scale = np.where(helped, np.minimum(1.0, 2 * self.scale), self.scale / 2)
        self.scale = np.where(tried, scale, self.scale)
        self.refined = np.full(self.points.shape, np.nan)

    def _trials(self, targets: Indices) -> Floats:
        return np.where(np.isnan(self.refined), super()._trials(targets), self.refined)

    def _best_members(self) -> Indices:
        return ranking(self.objectives[:, 0])[: self.refine]

    def _relaxed_members(self) -> Floats:
        """The members with the real values of what is not an integer, shape (N, D), in the relaxed space."""
        return np.where(self.integer, self.points, self.values)

    def _follow(self, slopes: Floats) -> None:
        """Move by a step each of the best members whose gradient is a number and leads somewhere."""
        known = np.full(self.points.shape, np.nan)
        known[self._best_members()] = slopes
        valid = np.all(abs(known) < LARGEST, axis=1)
        slopes = np.where(valid[:, None] & ~self.integer, known, 0.0)
        here = self._relaxed_members()
        self._learn(valid, here, slopes)
        free = free_variables(self.relaxed, here, slopes) & ~self.binary
        steps = np.where(self.binary, self.learning_rate * np.sign(slopes), self.rule.steps(valid, slopes, free))
        there = self.relaxed.bound(here + self.scale[:, None] * steps * self.space.span)
        leads = valid & (there != here).any(axis=1)
        self.refined = np.where(leads[:, None], np.where(self.integer, self.values, there), np.nan)

    def _learn(self, valid: Bools, here: Floats, slopes: Floats) -> None:
        """Let L-BFGS compare the gradients of some members with their last ones, and with the next better member's."""
        best = self._best_members()
        best = best[valid[best]]
        better = np.arange(self.population)
        better[best] = np.roll(best, 1)  # of the best the last
        for place, gradient in ((self.anchor, self.slopes), (here[better], slopes[better])):
            known = (valid & ~np.isnan(place[:, 0]))[:, None]
            moved = np.where(known & ~self.integer, self.relaxed.offset(here, place), 0.0)
            self.rule.learn(np.any(moved, axis=1), moved, np.where(known, slopes - gradient, 0.0))
        self.anchor = np.where(valid[:, None], here, self.anchor)
        self.slopes = np.where(valid[:, None], slopes, self.slopes)

    def _groups(self) -> Mapping[str, Arrays]:
        return {"rule": self.rule.arrays}
