"""How far simulated experiments are from measured ones, by the logarithms of some properties, and how sure these are.

Standard errors of weighted nonlinear least squares (Seber & Wild, "Nonlinear Regression", 1989, ch. 2 and 5), for
errors of two kinds: the noise of the measurement, and what contact makes of a start that no one knows to a micrometre,
which is correlated along a track.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.stats import norm, t

from robots.calibration import Experiment, Laboratory, Properties, Trial
from taichi_sim.base.arrays import Bools, Floats

ASSUMED = 0.02  # standard deviation where none is given, in parts of an experiment's largest value
SMALLEST = 0.002  # of such a deviation, however equal readings are: they are rounded, and gauges are no better
DIFFERENCE = 0.03  # half width of central differences, of logarithms; wide enough for contacts, see docs/gradients.md
REPLICAS = 8  # starts by whose noise the simulator's own scatter is known
FAR_OFF = 1e3  # residual of what diverges


@dataclass(frozen=True, eq=False)
class Linearised:
    """The misfit at a point, and around it."""

    predictions: Floats  # of all points, the mean of the replicas, shape (N,)
    residuals: Floats  # (prediction - measurement) / standard deviation, shape (N,)
    slopes: Floats  # derivatives of the residuals by the logarithms of the properties, shape (N, K)
    scatter: Floats  # covariance of one replica's residuals by noise on its start, shape (N, N)

    def weighted(self, factors: Floats) -> "Linearised":
        """The same in other standard deviations: residuals times factors of shape (N,)."""
        slopes, scatter = self.slopes * factors[:, None], self.scatter * np.outer(factors, factors)
        return replace(self, residuals=self.residuals * factors, slopes=slopes, scatter=scatter)


@dataclass(frozen=True, eq=False)
class Misfit:
    """Residuals of experiments."""

    experiments: Sequence[Experiment]  # with what was measured
    laboratory: Laboratory  # in which they are simulated
    names: tuple[str, ...]  # of the properties that change, K
    start: Properties  # the other properties
    bounds: Mapping[str, tuple[float, float]]  # of all properties that change

    @cached_property
    def measured(self) -> Floats:
        """Values of all points, shape (N,)."""
        return np.concatenate([experiment.values for experiment in self.experiments])

    @cached_property
    def given(self) -> Bools:
        """Which points' standard deviations are given, not assumed, shape (N,)."""
        return np.concatenate([np.full(len(e.values), e.deviations is not None) for e in self.experiments])

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
        """The point of some properties, kept within the bounds."""
        low, high = self.limits
        inside: Floats = np.clip(np.log([getattr(properties, name) for name in self.names]), low, high)
        return inside

    def properties(self, point: Floats) -> Properties:
        """The properties of a point."""
        values = np.exp(point)
        return replace(self.start, **{name: float(v) for name, v in zip(self.names, values, strict=True)})

    def predictions(self, trials: Sequence[Trial]) -> Floats:
        """What all experiments would measure in some trials, shape (T, N)."""
        return np.hstack([experiment.predict(trials, self.laboratory) for experiment in self.experiments])

    def costs(self, points: Floats) -> Floats:
        """Sums of squares at points of shape (P, K), one replica each; infinity where a simulation diverges."""
        found = self.predictions([Trial(self.properties(point)) for point in points])
        squares = (((found - self.measured) / self.deviations) ** 2).sum(axis=1)
        return np.where(np.isfinite(squares), squares, np.inf)

    def linearised(self, point: Floats) -> Linearised:
        """Residuals, slopes and scatter, all simulated side by side.

        Differences that a bound cuts short are those of one side, and so are those that diverge on one.
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
    """How sure K properties are."""

    errors: Floats  # standard errors of the logarithms, which are relative standard errors, shape (K,)
    reach: Floats  # half widths of the 95 % confidence intervals of the logarithms, shape (K,)
    correlation: Floats  # between the errors, shape (K, K)
    chaos: Floats  # part of each error's variance that is the simulator's scatter, shape (K,)
    noise: float  # root mean square of the residuals, in standard deviations, for the degrees of freedom left


def uncertainty(found: Linearised, given: Bools, share: Floats) -> Uncertainty:
    """Uncertainty of a fit that ended at a point.

    Variances that are assumed, of points that are not ``given``, shape (N,), are scaled by what the residuals say, but
    never to deviations below ``SMALLEST``: few readings may be equal, or on the curve, by chance. Given ones are
    scaled if the residuals are larger than these allow, never if they are smaller. The simulator's scatter counts once
    for the rig, whose one run is as chaotic, and once for the mean of the replicas. ``share`` is that of the
    measurement in the variance that each residual is weighted by, shape (N,).
    """
    slopes, freedom = found.slopes, found.slopes.shape[0] - found.slopes.shape[1]
    scale = float(found.residuals @ found.residuals) / freedom
    solve = np.linalg.pinv(slopes)
    measured = share * np.where(given, max(scale, 1.0), max(scale, (SMALLEST / ASSUMED) ** 2))
    noise = (solve * measured) @ solve.T
    chaos = solve @ (found.scatter * (1 + 1 / REPLICAS)) @ solve.T
    covariance = noise + chaos
    errors = np.sqrt(np.diag(covariance))
    safe = np.where(errors > 0, errors, 1.0)
    level = (1 + CONFIDENCE) / 2
    reach = errors * float(norm.ppf(level) if given.all() else t.ppf(level, freedom))
    return Uncertainty(errors, reach, covariance / np.outer(safe, safe), np.diag(chaos) / safe**2, scale**0.5)
