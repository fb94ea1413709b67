"""Sensor homeostasis of what co-optimisation finds: how alike a solution's sensors see the environments.

Source: dissertation, chapter 4, figure "neurips_cooptimization" (right). Solutions that fail may score best of all, as
their sensors never see the light; so solved ones are looked at alone, beside all that were reported, as in the chapter.
"""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from optim.experiments.comparison import compare
from optim.experiments.results import Progress, cached
from optim.experiments.tables import write_table
from optim.experiments.trials import NOTHING, Trials
from optim.measures import homeostasis
from optim.measures.statistics import mean_band
from taichi_sim.base.arrays import Arrays, Bools, Floats, Ints
from taichi_sim.signals import warping_distances
from taichi_sim.vehicle import VehicleBatch, VehicleTask, trace

if TYPE_CHECKING:
    from optim.studies.chapter4.co_optimisation import CoOptimisation
    from taichi_sim.base.results_folder import ResultsFolder


SAMPLES = 1000  # of a decimated trace, at most, beside the start
SAMPLES_AT_ONCE = 2_000_000  # of light: 16 MB
AT_LEAST = 5  # solved trials for a mean over them


def decimation(task: VehicleTask, samples: int = SAMPLES) -> int:
    """Steps between samples of a trace that has at most so many beside the start.

    Vehicles that stay by the light turn quickly there, which few samples miss: for two solutions of the best body,
    every 5th, 10th and 20th sample gives up to 1.5, 1.8 and 2.8 times the raw distance of all (two of the baseline:
    1.06).
    """
    return -(-task.steps // samples)


def sensor_distances(
    sites: ArrayLike, controllers: ArrayLike, task: VehicleTask, every: int = 1, threads: int | None = None
) -> tuple[Floats, Floats]:
    """Mean warping distance of N controllers' light signals between environments, see ``homeostasis``.

    Args:
        sites: of the sensors, shape (N, S, 2) [m].
        controllers: matrices, shape (N, 2, S).
        task: environments and time.
        every: steps between samples: distances of decimated signals differ from those of full ones.
        threads: CPU threads, all available if None; changes no result.

    Returns:
        Of the readings [1/m^2], and of the same shifted and scaled to mean 0 and standard deviation 1, shape (N,)
        each; NaN where a sensor met the light.
    """
    sites, controllers = np.asarray(sites, float), np.asarray(controllers, float)
    raw, normalised = np.full((2, len(sites)), np.nan)
    per_controller = len(task.starts) * sites.shape[1] * (task.steps // every + 1)
    at_once = max(1, SAMPLES_AT_ONCE // per_controller)
    for first in range(0, len(sites), at_once):
        part = slice(first, first + at_once)
        seen = trace(VehicleBatch(sites[part], controllers[part, None]), task, every=every, threads=threads).readings
        for values, scaled in ((raw, False), (normalised, True)):
            values[part] = homeostasis(seen[:, 0], partial(warping_distances, normalise=scaled, threads=threads))
    return raw, normalised


def distances_of_reported(
    settings: "CoOptimisation", given: Mapping[str, Any], trials: Trials, reported: Ints
) -> Arrays:
    """Distances, from decimated signals, of everything that trials reported: ``raw``, ``normalised``, shape (R, B).

    They are those of points, NaN for all that were never reported.
    """
    shown = np.zeros(trials.solved.shape, bool)
    rows, columns = np.nonzero(reported != NOTHING)
    shown[rows, reported[rows, columns]] = True
    problem, task = settings.problem(**given), settings.task
    sites, controllers = problem.split(trials.points[shown])
    found = sensor_distances(sites, controllers[:, 0], task, decimation(task), settings.threads)
    arrays = {name: np.full(shown.shape, np.nan) for name in ("raw", "normalised")}
    for values, distances in zip(arrays.values(), found, strict=True):
        values[shown] = distances
    return arrays


def distances_at_the_end(
    settings: "CoOptimisation", given: Mapping[str, Any], trials: Trials, reported: Ints
) -> Arrays:
    """Distances, from full signals, of what trials report in the end and that solves all; NaN where it does not."""
    last = reported[:, -1]
    chosen = np.flatnonzero(
        (last != NOTHING) & (trials.solved[np.arange(len(last)), last] == len(settings.task.starts))
    )
    arrays = {name: np.full(trials.runs, np.nan) for name in ("raw", "normalised")}
    if len(chosen):
        sites, controllers = settings.problem(**given).split(trials.points[chosen, last[chosen]])
        found = sensor_distances(sites, controllers[:, 0], settings.task, threads=settings.threads)
        for values, distances in zip(arrays.values(), found, strict=True):
            values[chosen] = distances
    return arrays


def follow_homeostasis(
    settings: "CoOptimisation",
    found: Mapping[str, Trials],
    folder: "ResultsFolder | None",
    out: Path,
    progress: Progress,
) -> dict[str, Any]:
    """Write the course of the distances as CSV, and return their numbers."""
    from optim.studies.chapter4.co_optimisation import ARMS, BORG

    environments = len(settings.task.starts)
    curves: list[tuple[Any, ...]] = []
    ends: dict[str, Floats] = {}
    summary: dict[str, Any] = {
        "steps_between_samples_in_the_course": decimation(settings.task),
        "course": {},
        "end": {},
    }
    for n, (arm, trials) in enumerate(found.items()):
        given, reported = ARMS[arm][1], trials.reported(BORG["epsilons"])
        course = cached(folder, f"course_{arm}", partial(distances_of_reported, settings, given, trials, reported))
        end = cached(folder, f"end_{arm}", partial(distances_at_the_end, settings, given, trials, reported))
        solved = trials.of_points(trials.solved, reported, 0) == environments
        shown = {name: trials.of_points(values, reported, np.nan) for name, values in course.items()}
        for name, values in shown.items():
            curves += _curve(arm, name, "all", values) + _curve(arm, name, "solved", np.where(solved, values, np.nan))
            summary["course"].setdefault(arm, {})[name] = from_first_to_last(values, solved)
        for name, values in end.items():
            done = values[np.isfinite(values)]
            ends[f"{arm}/{name}"] = done
            quartiles = np.percentile(done, [25, 50, 75]).tolist() if len(done) else None
            summary["end"].setdefault(arm, {})[name] = {"n": len(done), "quartiles": quartiles}
        if progress:
            progress((n + 1) / len(found))
    pairs = [(f"co_optimised/{name}", f"baseline/{name}") for name in ("raw", "normalised")]
    if all(len(ends[name]) > 1 for pair in pairs for name in pair):
        summary["tests_of_the_end"] = compare(ends, pairs, "two-sided")
    header = ("arm", "signals", "solutions", "evaluations", "trials", "mean", "low", "high", "median")
    write_table(out / "homeostasis.csv.gz", header, curves)
    rows = [(name, value) for name, values in ends.items() for value in values.tolist()]
    write_table(out / "homeostasis-at-the-end.csv", ("arm_and_signals", "distance"), rows)
    return summary


def _curve(arm: str, signals: str, solutions: str, values: Floats) -> list[tuple[Any, ...]]:
    """Mean over the trials that have a value, with its band, and their median, after each evaluation."""
    rows: list[tuple[Any, ...]] = []
    for n, column in enumerate(values.T):
        there = column[np.isfinite(column)]
        if len(there) >= min(AT_LEAST, len(column)):
            low, high = mean_band(there)
            middle = float(np.median(there))
            rows.append(
                (arm, signals, solutions, n + 1, len(there), float(there.mean()), float(low), float(high), middle)
            )
    return rows


def from_first_to_last(values: Floats, solved: Bools) -> dict[str, Any]:
    """How a trial's first reported solution differs from its last, over the trials where both are there and differ.

    Args:
        values: of what is reported after each evaluation, shape (R, B).
        solved: whether that solves all environments, shape (R, B).

    Returns:
        Medians, trials in which the distance fell and rose, and p of the two-sided Wilcoxon signed-rank test; for
        solutions that solve all alone, and for everything reported, from the first report to the last.
    """
    from scipy.stats import wilcoxon  # slow to import

    found: dict[str, Any] = {}
    for name, there in (("solved", solved & np.isfinite(values)), ("all", np.isfinite(values))):
        trials = np.flatnonzero(there.any(axis=1))
        first = values[trials, there[trials].argmax(axis=1)]
        last = values[trials, there.shape[1] - 1 - there[trials, ::-1].argmax(axis=1)]
        change = last - first
        moved = np.count_nonzero(change)
        found[name] = {
            "trials": len(trials),
            "fell": int((change < 0).sum()),
            "rose": int((change > 0).sum()),
            "median_first": float(np.median(first)) if len(first) else None,
            "median_last": float(np.median(last)) if len(last) else None,
            "p_wilcoxon_two_sided": float(wilcoxon(last, first).pvalue) if moved else 1.0,
        }
    return found
