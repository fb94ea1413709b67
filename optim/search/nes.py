"""Separable natural evolution strategy: follows the natural gradient of the expected rank."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from statistics import NormalDist
from typing import ClassVar

import numpy as np

from optim.problem import Evaluation, Minibatch
from optim.search.base import number, whole
from optim.search.method import MOST_POINTS, below_all
from optim.search.population import PopulationSearch
from optim.search.variation import Bounds, draw_inside
from optim.space import Space
from taichi_sim.base.arrays import Floats

OFF = 0.2  # share of the points in which some integer at rest still differs from its mean


@dataclass(eq=False, kw_only=True)
class SeparableNES(PopulationSearch):
    """Search by separable NES: N points per generation from a normal distribution that follows the natural gradient.

    Source: Wierstra et al., "Natural evolution strategies", JMLR 15, 2014, algorithm 6 (SNES), with its utilities and
    learning rates (table 1). Coordinates are ranges of the variables. What lies beyond a bound is evaluated where
    :meth:`Space.reflect` brings it, angles so too, and the mean is reflected in the same way, which changes no
    probability (with ``bounds="random"`` it does). Integers are rounded for evaluation. Their standard deviation has a
    floor, at which, with all integer means at whole numbers, one in five points has one that differs.

    Equal scores share their utilities, failures those of the last ranks. Nothing restarts it.

    With ``minibatch_size``, the points of a generation are judged in a few of the problem's worlds, or draws of what is
    uncertain, all in the same ones; the mean is judged in all every few generations, and only these judgements are
    results.

    Attributes:
        start: values by name where the mean first is; of the other variables it is in the middle, or at random.
            Where all are given, generation 0 judges that point, too.
        sigma: first standard deviation of every variable [ranges].
        mirrored: draw every other point opposite to the one before, seen from the mean.
        random_mean: begin at a random point, not in the middle.
        max_sigma: the largest standard deviation [ranges]; wider than its range says no more.
        minibatch_size: worlds or draws of a generation; all by default.
        judging: generations between two evaluations of the mean in all worlds or draws.
        bounds: ``"reflect"``, or ``"random"``: what lies beyond a bound is drawn evenly between mean and bound.
    """

    arrays: ClassVar[tuple[str, ...]] = ("mean", "deviation")

    population: int = whole(60, 4, MOST_POINTS)
    sigma: float = number(0.3, 1e-3, 1.0)
    mirrored: bool = False
    random_mean: bool = False
    max_sigma: float = number(1.0, "sigma", 1e300)
    minibatch_size: int | None = whole(None, 1)
    judging: int = whole(10, 1)
    bounds: Bounds = "reflect"

    def __post_init__(self) -> None:
        super().__post_init__()
        space = self.space
        given = np.array([self.random_mean or name in self.given for name in space.names])
        self.mean = np.where(given, (self._starts()[0] - space.low) / space.span, 0.5)
        self.floor = _floor(space)
        self.ceiling = np.maximum(self.max_sigma, self.floor)
        self.deviation = np.maximum(self.sigma, self.floor)

    @property
    def _judges(self) -> bool:
        """Whether this generation judges the mean in all worlds."""
        return self.minibatch_size is not None and self.generation % (self.judging + 1) == 0

    @property
    def minibatch(self) -> Minibatch | None:
        """Minibatch of the next points, a new one for each generation; None for all worlds or draws."""
        if self.minibatch_size is None or self._judges:
            return None
        judged = self.generation // (self.judging + 1) + 1  # generations before this one that judged the mean
        return Minibatch(self.minibatch_size, self.generation - judged, self.seed)

    def ask(self) -> Floats:
        """Return N points drawn from the distribution, at first also a start that sets all variables, shape (M, D).

        Where minibatches are judged, now and then the mean alone.
        """
        if self._judges:
            return self.space.round(self.space.low + self.mean * self.space.span)[None]
        drawn = self.space.round(self._inside(self.mean + self.deviation * self._deviates(), 1))
        return np.concatenate([drawn, self._complete_start()])

    def _remember(self, points: Floats, scores: Floats) -> None:
        if self.minibatch is None:  # others are judged elsewhere
            super()._remember(points, scores)

    def _take(self, points: Floats, evaluation: Evaluation) -> None:
        if not self._judges:
            self._follow_ranks(points, evaluation)

    def _follow_ranks(self, points: Floats, evaluation: Evaluation) -> None:
        """Algorithm 6: both gradients in the coordinates of the distribution itself."""
        self.points = points[: self.population].copy()
        self.objectives = evaluation.objectives[: self.population].copy()
        deviates, size = self._deviates(), self.space.size
        utilities = _utilities(below_all(self.objectives[:, 0]))
        moved = self.mean + self.deviation * (utilities @ deviates)  # learning rate 1
        self.mean = (self._inside(moved, 2) - self.space.low) / self.space.span
        rate = (3 + math.log(size)) / (5 * math.sqrt(size))
        self.deviation = self.deviation * np.exp(rate / 2 * (utilities @ (deviates**2 - 1)))
        self.deviation = np.clip(self.deviation, self.floor, self.ceiling)

    def _deviates(self) -> Floats:
        """Standard normal, shape (N, D), the same as often as asked in a generation."""
        if not self.mirrored:
            return self._generator().standard_normal((self.population, self.space.size))
        half = self._generator().standard_normal(((self.population + 1) // 2, self.space.size))
        return np.stack([half, -half], axis=1).reshape(-1, self.space.size)[: self.population]

    def _inside(self, places: Floats, stream: int) -> Floats:
        """Places [ranges] as values, shape (..., D), within the bounds."""
        points, mean = (self.space.low + values * self.space.span for values in (places, self.mean))
        if self.bounds == "reflect":
            return self.space.reflect(points)
        return draw_inside(self.space, points, mean, self._generator(stream))

    def _numbers(self) -> Mapping[str, float | int | None]:
        """Geometric mean of the standard deviations [ranges]."""
        return {"sigma": float(np.exp(np.log(self.deviation).mean()))}


def _utilities(scores: Floats) -> Floats:
    """The utility of each point, shape (N,), with sum 0; equal scores share the utilities of their ranks."""
    ranks = np.arange(1, len(scores) + 1)
    shares = np.maximum(0.0, math.log(len(scores) / 2 + 1) - np.log(ranks))
    utilities = shares / shares.sum() - 1 / len(scores)
    _, group, count = np.unique(-scores, return_inverse=True, return_counts=True)
    of_rank = np.repeat(np.arange(len(count)), count)
    return (np.bincount(of_rank, utilities) / count)[group]


def _floor(space: Space) -> Floats:
    """Smallest standard deviation of each variable [ranges], shape (D,); of a continuous one nearly 0."""
    discrete = space.integers
    each = 1 - (1 - OFF) ** (1 / max(discrete.sum(), 1))  # probability that one of them is off
    half_step = NormalDist().inv_cdf(1 - each / 2)  # in standard deviations
    return np.where(discrete, 0.5 / space.span / half_step, np.finfo(float).tiny)
