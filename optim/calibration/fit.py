"""Weighted least squares of the inflatable robot's properties to experiments on a rig.

Contact makes a misfit rugged far from its minimum, so what an experiment tells best is looked for there first, one
kind of experiment after the other: friction in dragged feet, the modulus in diameters, the inflation rate in gaits.
Each look goes over all of the bounds, then closer. From there all properties go down together on all data, by SciPy's
trust region reflective method (Branch, Coleman & Li, SIAM Journal on Scientific Computing 21, 1999). Properties are
positive and searched as logarithms. Derivatives are central differences whose robots are simulated side by side with
the others of the step. The lattice's reverse mode would not help: the rate acts through the steps at which a bladder
arrives, and friction through switches, which it does not differentiate.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.stats.qmc import LatinHypercube

from optim.calibration.misfit import REPLICAS, Linearised, Misfit, deviations_of
from optim.calibration.uncertainty import Uncertainty, uncertainty
from robots.calibration import BOUNDS, NAMES, Diameter, Drag, Experiment, Gait, Laboratory, Properties, Trial
from taichi_sim.base.arrays import Floats

KINDS = (Drag, Diameter, Gait)  # in the order in which they are looked at
LOOK = 16  # robots side by side, see docs/performance.md
_STEPS = 8  # evaluations of the joint fit
_INSIDE = 1e-6  # between bounds and where SciPy may begin
_NEAR_BOUND = 0.01  # of the logarithm


@dataclass(frozen=True, eq=False)
class Calibration:
    """What was found.

    Attributes:
        before: properties that the search began with.
        after: those found.
        names: of the properties that were fitted, K.
        uncertainty: of their logarithms.
        predictions: of all points before and after, shape (2, N).
        misfit: root mean square residual before and after, in standard deviations.
        at_bound: names of properties that ended at a bound.
    """

    before: Properties
    after: Properties
    names: tuple[str, ...]
    uncertainty: Uncertainty
    predictions: Floats
    misfit: tuple[float, float]
    at_bound: tuple[str, ...]

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
    progress: Callable[[float, str], None] | None = None,
) -> Calibration:
    """Fit properties to experiments, beginning with those of the laboratory's robot.

    Args:
        experiments: what was measured.
        laboratory: how it is simulated; stiff enough for the bounds.
        names: of the properties to fit.
        bounds: of the properties.
        progress: called with the fraction done, roughly, and what was found.

    Raises:
        ValueError: in one line, for unknown names, too few points, and properties that the data cannot tell.
        RuntimeError: in one line, if the robot diverges where the joint fit begins.
    """
    check_names(experiments, names)
    before = Properties.of(laboratory.geometry, laboratory.actuation)
    told = progress or (lambda fraction, text: None)
    search = _Search(experiments, laboratory, tuple(names), dict(bounds), told)
    return search.descend(search.look_around(before), before)


def check_names(experiments: Sequence[Experiment], names: Sequence[str]) -> None:
    """Check, before anything is simulated, that experiments may tell these properties.

    Raises:
        ValueError: in one line.
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


@dataclass(frozen=True, eq=False)
class _Search:
    experiments: Sequence[Experiment]
    laboratory: Laboratory
    names: tuple[str, ...]
    bounds: dict[str, tuple[float, float]]
    told: Callable[[float, str], None]

    def misfit(self, experiments: Sequence[Experiment], names: tuple[str, ...], at: Properties) -> Misfit:
        return Misfit(experiments, self.laboratory, names, at, self.bounds, deviations_of(experiments)[0])

    def look_around(self, at: Properties) -> Properties:
        """Properties near the minimum: each looked for in the kind of experiment that tells it best.

        A drag is soon simulated, a sensitivity is not: friction is looked for before properties are checked.
        """
        drags = [experiment for experiment in self.experiments if isinstance(experiment, Drag)]
        rubbed = tuple(name for name in self.names if name in {drag.informs[0] for drag in drags})
        at = self.look(Drag, rubbed, at)
        homes = self.check_rank(at)
        for kind in KINDS:
            at = self.look(kind, tuple(n for n in self.names if n not in rubbed and homes[n] is kind), at)
        return at

    def look(self, kind: type, names: tuple[str, ...], at: Properties) -> Properties:
        """The best of a look over all of the bounds, and of a closer one around what that found."""
        if not names:
            return at
        misfit = self.misfit([e for e in self.experiments if isinstance(e, kind)], names, at)
        low, high = misfit.limits
        if len(names) == 1:
            points, width = np.linspace(0.0, 1.0, LOOK)[:, None], 2 / (LOOK - 1)
        else:
            points, width = LatinHypercube(len(names), rng=np.random.default_rng(0)).random(LOOK * len(names)), 0.25
        best = _least(misfit, low + (high - low) * points)
        closer = best + width * (high - low) * (points - 0.5)
        at = misfit.properties(_least(misfit, np.clip(closer, low, high)))
        self.told(0.2 * (1 + KINDS.index(kind)), f"{kind.__name__.lower()}: {_listed(names, at)}")
        return at

    def check_rank(self, at: Properties) -> dict[str, type]:
        """Refuse properties that the data cannot tell; for the others the kind of experiment that tells them best.

        In units of what the bounds leave open (the standard deviation of a uniform deviate between them), data tell
        a combination of properties if its standard error is below one.
        """
        misfit = self.misfit(self.experiments, self.names, at)
        low, high = misfit.limits
        slopes = _simulated(misfit, misfit.of(at)).slopes * (high - low) / np.sqrt(12)
        _, sizes, ways = np.linalg.svd(slopes, full_matrices=False)
        if sizes[-1] < 1:
            part = np.abs(ways[-1])
            unclear = [name for name, p in zip(self.names, part, strict=True) if p > 0.5 * part.max()]
            what = " and ".join(unclear) + (" apart" if len(unclear) > 1 else "")
            raise ValueError(f"fit: the data cannot tell {what}; add experiments or points that do, or fit fewer")
        return {name: self.home(name, column) for name, column in zip(self.names, slopes.T, strict=True)}

    def home(self, name: str, slopes: Floats) -> type:
        """The kind of experiment that tells a property best: by its nature, or else by slopes of shape (N,)."""
        parts = np.split(slopes, np.cumsum([len(e.values) for e in self.experiments])[:-1])
        told = [
            (experiment.informs[0] == name, float(part @ part), type(experiment))
            for experiment, part in zip(self.experiments, parts, strict=True)
        ]
        return max(told, key=lambda entry: entry[:2])[2]

    def descend(self, at: Properties, before: Properties) -> Calibration:
        """The joint fit, where the simulator's scatter counts as noise too."""
        misfit = self.misfit(self.experiments, self.names, at)
        low, high = misfit.limits
        point = np.clip(misfit.of(at), low + _INSIDE, high - _INSIDE)
        first = _simulated(misfit, point)
        factors = 1 / np.sqrt(1 + (1 + 1 / REPLICAS) * np.diag(first.scatter))
        seen = {point.tobytes(): first.weighted(factors)}

        def around(x: Floats) -> Linearised:
            if x.tobytes() not in seen:
                seen[x.tobytes()] = misfit.linearised(x).weighted(factors)
                self.told(0.6 + 0.4 * len(seen) / (_STEPS + 1), f"all: {_listed(self.names, misfit.properties(x))}")
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
        given = deviations_of(self.experiments)[1]
        return Calibration(
            before,
            misfit.properties(end),
            self.names,
            uncertainty(found, given, factors**2),
            predictions,
            (float(misses[0]), float(misses[1])),
            tuple(name for name, flag in zip(self.names, near, strict=True) if flag),
        )


def _simulated(misfit: Misfit, point: Floats) -> Linearised:
    found = misfit.linearised(point)
    if not np.isfinite(found.predictions).all():
        raise RuntimeError("the simulation diverges where the fit begins; give other bounds")
    return found


def _least(misfit: Misfit, points: Floats) -> Floats:
    best: Floats = points[int(np.argmin(misfit.costs(points)))]
    return best


def _listed(names: Sequence[str], properties: Properties) -> str:
    return ", ".join(f"{name} {getattr(properties, name):.4g}" for name in names)
