"""Whether homeostasis as an objective helps: co-optimisation with and without it, at the same budget and seeds.

Source: dissertation, chapter 6, which proposes it as a proxy of learnability. Beside the two searches stands a third
way that costs no search: of everything that the search without it evaluated, report the most homeostatic solution.
Judged are the reported solution's homeostasis by full signals, the metrics of its body by a sweep of its own, and how
well the solution stands perturbations. Until the first solution both searches are the same by construction, so the
objective cannot change how soon it comes. Controllers that never see the light have the most similar signals of all; so
similarity counts only among those that solve all environments, and any of these is better in it than all others.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from optim.experiments.allowed import Allowed, check_arrays
from optim.experiments.comparison import compare, describe_times, quartiles
from optim.experiments.data import Data, Kind
from optim.experiments.figures import COLOURS, PAGE, figure, legend_above, logarithmic
from optim.experiments.results import Progress, cached, computed, write_json
from optim.experiments.search_evaluations import NOTHING, SearchEvaluations, computed_searches, record_searches
from optim.experiments.study import Count, Settings, Several, Study
from optim.experiments.tables import Record, column, select, write_records
from optim.measures import learnability, resistance
from optim.problem import Evaluation
from optim.problems.braitenberg import VehicleProblem
from optim.space import Space
from optim.studies.chapter4.co_optimisation import BORG, CoOptimisation
from optim.studies.chapter4.perturbations import PERTURBATIONS
from optim.studies.chapter4.reality_gap import survival
from optim.studies.chapter4.sensor_homeostasis import MEASURES, decimation, distances_of
from robots.braitenberg import VehicleBody, sweep
from robots.robot import part_of
from taichi_sim.base import checks
from taichi_sim.base.arrays import Arrays, Bools, Floats, Ints
from taichi_sim.base.results_folder import ResultsFolder

UNSOLVED = -1.0  # below every similarity


@dataclass(frozen=True, eq=False)
class HomeostasisProblem:
    """The objectives of a vehicle problem, and one more: homeostasis.

    It is -d / (1 + d), between -1 and 0, of the mean warping distance d of light signals [1/m^2] that are decimated
    to ``samples``, for points that solve all environments, else -1.
    """

    vehicle: VehicleProblem  # the problem without it, with an objective for each environment
    samples: int = 1000  # of a trace, at most, beside the start

    def __post_init__(self) -> None:
        checks.integer("samples", self.samples, 1)

    @property
    def space(self) -> Space:
        """The space of the vehicle."""
        return self.vehicle.space

    def evaluate(self, points: ArrayLike) -> Evaluation:
        """Judge points; details as of the vehicle."""
        judged, points = self.vehicle.evaluate(points), np.atleast_2d(np.asarray(points, float))
        solved = np.asarray(~judged.failed & (judged.details["solved"] == len(self.vehicle.task.starts)))
        distance = distances_of(self.vehicle, points, solved, decimation(self.vehicle.task, self.samples))["raw"]
        homeostasis = np.nan_to_num(-distance / (1 + distance), nan=UNSOLVED)
        return replace(judged, objectives=np.column_stack([judged.objectives, homeostasis]))

    def evaluate_relaxed(self, points: ArrayLike, sharpness: float, gradients: bool) -> Evaluation:
        """Judge points as :meth:`evaluate` does, as nothing is binary; raises ValueError if asked for gradients."""
        if gradients:
            raise ValueError("gradients: not allowed with several objectives; ask for points")
        return self.evaluate(points)


BOX = 0.0005  # side of the boxes of homeostasis; solutions of the best body lie some of them apart
LABELS = {"without": "not asked for", "selected": "chosen afterwards", "with": "as an objective"}
PAIRS = (("with", "without"), ("selected", "without"), ("with", "selected"))
OUTCOMES = {
    "raw": "DTW distance [1/m$^2$]",
    "normalised": "DTW distance, normalised",
    "M_L": "learnability $M_L$",
    "M_CI": "resistance $M_{CI}$",
    "survival": "survival of perturbations",
}
REPORTED, TIMES = "reported.csv", "evaluations-until-all-solved.csv"
SEARCHES = ("without", "with")
COLUMNS: dict[str, Kind] = {"way": tuple(LABELS), **dict.fromkeys(OUTCOMES, float)}
COLUMNS_OF_TIMES: dict[str, Kind] = {"way": SEARCHES, "seed": int, "evaluations": int}  # -1 of runs that failed


@dataclass(frozen=True)
class HomeostasisObjective(Settings):
    """Both searches, and how what they report is judged."""

    searches: CoOptimisation = CoOptimisation()  # noqa: RUF009 (immutable)
    samples: Count = 1000  # of a trace in the searches, at most
    weights: Several = 61  # values of each weight in the sweeps of reported bodies
    draws: Count = 10  # of every random perturbation

    def describe(self) -> dict[str, Any]:
        """All that results depend on, as JSON values."""
        numbers = {name: getattr(self, name) for name in ("samples", "weights", "draws")}
        return {**self.searches.describe(), **numbers, "borg": BORG, "box": BOX}


def reported(
    settings: HomeostasisObjective, found: Mapping[str, SearchEvaluations], folder: ResultsFolder
) -> dict[str, Floats]:
    """Points that each way reports, shape (R, D); NaN in the rows of searches that solved nothing.

    With the objective and with selection it is the most homeostatic solution that was evaluated, by decimated signals,
    without them the member of the archive with the largest sum.
    """
    own, without, with_it = settings.searches, found["without"], found["with"]
    solved, solved_with_it = (searches.solved == len(own.task.starts) for searches in (without, with_it))
    last = without.reported(BORG["epsilons"])[:, -1]
    last = np.where((last != NOTHING) & solved[np.arange(len(last)), last], last, NOTHING)

    def similarity() -> Arrays:
        """The objective of every point that solves all environments; NaN elsewhere."""
        every = decimation(own.task, settings.samples)
        return {"homeostasis": -distances_of(own.problem(), without.points, solved, every)["raw"]}

    allowed = {"homeostasis": Allowed(without.solved.shape, high=0.0, failed=np.nan)}
    similar = cached(folder, "similarity_without", similarity, partial(check_arrays, allowed))["homeostasis"]
    chosen = {
        "without": (without, last),
        "selected": (without, _largest(similar, solved)),
        "with": (with_it, _largest(with_it.objectives[..., -1], solved_with_it)),
    }
    return {way: _points(*chosen[way]) for way in LABELS}


def _largest(values: Floats, allowed: Bools) -> Ints:
    """Index of the largest value allowed in each row; -1 if none is."""
    shown = np.where(allowed & np.isfinite(values), values, -np.inf)
    return np.where(np.isfinite(shown).any(axis=1), shown.argmax(axis=1), NOTHING)


def _points(searches: SearchEvaluations, chosen: Ints) -> Floats:
    points = searches.points[np.arange(len(chosen)), np.maximum(chosen, 0)]
    return np.where((chosen == NOTHING)[:, None], np.nan, points)


def judge(settings: HomeostasisObjective, points: Floats, sweep_folder: Path | None, _: Progress) -> Arrays:
    """Measure reported points, by the names in ``OUTCOMES``, shape (R,); NaN where there is no point."""
    own, there = settings.searches, np.asarray(~np.isnan(points).any(axis=1))
    arrays = {name: np.full(len(points), np.nan) for name in OUTCOMES}
    if not there.any():
        return arrays
    sites, controllers = own.problem().split(points[there])
    arrays |= distances_of(own.problem(), points, there)
    bodies = [VehicleBody(tuple(map(tuple, places))) for places in sites.tolist()]
    task = own.task.radius, own.task.time_step, own.task.steps
    overlaps = sweep(bodies, settings.weights, *task, out=sweep_folder, threads=own.threads)
    arrays["M_L"][there], arrays["M_CI"][there] = learnability(overlaps), resistance(overlaps)
    each = (sites, controllers[:, 0], own.task)
    shares = [survival(*each, p, settings.draws, own.seed, own.threads) for p in PERTURBATIONS]
    arrays["survival"][there] = np.mean(shares, axis=0)
    return arrays


def study(folder: Path, settings: HomeostasisObjective, progress: Progress = None) -> None:
    """Write ``summary.json``, tables as CSV and a figure."""
    results, own = ResultsFolder(folder, "homeostasis-objective", settings.describe()), settings.searches
    vehicle = own.problem()
    boxes = [*[BORG["epsilons"]] * len(vehicle.objective_names), BOX]
    homeostatic = HomeostasisProblem(vehicle, settings.samples), "borg", {**BORG, "epsilons": boxes}
    arms = {
        "without": partial(record_searches, vehicle, "borg", BORG, own.seeds, own.budget),
        "with": partial(record_searches, *homeostatic, own.seeds, own.budget),
    }
    found = computed_searches(results, arms, part_of(progress, 0, 2))
    points = reported(settings, found, results)
    parts = {way: partial(judge, settings, each, folder / "sweep") for way, each in points.items()}
    check = partial(check_arrays, dict.fromkeys(OUTCOMES, Allowed((own.runs,), 0.0, failed=np.nan)))
    outcomes = computed(results, parts, part_of(progress, 1, 2), "judged_{}", check)
    times = [
        {"way": way, "seed": seed, "evaluations": evaluations}
        for way, searches in found.items()
        for seed, evaluations in zip(own.seeds, searches.first(len(own.task.starts)).tolist(), strict=True)
    ]
    header = ("way", "seed", *OUTCOMES, *vehicle.space.names)
    rows = [
        dict(zip(header, (way, seed, *values, *point), strict=True))
        for way, arrays in outcomes.items()
        for seed, point, *values in zip(
            own.seeds, points[way].tolist(), *(arrays[name].tolist() for name in OUTCOMES), strict=True
        )
    ]
    write_records(folder / TIMES, times)
    write_records(folder / REPORTED, rows)
    _report(folder, own.budget, times, rows)


def rewrite(data: Data, folder: Path) -> None:
    """Write ``summary.json`` and the figure from the tables."""
    times, rows = data.records(TIMES, COLUMNS_OF_TIMES, "way"), data.records(REPORTED, COLUMNS, "way")
    _report(folder, data.count("budget"), times, rows)


def _report(folder: Path, budget: int, times: Sequence[Record], rows: Sequence[Record]) -> None:
    """Write ``summary.json`` and the figure: evaluations until success, quartiles and two-sided tests of outcomes."""
    needed = {way: describe_times(column(select(times, way=way), "evaluations"), budget) for way in SEARCHES}
    summary: dict[str, Any] = {"budget": budget, "evaluations_until_all_solved": needed, "outcomes": {}, "tests": {}}
    for name in OUTCOMES:
        samples = {way: _known(rows, way, name) for way in LABELS}
        summary["outcomes"][name] = {way: quartiles(values) for way, values in samples.items()}
        pairs = [pair for pair in PAIRS if all(len(samples[way]) > 1 for way in pair)]
        summary["tests"][name] = compare(samples, pairs, "two-sided")
    write_json(folder / "summary.json", summary)
    draw(rows, folder / "homeostasis-objective.png")


def _known(rows: Sequence[Record], way: str, name: str) -> Floats:
    """An outcome of a way, of the searches that have it."""
    values = column(select(rows, way=way), name)
    return values[np.isfinite(values)]


def draw(rows: Sequence[Record], path: Path) -> None:
    """Every outcome of every search, with medians, a panel each."""
    with figure(path, PAGE, 2.2, ncols=len(OUTCOMES)) as (drawn, panels):
        for axes, (name, label) in zip(panels.flat, OUTCOMES.items(), strict=True):
            for place, ((way, meaning), colour) in enumerate(zip(LABELS.items(), COLOURS, strict=False)):
                values = _known(rows, way, name)
                spread = np.linspace(-0.25, 0.25, len(values))
                axes.plot(place + spread, values, ".", color=colour, markersize=3, alpha=0.7, label=meaning)
                if len(values):
                    axes.plot([place - 0.35, place + 0.35], [np.median(values)] * 2, color=colour)
                    if name in MEASURES:
                        logarithmic(axes, "y")
            axes.set(ylabel=label, xticks=[])
        legend_above(drawn, panels[0, 0].get_legend_handles_labels()[0])


STUDY = Study(
    title="whether homeostasis as an objective helps",
    source="chapter 6",
    scales={
        "small": HomeostasisObjective(CoOptimisation(runs=3, budget=100), weights=15, draws=2),
        "full": HomeostasisObjective(),
    },
    run=study,
    rewrite=rewrite,
    writes=("summary.json", TIMES, REPORTED, "homeostasis-objective.png"),
)
