"""Co-optimisation of body and controller beside controllers of a fixed body, by the Borg MOEA.

Source: dissertation, chapter 4, "Co-Optimization" and figure "neurips_cooptimization". Each environment's smallest
distance from the light is an objective; a search has 500 evaluations; what it reports is the member of its archive with
the best sum. The settings of Borg are those of the experiment's program (https://github.com/jpp46/ARXIV2021), which are
the defaults of BlackBoxOptim.jl: 50 members, boxes of 0.1 m, one child at a time, no restart before 1000 evaluations.
The chapter has the first two arms; the third gives the baseline's controller all four connections.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from optim.experiments.comparison import compare, describe_times, quartiles, ranked
from optim.experiments.figures import COLOURS, PAGE, figure, legend_above, letter, logarithmic
from optim.experiments.results import Budget, Progress, cached, check_counts, part_of, write_json
from optim.experiments.study import Study
from optim.experiments.tables import read_table, write_table
from optim.experiments.trials import NOTHING, Trials, cached_trials, first_time
from optim.measures.statistics import mean_band
from optim.plots.curves import draw_band
from optim.problems.braitenberg import VehicleProblem
from optim.studies.chapter4.sensor_homeostasis import MEASURES, decimation, distances_of
from robots.braitenberg import BASELINE, PUBLISHED, VehicleTask
from taichi_sim.base.arrays import Arrays, Bools, Floats, Ints
from taichi_sim.base.results_folder import ResultsFolder

BORG: dict[str, Any] = {"population": 50, "children": 1, "epsilons": 0.1, "window": 1000}
ARMS: dict[str, tuple[str, dict[str, Any]]] = {
    "co_optimised": ("body and controller", {}),
    "baseline": ("baseline body, two weights", {"body": BASELINE}),
    "baseline_full": ("baseline body, four weights", {"body": BASELINE, "controller": "full"}),
}
PAIRS = (("co_optimised", "baseline"), ("co_optimised", "baseline_full"))
AT_LEAST = 5  # solved trials for a mean over them


@dataclass(frozen=True)
class CoOptimisation:
    """Settings.

    Attributes:
        runs: searches of each arm.
        budget: evaluations of each.
        seed: of the first search; the others have those that follow.
        task: environments, radius of success and time.
        threads: CPU threads, all available if None; changes no result.
    """

    runs: int = 30
    budget: int = 500
    seed: int = 1
    task: VehicleTask = PUBLISHED
    threads: int | None = None

    def __post_init__(self) -> None:
        check_counts(self, runs=2, budget=1, seed=0)

    @property
    def seeds(self) -> range:
        """Seeds of the searches."""
        return range(self.seed, self.seed + self.runs)

    def problem(self, objectives: str = "environments", **given: Any) -> VehicleProblem:
        """The problem of finding body and controller, or less if some of it is given."""
        return VehicleProblem(objectives=objectives, task=self.task, threads=self.threads, **given)

    def describe(self) -> dict[str, Any]:
        """All that results depend on, but for arms."""
        numbers = {name: getattr(self, name) for name in ("runs", "budget", "seed")}
        return {**numbers, "problem": self.problem().describe()}


SCALES: Mapping[Budget, CoOptimisation] = {"small": CoOptimisation(runs=4, budget=120), "full": CoOptimisation()}


def co_optimise(settings: CoOptimisation, folder: ResultsFolder | None, progress: Progress = None) -> dict[str, Trials]:
    """Run all arms, or those that the folder does not have yet."""
    found = {}
    for n, (arm, (_, given)) in enumerate(ARMS.items()):
        searches = settings.problem(**given), "borg", BORG, settings.seeds, settings.budget
        found[arm] = cached_trials(folder, arm, *searches, progress=part_of(progress, n, len(ARMS)))
    return found


def environments_solved(trials: Trials) -> NDArray[np.int8]:
    """Environments solved by what each trial would report after each evaluation, shape (R, B)."""
    return trials.of_points(trials.solved, trials.reported(BORG["epsilons"]), 0)


def report(settings: CoOptimisation, found: dict[str, Trials], out: Path) -> dict[str, Any]:
    """Write curves and raw times as CSV, and return the numbers of this study."""
    environments, times, curves, raw = len(settings.task.starts), {}, [], []
    summary: dict[str, Any] = {"evaluations_until_all_solved": {}, "environments_solved_at_the_end": {}}
    for arm, trials in found.items():
        solved = environments_solved(trials)
        any_point, reported = trials.first(environments), first_time(solved == environments)
        times[arm] = ranked(any_point, settings.budget)
        low, high = mean_band(solved)
        course = np.stack([solved.mean(axis=0), low, high], axis=1).tolist()
        curves += [(arm, n, *values) for n, values in enumerate(course, 1)]
        raw += [(arm, *row) for row in zip(settings.seeds, any_point, reported, solved[:, -1], strict=True)]
        summary["evaluations_until_all_solved"][arm] = {
            "any_point": describe_times(any_point, settings.budget),
            "reported_point": describe_times(reported, settings.budget),
        }
        summary["environments_solved_at_the_end"][arm] = {
            "mean": float(solved[:, -1].mean()),
            "interval": [float(low[-1]), float(high[-1])],
            "trials_with_each": np.bincount(solved[:, -1], minlength=environments + 1).tolist(),
        }
    summary["tests_of_evaluations_until_all_solved"] = compare(times, PAIRS, "less")
    write_table(out / "environments-solved.csv", ("arm", "evaluations", "mean", "low", "high"), curves)
    header = ("arm", "seed", "first_point_solving_all", "reported_solves_all_from", "solved_at_the_end")
    write_table(out / "evaluations-until-all-solved.csv", header, raw)
    return summary


def distances_of_reported(settings: CoOptimisation, given: Mapping[str, Any], trials: Trials, reported: Ints) -> Arrays:
    """Distances, from decimated signals, of everything that trials reported: ``raw``, ``normalised``, shape (R, B).

    They are those of points, NaN for all that were never reported.
    """
    shown = np.zeros(trials.solved.shape, bool)
    rows, columns = np.nonzero(reported != NOTHING)
    shown[rows, reported[rows, columns]] = True
    return distances_of(settings.problem(**given), trials.points, shown, decimation(settings.task))


def distances_at_the_end(settings: CoOptimisation, given: Mapping[str, Any], trials: Trials, reported: Ints) -> Arrays:
    """Distances, from full signals, of what trials report in the end and that solves all; NaN where it does not."""
    rows, last = np.arange(trials.runs), reported[:, -1]
    chosen = (last != NOTHING) & (trials.solved[rows, last] == len(settings.task.starts))
    return distances_of(settings.problem(**given), trials.points[rows, last], chosen)


def follow_homeostasis(
    settings: CoOptimisation, found: Mapping[str, Trials], folder: ResultsFolder | None, out: Path, progress: Progress
) -> dict[str, Any]:
    """Write the course of the distances as CSV, and return their numbers."""
    environments = len(settings.task.starts)
    curves, ends = list[tuple[Any, ...]](), dict[str, Floats]()
    every = decimation(settings.task)
    summary: dict[str, Any] = {"steps_between_samples_in_the_course": every, "course": {}, "end": {}}
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
            ends[f"{arm}/{name}"] = done = values[np.isfinite(values)]
            summary["end"].setdefault(arm, {})[name] = quartiles(done)
        if progress:
            progress((n + 1) / len(found))
    pairs = [(f"co_optimised/{name}", f"baseline/{name}") for name in MEASURES]
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
            numbers = (float(value) for value in (there.mean(), *mean_band(there), np.median(there)))
            rows.append((arm, signals, solutions, n + 1, len(there), *numbers))
    return rows


def from_first_to_last(values: Floats, solved: Bools) -> dict[str, Any]:
    """Compare the first and the last solution that each trial reports, over trials that report any.

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
        found[name] = {
            "trials": len(trials),
            "fell": int((change < 0).sum()),
            "rose": int((change > 0).sum()),
            "median_first": float(np.median(first)) if len(first) else None,
            "median_last": float(np.median(last)) if len(last) else None,
            "p_wilcoxon_two_sided": float(wilcoxon(last, first).pvalue) if change.any() else 1.0,
        }
    return found


def study(folder: Path, settings: CoOptimisation, progress: Progress = None) -> None:
    """Write ``summary.json``, curves and raw data as CSV, and ``co-optimisation.png``.

    For the arguments see :class:`optim.experiments.study.Study`.
    """
    results = ResultsFolder(folder, "co-optimisation", {**settings.describe(), "borg": BORG})
    found = co_optimise(settings, results, part_of(progress, 0, 2))
    summary = report(settings, found, folder)
    summary["homeostasis"] = follow_homeostasis(settings, found, results, folder, part_of(progress, 1, 2))
    write_json(folder / "summary.json", summary)
    draw(folder)


def draw(folder: Path) -> None:
    """Write ``co-optimisation.png`` beside the tables."""
    _, solved = read_table(folder / "environments-solved.csv")
    _, distances = read_table(folder / "homeostasis.csv.gz")
    with figure(folder / "co-optimisation.png", PAGE, 2.8, ncols=3) as (drawn, panels):
        for number, (arm, (label, _)) in enumerate(ARMS.items()):
            colour = COLOURS[number]
            rows = np.array([row[1:] for row in solved if row[0] == arm], float)
            draw_band(panels[0, 0], *rows[:, :4].T, colour=colour, label=label)
            for axes, signals in zip(panels[0, 1:], MEASURES, strict=True):
                for solutions, style in (("solved", "-"), ("all", ":")):
                    chosen = [row[3:] for row in distances if row[:3] == [arm, signals, solutions]]
                    values = np.array(chosen, float).reshape(-1, 6)
                    axes.plot(values[:, 0], values[:, 5], style, color=colour)
        panels[0, 0].set(ylabel="environments solved", xlabel="evaluations", ylim=(0, 4.05), yticks=range(5))
        for axes, unit in zip(panels[0, 1:], (" [1/m$^2$]", ", normalised"), strict=True):
            axes.set(xlabel="evaluations", ylabel=f"median DTW distance{unit}")
            logarithmic(axes, "y")
        arms = panels[0, 0].get_legend_handles_labels()[0]
        kinds = (("solving all", "-"), ("all reported", ":"))
        legend_above(drawn, [*arms, *(panels[0, 1].plot([], [], f"k{style}", label=k)[0] for k, style in kinds)])
        letter(panels)


STUDY = Study(
    title="body and controller together beside the controller alone, and how homeostatic their solutions become",
    source="chapter 4, figure neurips_cooptimization",
    scales=SCALES,
    run=study,
    writes=(
        *("summary.json", "environments-solved.csv", "evaluations-until-all-solved.csv"),
        *("homeostasis.csv.gz", "homeostasis-at-the-end.csv", "co-optimisation.png"),
    ),
)
