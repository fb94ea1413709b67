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

from optim.experiments.comparison import compare, describe_times, quartiles, ranked
from optim.experiments.figures import COLOURS, PAGE, figure, legend_above, logarithmic
from optim.experiments.results import Part, Progress, computed, part_of, write_json
from optim.experiments.study import Count, Settings, Several, Study, Whole
from optim.experiments.tables import Record, column, where, write_records, write_table
from optim.experiments.trials import NOTHING, Trials, computed_trials, first_time, record_trials
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
class CoOptimisation(Settings):
    """Searches of each arm of the study."""

    runs: Several = 30  # searches of each arm
    budget: Count = 500  # evaluations of each
    seed: Whole = 1  # of the first search; the others have those that follow
    task: VehicleTask = PUBLISHED  # environments, radius of success and time
    threads: int | None = None  # CPU threads, all available if None; changes no result

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


def report(
    settings: CoOptimisation, found: Mapping[str, Trials], reported: Mapping[str, Ints], out: Path
) -> tuple[dict[str, Any], list[Record]]:
    """Write curves and raw times as CSV, and return the numbers of this study, and the curves.

    ``reported`` is the number of the point that each trial would report after each evaluation, shape (R, B).
    """
    environments, times, curves, raw = len(settings.task.starts), {}, list[Record](), []
    summary: dict[str, Any] = {"evaluations_until_all_solved": {}, "environments_solved_at_the_end": {}}
    for arm, trials in found.items():
        solved = trials.of_points(trials.solved, reported[arm], 0)
        any_point, reported_point = trials.first(environments), first_time(solved == environments)
        times[arm] = ranked(any_point, settings.budget)
        course = np.stack([solved.mean(axis=0), *mean_band(solved)], axis=1).tolist()
        for n, (mean, low, high) in enumerate(course, 1):
            curves.append({"arm": arm, "evaluations": n, "mean": mean, "low": low, "high": high})
        raw += [(arm, *row) for row in zip(settings.seeds, any_point, reported_point, solved[:, -1], strict=True)]
        summary["evaluations_until_all_solved"][arm] = {
            "any_point": describe_times(any_point, settings.budget),
            "reported_point": describe_times(reported_point, settings.budget),
        }
        summary["environments_solved_at_the_end"][arm] = {
            "mean": course[-1][0],
            "interval": course[-1][1:],
            "trials_with_each": np.bincount(solved[:, -1], minlength=environments + 1).tolist(),
        }
    summary["tests_of_evaluations_until_all_solved"] = compare(times, PAIRS, "less")
    write_records(out / "environments-solved.csv", curves)
    header = ("arm", "seed", "first_point_solving_all", "reported_solves_all_from", "solved_at_the_end")
    write_table(out / "evaluations-until-all-solved.csv", header, raw)
    return summary, curves


def distances_of_reported(problem: VehicleProblem, trials: Trials, reported: Ints, _: Progress) -> Arrays:
    """Distances, from decimated signals, of everything that trials reported: ``raw``, ``normalised``, shape (R, B).

    They are those of points, NaN for all that were never reported.
    """
    shown = np.zeros(trials.solved.shape, bool)
    rows, columns = np.nonzero(reported != NOTHING)
    shown[rows, reported[rows, columns]] = True
    return distances_of(problem, trials.points, shown, decimation(problem.task))


def distances_at_the_end(problem: VehicleProblem, trials: Trials, reported: Ints, _: Progress) -> Arrays:
    """Distances, from full signals, of what trials report in the end and that solves all; NaN where it does not."""
    rows, last = np.arange(len(reported)), reported[:, -1]
    chosen = (last != NOTHING) & (trials.solved[rows, last] == len(problem.task.starts))
    return distances_of(problem, trials.points[rows, last], chosen)


def follow_homeostasis(
    settings: CoOptimisation,
    found: Mapping[str, Trials],
    reported: Mapping[str, Ints],
    folder: ResultsFolder,
    progress: Progress,
) -> tuple[dict[str, Any], list[Record]]:
    """Write the course of the distances as CSV, and return their numbers, and the course; see :func:`report`."""
    parts: dict[str, Part] = {}
    for arm, trials in found.items():
        given = settings.problem(**ARMS[arm][1]), trials, reported[arm]
        parts[f"course_{arm}"] = partial(distances_of_reported, *given)
        parts[f"end_{arm}"] = partial(distances_at_the_end, *given)
    distances = computed(folder, parts, progress)
    every, curves, ends = decimation(settings.task), list[Record](), dict[str, Floats]()
    summary: dict[str, Any] = {"steps_between_samples_in_the_course": every, "course": {}, "end": {}}
    for arm, trials in found.items():
        solved = trials.of_points(trials.solved, reported[arm], 0) == len(settings.task.starts)
        summary["course"][arm], summary["end"][arm] = {}, {}
        for name in MEASURES:
            values = trials.of_points(distances[f"course_{arm}"][name], reported[arm], np.nan)
            for solutions, shown in (("all", values), ("solved", np.where(solved, values, np.nan))):
                about = {"arm": arm, "signals": name, "solutions": solutions}
                curves += [{**about, **row} for row in _curve(shown)]
            summary["course"][arm][name] = from_first_to_last(values, solved)
            end = distances[f"end_{arm}"][name]
            ends[f"{arm}/{name}"] = done = end[np.isfinite(end)]
            summary["end"][arm][name] = quartiles(done)
    pairs = [(f"co_optimised/{name}", f"baseline/{name}") for name in MEASURES]
    if all(len(ends[name]) > 1 for pair in pairs for name in pair):
        summary["tests_of_the_end"] = compare(ends, pairs, "two-sided")
    header = ("arm", "signals", "solutions", "evaluations", "trials", "mean", "low", "high", "median")
    write_table(folder.path / "homeostasis.csv.gz", header, [tuple(row.values()) for row in curves])
    rows = [(name, value) for name, values in ends.items() for value in values.tolist()]
    write_table(folder.path / "homeostasis-at-the-end.csv", ("arm_and_signals", "distance"), rows)
    return summary, curves


def _curve(values: Floats) -> list[dict[str, Any]]:
    """Mean over the trials that have a value, with its band, and their median, after each evaluation."""
    rows = []
    for n, each in enumerate(values.T, 1):
        there = each[np.isfinite(each)]
        if len(there) >= min(AT_LEAST, len(each)):
            mean, low, high, median = map(float, (there.mean(), *mean_band(there), np.median(there)))
            row = {"evaluations": n, "trials": len(there), "mean": mean, "low": low, "high": high, "median": median}
            rows.append(row)
    return rows


def from_first_to_last(values: Floats, solved: Bools) -> dict[str, Any]:
    """Compare the first and the last solution that each trial reports, over trials that report any.

    Values are those of what is reported after each evaluation, shape (R, B), ``solved`` whether that solves all.

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
    """Write ``summary.json``, curves and raw data as CSV, and ``co-optimisation.png``."""
    results = ResultsFolder(folder, "co-optimisation", {**settings.describe(), "borg": BORG})
    arms = {
        arm: partial(record_trials, settings.problem(**given), "borg", BORG, settings.seeds, settings.budget)
        for arm, (_, given) in ARMS.items()
    }
    found = computed_trials(results, arms, part_of(progress, 0, 2))
    reported = {arm: trials.reported(BORG["epsilons"]) for arm, trials in found.items()}
    summary, solved = report(settings, found, reported, folder)
    summary["homeostasis"], course = follow_homeostasis(settings, found, reported, results, part_of(progress, 1, 2))
    write_json(folder / "summary.json", summary)
    draw(solved, course, folder / "co-optimisation.png")


def draw(solved: list[Record], course: list[Record], path: Path) -> None:
    """Draw environments solved, and distances of signals, over the evaluations."""
    with figure(path, PAGE, 2.8, ncols=3) as (drawn, panels):
        for (arm, (label, _)), colour in zip(ARMS.items(), COLOURS, strict=False):
            rows = where(solved, arm=arm)
            band = (column(rows, name) for name in ("evaluations", "mean", "low", "high"))
            draw_band(panels[0, 0], *band, colour=colour, label=label)
            for axes, signals in zip(panels[0, 1:], MEASURES, strict=True):
                for solutions, style in (("solved", "-"), ("all", ":")):
                    rows = where(course, arm=arm, signals=signals, solutions=solutions)
                    axes.plot(column(rows, "evaluations"), column(rows, "median"), style, color=colour)
        panels[0, 0].set(ylabel="environments solved", xlabel="evaluations", ylim=(0, 4.05), yticks=range(5))
        for axes, unit in zip(panels[0, 1:], (" [1/m$^2$]", ", normalised"), strict=True):
            axes.set(xlabel="evaluations", ylabel=f"median DTW distance{unit}")
            logarithmic(axes, "y")
        arms = panels[0, 0].get_legend_handles_labels()[0]
        kinds = (("solving all", "-"), ("all reported", ":"))
        legend_above(drawn, [*arms, *(panels[0, 1].plot([], [], f"k{style}", label=k)[0] for k, style in kinds)])


STUDY = Study(
    title="body and controller together beside the controller alone, and how homeostatic their solutions become",
    source="chapter 4, figure neurips_cooptimization",
    scales={"small": CoOptimisation(runs=4, budget=120), "full": CoOptimisation()},
    run=study,
    writes=(
        *("summary.json", "environments-solved.csv", "evaluations-until-all-solved.csv"),
        *("homeostasis.csv.gz", "homeostasis-at-the-end.csv", "co-optimisation.png"),
    ),
)
