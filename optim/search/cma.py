"""CMA-ES with margin: a normal distribution that learns its shape, for numbers and whole numbers together.

Sources: Hamano et al., GECCO 2022, arXiv:2205.13482 (margin); Ros & Hansen, PPSN X, 2008, p. 296 (separable CMA-ES).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, cast

import numpy as np
from numpy.typing import NDArray

from optim.problem import Evaluation
from optim.search.base import number, whole
from optim.search.method import MOST_POINTS, below_all
from optim.search.population import PopulationSearch
from taichi_sim.base.arrays import Arrays, Floats
from taichi_sim.base.checks import flag

if TYPE_CHECKING:
    from cmaes import CMAwM, SepCMA

MANY = 500  # variables: with more, a full covariance takes seconds a generation and never learns enough
COLLAPSED = 1e-9  # the widest continuous variable has a smaller standard deviation: nothing is left to search [ranges]
# What changes from generation to generation: of the inner CMA, and of the margin around it, which is there only
# if a variable is discrete. Between two generations nothing else has a value that the constructor would not give.
INNER = ("_mean", "_C", "_sigma", "_p_sigma", "_pc", "_g", "_funhist_values")
MARGIN = ("_A", "m_z_lim_low", "m_z_lim_up")


@dataclass(eq=False, kw_only=True)
class CMAESWithMargin(PopulationSearch):
    """Search by CMA-ES with margin: N points per generation from a normal distribution that adapts to the best half.

    A margin keeps the probability of every neighbouring whole number from vanishing, as implemented by the library
    ``cmaes``. Coordinates are ranges of the variables. Continuous ones are free to leave their bounds, and evaluated
    where :meth:`Space.reflect` brings them, angles so too: drawing anew and clipping, as the library does, hardly
    converges where several bounds hold the optimum.

    Only the order of the scores counts: equal ones share a rank, failures have the last. The mean starts in the middle
    of the ranges, which needs no more generations than a random start. It starts again, with the first step size and
    somewhere at random, when continuous variables have collapsed, when the library's criteria say so, when nothing
    has got better for ``patience`` generations, or at once if there were only failures.

    Attributes:
        start: values by name where the mean first is; of the other variables it is in the middle. Where all are
            given, generation 0 judges that point, too.
        sigma: first standard deviation of every variable [ranges].
        patience: generations of points without a better one before a restart.
        separable: whether the covariance is diagonal, so that variances alone are learnt: in less time and memory, and
            from fewer points, but no variable with another. With more than ``MANY`` variables if None.
        random_mean: whether the mean is first at random where ``start`` says nothing, as after a restart: for
            problems whose middle is no good place, such as a plateau.
    """

    arrays: ClassVar[tuple[str, ...]] = ("record", "stalled", "restarts")

    population: int = whole(60, 4, MOST_POINTS)
    sigma: float = number(0.3, 1e-3, 1.0)
    patience: int = whole(100, 1)
    separable: bool | None = None
    random_mean: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.separable is not None:
            flag("separable", self.separable)
        self.diagonal = self.space.size > MANY if self.separable is None else self.separable
        if self.diagonal and self.space.size == 1:
            raise ValueError("separable: only allowed with at least 2 variables; leave it out")
        self.discrete = self.space.integers
        given = np.array([self.random_mean or name in self.given for name in self.space.names])
        self.strategy = to_arrays(self._build(np.where(given, self._to_ranges(self._starts()[0]), 0.5)))
        # Of this restart: its best score, and generations since it rose.
        self.record, self.stalled, self.restarts = np.nan, 0, 0

    def ask(self) -> Floats:
        """Return N points drawn from the distribution, at first also a start that sets all variables, shape (M, D)."""
        _, places, _ = self._draw()
        return np.concatenate([self._to_points(places), self._complete_start()])

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Continue from :meth:`state`, with the kind of covariance that the search began with."""
        if self.separable is None and self.diagonal != (state["strategy/C"].ndim == 1):
            self.diagonal = not self.diagonal
            self.strategy = to_arrays(self._build(np.full(self.space.size, 0.5)))  # its shapes
        super().restore(state)

    def _take(self, points: Floats, evaluation: Evaluation) -> None:
        """Move the distribution, unless there is nothing to learn; restart it if it has done what it can."""
        self.points = points[: self.population].copy()
        self.objectives = evaluation.objectives[: self.population].copy()
        scores = below_all(self.objectives[:, 0])
        if scores.max() > below_all(self.record):
            self.record, self.stalled = float(scores.max()), 0
        else:
            self.stalled += 1
        if np.isfinite(scores.max()):
            strategy, _, raw = self._draw()
            ranks = np.unique(-scores, return_inverse=True)[1].astype(float)
            strategy.tell(list(zip(raw, ranks, strict=True)))
            self.strategy = to_arrays(strategy)
            over = self._collapsed() or strategy.should_stop()
        else:
            over = np.isnan(self.record)
        if over or self.stalled >= self.patience:
            self.record, self.stalled, self.restarts = np.nan, 0, self.restarts + 1
            self.strategy = to_arrays(self._build(self._to_ranges(self.space.sample(self._generator(1), 1)[0])))

    def _collapsed(self) -> bool:
        covariance = self.strategy["C"]
        variances = np.diag(covariance) if covariance.ndim == 2 else covariance
        deviations = self.strategy["sigma"] * np.sqrt(variances)
        return not self.discrete.all() and bool(deviations[~self.discrete].max() < COLLAPSED)

    def _draw(self) -> tuple["CMAwM", Floats, Floats]:
        """The strategy as it is after drawing, where its N points are evaluated, and what it is told of them.

        Drawing also rounds the covariance, so a strategy is told what the same strategy has drawn.
        """
        strategy = self._build(np.full(self.space.size, 0.5))
        set_arrays(strategy, self.strategy)
        strategy.reseed_rng(int(self._generator(0).integers(2**32)))
        places, raw = zip(*(strategy.ask() for _ in range(self.population)), strict=True)
        return strategy, np.array(places), np.array(raw)

    def _build(self, mean: Floats) -> "CMAwM":
        bounds = np.where(self.discrete[:, None], [0.0, 1.0], [-np.inf, np.inf])
        steps = np.where(self.discrete, 1 / self.space.span, 0.0)
        return build_strategy(mean, self.sigma, bounds, steps, self.population, self.diagonal)

    def _to_ranges(self, points: Floats) -> Floats:
        return (points - self.space.low) / self.space.span

    def _to_points(self, places: Floats) -> Floats:
        return self.space.round(self.space.reflect(self.space.low + places * self.space.span))

    def _numbers(self) -> Mapping[str, float | int | None]:
        """Step size [ranges] and how often the search began again."""
        return {"sigma": float(self.strategy["sigma"]), "restarts": self.restarts}

    def _groups(self) -> Mapping[str, Arrays]:
        return {"strategy": self.strategy}


class _Diagonal:
    """A separable strategy as the margin of the library wants one: its covariance is a matrix."""

    def __init__(self, strategy: "SepCMA") -> None:
        self.strategy = strategy

    def __getattr__(self, name: str) -> Any:
        return getattr(self.strategy, name)

    @property
    def _C(self) -> Floats:
        return np.diag(self.strategy._C)


def build_strategy(
    mean: Floats, sigma: float, bounds: Floats, steps: Floats, population: int, diagonal: bool = False
) -> "CMAwM":
    """Make a new strategy of the library ``cmaes``.

    Args:
        mean: first mean, shape (D,).
        sigma: first step size.
        bounds: low and high of each variable, shape (D, 2).
        steps: distance between the values of each variable, 0 for a continuous one, shape (D,).
        population: points per generation.
        diagonal: whether the covariance is diagonal.
    """
    from cmaes import CMAwM, SepCMA  # it costs time, and not every search needs it

    strategy = CMAwM(mean=mean, sigma=sigma, bounds=bounds, steps=steps, population_size=population, seed=0)
    if diagonal:
        plain = SepCMA(mean=mean.copy(), sigma=sigma, population_size=population, seed=0)
        plain._cmu = min(plain._cmu, 1 - plain._c1)  # of many points in few variables: variances stay positive
        strategy._cma = cast(Any, _Diagonal(plain))
    _inner(strategy)._funhist_values[:] = 0.0  # not initialised by the library, though never read before it is set
    return strategy


def _inner(strategy: "CMAwM") -> Any:
    """The strategy around which the margin is."""
    return strategy._cma.strategy if isinstance(strategy._cma, _Diagonal) else strategy._cma


def to_arrays(strategy: "CMAwM") -> Arrays:
    """Copy the changing state of a strategy, by name; call it after ``tell`` and before the next ``ask``."""
    inner = {name.strip("_"): np.array(getattr(_inner(strategy), name)) for name in INNER}
    return inner | {name.strip("_"): np.array(getattr(strategy, name)) for name in MARGIN if hasattr(strategy, name)}


def set_arrays(strategy: "CMAwM", arrays: Mapping[str, NDArray[Any]]) -> None:
    """Restore in a strategy of the same shape the state that :func:`to_arrays` returned."""
    for owner, names in ((_inner(strategy), INNER), (strategy, MARGIN)):
        for name in names:
            if (values := arrays.get(name.strip("_"))) is not None:
                setattr(owner, name, values.copy() if values.ndim else values.item())
