"""Fit the inflatable robot's properties to experiments on a rig by weighted least squares.

Contact makes the misfit rugged far from its minimum. Therefore each property is first searched in the kind of
experiment that determines it best, one kind after the other: friction in drags of feet, the modulus in diameters, the
inflation rate in gaits. Each of these searches samples the whole range between the bounds, then the surroundings of
the best sample. From there all properties are fitted together to all data, by SciPy's trust region reflective method
(Branch, Coleman & Li, SIAM Journal on Scientific Computing 21, 1999). Properties are positive, so their logarithms are
fitted. Derivatives are central differences, whose robots are simulated in one batch with the others of the step. The
lattice's reverse mode would not help, as it differentiates neither the steps at which a bladder arrives, through which
the rate acts, nor switches, through which friction acts.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares
from scipy.stats.qmc import LatinHypercube

from optim.calibration.misfit import REPLICAS, Linearised, Misfit, Uncertainty, uncertainty
from robots.calibration import BOUNDS, KINDS, NAMES, Drag, Experiment, Laboratory, Properties, Trial
from taichi_sim.base.arrays import Floats

Told = Callable[[float, str], None]
LOOK = 16  # sample points for each property; the number of robots in a vector in version 1.0
STIFFER = 1.1  # times the modulus that was found: how far the last fit may go where steps depend on it
_STEPS = 8  # maximum number of evaluations of the joint fit
_INSIDE = 1e-6  # least distance of SciPy's start from the bounds, of the logarithm
_NEAR_BOUND = 0.01  # distance from a bound, of the logarithm, below which a property counts as at the bound


@dataclass(frozen=True, eq=False)
class Calibration:
    """Result of a fit: properties before and after it, and their uncertainty."""

    before: Properties  # properties before the fit
    after: Properties  # fitted properties
    names: tuple[str, ...]  # of the properties that were fitted, K
    uncertainty: Uncertainty  # of their logarithms
    predictions: Floats  # predictions of all points before and after the fit, shape (2, N)
    misfit: tuple[float, float]  # root mean square residual before and after, in standard deviations
    at_bound: tuple[str, ...]  # names of properties that ended at a bound

    @property
    def intervals(self) -> Floats:
        """95 % confidence intervals, each in its own unit, shape (K, 2)."""
        middle = np.log([getattr(self.after, name) for name in self.names])
        return np.exp(middle[:, None] + np.outer(self.uncertainty.reach, [-1.0, 1.0]))


def calibrate(
    experiments: Sequence[Experiment],
    laboratory: Laboratory,
    names: Sequence[str] = NAMES,
    bounds: Mapping[str, tuple[float, float]] = BOUNDS,
    progress: Told | None = None,
) -> Calibration:
    """Fit properties to experiments, starting from those of the laboratory's robot.

    All are simulated at the time step that the stiffest robot within the bounds needs, and fitted once more from there
    at that of the robot found, if it is another.

    Raises:
        ValueError: for unknown names, too few points, or properties that the data do not determine.
        RuntimeError: if the robot diverges at the start of the joint fit.
    """
    check_names(experiments, names)
    before = Properties.of(laboratory.geometry, laboratory.actuation)
    told = progress or (lambda fraction, text: None)
    misfit = Misfit(experiments, laboratory, tuple(names), before, bounds)
    found = _descend(replace(misfit, start=_look_around(misfit, told)), before, told, (0.6, 0.8))
    played = laboratory.as_played(found.after)
    if played.time_step == laboratory.time_step:
        return found
    within = {
        **bounds,
        "modulus": modulus_near(found.after.modulus, bounds["modulus"], laboratory.geometry.most_modulus),
    }
    return _descend(replace(misfit, laboratory=played, start=found.after, bounds=within), before, told, (0.8, 1.0))


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


def _look_around(misfit: Misfit, told: Told) -> Properties:
    """Properties near the minimum: each is searched in the kind of experiment that determines it best.

    Friction is searched before the properties are checked, as drags are fast and sensitivities are not.
    """
    told_by_drags = {experiment.informs[0] for experiment in misfit.experiments if isinstance(experiment, Drag)}
    rubbed = tuple(name for name in misfit.names if name in told_by_drags)
    at = _look(misfit, Drag, rubbed, told)
    homes = _checked_homes(replace(misfit, start=at))
    for kind in KINDS:
        names = tuple(name for name in misfit.names if name not in rubbed and homes[name] is kind)
        at = _look(replace(misfit, start=at), kind, names, told)
    return at


def _look(misfit: Misfit, kind: type, names: tuple[str, ...], told: Told) -> Properties:
    """Best of samples between the bounds, then of samples around that best, in one kind of experiment."""
    if not names:
        return misfit.start
    part = replace(misfit, experiments=[e for e in misfit.experiments if isinstance(e, kind)], names=names)
    low, high = part.limits
    if len(names) == 1:
        points, width = np.linspace(0.0, 1.0, LOOK)[:, None], 2 / (LOOK - 1)
    else:
        points, width = LatinHypercube(len(names), rng=np.random.default_rng(0)).random(LOOK * len(names)), 0.25
    best = _least(part, low + (high - low) * points)
    closer = best + width * (high - low) * (points - 0.5)
    at = part.properties(_least(part, np.clip(closer, low, high)))
    told(0.2 * (1 + KINDS.index(kind)), f"{kind.__name__.lower()}: {_listed(names, at)}")
    return at


def _least(misfit: Misfit, points: Floats) -> Floats:
    best: Floats = points[int(np.argmin(misfit.costs(points)))]
    return best


def _checked_homes(misfit: Misfit) -> dict[str, type]:
    """Find the kind of experiment that determines each property best; refuse properties that the data do not determine.

    The unit of each logarithm is the standard deviation of a uniform distribution between the bounds. Data determine
    a combination of properties if its standard error is below one such unit. A property is determined best by
    experiments made for it and, among these, or if there are none, by those with the largest slopes.

    Raises:
        ValueError: if the data do not determine a combination of properties.
    """
    low, high = misfit.limits
    slopes = _simulated(misfit, misfit.of(misfit.start)).slopes * (high - low) / np.sqrt(12)
    _, sizes, ways = np.linalg.svd(slopes, full_matrices=False)
    if sizes[-1] < 1:
        part = np.abs(ways[-1])
        unclear = [name for name, p in zip(misfit.names, part, strict=True) if p > 0.5 * part.max()]
        what = " and ".join(unclear) + (" apart" if len(unclear) > 1 else "")
        raise ValueError(f"fit: the data cannot tell {what}; add experiments or points that do, or fit fewer")
    edges = np.cumsum([len(experiment.values) for experiment in misfit.experiments])[:-1]
    homes: dict[str, type] = {}
    for name, column in zip(misfit.names, slopes.T, strict=True):
        told = [
            (experiment.informs[0] == name, float(part @ part))
            for experiment, part in zip(misfit.experiments, np.split(column, edges), strict=True)
        ]
        homes[name] = type(misfit.experiments[told.index(max(told))])
    return homes


def _descend(misfit: Misfit, before: Properties, told: Told, share: tuple[float, float]) -> Calibration:
    """Fit all properties jointly; the scatter of the simulator counts as additional noise.

    ``share`` is where its progress begins and ends.
    """
    begin, finish = share
    low, high = misfit.limits
    point = np.clip(misfit.of(misfit.start), low + _INSIDE, high - _INSIDE)
    first = _simulated(misfit, point)
    factors = 1 / np.sqrt(1 + (1 + 1 / REPLICAS) * np.diag(first.scatter))
    seen = {point.tobytes(): first.weighted(factors)}

    def around(x: Floats) -> Linearised:
        if x.tobytes() not in seen:
            seen[x.tobytes()] = misfit.linearised(x).weighted(factors)
            done = begin + (finish - begin) * len(seen) / (_STEPS + 1)
            told(done, f"all: {_listed(misfit.names, misfit.properties(x))}")
        return seen[x.tobytes()]

    end = least_squares(
        lambda x: around(x).residuals,
        point,
        jac=lambda x: around(x).slopes,
        bounds=(low, high),
        xtol=1e-3,
        ftol=1e-4,
        max_nfev=_STEPS,
    ).x
    found, began = around(end), misfit.predictions([Trial(before)])[0]
    predictions = np.array([began, found.predictions])
    misses = np.sqrt(np.mean(((predictions - misfit.measured) / misfit.deviations * factors) ** 2, axis=1))
    near = np.minimum(end - low, high - end) < _NEAR_BOUND
    return Calibration(
        before,
        misfit.properties(end),
        misfit.names,
        uncertainty(found, misfit.assumed, factors**2),
        predictions,
        (float(misses[0]), float(misses[1])),
        tuple(name for name, flag in zip(misfit.names, near, strict=True) if flag),
    )


def _simulated(misfit: Misfit, point: Floats) -> Linearised:
    found = misfit.linearised(point)
    if not np.isfinite(found.predictions).all():
        raise RuntimeError("the simulation diverges where the fit begins; give other bounds")
    return found


def _listed(names: Sequence[str], properties: Properties) -> str:
    return ", ".join(f"{name} {getattr(properties, name):.4g}" for name in names)
