"""Fit the inflatable robot's properties to experiments on a rig by weighted least squares.

From where ``optim.calibration.look`` found them, all properties are fitted together to all data, by steps of Gauss and
Newton within the bounds. Properties are positive, so their logarithms are fitted. Derivatives are central differences,
whose robots are simulated in one batch with the others of the step. The lattice's reverse mode would not help, as it
differentiates neither the steps at which a bladder arrives, through which the rate acts, nor switches, through which
friction acts. Where gaits are chaotic, sums of squares and slopes are random: a step that is small against the errors
is not taken, and one counts as worse only beyond the scatter of the sums.
"""

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from optim.calibration.look import Diverged, Told, listed, look_around, simulated
from optim.calibration.misfit import (
    ASSUMED,
    CONFIDENCE,
    DIFFERENCE,
    GIVEN,
    REPLICAS,
    SMALLEST,
    TOO_LARGE,
    WIDEST,
    Linearised,
    Misfit,
    Uncertainty,
)
from optim.calibration.misfit import uncertainty as uncertainty_of
from optim.calibration.outliers import outliers
from robots.calibration import BOUNDS, NAMES, Experiment, Laboratory, Properties, Replica
from taichi_sim.base.arrays import Floats

STIFFER = 1.1  # times the modulus that was found: how far the last fit may go where steps depend on it
_NEARLY = 10.0  # chi-square above that of the best sample up to which another one may lead to the deepest minimum
_AS_LIKELY = float(chi2.ppf(CONFIDENCE, 1))  # chi-square above that of the end that is kept: as far as intervals reach
_STEPS = 8  # maximum number of evaluations of the joint fit
_SMALL = 0.2  # steps in standard errors that are not worth an evaluation
_RANDOM = 0.6  # more of those that scatter makes: steps to the mean of the replicas are random by a third of these
_HARDLY = 0.5**0.5  # errors, in those that the bounds leave, from which data tell less than the bounds
_NEAR_BOUND = 0.01  # distance from a bound, of the logarithm, below which a property counts as at the bound


@dataclass(frozen=True, eq=False)
class Calibration:
    """Result of a fit: properties before and after it, and their uncertainty."""

    before: Properties  # properties before the fit
    after: Properties  # fitted properties
    names: tuple[str, ...]  # of the properties that were fitted, K
    uncertainty: Uncertainty  # of their logarithms
    intervals: Floats  # 95 % confidence intervals, each in its own unit, shape (K, 2)
    predictions: Floats  # predictions of all points before and after the fit, shape (2, N)
    misfit: tuple[float, float]  # root mean square residual before and after, in standard deviations
    unlikelihood: float  # minus twice the logarithm of the likelihood after the fit, up to a constant
    at_bound: tuple[str, ...]  # names of properties that ended at a bound
    hardly_told: tuple[str, ...]  # names of properties of which the bounds tell more than the data
    outliers: tuple[str, ...]  # measurements too far off to be noise, a line each
    rival: Properties | None = None  # another minimum, outside the intervals, that is about as likely


def calibrate(
    experiments: Sequence[Experiment],
    laboratory: Laboratory,
    names: Sequence[str] = NAMES,
    bounds: Mapping[str, tuple[float, float]] = BOUNDS,
    progress: Told | None = None,
) -> Calibration:
    """Fit properties to experiments, starting from those of the laboratory's robot.

    All are simulated at the time step that the stiffest robot within the bounds needs, and fitted once more from there
    at that of the robot found, if it is another. A misfit may have several minima: samples that are nearly as good as
    the best are fitted, too, and all of them where residuals stay too large; the likeliest end is kept.

    Raises:
        ValueError: for unknown names, too few points, or properties that the data do not determine.
        Diverged: if the robot diverges at the start of the joint fit.
    """
    check_names(experiments, names)
    before = Properties.of(laboratory.geometry, laboratory.actuation)
    told = progress or (lambda fraction, text: None)
    misfit = Misfit(experiments, laboratory, tuple(names), before, bounds, known=bounds)
    first, *others = look_around(misfit, told)
    found = _descend(replace(misfit, start=first.properties), before, told, (0.6, 0.8))
    ends = [found]
    for other in others:
        if other.cost > first.cost + _NEARLY * max(found.uncertainty.noise, 1.0) ** 2 and _agrees(misfit, found):
            break
        with contextlib.suppress(Diverged):  # the fits that there are stay
            ends.append(_descend(replace(misfit, start=other.properties), before, told, (0.8, 0.8)))
            found = min(ends, key=lambda each: each.unlikelihood)
    found = replace(found, rival=_rival(misfit, found, ends))
    played = laboratory.as_played(found.after)
    if played.time_step == laboratory.time_step:
        return found
    near = modulus_near(found.after.modulus, bounds["modulus"], laboratory.geometry.most_modulus)
    within, width = {**bounds, "modulus": near}, _width(found.uncertainty)
    there = replace(misfit, laboratory=played, start=found.after, bounds=within, width=width)
    return replace(_descend(there, before, told, (0.8, 1.0)), rival=found.rival)


def _agrees(misfit: Misfit, found: Calibration) -> bool:
    """Whether residuals are as small as deviations say: given ones by the chi-square test, assumed ones are a guess."""
    freedom = len(misfit.measured) - len(misfit.names)
    known = (misfit.assumed == GIVEN).all()
    return found.uncertainty.noise <= (np.sqrt(chi2.ppf(CONFIDENCE, freedom) / freedom) if known else TOO_LARGE)


def _rival(misfit: Misfit, found: Calibration, ends: Sequence[Calibration]) -> Properties | None:
    """The likeliest other end outside the intervals, if it is about as likely; deviations scale as those of a fit."""
    least = 1.0 if (misfit.assumed == GIVEN).any() else SMALLEST / ASSUMED
    most = found.unlikelihood + _AS_LIKELY * max(found.uncertainty.noise, least) ** 2
    low, high = found.intervals.T
    for end in sorted(ends, key=lambda each: each.unlikelihood):
        values = np.array([getattr(end.after, name) for name in misfit.names])
        if end.unlikelihood <= most and ((values < low) | (values > high)).any():
            return end.after
    return None


def modulus_near(found: float, bounds: tuple[float, float], most: float) -> tuple[float, float]:
    """Bounds within which a modulus keeps the time step of the one that was found; ``most`` is that of the geometry's.

    Above it steps get shorter with the modulus, by 5 % at most within these bounds.
    """
    low, high = bounds
    return (low, min(high, most)) if found <= most else (max(low, most), min(high, found * STIFFER))


def check_names(experiments: Sequence[Experiment], names: Sequence[str]) -> None:
    """Check, before anything is simulated, that experiments may determine these properties.

    Raises:
        ValueError: for unknown names, too few points, or properties that act in no experiment.
    """
    if unknown := [name for name in names if name not in NAMES]:
        raise ValueError(f"fit: {unknown[0]!r} is unknown; choose of {', '.join(NAMES)}")
    if not names or len(set(names)) < len(names):
        raise ValueError(f"fit: {','.join(names)!r} is not allowed; name each property once")
    informed = {name for experiment in experiments for name in experiment.informs}
    if missing := [name for name in names if name not in informed]:
        kinds = {"low_friction": "a drag of a foot that slides, or a gait", "inflation_rate": "a gait"}
        raise ValueError(
            f"fit: {missing[0]} does not act in these experiments; add "
            f"{kinds.get(missing[0], 'a gait')}, or do not fit it"
        )
    points = sum(len(experiment.values) for experiment in experiments)
    if points <= len(names):
        raise ValueError(
            f"data: {points} points are not enough for {len(names)} properties; give at least {len(names) + 1}"
        )


def _descend(misfit: Misfit, before: Properties, told: Told, share: tuple[float, float]) -> Calibration:
    """Fit all properties jointly; the scatter of the simulator counts as additional noise.

    ``share`` is where its progress begins and ends.
    """
    misfit, point, first = _as_wide_as_errors(misfit)
    factors = _factors(first)
    end, found = _stepped(misfit, point, first.weighted(factors), factors, told, share)
    began = misfit.predictions([Replica(before)])[0]
    predictions = np.array([began, found.predictions])
    misses = np.sqrt(np.mean(((predictions - misfit.measured) / misfit.deviations * factors) ** 2, axis=1))
    low, high = misfit.limits
    known = _uncertainty(misfit, found, factors)
    bound, hardly = np.minimum(end - low, high - end) < _NEAR_BOUND, known.errors > _HARDLY * misfit.spans
    around = np.clip(end[:, None] + np.outer(known.reach, [-1.0, 1.0]), *misfit.before.T[..., None])
    at_bound, hardly_told = (
        tuple(name for name, flag in zip(misfit.names, flags, strict=True) if flag) for flags in (bound, hardly)
    )
    return Calibration(
        before,
        misfit.properties(end),
        misfit.names,
        known,
        np.exp(np.where(hardly[:, None], misfit.before, around)),
        predictions,
        (float(misses[0]), float(misses[1])),
        float((found.residuals**2).sum() - 2 * np.log(factors).sum()),
        at_bound,
        hardly_told,
        outliers(found, misfit.experiments),
    )


def _stepped(
    misfit: Misfit, point: Floats, at: Linearised, factors: Floats, told: Told, share: tuple[float, float]
) -> tuple[Floats, Linearised]:
    """Where steps of Gauss and Newton from a point end, and the weighted misfit there.

    A step that makes the sum of squares larger, by more than its scatter, is halved. Slopes are the mean of those of
    all steps so far that are near, and so is the scatter.
    """
    (low, high), (begin, finish) = misfit.limits, share
    here, seen, step = at, [(point, at)], misfit.step(point, at)
    for count in range(1, _STEPS):
        known = _expected(misfit, at, factors)
        if (np.abs(step) <= (_SMALL + _RANDOM * np.sqrt(known.chaos)) * known.errors).all():
            break
        there = np.clip(point + step, low, high)
        alone = misfit.linearised(there).weighted(factors)
        told(begin + (finish - begin) * count / _STEPS, f"all: {listed(misfit.names, misfit.properties(there))}")
        if np.isfinite(alone.predictions).all():
            seen.append((there, alone))
        scatter = np.sqrt(np.maximum(8 * at.residuals @ at.scatter @ at.residuals / REPLICAS, 0.0))
        is_better = (alone.residuals**2).sum() <= (at.residuals**2).sum() + scatter
        if is_better:
            point, here = there, alone
        at = here.joined([each for where, each in seen if (np.abs(where - point) <= 2 * misfit.width).all()])
        step = misfit.step(point, at) if is_better else step / 2
    return point, at


def _as_wide_as_errors(misfit: Misfit) -> tuple[Misfit, Floats, Linearised]:
    """The misfit with differences as wide as the errors at its start, that point, and what is found there."""
    point = misfit.of(misfit.start)
    first = simulated(misfit, point)
    if np.ndim(misfit.width):  # errors are known of an earlier fit
        return misfit, point, first
    factors = _factors(first)
    width = _width(_expected(misfit, first.weighted(factors), factors))
    wider = replace(misfit, width=width)
    return wider, point, first if (width <= misfit.width).all() else simulated(wider, point)


def _width(known: Uncertainty) -> Floats:
    """Half widths of differences between which properties are not told apart, shape (K,)."""
    return np.clip(known.errors, DIFFERENCE, WIDEST)


def _expected(misfit: Misfit, found: Linearised, factors: Floats) -> Uncertainty:
    """Uncertainty at the end of a fit that goes on: its residuals will be no larger than their deviations."""
    return _uncertainty(misfit, replace(found, residuals=np.clip(found.residuals, -1.0, 1.0)), factors)


def _uncertainty(misfit: Misfit, found: Linearised, factors: Floats) -> Uncertainty:
    return uncertainty_of(found, misfit.assumed, factors**2, misfit.spans)


def _factors(found: Linearised) -> Floats:
    """Weights of residuals whose noise is that of the measurement and the scatter of the simulator, shape (N,)."""
    factors: Floats = 1 / np.sqrt(1 + (1 + 1 / REPLICAS) * np.diag(found.scatter))
    return factors
