"""Co-optimisation of body and controller beside controllers of a fixed body, by the Borg MOEA.

Source: dissertation, chapter 4, "Co-Optimization" and figure "neurips_cooptimization". Each environment's smallest
distance from the light is an objective; a search has 500 evaluations; what it reports is the member of its archive with
the best sum. The settings of Borg are those of the experiment's program (https://github.com/jpp46/ARXIV2021), which are
the defaults of BlackBoxOptim.jl: 50 members, boxes of 0.1 m, one child at a time, no restart before 1000 evaluations.
The chapter has the first two arms; the third gives the baseline's controller all four connections.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from optim.experiments.comparison import compare, describe_times, ranked
from optim.experiments.results import Budget, Progress, part_of, write_json
from optim.experiments.study import Study
from optim.experiments.tables import write_table
from optim.experiments.trials import Trials, cached_trials, first_time
from optim.measures.statistics import mean_band
from optim.problems.braitenberg import VehicleProblem
from robots.braitenberg import BASELINE, PUBLISHED, VehicleTask
from taichi_sim.base import checks
from taichi_sim.base.results_folder import ResultsFolder

BORG: dict[str, Any] = {"population": 50, "children": 1, "epsilons": 0.1, "window": 1000}
ARMS: dict[str, tuple[str, dict[str, Any]]] = {
    "co_optimised": ("body and controller", {}),
    "baseline": ("baseline body, two weights", {"body": BASELINE}),
    "baseline_full": ("baseline body, four weights", {"body": BASELINE, "controller": "full"}),
}
PAIRS = (("co_optimised", "baseline"), ("co_optimised", "baseline_full"))


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
        for name, low in {"runs": 2, "budget": 1, "seed": 0}.items():
            checks.integer(name, getattr(self, name), low)

    @property
    def seeds(self) -> range:
        """Of the searches."""
        return range(self.seed, self.seed + self.runs)

    def problem(self, objectives: str = "environments", **given: Any) -> VehicleProblem:
        """What is searched: body and controller, or less if some of it is given."""
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
        curves += [
            (arm, n + 1, *(float(values[n]) for values in (solved.mean(axis=0), low, high)))
            for n in range(settings.budget)
        ]
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


def study(folder: Path, settings: CoOptimisation, progress: Progress = None) -> None:
    """Write ``summary.json``, curves and raw data as CSV, and ``co-optimisation.png``.

    For the arguments see :class:`optim.experiments.study.Study`.
    """
    from optim.studies.chapter4.co_optimisation_figure import draw
    from optim.studies.chapter4.sensor_homeostasis import follow_homeostasis

    results = ResultsFolder(folder, "co-optimisation", {**settings.describe(), "borg": BORG})
    found = co_optimise(settings, results, part_of(progress, 0, 2))
    summary = report(settings, found, folder)
    summary["homeostasis"] = follow_homeostasis(settings, found, results, folder, part_of(progress, 1, 2))
    write_json(folder / "summary.json", summary)
    draw(folder)


STUDY = Study(
    title="body and controller together beside the controller alone, and how homeostatic their solutions become",
    source="chapter 4, figure neurips_cooptimization",
    scales=SCALES,
    run=study,
    writes=(
        "summary.json",
        "environments-solved.csv",
        "evaluations-until-all-solved.csv",
        "homeostasis.csv.gz",
        "homeostasis-at-the-end.csv",
        "co-optimisation.png",
    ),
)
