"""Misfit between simulated and measured experiments as a function of properties, and the properties' uncertainty.

Standard errors are those of weighted nonlinear least squares (Seber & Wild, "Nonlinear Regression", 1989, ch. 2 and 5)
for two kinds of errors: noise of the measurements, and the scatter of the simulation, because contact amplifies
differences of the start positions, which are not known to a micrometre. The latter is correlated along a track.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.stats import norm, t

from robots.calibration import Experiment, Laboratory, Properties, Trial
from taichi_sim.base.arrays import Floats, Ints

ASSUMED = 0.02  # standard deviation where none is given, relative to an experiment's largest value
SMALLEST = 0.002  # least such deviation, because readings are rounded and gauges are no better
DIFFERENCE = 0.03  # half width of central differences, of logarithms; wide enough for contacts, see docs/gradients.md
REPLICAS = 8  # simulations with different start noise, from which the simulator's scatter is estimated
FAR_OFF = 1e3  # residual of simulations that diverge
GIVEN = -1  # experiment of points whose standard deviation is given
LEAST_FREEDOM = 1.5  # degrees of freedom from which an experiment's own noise is told by its residuals


@dataclass(frozen=True, eq=False)
class Linearised:
    """Residuals of the misfit at a point, with their derivatives and scatter."""

    predictions: Floats  # of all points, the mean of the replicas, shape (N,)
    residuals: Floats  # (prediction - measurement) / standard deviation, shape (N,)
    slopes: Floats  # derivatives of the residuals by the logarithms of the properties, shape (N, K)
    scatter: Floats  # covariance of one replica's residuals by noise on its start, shape (N, N)

    def weighted(self, factors: Floats) -> "Linearised":
        """Copy with residuals multiplied by factors, shape (N,), for other standard deviations."""
        slopes, scatter = self.slopes * factors[:, None], self.scatter * np.outer(factors, factors)
        return replace(self, residuals=self.residuals * factors, slopes=slopes, scatter=scatter)


@dataclass(frozen=True, eq=False)
class Misfit:
    """Residuals of experiments as a function of the logarithms of K properties."""

    experiments: Sequence[Experiment]  # with their measured values
    laboratory: Laboratory  # in which they are simulated
    names: tuple[str, ...]  # names of the K properties that change
    start: Properties  # values of the other properties
    bounds: Mapping[str, tuple[float, float]]  # of all properties that change

    @cached_property
    def measured(self) -> Floats:
        """Values of all points, shape (N,)."""
        return np.concatenate([experiment.values for experiment in self.experiments])

    @cached_property
    def assumed(self) -> Ints:
        """Experiment of each point whose standard deviation is assumed, ``GIVEN`` where it is given, shape (N,)."""
        numbered = enumerate(self.experiments)
        return np.concatenate([np.full(len(e.values), i if e.deviations is None else GIVEN) for i, e in numbered])

    @cached_property
    def deviations(self) -> Floats:
        """Standard deviation of each point, shape (N,)."""
        assumed = [np.full(len(e.values), ASSUMED * np.abs(e.values).max()) for e in self.experiments]
        each = zip(assumed, self.experiments, strict=True)
        return np.concatenate([guess if e.deviations is None else e.deviations for guess, e in each])

    @property
    def limits(self) -> tuple[Floats, Floats]:
        """Logarithms of the bounds, shape (K,) each."""
        low, high = np.log([self.bounds[name] for name in self.names]).T
        return low, high

    def of(self, properties: Properties) -> Floats:
        """Point of some properties: their logarithms, clipped to the bounds, shape (K,)."""
        low, high = self.limits
        inside: Floats = np.clip(np.log([getattr(properties, name) for name in self.names]), low, high)
        return inside

    def properties(self, point: Floats) -> Properties:
        """The properties of a point."""
        values = np.exp(point)
        return replace(self.start, **{name: float(v) for name, v in zip(self.names, values, strict=True)})

    def predictions(self, trials: Sequence[Trial]) -> Floats:
        """Predicted values of all experiments in T trials, shape (T, N)."""
        return np.hstack([experiment.predict(trials, self.laboratory) for experiment in self.experiments])

    def costs(self, points: Floats) -> Floats:
        """Sums of squares at points of shape (P, K), one replica each; infinity where a simulation diverges."""
        found = self.predictions([Trial(self.properties(point)) for point in points])
        squares = (((found - self.measured) / self.deviations) ** 2).sum(axis=1)
        return np.where(np.isfinite(squares), squares, np.inf)

    def linearised(self, point: Floats) -> Linearised:
        """Compute residuals, slopes and scatter from one batch of simulations.

        Differences are one-sided where a bound, or a simulation that diverges, prevents a step to the other side.
        """
        count, (low, high) = len(point), self.limits
        moves = DIFFERENCE * np.concatenate([np.eye(count), -np.eye(count)])
        points = np.clip(point + moves, low, high)
        trials = [Trial(self.properties(point), replica) for replica in range(REPLICAS)]
        found = self.predictions([*trials, *(Trial(self.properties(moved)) for moved in points)])
        here, around = np.split(found, [REPLICAS])
        gone = ~np.isfinite(around).all(axis=1)
        points[gone], around[gone] = point, here[0]
        rise = (around[:count] - around[count:]) / self.deviations
        widths = np.diag(points[:count] - points[count:])
        slopes = np.divide(rise.T, widths, out=np.zeros_like(rise.T), where=(widths > 0) & np.isfinite(rise.T))
        middle = here.mean(axis=0)
        scatter = np.cov((here / self.deviations).T).reshape(len(middle), -1)
        residuals = np.nan_to_num((middle - self.measured) / self.deviations, nan=FAR_OFF)
        return Linearised(middle, residuals, slopes, np.nan_to_num(scatter))


CONFIDENCE = 0.95


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Uncertainty of K fitted properties."""

    errors: Floats  # standard errors of the logarithms, which are relative standard errors, shape (K,)
    reach: Floats  # half widths of the 95 % confidence intervals of the logarithms, shape (K,)
    correlation: Floats  # between the errors, shape (K, K)
    chaos: Floats  # share of each variance that comes from the simulator's scatter, shape (K,)
    noise: float  # root of the residuals' sum of squares over the degrees of freedom [standard deviations]


def uncertainty(found: Linearised, assumed: Ints, share: Floats) -> Uncertainty:
    """Uncertainty of a fit, from the linearised misfit at its end.

    Assumed variances are scaled to the residuals, those of each experiment to its own, but never to deviations below
    ``SMALLEST``, as a few readings may be equal, or on the curve, by chance. Given variances are only ever scaled up.
    The simulator's scatter counts once for the single run of the rig, which is as chaotic, and once for the mean of the
    replicas. Scaled variances are themselves uncertain: the intervals follow Student's distribution, with the effective
    degrees of freedom of a sum of such variances (Satterthwaite, Biometrics Bulletin 2, 1946).

    Args:
        found: linearised misfit.
        assumed: experiment of each point whose deviation is assumed, ``GIVEN`` where it is given, shape (N,).
        share: share of the measurement in the variance by which each residual is weighted, shape (N,).
    """
    slopes, solve = found.slopes, np.linalg.pinv(found.slopes)
    squares, left = found.residuals**2, 1 - np.einsum("nk,kn->n", slopes, solve)
    parts = [
        (_noise(squares, left, assumed, group), share * (assumed == group)) for group in np.unique(assumed).tolist()
    ]
    measured = sum((scale * points for (scale, _), points in parts), np.zeros(len(squares)))
    noise = (solve * measured) @ solve.T
    chaos = solve @ (found.scatter * (1 + 1 / REPLICAS)) @ solve.T
    covariance = noise + chaos
    errors = np.sqrt(np.diag(covariance))
    safe = np.where(errors > 0, errors, 1.0)
    doubt = sum((scale * (solve**2 @ points) / safe**2) ** 2 / freedom for (scale, freedom), points in parts)
    level = (1 + CONFIDENCE) / 2
    reach = errors * np.where(doubt > 0, t.ppf(level, 1 / np.where(doubt > 0, doubt, 1.0)), norm.ppf(level))
    overall = float(np.sqrt(squares.sum() / left.sum()))
    return Uncertainty(errors, reach, covariance / np.outer(safe, safe), np.diag(chaos) / safe**2, overall)


def _noise(squares: Floats, left: Floats, assumed: Ints, group: int) -> tuple[float, float]:
    """Factor of the variances of a group of points, and with how many degrees of freedom it is known.

    Each residual leaves 1 - leverage degrees of freedom (Horn, Horn & Duncan, JASA 70, 1975). A group in which too few
    are left takes the factor of all points whose deviation is assumed, or given, as its own or, if these are too few,
    that of all points.

    Args:
        squares: squares of the residuals, shape (N,).
        left: degrees of freedom that each leaves, shape (N,).
        assumed: experiment of each point whose deviation is assumed, shape (N,).
        group: that experiment, or ``GIVEN``: given variances are taken as known.
    """
    known = group == GIVEN
    candidates = (assumed == group, (assumed == GIVEN) == known, np.ones(len(assumed), bool))
    points = next((each for each in candidates if left[each].sum() >= LEAST_FREEDOM), candidates[-1])
    freedom = float(left[points].sum())
    factor = float(squares[points].sum()) / freedom
    return (max(factor, 1.0), np.inf) if known else (max(factor, (SMALLEST / ASSUMED) ** 2), freedom)
