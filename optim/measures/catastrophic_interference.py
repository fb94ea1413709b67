"""Measures of catastrophic interference: how the mutations that a run kept changed the score in each environment.

A run is given as the N evaluations that its climbers kept, in the order of generations: the climber of each, shape
(N,), and its distance from success at the end of the trial in each of E environments, shape (N, E). Distances may
have any unit: chapter 2 uses metres from the light, other studies a fraction of a bound. The first evaluation of a
climber is its start; each further one is a beneficial mutation.

Source: dissertation, chapter 2, "Measuring catastrophic interference": Eq. dist_record (the change of a mutation),
runchampion, m1 (worst distance), m2 (angle from the diagonal), m3 (length), and quadrant I (M4).
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from optim.measures.statistics import known_mean
from taichi_sim.base.arrays import Bools, Floats, Ints
from taichi_sim.base.short_text import ShortText


@dataclass(frozen=True)
class RunMeasures:
    """The four measures (M1 to M4) of a run.

    Attributes:
        champion: number of the climber whose worst distance is ``worst``.
        worst: M1, distance of the champion in its worst environment, in the unit of the given distances.
        angle: M2, mean angle between changes and the diagonal [degrees]; NaN without changes.
        length: M3, mean length of changes, in the same unit; NaN without changes.
        share: M4, share of changes that are improvements in every environment, from 0 to 1; NaN without changes.
        changes: number of changes in the line of descent.
    """

    champion: int
    worst: float
    angle: float
    length: float
    share: float
    changes: int


@dataclass(frozen=True)
class MeanOfRuns:
    """Mean of a measure over independent runs, with its 95 % interval.

    Attributes:
        value: mean over the runs that have the measure; None if no run has it.
        low: lower end of its interval by Student's t; None with fewer than two such runs.
        high: upper end.
        counted: number of runs that have the measure.
    """

    value: float | None
    low: float | None
    high: float | None
    counted: int

    @classmethod
    def of(cls, values: Iterable[float]) -> "MeanOfRuns":
        """Average one value per run; a value is NaN if its run lacks the measure."""
        found = np.array([value for value in values if np.isfinite(value)])
        return cls(counted=len(found), **known_mean(found, "value"))


@dataclass(frozen=True, repr=False)
class SeveralRuns(ShortText):
    """The four measures of independent runs, and their means.

    Attributes:
        worst: mean of M1.
        angle: mean of M2 over the runs whose champion has changes.
        length: mean of M3 over the same runs.
        share: mean of M4 over the same runs.
        runs: the measures of each run, at least one.
    """

    worst: MeanOfRuns
    angle: MeanOfRuns
    length: MeanOfRuns
    share: MeanOfRuns
    runs: tuple[RunMeasures, ...]

    @classmethod
    def of(cls, runs: Iterable[RunMeasures]) -> "SeveralRuns":
        """Average the measures of runs."""
        each = tuple(runs)
        return cls(
            MeanOfRuns.of(run.worst for run in each),
            MeanOfRuns.of(run.angle for run in each),
            MeanOfRuns.of(run.length for run in each),
            MeanOfRuns.of(run.share for run in each),
            each,
        )

    @property
    def changes(self) -> int:
        """Number of changes in the lines of descent of all champions."""
        return sum(run.changes for run in self.runs)


def changes_of(line: ArrayLike) -> Floats:
    """Changes of distance along a line of descent, (A, E), from its distances, (A + 1, E); positive if nearer.

    Source: Eq. dist_record. Failed evaluations (NaN) are left out; only the start of a line can be one.
    """
    away = np.asarray(line, float)
    return np.asarray(-np.diff(away[np.isfinite(away).all(axis=1)], axis=0))


def angles(changes: ArrayLike) -> Floats:
    """Angle of each change, (A, E), from the diagonal of equal gains [degrees], (A,); NaN for a change of zero.

    Source: Eq. m2, computed with the arc tangent, which stays accurate near the diagonal. The equation folds angles
    above 180 degrees; none occur.
    """
    delta = np.asarray(changes, float)
    along = delta.mean(axis=1, keepdims=True)
    found = np.arctan2(lengths(delta - along), along[:, 0] * np.sqrt(delta.shape[1]))
    return np.asarray(np.where((delta != 0).any(axis=1), np.degrees(found), np.nan))


def lengths(changes: ArrayLike) -> Floats:
    """Length of each change, (A, E), as a vector over environments, shape (A,) (Eq. m3)."""
    return np.asarray(np.linalg.norm(np.asarray(changes, float), axis=1))


def avoids_interference(changes: ArrayLike) -> Bools:
    """Whether each change, (A, E), is an improvement in every environment, shape (A,) (quadrant I for E = 2)."""
    return np.asarray((np.asarray(changes, float) > 0).all(axis=1))


def last_kept(climber: ArrayLike) -> Ints:
    """Row of the last evaluation of each climber, shape (P,), in the order of climber numbers."""
    reversed_climbers = np.asarray(climber)[::-1]
    return np.asarray(len(reversed_climbers) - 1 - np.unique(reversed_climbers, return_index=True)[1])


def measure_run(climber: ArrayLike, distance: ArrayLike) -> RunMeasures:
    """Measure M1 to M4 of a run as the dissertation defines them.

    The champion is the climber with the smallest worst distance in the last generation (Eq. runchampion); its line of
    descent is all evaluations that it kept.

    Args:
        climber: number of the climber of each kept evaluation, (N,).
        distance: distance from success at the end of each evaluation, (N, E); NaN if it failed.

    Raises:
        ValueError: for other shapes, or a run without evaluations.
    """
    of, away = _checked(climber, distance)
    ends = last_kept(of)
    best = ends[np.argmin(_worst(away[ends]))]
    return _measures(int(of[best]), float(away[best].max()), changes_of(away[of == of[best]]))


def measure_run_as_computed(climber: ArrayLike, distance: ArrayLike, apparent: ArrayLike | None = None) -> RunMeasures:
    """Measure M1 to M4 of a run as the published experiment computed them.

    The champion is the climber with the smallest *sum* of distances in the last generation, and M1 is its worst
    distance. M2 to M4 are those of another line of descent: the one that leads to the smallest worst distance of all
    generations. Only its steps that change the worst distance count. (differs: for two environments the experiment
    followed children whether or not they were kept.)

    Args:
        climber: number of the climber of each kept evaluation, (N,).
        distance: horizontal distance from the light at the end of each evaluation, (N, E) [m]; NaN if it failed.
        apparent: distances that correspond to the light readings, (N, E) [m], by which M2 to M4 are measured;
            ``distance`` if None.

    Raises:
        ValueError: for other shapes, or a run without evaluations.
    """
    of, away = _checked(climber, distance)
    _, seen = (of, away) if apparent is None else _checked(climber, apparent)
    ends = last_kept(of)
    logged = ends[np.argmin(np.nan_to_num(away[ends].sum(axis=1), nan=np.inf))]
    nearest = int(np.argmin(_worst(seen)))
    line = seen[: nearest + 1][of[: nearest + 1] == of[nearest]]
    line = line[np.isfinite(line).all(axis=1)]
    return _measures(int(of[logged]), float(away[logged].max()), changes_of(line)[np.diff(_worst(line)) != 0])


def _measures(champion: int, worst: float, changes: Floats) -> RunMeasures:
    turned = angles(changes)
    turned = turned[np.isfinite(turned)]
    if not len(changes) or not len(turned):
        return RunMeasures(champion, worst, np.nan, np.nan, np.nan, 0)
    share = float(avoids_interference(changes).mean())
    return RunMeasures(champion, worst, float(turned.mean()), float(lengths(changes).mean()), share, len(changes))


def _worst(distance: Floats) -> Floats:
    """Largest distance of each row; infinite where an evaluation failed."""
    return np.asarray(np.nan_to_num(distance.max(axis=1), nan=np.inf))


def _checked(climber: ArrayLike, distance: ArrayLike) -> tuple[Ints, Floats]:
    of, away = np.asarray(climber, np.int64), np.asarray(distance, float)
    if of.ndim != 1 or away.ndim != 2 or len(of) != len(away) or away.shape[1] < 1 or not len(of):
        raise ValueError(
            f"distance: shape {away.shape} is not allowed for {of.size} evaluations; give (evaluations, environments)"
        )
    return of, away
