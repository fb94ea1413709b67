"""Look for properties near the minimum, over the whole range between their bounds.

Contact makes the misfit rugged far from its minimum. Therefore each property is first searched in the kind of
experiment that determines it best, one kind after the other: friction in drags of feet, the modulus in diameters, the
inflation rate in gaits. Each of these searches samples the whole range between the bounds, then the surroundings of
the best few samples that are apart: a misfit may have several minima, and scatter may hide the deepest.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.stats.qmc import LatinHypercube

from optim.calibration.misfit import Linearised, Misfit
from robots.calibration import KINDS, Drag, Experiment, Properties
from robots.calibration.experiments import spoken_reading
from taichi_sim.base.arrays import Floats

Told = Callable[[float, str], None]
LOOK = 16  # sample points for each property; the number of robots in a vector in version 1.0
FEW = 4  # best of them around which is looked closer
STARTS = 8  # best of all of them from which a fit may begin
STEPS = 2  # from each, before it is told which are worth a fit
FAR_ABOVE = 20.0  # medians of its experiment: a value above them is likely in another unit


class Start(NamedTuple):
    """Where a fit may begin."""

    cost: float  # sum of squares of one replica there, in the experiments in which it was last looked for
    properties: Properties


class Diverged(RuntimeError):
    """A simulation diverges where a fit begins."""


def look_around(misfit: Misfit, told: Told) -> list[Start]:
    """Properties near minima, the best first: each is searched in the kind of experiment that determines it best.

    Friction is searched before the properties are checked, as drags are fast and sensitivities are not.
    """
    told_by_drags = {experiment.informs[0] for experiment in misfit.experiments if isinstance(experiment, Drag)}
    rubbed = tuple(name for name in misfit.names if name in told_by_drags)
    at = _look(misfit, Drag, rubbed, 0.0, told) if rubbed else [Start(0.0, misfit.start)]
    homes, scatter = _checked_homes(replace(misfit, start=at[0].properties))
    for kind in KINDS:
        names = tuple(name for name in misfit.names if name not in rubbed and issubclass(homes[name], kind))
        at = _look(replace(misfit, start=at[0].properties), kind, names, scatter, told) if names else at
    return _followed(misfit, at, scatter)


def _followed(misfit: Misfit, starts: Sequence[Start], scatter: Floats) -> list[Start]:
    """Starts after a few steps in all experiments, side by side, the best first; of those that meet one is left.

    What a sample costs tells little of the minimum that it leads to where a valley is narrow.
    """
    if len(starts) < 2:
        return list(starts)
    (low, high), points, costs = misfit.limits, list[Floats](), list[Floats]()
    there = np.array([misfit.of(start.properties) for start in starts])
    for _ in range(STEPS):
        points.append(there)
        cost, there = misfit.stepped(there, scatter)
        costs.append(cost)
    points.append(there)
    costs.append(misfit.costs(there, scatter))
    best, one_each = np.argmin(costs, axis=0), np.arange(len(starts))
    ends, least = np.array(points)[best, one_each], np.array(costs)[best, one_each]
    kept = _apart((ends - low) / (high - low), least, 2 / (LOOK - 1), STARTS)
    return [Start(float(least[number]), misfit.properties(ends[number])) for number in kept]


def _look(misfit: Misfit, kind: type, names: tuple[str, ...], scatter: Floats | float, told: Told) -> list[Start]:
    """Best of samples between the bounds and around the best few of these, in one kind of experiment, the best first.

    ``scatter`` is the variance of one replica's residuals in all experiments, shape (N,), or none.
    """
    of_kind = [isinstance(experiment, kind) for experiment in misfit.experiments]
    part = replace(
        misfit, experiments=[e for e, use in zip(misfit.experiments, of_kind, strict=True) if use], names=names
    )
    points = np.repeat(of_kind, [len(experiment.values) for experiment in misfit.experiments])
    scatter = np.broadcast_to(scatter, points.shape)[points]
    low, high = part.limits
    samples, width = _samples(len(names), LOOK)
    costs = part.costs(low + (high - low) * samples, scatter)
    best = _apart(samples, costs, width, FEW)
    closer, _ = _samples(len(names), LOOK if kind is Drag else LOOK // 2)
    near = np.concatenate([np.clip(each + width * (closer - 0.5), 0.0, 1.0) for each in samples[best]])
    samples, costs = np.vstack([samples, near]), np.append(costs, part.costs(low + (high - low) * near, scatter))
    at = [
        Start(float(costs[number]), part.properties(low + (high - low) * samples[number]))
        for number in _apart(samples, costs, width, STARTS)
    ]
    told(0.2 * (1 + KINDS.index(kind)), f"{kind.__name__.lower()}: {listed(names, at[0].properties)}")
    return at


def _samples(count: int, each: int) -> tuple[Floats, float]:
    """Points in the unit cube of properties, so many for each of these; and the width of what is around one of them."""
    if count == 1:
        return np.linspace(0.0, 1.0, each)[:, None], 2 / (LOOK - 1)
    return LatinHypercube(count, rng=np.random.default_rng(0)).random(each * count), 0.25


def _apart(samples: Floats, costs: Floats, width: float, few: int) -> list[int]:
    """Numbers of the best few samples, none within the surroundings of a better one, and of those that diverge none."""
    kept: list[int] = []
    for number in np.argsort(costs, kind="stable").tolist():
        if kept and not np.isfinite(costs[number]):
            break
        if len(kept) < few and all(np.abs(samples[number] - samples[other]).max() > 0.51 * width for other in kept):
            kept.append(number)
    return kept


def _checked_homes(misfit: Misfit) -> tuple[dict[str, type], Floats]:
    """Find the kind of experiment that determines each property best; refuse properties that the data do not determine.

    The unit of each logarithm is the standard deviation of a uniform distribution between the bounds. Data determine
    a combination of properties if its standard error is below one such unit. A property is determined best by
    experiments made for it and, among these, or if there are none, by those with the largest slopes. Scatter is noise
    of the points here. That it is noise of the slopes, too, is told after the fit, between wider differences. Data may
    tell nothing where the fit begins, such as friction near its least bound, and much elsewhere: before they are
    refused, they are tried at the best few samples.

    Returns:
        The kind of each property, and the variance of one replica's residuals, shape (N,).

    Raises:
        ValueError: if the data do not determine a combination of properties.
    """
    found, scatter, unclear = _told_at(misfit, misfit.of(misfit.start))
    for point in _elsewhere(misfit, scatter) if unclear else []:
        with suppress(Diverged):
            there = _told_at(misfit, point)
            if not there[2]:
                found, scatter, unclear = there
                break
    if unclear:
        what = " and ".join(unclear) + (" apart" if len(unclear) > 1 else "")
        more = _far_off(misfit.experiments) or "add experiments or points that do, or fit fewer"
        raise ValueError(f"fit: the data cannot tell {what}; {more}")
    edges = np.cumsum([len(experiment.values) for experiment in misfit.experiments])[:-1]
    homes: dict[str, type] = {}
    for name, column in zip(misfit.names, (found.sure * misfit.spans).T, strict=True):
        told = [
            (experiment.informs[0] == name, float(part @ part))
            for experiment, part in zip(misfit.experiments, np.split(column, edges), strict=True)
        ]
        homes[name] = type(misfit.experiments[told.index(max(told))])
    return homes, scatter


def _told_at(misfit: Misfit, point: Floats) -> tuple[Linearised, Floats, list[str]]:
    """The weighted misfit at a point, the variance of one replica's residuals, and what the data do not tell there."""
    found = simulated(misfit, point)
    scatter = np.diag(found.scatter)
    found = found.weighted(1 / np.sqrt(1 + 2 * scatter))
    _, sizes, ways = np.linalg.svd(found.slopes * misfit.spans, full_matrices=False)
    part = np.abs(ways[-1])
    told = sizes[-1] >= 1
    return found, scatter, [] if told else [n for n, p in zip(misfit.names, part, strict=True) if p > 0.5 * part.max()]


def _elsewhere(misfit: Misfit, scatter: Floats) -> list[Floats]:
    """The best few samples between the bounds, of all properties in all experiments, the best first."""
    (low, high), (samples, width) = misfit.limits, _samples(len(misfit.names), LOOK)
    points = low + (high - low) * samples
    return [points[number] for number in _apart(samples, misfit.costs(points, scatter), width, FEW)]


def _far_off(experiments: Sequence[Experiment]) -> str:
    """Names a value so far above the others of its experiment that the deviation assumed by it drowns them, if any."""
    for experiment in experiments:
        sizes = np.abs(experiment.values)
        if experiment.deviations is None and sizes.max() > FAR_ABOVE * np.median(sizes) > 0:
            place = int(sizes.argmax())
            times = f"{sizes[place] / np.median(sizes):.3g} times the median"
            return f"{spoken_reading(experiment, place)} is {times}; check it, or give deviations"
    return ""


def simulated(misfit: Misfit, point: Floats) -> Linearised:
    """The misfit at a point, linearised.

    Raises:
        Diverged: if a simulation diverges there.
    """
    found = misfit.linearised(point)
    if not np.isfinite(found.predictions).all():
        raise Diverged("the simulation diverges where the fit begins; give other bounds")
    return found


def listed(names: Sequence[str], properties: Properties) -> str:
    """Names and values of properties as one line of text."""
    return ", ".join(f"{name} {getattr(properties, name):.4g}" for name in names)
