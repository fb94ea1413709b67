"""Co-optimisation of body and controller beside controllers of a fixed body, by the Borg MOEA.

Source: dissertation, chapter 4, "Co-Optimization" and figure "neurips_cooptimization". Each environment's smallest
distance from the light is an objective; a search has 500 evaluations; what it reports is the member of its archive with
the best sum. The settings of Borg are those of the experiment's program (https://github.com/jpp46/ARXIV2021), which are
the defaults of BlackBoxOptim.jl: 50 members, boxes of 0.1 m, one child at a time, no restart before 1000 evaluations.
The chapter has the first two arms; the third gives the baseline's controller all four connections.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.allowed import Allowed, check_arrays
from optim.experiments.comparison import compare, describe_times, quartiles, ranked
from optim.experiments.data import Data, Kind
from optim.experiments.figures import COLOURS, PAGE, figure, legend_above, logarithmic
from optim.experiments.results import Part, Progress, computed, write_json
from optim.experiments.search_evaluations import (
    NOTHING,
    SearchEvaluations,
    computed_searches,
    first_time,
    record_searches,
)
from optim.experiments.study import Count, Settings, Several, Study, Whole
from optim.experiments.tables import Record, column, select, write_table
from optim.measures.statistics import mean_band
from optim.plots.curves import draw_band
from optim.problems.braitenberg import VehicleProblem
from optim.studies.chapter4.sensor_homeostasis import MEASURES, decimation, distances_of
from robots.braitenberg import BASELINE, PUBLISHED, VehicleTask
from robots.robot import part_of
from taichi_sim.base.arrays import Arrays, Floats, Ints
from taichi_sim.base.compute import Threads
from taichi_sim.base.results_folder import ResultsFolder

BORG: dict[str, Any] = {"population": 50, "children": 1, "epsilons": 0.1, "window": 1000}
ARMS: dict[str, tuple[str, dict[str, Any]]] = {
    "co_optimised": ("body and controller", {}),
    "baseline": ("baseline body, two weights", {"body": BASELINE}),
    "baseline_full": ("baseline body, four weights", {"body": BASELINE, "controller": "full"}),
}
PAIRS = (("co_optimised", "baseline"), ("co_optimised", "baseline_full"))
AT_LEAST = 5  # solved searches for a mean over them
TIMES, SOLVED = "evaluations-until-all-solved.csv", "environments-solved.csv"
COURSE, CHANGES, ENDS = "homeostasis.csv.gz", "homeostasis-changes.csv", "homeostasis-at-the-end.csv"
TIMES_OF_TRIALS = ("first_point_solving_all", "reported_solves_all_from", "solved_at_the_end")
SOLVED_LAST = "environments_solved_at_the_end"  # in the summary
ARMS_AND_SIGNALS = tuple(f"{arm}/{name}" for arm, name in product(ARMS, MEASURES))
EVERY = "steps_between_samples_in_the_course"
PICTURES = ("co-optimisation.png", "medians.png")
BLUE, RED, GREY, GREEN = COLOURS[0], "#C1272D", "#888888", COLOURS[2]
ARM: dict[str, Kind] = {"arm": tuple(ARMS)}
SOLUTIONS: dict[str, Kind] = {**ARM, "signals": MEASURES, "solutions": ("all", "solved")}
TABLES: dict[str, dict[str, Kind]] = {
    TIMES: {**ARM, "seed": int, **dict.fromkeys(TIMES_OF_TRIALS, int)},
    SOLVED: {**ARM, "evaluations": int, **dict.fromkeys(("mean", "low", "high"), float)},
    COURSE: {**SOLUTIONS, "evaluations": int, "trials": int, **dict.fromkeys(("mean", "low", "high", "median"), float)},
    CHANGES: {**SOLUTIONS, "seed": int, **dict.fromkeys(("first", "last"), float)},
    ENDS: {"arm_and_signals": ARMS_AND_SIGNALS, "distance": float},
}
Tables = dict[str, list[Record]]


@dataclass(frozen=True)
class CoOptimisation(Settings):
    """Searches of each arm of the study."""

    runs: Several = 30  # searches of each arm
    budget: Count = 500  # evaluations of each
    seed: Whole = 1  # of the first search; the others have those that follow
    task: VehicleTask = PUBLISHED  # environments, radius of success and time
    threads: Threads = None  # of the CPU; changes no result

    @property
    def seeds(self) -> range:
        """Seeds of the searches."""
        return range(self.seed, self.seed + self.runs)

    def problem(self, objectives: str = "environments", **given: Any) -> VehicleProblem:
        """The problem of finding body and controller, or less if some of it is given."""
        return VehicleProblem(objectives=objectives, task=self.task, threads=self.threads, **given)

    def describe(self) -> dict[str, Any]:
        """All that results depend on but the arms, as JSON values."""
        numbers = {name: getattr(self, name) for name in ("runs", "budget", "seed")}
        return {**numbers, "problem": self.problem().describe()}


def solved_tables(
    settings: CoOptimisation, found: Mapping[str, SearchEvaluations], reported: Mapping[str, Ints]
) -> Tables:
    """When each search solved all, and how many environments are solved after each evaluation, with a band.

    ``reported`` is the number of the point that each search would report after each evaluation, shape (R, B).
    """
    environments, times, curves = len(settings.task.starts), list[Record](), list[Record]()
    for arm, searches in found.items():
        solved = searches.of_points(searches.solved, reported[arm], 0)
        first = searches.first(environments), first_time(solved == environments)
        each = zip(settings.seeds, *first, solved[:, -1], strict=True)
        times += [dict(zip(TABLES[TIMES], (arm, *row), strict=True)) for row in each]
        course = np.stack([solved.mean(axis=0), *mean_band(solved)], axis=1).tolist()
        curves += [dict(zip(TABLES[SOLVED], (arm, n, *row), strict=True)) for n, row in enumerate(course, 1)]
    return {TIMES: times, SOLVED: curves}


def distances_of_reported(problem: VehicleProblem, searches: SearchEvaluations, reported: Ints, _: Progress) -> Arrays:
    """Distances, from decimated signals, of everything that searches reported: ``raw``, ``normalised``, shape (R, B).

    They are those of points, NaN for all that were never reported.
    """
    shown = np.zeros(searches.solved.shape, bool)
    rows, columns = np.nonzero(reported != NOTHING)
    shown[rows, reported[rows, columns]] = True
    return distances_of(problem, searches.points, shown, decimation(problem.task))


def distances_at_the_end(problem: VehicleProblem, searches: SearchEvaluations, reported: Ints, _: Progress) -> Arrays:
    """Distances, from full signals, of what searches report in the end and that solves all; NaN where it does not."""
    rows, last = np.arange(len(reported)), reported[:, -1]
    chosen = (last != NOTHING) & (searches.solved[rows, last] == len(problem.task.starts))
    return distances_of(problem, searches.points[rows, last], chosen)


def homeostasis_tables(
    settings: CoOptimisation,
    found: Mapping[str, SearchEvaluations],
    reported: Mapping[str, Ints],
    folder: ResultsFolder,
    progress: Progress,
) -> Tables:
    """The course of the distances, the first and the last of each search, and those of full signals in the end."""
    parts: dict[str, Part] = {}
    for arm, searches in found.items():
        given = settings.problem(**ARMS[arm][1]), searches, reported[arm]
        parts[f"course_{arm}"] = partial(distances_of_reported, *given)
        parts[f"end_{arm}"] = partial(distances_at_the_end, *given)
    shape = {"course": (settings.runs, settings.budget), "end": (settings.runs,)}
    distance = {what: Allowed(each, 0.0, failed=np.nan) for what, each in shape.items()}
    check = {name: partial(check_arrays, dict.fromkeys(MEASURES, distance[name.split("_")[0]])) for name in parts}
    distances = computed(folder, parts, progress, "{}", check)
    tables: Tables = {COURSE: [], CHANGES: [], ENDS: []}
    for arm, searches in found.items():
        solved = searches.of_points(searches.solved, reported[arm], 0) == len(settings.task.starts)
        for name in MEASURES:
            values = searches.of_points(distances[f"course_{arm}"][name], reported[arm], np.nan)
            for solutions, shown in (("all", values), ("solved", np.where(solved, values, np.nan))):
                about = {"arm": arm, "signals": name, "solutions": solutions}
                tables[COURSE] += [{**about, **row} for row in _curve(shown)]
                tables[CHANGES] += [{**about, **row} for row in first_and_last(shown, settings.seeds)]
            end = distances[f"end_{arm}"][name]
            rows = [{"arm_and_signals": f"{arm}/{name}", "distance": value} for value in end[np.isfinite(end)].tolist()]
            tables[ENDS] += rows
    return tables


def _curve(values: Floats) -> list[dict[str, Any]]:
    """Mean over the searches that have a value, with its band, and their median, after each evaluation."""
    rows = []
    for n, each in enumerate(values.T, 1):
        there = each[np.isfinite(each)]
        if len(there) >= min(AT_LEAST, len(each)):
            mean, low, high, median = map(float, (there.mean(), *mean_band(there), np.median(there)))
            row = {"evaluations": n, "trials": len(there), "mean": mean, "low": low, "high": high, "median": median}
            rows.append(row)
    return rows


def first_and_last(values: Floats, seeds: Sequence[int]) -> list[dict[str, Any]]:
    """The first and the last value of each search that has any, NaN where there is none, shape (R, B)."""
    return [
        {"seed": seed, "first": float(known[0]), "last": float(known[-1])}
        for seed, known in ((seed, each[np.isfinite(each)]) for seed, each in zip(seeds, values, strict=True))
        if len(known)
    ]


def compare_first_and_last(rows: Sequence[Record]) -> dict[str, Any]:
    """Compare the first and the last solution that each search reports, see :func:`first_and_last`.

    Returns:
        Medians, searches in which the distance fell and rose, and p of the two-sided Wilcoxon signed-rank test.
    """
    from scipy.stats import wilcoxon  # slow to import

    first, last = column(rows, "first"), column(rows, "last")
    change = last - first
    return {
        "trials": len(rows),
        "fell": int((change < 0).sum()),
        "rose": int((change > 0).sum()),
        "median_first": float(np.median(first)) if len(first) else None,
        "median_last": float(np.median(last)) if len(last) else None,
        "p_wilcoxon_two_sided": float(wilcoxon(last, first).pvalue) if change.any() else 1.0,
    }


def study(folder: Path, settings: CoOptimisation, progress: Progress = None) -> None:
    """Write ``summary.json``, curves and raw data as CSV, and the figures."""
    results = ResultsFolder(folder, "co-optimisation", {**settings.describe(), "borg": BORG})
    arms = {
        arm: partial(record_searches, settings.problem(**given), "borg", BORG, settings.seeds, settings.budget)
        for arm, (_, given) in ARMS.items()
    }
    found = computed_searches(results, arms, part_of(progress, 0, 2))
    reported = {arm: searches.reported(BORG["epsilons"]) for arm, searches in found.items()}
    tables = {
        **solved_tables(settings, found, reported),
        **homeostasis_tables(settings, found, reported, results, part_of(progress, 1, 2)),
    }
    for name, rows in tables.items():
        write_table(folder / name, tuple(TABLES[name]), [tuple(row[each] for each in TABLES[name]) for row in rows])
    _report(folder, tables, decimation(settings.task), len(settings.task.starts))


def rewrite(data: Data, folder: Path) -> None:
    """Write ``summary.json`` and the figures from the tables."""
    tables = {}
    for name, columns in TABLES.items():
        whole = name in (TIMES, SOLVED)  # where nothing is solved, the others have no rows of an arm, or none at all
        tables[name] = data.records(name, columns, *(("arm",) if whole else ()), may_be_empty=not whole)
    arm = next(iter(ARMS))
    environments = data.from_summary(lambda summary: len(summary[SOLVED_LAST][arm]["trials_with_each"]) - 1)
    _report(folder, tables, data.count("homeostasis", EVERY), environments)


def _report(folder: Path, tables: Tables, every: int, environments: int) -> None:
    """Write ``summary.json`` and the figures, which follow from the tables, for so many steps between samples."""
    times = _of_times(tables[TIMES], tables[SOLVED], environments)
    summary = {**times, "homeostasis": {EVERY: every, **_of_homeostasis(tables)}}
    write_json(folder / "summary.json", summary)
    draw(tables[SOLVED], tables[COURSE], folder / PICTURES[0])
    draw_medians(tables[SOLVED], tables[COURSE], folder / PICTURES[1])


def _of_times(times: Sequence[Record], curves: Sequence[Record], environments: int) -> dict[str, Any]:
    """Evaluations until all is solved, with tests, and what is solved at the end."""
    needed, ends, ranks = {}, {}, {}
    for arm in ARMS:
        rows, course = select(times, arm=arm), select(curves, arm=arm)
        any_point, reported, last = (column(rows, name) for name in TIMES_OF_TRIALS)
        needed[arm] = {
            "any_point": describe_times(any_point, len(course)),
            "reported_point": describe_times(reported, len(course)),
        }
        ends[arm] = {
            "mean": course[-1]["mean"],
            "interval": [course[-1]["low"], course[-1]["high"]],
            "trials_with_each": np.bincount(last.astype(int), minlength=environments + 1).tolist(),
        }
        ranks[arm] = ranked(any_point, len(course))
    return {
        "evaluations_until_all_solved": needed,
        SOLVED_LAST: ends,
        "tests_of_evaluations_until_all_solved": compare(ranks, PAIRS, "less"),
    }


def _of_homeostasis(tables: Tables) -> dict[str, Any]:
    """How distances change from the first to the last solution of searches, and those in the end, with tests."""
    course: dict[str, Any] = {}
    for arm, name in product(ARMS, MEASURES):
        own = select(tables[CHANGES], arm=arm, signals=name)
        course.setdefault(arm, {})[name] = {
            kind: compare_first_and_last(select(own, solutions=kind)) for kind in ("solved", "all")
        }
    ends = {each: column(select(tables[ENDS], arm_and_signals=each), "distance") for each in ARMS_AND_SIGNALS}
    found = {"course": course, "end": {arm: {n: quartiles(ends[f"{arm}/{n}"]) for n in MEASURES} for arm in ARMS}}
    pairs = [(f"co_optimised/{name}", f"baseline/{name}") for name in MEASURES]
    if all(len(ends[name]) > 1 for pair in pairs for name in pair):
        return {**found, "tests_of_the_end": compare(ends, pairs, "two-sided")}
    return found


def draw(solved: list[Record], course: list[Record], path: Path) -> None:
    """Draw the figure of chapter 4: means over the evaluations, with 95 % bands.

    A: environments solved, the baseline red and co-optimisation blue, with the third arm beside them. B: distances of
    the signals of what co-optimisation reports; those of all, and of what solves all environments.
    """
    with figure(path, PAGE, 2.8, "A", ncols=2) as (_, panels):
        left, right = panels[0]
        for (arm, (label, _)), colour in zip(ARMS.items(), (BLUE, RED, GREY), strict=True):
            draw_band(left, *_band(select(solved, arm=arm)), colour=colour, label=label)
        arm, signals = next(iter(ARMS)), MEASURES[0]
        for solutions, colour, label in (("all", BLUE, "all reported"), ("solved", GREEN, "those that solve all")):
            rows = select(course, arm=arm, signals=signals, solutions=solutions)
            draw_band(right, *_band(rows), colour=colour, label=label)
        left.set(ylabel="environments solved, mean", xlabel="evaluations", ylim=(0, 4.05), yticks=range(5))
        right.set(ylabel="DTW distance, mean [1/m$^2$]", xlabel="evaluations")
        right.set_ylim(bottom=0)
        left.legend(loc="lower right")
        right.legend(loc="upper right")


def _band(rows: Sequence[Record]) -> list[Floats]:
    """Evaluations, means, and both ends of their intervals."""
    return [column(rows, name) for name in ("evaluations", "mean", "low", "high")]


def draw_medians(solved: list[Record], course: list[Record], path: Path) -> None:
    """Draw environments solved, and medians of distances of signals in all arms, over the evaluations."""
    with figure(path, PAGE, 2.8, ncols=3) as (drawn, panels):
        for (arm, (label, _)), colour in zip(ARMS.items(), COLOURS, strict=False):
            rows = select(solved, arm=arm)
            draw_band(panels[0, 0], *_band(rows), colour=colour, label=label)
            for axes, signals in zip(panels[0, 1:], MEASURES, strict=True):
                for solutions, style in (("solved", "-"), ("all", ":")):
                    rows = select(course, arm=arm, signals=signals, solutions=solutions)
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
    rewrite=rewrite,
    writes=("summary.json", *TABLES, *PICTURES),
)
