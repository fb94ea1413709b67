"""Groups of runs: those that differ only in their seed make one group, whose best scores are one curve each.

The unit of statistics is the run; where every group is a single run of independent climbers, it is the climber. The
members of a population are not independent samples, nor are climbers that learn from each other, so a single run of
such has neither bands nor effect sizes.
"""

import json
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from optim.measures.statistics import known_interval, student_band
from optim.problem import DESIGN
from optim.runs.config import climbs_independently, identity, usual_settings
from optim.runs.history import History, begun
from optim.search.method import LARGEST
from taichi_sim.base.arrays import Floats

Axis = Literal["evaluations", "generations", "seconds"]
# A first generation that takes that many times as long as others, and that much longer [s], has compiled kernels.
MANY_TIMES, FEW_SECONDS = 3.0, 1.0


class Start(NamedTuple):
    """What tells whether units of two groups began alike.

    Attributes:
        seed: seed of the run.
        climber: number of the climber; None where the unit is the run.
        found: score of the climber in generation 0, or best score of the run in it and the values of the best point;
            None without any success.
    """

    seed: int | None
    climber: int | None
    found: float | tuple[float, tuple[tuple[str, float], ...]] | None


@dataclass(frozen=True)
class Curve:
    """Best scores so far of a group of runs, over evaluations, generations or time.

    Attributes:
        label: name of the group.
        folders: run folders of the group.
        unit: ``"runs"`` or ``"climbers"``.
        x: evaluations (of each climber, where these are the units), generations or seconds, increasing, shape (P,).
        scores: best score so far of each unit, shape (U, P); NaN until its first successful evaluation.
        starts: start of each unit; empty if they are not known.
    """

    label: str
    folders: tuple[str, ...]
    unit: str
    x: Floats
    scores: Floats
    starts: tuple[Start, ...] = ()

    def at(self, x: float) -> Floats:
        """Best scores at x of the units that have one, shape (at most U,); empty if x lies before the curve."""
        values = self.all_at(x)
        return values[~np.isnan(values)]

    def all_at(self, x: float) -> Floats:
        """Best scores at x of all units, NaN without any success, shape (U,); empty if x lies before the curve."""
        reached = int(np.searchsorted(self.x, x, side="right")) - 1
        return self.scores[:, reached] if reached >= 0 else np.empty(0)

    def band(self) -> tuple[Floats, Floats, Floats]:
        """Mean and both ends of its 95 % interval, shape (P,) each; NaN until all units have a score."""
        mean = self.scores.mean(axis=0)
        if len(self.scores) < 2:
            return mean, np.full_like(mean, np.nan), np.full_like(mean, np.nan)
        return mean, *student_band(self.scores)


@dataclass(frozen=True)
class Standing:
    """Scores of a group at one place on the axis.

    Attributes:
        label: label of its curve.
        folders: run folders of the group.
        unit: ``"runs"`` or ``"climbers"``.
        count: number of units.
        without_success: number of units that have no score so far.
        mean: mean best score of the other units; this and the following are None if there are no others.
        low: lower end of its 95 % interval by Student's t; None with fewer than two.
        high: upper end.
        best: highest of the best scores.
    """

    label: str
    folders: tuple[str, ...]
    unit: str
    count: int
    without_success: int
    mean: float | None
    low: float | None
    high: float | None
    best: float | None


@dataclass(frozen=True)
class MapStanding:
    """Quality or coverage of the maps of elites of a group of runs at one place on the axis.

    Attributes:
        label: label of its curve.
        name: ``"qd_score"``, the sum of the elites' scores above the method's offset, or ``"coverage"``, the share of
            cells that have one.
        runs: number of runs.
        mean: mean over the runs.
        low, high: its 95 % interval by Student's t; None for a single run.
    """

    label: str
    name: str
    runs: int
    mean: float
    low: float | None
    high: float | None


def map_standings(compared: Sequence[Curve], histories: Sequence[History], axis: Axis, x: float) -> list[MapStanding]:
    """Quality and coverage of maps at x, for each group whose runs all keep a map."""
    known = {str(history.path): history for history in histories}
    found = []
    for curve in compared:
        members = [known[folder] for folder in curve.folders]
        for name in ("qd_score", "coverage"):
            values = [_number_at(history, name, axis, x) for history in members]
            if all(value is not None for value in values):
                numbers = np.array(values, float)
                low, high = known_interval(numbers)
                found.append(MapStanding(curve.label, name, len(numbers), float(numbers.mean()), low, high))
    return found


def _number_at(history: History, name: str, axis: Axis, x: float) -> float | None:
    """A number that the method reported in the last generation up to x; None if there is none."""
    reached = int(np.searchsorted(_places(history, axis), x, side="right")) - 1
    return history.generations[reached].numbers.get(name) if reached >= 0 else None


def curves(histories: Sequence[History], axis: Axis, labels: Mapping[Path, str] | None = None) -> list[Curve]:
    """Make one curve for each group of runs that differ in their seed only.

    Args:
        histories: histories of the runs.
        axis: quantity over which they are compared.
        labels: labels of runs by folder; runs with one label are a group.

    Raises:
        ValueError: if a run has no generation yet, or its times are needed but unknown; if two runs of a group are
            the same search, share no part of the axis, or have one label and differ in more than their seed; or if a
            score is so large that its square is not finite.
    """
    labels = labels or {}
    for history in histories:
        begun(history)
        if axis == "seconds" and np.isnan(history.seconds).any():
            raise ValueError(f"by: the times of {history.path} are not known; compare by evaluations")
    groups: dict[tuple[str | None, str], list[History]] = {}
    for history in histories:
        key = labels.get(history.path), json.dumps(_without_seed(history.config), sort_keys=True)
        groups.setdefault(key, []).append(history)
    members = list(groups.values())
    named = [label for label, _ in groups]
    for label, group in zip(named, members, strict=True):
        _check_independent(group)
        if label is not None and named.count(label) > 1:
            raise ValueError(f"label: runs of {label!r} differ in {_difference(label, groups)}; only seeds may differ")
    single = all(len(group) == 1 for group in members)
    climbers = single and all(_has_independent_climbers(group[0]) for group in members)
    told = [label or usual for label, usual in zip(named, _labels(members), strict=True)]
    found = [_curve(label, group, axis, climbers) for label, group in zip(told, members, strict=True)]
    if axis == "seconds":
        _warn_of_slow_starts(histories)
    for curve in found:
        for score in curve.scores[abs(curve.scores) > LARGEST][:1]:
            where = ", ".join(curve.folders)
            raise ValueError(f"run: a score of {score:g}, in {where}, is not allowed here; give at most {LARGEST:g}")
    return found


def spoken_axis(compared: Sequence[Curve], axis: Axis) -> str:
    """What is counted along the axis: where climbers are the units, the evaluations of each."""
    own = axis == "evaluations" and all(curve.unit == "climbers" for curve in compared)
    return "evaluations of each climber" if own else axis


def shared_end(compared: Sequence[Curve], axis: Axis) -> float:
    """Last place on the axis that every curve has reached.

    Raises:
        ValueError: if a curve begins beyond it.
    """
    return _overlap({", ".join(curve.folders): curve.x for curve in compared}, axis)[1]


def standing(curve: Curve, x: float) -> Standing:
    """Summarise the scores of a group at x."""
    scores = curve.at(x)
    low, high = known_interval(scores)
    mean, best = (float(scores.mean()), float(scores.max())) if len(scores) else (None, None)
    without = len(curve.scores) - len(scores)
    return Standing(curve.label, curve.folders, curve.unit, len(curve.scores), without, mean, low, high, best)


def _overlap(places: Mapping[str, Floats], axis: Axis) -> tuple[float, float]:
    """Range of the axis that all runs cover; raises ValueError if there is none."""
    late = max(places, key=lambda name: float(places[name][0]))
    early = min(places, key=lambda name: float(places[name][-1]))
    begin, end = float(places[late][0]), float(places[early][-1])
    if begin > end:
        why = (
            ", as it seems to have compiled kernels first"
            if axis == "seconds" and _has_slow_start(places[late])
            else ""
        )
        raise ValueError(
            f"by: {early} ended at {end:g} {axis}, before {late} had a first score, at {begin:g}{why}; "
            "compare by generations, or continue what is short"
        )
    return begin, end


def _has_slow_start(places: Floats) -> bool:
    """Whether the first generation of a run took so much longer than others, at times [s], that kernels explain it."""
    return len(places) > 1 and bool(places[0] > MANY_TIMES * np.median(np.diff(places)) + FEW_SECONDS)


def _warn_of_slow_starts(histories: Sequence[History]) -> None:
    """Warn once of runs whose times seem to have what compiling kernels took in them, unless all have."""
    slow = [history for history in histories if _has_slow_start(_places(history, "seconds"))]
    if 0 < len(slow) < len(histories):
        first, *others = slow
        more = f", like that of {len(others)} more," if others else ""
        warnings.warn(
            f"the first generation of {first.path}{more} took {first.seconds[0]:.3g} s, as it seems to have "
            "compiled kernels, and others did not: compare by evaluations, or search again",
            stacklevel=2,
        )


def _check_independent(group: Sequence[History]) -> None:
    """Raise ValueError if two runs of a group have equal seeds, as one sample would be counted twice."""
    first: dict[str, Path] = {}
    for history in group:
        problem = {name: value for name, value in history.config["problem"].items() if name != DESIGN}
        other = first.setdefault(identity({**history.config, "problem": problem}), history.path)
        if other != history.path:
            raise ValueError(f"run: {history.path} is the same search as {other}, seed included; leave one of them out")


def _has_independent_climbers(history: History) -> bool:
    """Whether the scores of a run are those of climbers that are samples of their own."""
    return history.generations[-1].scores is not None and climbs_independently(history.config["method"])


def _curve(label: str, group: Sequence[History], axis: Axis, climbers: bool) -> Curve:
    folders = tuple(str(history.path) for history in group)
    places = [_places(history, axis) for history in group]
    seeds = [history.config["method"].get("seed") for history in group]
    if climbers:
        scores = np.array([generation.scores for generation in group[0].generations], float).T
        x = places[0] / len(scores) if axis == "evaluations" else places[0]
        first = group[0].generations[0].scores or ()
        starts = tuple(Start(seeds[0], number, score) for number, score in enumerate(first))
        return Curve(label, folders, "climbers", x, scores, starts)
    # The curve of a group ends where its shortest run does.
    begin, end = _overlap(dict(zip(folders, places, strict=True)), axis)
    x = np.unique(np.concatenate(places))
    x = x[(x >= begin) & (x <= end)]
    best = [np.array([generation.best for generation in history.generations], float) for history in group]
    rows = [values[np.searchsorted(place, x, side="right") - 1] for place, values in zip(places, best, strict=True)]
    starts = tuple(Start(seed, None, _first(history)) for seed, history in zip(seeds, group, strict=True))
    return Curve(label, folders, "runs", x, np.array(rows), starts)


def _first(history: History) -> tuple[float, tuple[tuple[str, float], ...]] | None:
    """Best score of generation 0 and the values of its point by name, in the order of names; None without success."""
    first = history.generations[0]
    if first.best is None or first.best_point is None:
        return None
    return first.best, tuple(sorted(first.best_point.items()))


def _places(history: History, axis: Axis) -> Floats:
    """Places of a run's generations on the axis."""
    if axis == "seconds":
        return np.cumsum(history.seconds)
    name = "generation" if axis == "generations" else axis
    return np.array([getattr(generation, name) for generation in history.generations], float)


def _without_seed(config: Mapping[str, Any]) -> dict[str, Any]:
    """Problem and method without the seed; settings that an older version lacked have their defaults."""
    method = usual_settings(config["method"]) | config["method"]
    problem = {name: value for name, value in config["problem"].items() if name != DESIGN}  # its file says all of it
    return {"problem": problem, "method": {name: method[name] for name in method if name != "seed"}}


def _labels(groups: Sequence[Sequence[History]]) -> list[str]:
    """Labels of groups: the method and the settings in which they differ, or the folder if that is too long."""
    flat = [_flat(_without_seed(group[0].config)) for group in groups]
    labels = []
    for settings, folder in zip(flat, _folders_of(groups), strict=True):
        alike = [other for other in flat if other["method.name"] == settings["method.name"]]
        rivals = {name: alike if name.startswith("method.") else flat for name in sorted(settings)}
        differing = [n for n, others in rivals.items() if len({json.dumps(each.get(n)) for each in others}) > 1]
        own = [f"{name.rpartition('.')[2]} {settings[name]}" for name in differing]
        label = ", ".join([settings["method.name"], *own])
        labels.append(label if len(label) <= 50 else f"{settings['method.name']} ({folder})")
    return labels


def _folders_of(groups: Sequence[Sequence[History]]) -> list[str]:
    """Names of the folders of groups of runs: those of all seeds, if each has its own; else of their first runs."""
    parents = [{history.path.parent for history in group} for group in groups]
    own = [
        len(group) > 1 and len(each) == 1 and parents.count(each) == 1
        for group, each in zip(groups, parents, strict=True)
    ]
    return [(group[0].path.parent if has else group[0].path).name for group, has in zip(groups, own, strict=True)]


def _difference(label: str, groups: Mapping[tuple[str | None, str], Sequence[History]]) -> str:
    """Names of the settings in which the runs with one label differ."""
    flat = [_flat(json.loads(settings)) for found, settings in groups if found == label]
    names = sorted({name for each in flat for name in each})
    return ", ".join(name for name in names if len({json.dumps(each.get(name)) for each in flat}) > 1)


def _flat(settings: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, value in settings.items():
        found |= _flat(value, f"{prefix}{name}.") if isinstance(value, Mapping) else {prefix + name: value}
    return found
