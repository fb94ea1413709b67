"""Misfit between simulated and measured experiments as a function of properties, and the properties' uncertainty.

Standard errors are those of weighted nonlinear least squares (Seber & Wild, "Nonlinear Regression", 1989, ch. 2 and 5)
for two kinds of errors: noise of the measurements, and the scatter of the simulation, because contact amplifies
differences of the start positions, which are not known to a micrometre. The latter is correlated along a track.

Scatter also makes slopes uncertain, which are differences of simulations. Two noisy slopes tell less than their size
says: its mean is that of the slopes and of their noise. Three things keep errors honest (Fuller, "Measurement Error
Models", 1987, ch. 1; Stein, Annals of Statistics 9, 1981; Fieller, J. Royal Stat. Soc. B 16, 1954): each slope counts
less the less it exceeds its noise, the part of their products that is noise is subtracted, and what an error of a
property times the noise of its slopes amounts to counts as noise of the points.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.optimize import lsq_linear
from scipy.stats import norm, t

from robots.calibration import Experiment, Laboratory, Properties, Replica
from taichi_sim.base.arrays import Floats, Ints

ASSUMED = 0.02  # standard deviation where none is given, relative to an experiment's largest value
SMALLEST = 0.002  # least such deviation, because readings are rounded and gauges are no better
DIFFERENCE = 0.03  # half width of central differences, of logarithms; wide enough for contacts, see docs/gradients.md
WIDEST = 0.3  # of those of properties that are known less well: a difference over their error tells more than noise
WIDER = 0.1  # width of differences of one replica each
FARTHEST = 0.5  # largest change of a logarithm in a step
INSIDE = 1e-9  # of the bounds of a step, which may not be equal
REPLICAS = 8  # simulations with different start noise, from which the simulator's scatter is estimated
AROUND = 24  # simulations for the differences of all properties, at most; with the replicas two vectors of 16 robots
FAR_OFF = 1e3  # residual of simulations that diverge
GIVEN = -1  # experiment of points whose standard deviation is given
ROUNDS = 100  # in which errors by the noise of slopes settle
TOO_LARGE = 2.0  # residuals, in standard deviations, above which model and data do not agree
LEAST_FREEDOM = 1.5  # degrees of freedom from which an experiment's own noise is told by its residuals


@dataclass(frozen=True, eq=False)
class Linearised:
    """Residuals of the misfit at a point, with their derivatives and scatter."""

    predictions: Floats  # of all points, the mean of the replicas, shape (N,)
    residuals: Floats  # (prediction - measurement) / standard deviation, shape (N,)
    slopes: Floats  # derivatives of the residuals by the logarithms of the properties, shape (N, K)
    scatter: Floats  # covariance of one replica's residuals by noise on its start, shape (N, N)
    doubt: Floats | None = None  # covariance of each property's slopes by that noise, shape (K, N, N); None is none
    freedom: tuple[float, float] = (np.inf, np.inf)  # degrees of freedom with which scatter and doubt are known

    def weighted(self, factors: Floats) -> "Linearised":
        """Copy with residuals multiplied by factors, shape (N,), for other standard deviations."""
        products = np.outer(factors, factors)
        return replace(
            self,
            residuals=self.residuals * factors,
            slopes=self.slopes * factors[:, None],
            scatter=self.scatter * products,
            doubt=None if self.doubt is None else self.doubt * products,
        )

    def joined(self, others: Sequence["Linearised"]) -> "Linearised":
        """Copy with the means of slopes and scatter over others that are near, itself among them."""
        doubts = [each.doubt for each in others if each.doubt is not None]
        scatter, known = np.sum([each.freedom for each in others], axis=0).tolist()
        return replace(
            self,
            slopes=np.mean([each.slopes for each in others], axis=0),
            scatter=np.mean([each.scatter for each in others], axis=0),
            doubt=np.sum(doubts, axis=0) / len(others) ** 2 if doubts else None,
            freedom=(scatter, known),
        )

    @property
    def variances(self) -> Floats:
        """Variances of the slopes, shape (N, K)."""
        none = np.zeros_like(self.slopes)
        return none if self.doubt is None else np.diagonal(self.doubt, axis1=1, axis2=2).T

    @property
    def sure(self) -> Floats:
        """Slopes less what may be noise: as they are far beyond it, 0 within it (James and Stein), shape (N, K)."""
        squares = self.slopes**2
        share = np.divide(self.variances, squares, out=np.ones_like(squares), where=squares > 0)
        return self.slopes * np.maximum(1 - share, 0.0)

    @property
    def products(self) -> Floats:
        """Products of the sure slopes with the true ones, without bias by noise (Stein's lemma), shape (K, K)."""
        squares, spread = self.slopes**2, self.variances
        beyond = squares > spread
        share = np.divide(spread, squares, out=np.zeros_like(squares), where=beyond)
        noise = (spread * (1 + share) * beyond).sum(axis=0)
        found = self.sure.T @ self.slopes
        np.fill_diagonal(found, np.maximum(np.diag(found) - noise, 0.0))
        return found


@dataclass(frozen=True, eq=False)
class Misfit:
    """Residuals of experiments as a function of the logarithms of K properties."""

    experiments: Sequence[Experiment]  # with their measured values
    laboratory: Laboratory  # in which they are simulated
    names: tuple[str, ...]  # names of the K properties that change
    start: Properties  # values of the other properties
    bounds: Mapping[str, tuple[float, float]]  # of all properties that change
    width: Floats | float = DIFFERENCE  # half widths of differences, of all properties or of each, shape (K,)
    known: Mapping[str, tuple[float, float]] | None = None  # what is known of them before the fit; None: their bounds

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

    @property
    def before(self) -> Floats:
        """Logarithms of the bounds within which properties are known to be before the fit, shape (K, 2)."""
        bounds = self.bounds if self.known is None else self.known
        return np.log([bounds[name] for name in self.names])

    @property
    def spans(self) -> Floats:
        """Standard deviations of the logarithms where all between these bounds is alike, shape (K,)."""
        spans: Floats = np.diff(self.before)[:, 0] / np.sqrt(12)
        return spans

    def of(self, properties: Properties) -> Floats:
        """Point of some properties: their logarithms, clipped to the bounds, shape (K,)."""
        low, high = self.limits
        inside: Floats = np.clip(np.log([getattr(properties, name) for name in self.names]), low, high)
        return inside

    def properties(self, point: Floats) -> Properties:
        """The properties of a point."""
        values = np.exp(point)
        return replace(self.start, **{name: float(v) for name, v in zip(self.names, values, strict=True)})

    def predictions(self, trials: Sequence[Replica]) -> Floats:
        """Predicted values of all experiments in T trials, shape (T, N)."""
        return np.hstack([experiment.predict(trials, self.laboratory) for experiment in self.experiments])

    def costs(self, points: Floats, scatter: Floats | float = 0.0) -> Floats:
        """Sums of squares at points of shape (P, K), one replica each; infinity where a simulation diverges.

        ``scatter`` is the variance of one replica's residuals, shape (N,): it counts for the replica and for the rig.
        """
        found = self.predictions([Replica(self.properties(point)) for point in points])
        squares = (((found - self.measured) / self.deviations) ** 2 / (1 + 2 * scatter)).sum(axis=1)
        return np.where(np.isfinite(squares), squares, np.inf)

    def step(self, point: Floats, at: Linearised) -> Floats:
        """Step of Gauss and Newton within the bounds, which damp it as if they were measurements, shape (K,)."""
        (low, high), count = self.limits, len(point)
        slopes, residuals = np.vstack([at.sure, np.diag(1 / self.spans)]), np.append(at.residuals, np.zeros(count))
        least, most = np.maximum(low - point, -FARTHEST), np.minimum(high - point, FARTHEST)
        step: Floats = lsq_linear(slopes, -residuals, (least - INSIDE, most + INSIDE)).x
        return step

    def stepped(self, points: Floats, scatter: Floats | float = 0.0) -> tuple[Floats, Floats]:
        """Sums of squares at points of shape (P, K), as ``costs``, and where a step from each leads, shape (P, K).

        Differences are one-sided, of one replica each. No step is made where a simulation diverges.
        """
        count, (low, high) = points.shape[1], self.limits
        moves = WIDER * np.where(points < (low + high) / 2, 1.0, -1.0)
        beside = np.clip(points[:, None] + moves[:, None] * np.eye(count), low, high)
        trials = [Replica(self.properties(each)) for each in np.concatenate([points, beside.reshape(-1, count)])]
        found = (self.predictions(trials) - self.measured) / self.deviations / np.sqrt(1 + 2 * scatter)
        here, around = found[: len(points)], found[len(points) :].reshape(len(points), count, -1)
        ends = points.copy()
        for row, (point, residuals, moved) in enumerate(zip(points, here, around, strict=True)):
            if np.isfinite(residuals).all():
                slopes = np.nan_to_num((moved - residuals) / np.diag(beside[row] - point)[:, None]).T
                at = Linearised(residuals, residuals, slopes, np.zeros((len(residuals),) * 2))
                ends[row] = np.clip(point + self.step(point, at), low, high)
        return np.nan_to_num((here**2).sum(axis=1), nan=np.inf), ends

    def linearised(self, point: Floats) -> Linearised:
        """Compute residuals, slopes, their noise and scatter from one batch of simulations.

        Differences are one-sided where a bound, or a simulation that diverges, prevents a step to the other side.
        """
        count, (low, high) = len(point), self.limits
        draws = min(REPLICAS, max(2, AROUND // (2 * count)))
        moves = self.width * np.concatenate([np.eye(count), -np.eye(count)])
        points = np.clip(point + moves, low, high)
        trials = [Replica(self.properties(point), replica) for replica in range(REPLICAS)]
        beside = [Replica(self.properties(moved), replica) for moved in points for replica in range(draws)]
        found = self.predictions([*trials, *beside])
        here, around = found[:REPLICAS], found[REPLICAS:].reshape(2 * count, draws, -1) / self.deviations
        gone = ~np.isfinite(around).all(axis=(1, 2))
        scatter, freedom = _pooled([here / self.deviations, *around[~gone]])
        points[gone], around[gone] = point, here[:draws] / self.deviations
        rises, widths = around[:count] - around[count:], np.diag(points[:count] - points[count:])
        spread, known = _pooled(list(rises))
        wide = np.where(widths > 0, widths, np.inf)
        middle = here.mean(axis=0)
        residuals = np.nan_to_num((middle - self.measured) / self.deviations, nan=FAR_OFF)
        slopes = np.nan_to_num(rises.mean(axis=1) / wide[:, None]).T
        doubt = spread / draws / wide[:, None, None] ** 2
        return Linearised(middle, residuals, slopes, scatter, doubt, (freedom, known))


def _pooled(groups: Sequence[Floats]) -> tuple[Floats, float]:
    """Covariance within groups of draws, of shape (D, N) each, and its degrees of freedom; 0 where they diverge."""
    apart = np.nan_to_num(np.concatenate([group - group.mean(axis=0) for group in groups]))
    freedom = len(apart) - len(groups)
    return apart.T @ apart / freedom, float(freedom)


CONFIDENCE = 0.95


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Uncertainty of K fitted properties."""

    errors: Floats  # standard errors of the logarithms, which are relative standard errors, shape (K,)
    reach: Floats  # half widths of the 95 % confidence intervals of the logarithms, shape (K,)
    correlation: Floats  # between the errors, shape (K, K)
    chaos: Floats  # share of each variance that comes from the simulator's scatter, shape (K,)
    noise: float  # root of the residuals' sum of squares over the degrees of freedom [standard deviations]


def uncertainty(found: Linearised, assumed: Ints, share: Floats, spans: Floats | None = None) -> Uncertainty:
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
        spans: standard deviations of the logarithms where nothing is measured, of what the bounds leave open, shape
            (K,): no error is larger. Infinite by default.
    """
    sure = found.sure
    squares, left = found.residuals**2, 1 - np.einsum("nk,kn->n", sure, np.linalg.pinv(sure))
    parts = [
        (_noise(squares, left, assumed, group), share * (assumed == group)) for group in np.unique(assumed).tolist()
    ]
    measured = sum((scale * points for (scale, _), points in parts), np.zeros(len(squares)))
    before = np.zeros(sure.shape[1]) if spans is None else spans**-2.0
    inverse = np.linalg.pinv(found.products + np.diag(before))
    solve = inverse @ sure.T
    known = (solve * measured) @ solve.T + (inverse * before) @ inverse.T
    chaos = solve @ (found.scatter * (1 + 1 / REPLICAS)) @ solve.T
    level = (1 + CONFIDENCE) / 2
    covariance, from_slopes = _with_doubt(known + chaos, found, solve, before, level)
    errors = np.sqrt(np.diag(covariance))
    safe = np.where(errors > 0, errors, 1.0)
    doubt = sum(
        np.minimum(scale * (solve**2 @ points) / safe**2, 1.0) ** 2 / freedom for (scale, freedom), points in parts
    )
    doubt += np.minimum(np.diag(chaos) / safe**2, 1.0) ** 2 / found.freedom[0]
    reach = errors * np.where(doubt > 0, t.ppf(level, 1 / np.where(doubt > 0, doubt, 1.0)), norm.ppf(level))
    overall = float(np.sqrt(squares.sum() / left.sum()))
    part = np.minimum((np.diag(chaos) + from_slopes) / safe**2, 1.0)
    return Uncertainty(errors, reach, covariance / np.outer(safe, safe), part, overall)


def _with_doubt(
    covariance: Floats, found: Linearised, solve: Floats, before: Floats, level: float
) -> tuple[Floats, Floats]:
    """Covariance with what errors of properties times the noise of their slopes add to it, and that part's diagonal.

    A standard error p of a property makes noise p^2 C of the points, where C is the covariance of its slopes, and such
    noise makes errors: p^2 = q^2 + F T p^2. With Student's quantile squared for F this is Fieller's interval of a
    ratio. It is unbounded where the slopes are not beyond their noise; then p is what the bounds leave open.
    """
    alone = np.diag(covariance)
    if found.doubt is None:
        return covariance, np.zeros(len(alone))
    spread = t.ppf(level, found.freedom[1]) ** 2 * np.einsum("in,knm,jm->kij", solve, found.doubt, solve)
    most = np.divide(1.0, before, out=np.full(len(alone), np.inf), where=before > 0)
    variances = np.minimum(alone, most)
    for _ in range(ROUNDS):
        variances = np.minimum(alone + np.einsum("k,kii->i", variances, spread), most)
    added = np.einsum("k,kij->ij", variances, spread)
    total = covariance + added
    fewer = np.sqrt(np.divide(variances, np.diag(total), out=np.ones(len(alone)), where=np.diag(total) > 0))
    return total * np.outer(fewer, fewer), np.diag(added) * fewer**2


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
