"""Training: how many evaluations search methods need to tune a controller, and whether metrics of bodies predict it.

Source: dissertation, chapter 4, "Training" and figure "neurips_evolution_correlation": the weights w1 and w2 of a body
are tuned by the sum of the smallest distances from the light, by four methods, five times each, with at most 500
evaluations, until one controller solves all four environments. The methods have the settings of that experiment, see
``optim.search.published``. It looked at its best point after every step of a method; here every point is looked at, in
the order asked for.
"""

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from optim.experiments.data import Data
from optim.experiments.figures import COLOURS, PAGE, caption, figure, note
from optim.experiments.results import Progress, write_json
from optim.experiments.side_by_side import BudgetedSearch, run_with_budget
from optim.experiments.study import Count, Settings, Study, StudyReport, StudySection, Whole
from optim.experiments.tables import read_table, write_columns, write_table
from optim.measures.statistics import Correlation, pearson
from optim.plots.curves import draw_share_solved
from optim.problem import Evaluation, Request
from optim.problems.braitenberg import VehicleProblem
from optim.search import build_method
from optim.search.published import BLACK_BOX_OPTIM
from optim.studies.chapter3.sensor_placement import correlation_of_metrics
from optim.studies.chapter3.sweep_table import SweepTable, read_sweep_table, sample_designs, sweep_published
from robots.braitenberg import BASELINE, DESIGNS, PUBLISHED, Sweep, VehicleBody, VehicleTask
from robots.robot import part_of
from taichi_sim.base.arrays import Arrays, Bools, Floats, Ints
from taichi_sim.base.checks import check_fields, within
from taichi_sim.base.compute import Precision
from taichi_sim.base.results_folder import ResultsFolder, read_settings
from taichi_sim.base.short_text import counted

COLUMNS = ("design", "method", "repetition", "evaluations", "solved")


@dataclass(frozen=True, eq=False)
class TrainingTable:
    """Outcomes of runs: M methods, each R times in each of D bodies."""

    methods: tuple[str, ...]  # names, shape (M,)
    designs: Ints  # numbers of the bodies, ascending, shape (D,)
    # until one controller solved all environments; of a run that found none, all it had; shape (M, D, R)
    evaluations: Ints
    solved: Bools  # whether one was found, shape (M, D, R)

    def write(self, path: Path) -> None:
        """Write a row for each run as CSV, compressed if its name ends in ``.gz``."""
        rows = [
            (design, method, number, *map(int, run))
            for method, *outcomes in zip(self.methods, self.evaluations, self.solved, strict=True)
            for design, *runs in zip(self.designs.tolist(), *outcomes, strict=True)
            for number, run in enumerate(zip(*runs, strict=True), 1)
        ]
        write_table(path, COLUMNS, rows)


def read_training_table(path: Path) -> TrainingTable:
    """Read what :meth:`TrainingTable.write` wrote; raises ValueError for any other file."""
    header, rows = read_table(path)
    try:
        if tuple(header) != COLUMNS:
            raise ValueError
        methods = tuple(dict.fromkeys(row[1] for row in rows))
        designs, numbers = np.unique([int(row[0]) for row in rows]), np.array([row[2:] for row in rows], np.int64)
        repetitions = int(numbers[:, 0].max())
        shape = len(methods), len(designs), repetitions
        table = TrainingTable(methods, designs, numbers[:, 1].reshape(shape), numbers[:, 2].reshape(shape) == 1)
    except (ValueError, IndexError):
        raise ValueError(f"{path}: is not a table of training, with columns {','.join(COLUMNS)}") from None
    return table


@dataclass(frozen=True)
class MetricCorrelation:
    """Correlation of the evaluations that a method needs with a metric of the body."""

    method: str  # its name
    metric: str  # ``"M_L"`` or ``"M_CI"``
    over: str  # ``"runs"``, those in one body not independent; or ``"bodies"``, the means of their runs, as published
    found: Correlation  # Pearson's correlation, its p two-sided


def metric_correlations(table: TrainingTable, sweep: SweepTable) -> list[MetricCorrelation]:
    """Correlations of all methods with both metrics, over runs and bodies; raises ValueError if some are missing."""
    found = []
    for method, evaluations in zip(table.methods, table.evaluations, strict=True):
        for metric, values in sweep.rows(table.designs).metrics.items():
            runs = np.repeat(values, evaluations.shape[1]), evaluations.ravel()
            for over, pairs in (("runs", runs), ("bodies", (values, evaluations.mean(axis=1)))):
                found.append(MetricCorrelation(method, metric, over, pearson(*pairs, "two-sided")))
    return found


TRAINERS = tuple(BLACK_BOX_OPTIM)
BODIES_PER_FILE = 25  # a file each half a minute or so
_Outcome = tuple[Ints, Bools]  # of a body: evaluations and successes, shape (R,) each


@dataclass(frozen=True)
class Training(Settings):
    """Settings of the study."""

    repetitions: Count = 5  # R, runs of each method in each body
    budget: Count = 500  # evaluations of a run
    seed: Whole = 1  # of all random numbers
    task: VehicleTask = PUBLISHED  # environments, radius of success and time
    precision: Precision = "f64"  # ``"f64"`` or ``"f32"``

    def problem(self, threads: int | None = None) -> VehicleProblem:
        """The problem that judges controllers together with the places of their sensors."""
        return VehicleProblem(task=self.task, precision=self.precision, threads=threads)

    def describe(self) -> dict[str, Any]:
        """All that outcomes depend on but body and method, as JSON values."""
        numbers = {name: getattr(self, name) for name in ("repetitions", "budget", "seed")}
        methods = {name: dict(settings) for name, settings in BLACK_BOX_OPTIM.items()}
        return {**numbers, "methods": methods, "problem": self.problem().describe()}

    def check(self, arrays: Arrays) -> None:
        """Refuse outcomes of a file that no run with these settings has, by a ValueError."""
        for name in ("evaluations", "solved"):
            if (runs := arrays[name].shape[1]) != self.repetitions:
                raise ValueError(f"{name}: {runs} runs of a body are not allowed; give {self.repetitions}")
        within("designs", arrays["designs"], 1, DESIGNS)
        within("evaluations", arrays["evaluations"], 1, self.budget)


def train(
    designs: Iterable[int],
    methods: Sequence[str] = TRAINERS,
    settings: Training = Training(),
    *,
    threads: int | None = None,
    out: Path | None = None,
    progress: Progress = None,
) -> TrainingTable:
    """Tune controllers of bodies by search methods, and count evaluations until success.

    The folder takes the outcomes as they come. A study of the same settings that finds it goes on from there, also with
    other bodies and methods; killed at any moment, it loses half a minute of work or so. Designs are numbers of the
    published grid, from 1 to 6561.

    Returns:
        Outcomes of all runs. A run's depends on its body, method, repetition and the settings only.

    Raises:
        ValueError: for bodies and methods that are not there, none of them, or a folder of other settings.
    """
    bodies = {design: VehicleBody.published(design) for design in sorted(set(designs))}
    methods = tuple(dict.fromkeys(methods))
    for name, given in {"designs": bodies, "methods": methods}.items():
        if not given:
            raise ValueError(f"{name}: none given; give at least one")
    for method in methods:
        if method not in TRAINERS:
            raise ValueError(f"methods: {method!r} is unknown; choose some of {', '.join(TRAINERS)}")
    folder = ResultsFolder(out, "training", settings.describe()) if out else None
    known: dict[str, dict[int, _Outcome]] = {method: {} for method in methods}
    chunks = []
    for method in methods:
        kinds = {"designs": "i1", "evaluations": "i2", "solved": "b2"}
        for arrays in folder.load(f"runs-{method}", settings.check, **kinds) if folder else ():
            known[method] |= _by_design(arrays)
        missing = [design for design in bodies if design not in known[method]]
        chunks += [(method, missing[n : n + BODIES_PER_FILE]) for n in range(0, len(missing), BODIES_PER_FILE)]
    total = len(methods) * len(bodies)
    done = total - sum(len(chunk) for _, chunk in chunks)
    for method, chunk in chunks:
        share = part_of(progress, done, total, len(chunk))
        evaluations, solved = _run(method, [bodies[design] for design in chunk], settings, threads, share)
        fresh = {"designs": np.array(chunk), "evaluations": evaluations, "solved": solved}
        known[method] |= _by_design(fresh)
        done += len(chunk)
        if folder:
            folder.add(f"runs-{method}", fresh["designs"].tobytes(), **fresh)
    found = [np.array([[known[m][design][n] for design in bodies] for m in methods]) for n in (0, 1)]
    return TrainingTable(methods, np.array(list(bodies)), *found)


def _run(
    method: str, bodies: Sequence[VehicleBody], settings: Training, threads: int | None, progress: Progress
) -> tuple[Ints, Bools]:
    """All repetitions of a method in D bodies, side by side: evaluations and successes, shape (D, R) each."""
    problem, weights = settings.problem(threads), VehicleProblem(body=BASELINE).space
    runs = [(body, repetition) for body in bodies for repetition in range(settings.repetitions)]
    places = np.array([np.ravel(body.sensors) for body, _ in runs])
    evaluations, solved = np.zeros(len(runs), np.int64), np.zeros(len(runs), bool)

    def evaluate(owners: Sequence[BudgetedSearch], request: Request) -> Evaluation:
        return problem.evaluate(np.hstack([places[[owner.name for owner in owners]], request.points]))

    def observe(run: int, points: Floats, evaluation: Evaluation) -> bool:
        successes = np.flatnonzero(evaluation.details["solved"] == len(settings.task.starts))
        solved[run] = successes.size > 0
        evaluations[run] += successes[0] + 1 if successes.size else len(points)
        return bool(solved[run])

    seeds = [_seed(settings.seed, body.design or 0, repetition) for body, repetition in runs]
    methods = [build_method(method, weights, {**BLACK_BOX_OPTIM[method], "seed": seed}) for seed in seeds]
    run_with_budget(methods, settings.budget, evaluate, observe, progress)
    return evaluations.reshape(len(bodies), -1), solved.reshape(len(bodies), -1)


def _seed(*stream: int) -> int:
    """The seed of a run, of the study's, body and repetition: methods have the same, as they begin alike."""
    return int(np.random.SeedSequence(stream).generate_state(1, np.uint64)[0]) >> 1  # seeds are below 2^63


def _by_design(arrays: Arrays) -> dict[int, _Outcome]:
    pairs = zip(arrays["evaluations"], arrays["solved"], strict=True)
    return dict(zip(arrays["designs"].tolist(), pairs, strict=True))


@dataclass(frozen=True)
class TrainingInBodies:
    """Bodies in which trainers are tried, and their sweep."""

    fixed: ClassVar = ("training.task", "training.precision")  # those of the sweep
    bodies: Count = DESIGNS  # how many, drawn from the published grid
    weights: int = 121  # values of each weight in the sweep that gives their metrics
    training: Training = Training()  # of the trainers

    def __post_init__(self) -> None:
        check_fields(self)
        _ = self.designs, Sweep(weights=self.weights)  # refuse numbers that are not allowed

    @property
    def designs(self) -> list[int]:
        """Numbers of the bodies, ascending."""
        return sample_designs(self.bodies)

    def describe(self) -> dict[str, Any]:
        """All that results depend on, as JSON values."""
        return {**self.training.describe(), "bodies": self.bodies, "weights": self.weights}


def study(
    folder: Path, settings: TrainingInBodies, progress: Progress = None, sweep_folder: Path | None = None
) -> None:
    """Four trainers in random bodies: write ``runs.csv``, ``summary.json`` and ``training.png``."""
    ResultsFolder(folder, "training", settings.describe())
    designs, overlaps = settings.designs, sweep_folder or folder / "overlaps"
    sweep = sweep_published(designs, Sweep(weights=settings.weights), overlaps, part_of(progress, 0, 2))
    table = train(designs, TRAINERS, settings.training, out=folder / "runs", progress=part_of(progress, 1, 2))
    table.write(folder / "runs.csv")
    _report(folder, table, sweep)


def rewrite(data: Data, folder: Path) -> None:
    """Write ``summary.json`` and ``training.png`` from tables of runs and sweep, a study's or of all bodies."""
    own = data.has("runs.csv")
    runs = read_training_table(data.path("runs.csv" if own else "vehicle-training-all.csv"))
    sweep = read_sweep_table(data.folder / "overlaps" if own else data.path("vehicle-sweep.csv"))
    _report(folder, runs, sweep.rows(runs.designs))


def _report(folder: Path, table: TrainingTable, sweep: SweepTable) -> None:
    """Write ``summary.json`` and ``training.png``, which follow from the tables of runs and of the sweep."""
    found = [asdict(one) for one in metric_correlations(table, sweep)]
    write_json(folder / "summary.json", {"correlations": found, "metrics": asdict(correlation_of_metrics(sweep))})
    save_training(table, sweep, folder / "training.png")


NAMES = {
    "random": "random search",
    "generating-set": "generating set search",
    "nes": "natural evolution strategy",
    "de": "differential evolution",
}
MANY = 1000  # bodies, whose points are small
SYMBOLS = {"M_L": "$M_L$", "M_CI": "$M_{CI}$"}


def save_training(table: TrainingTable, sweep: SweepTable, path: Path) -> None:
    """Draw a row for each method, a column for each metric; a point is a body, the mean of its runs. Beside it: CSV."""
    part, means = sweep.rows(table.designs), table.evaluations.mean(axis=2)
    found = {(c.method, c.metric): c.found for c in metric_correlations(table, part) if c.over == "bodies"}
    size = 5.0 if len(part.designs) < MANY else 2.0
    rows, height = len(table.methods), 0.4 + 1.7 * len(table.methods)
    with figure(path, PAGE, height, nrows=rows, ncols=len(SYMBOLS), sharex="col", sharey=True) as (_, panels):
        for row, method, mean in zip(panels, table.methods, means, strict=True):
            for axes, (metric, values) in zip(row, part.metrics.items(), strict=True):
                axes.scatter(values, mean, s=size, color=COLOURS[0], alpha=0.4, linewidths=0, rasterized=True)
                caption(axes, NAMES.get(method, method))
                correlation = found[method, metric]
                if correlation.r is not None:
                    p = "p < 0.001" if correlation.p < 0.001 else f"p = {correlation.p:.3f}"
                    note(axes, f"$r = {correlation.r:.2f}$, {p}", 0.95)
            row[0].set_ylabel("mean evaluations")
        for axes, metric in zip(panels[-1], part.metrics, strict=True):
            axes.set_xlabel(SYMBOLS[metric])
    columns = {"design": table.designs, **part.metrics, **dict(zip(table.methods, means, strict=True))}
    write_columns(path.with_suffix(".csv"), columns)


STUDY = Study(
    title="evaluations that four trainers need, against what a sweep says of the bodies",
    source="chapter 4, figure of sample efficiency",
    scales={"small": TrainingInBodies(20, 41, Training(repetitions=2)), "full": TrainingInBodies()},
    run=study,
    rewrite=rewrite,
    writes=("summary.json", "runs.csv", "training.png"),
)


def _median(spent: Ints, solved: Bools, budget: int) -> float | str:
    """Median of the evaluations until success, those of failures above all others; a text if that is beyond them."""
    found = float(np.median(np.where(solved, spent, np.inf)))
    return found if np.isfinite(found) else f"more than {budget}"


def report(folder: Path) -> StudyReport:
    """What a report tells of training; raises ValueError if there is no table yet."""
    settings, found = read_settings(folder, "training"), read_training_table(folder / "runs.csv")
    budget = int(settings.get("budget", found.evaluations.max()))
    methods = list(zip(found.methods, found.evaluations, found.solved, strict=True))

    def draw(axes: Any) -> None:
        for (name, spent, solved), colour in zip(methods, COLOURS, strict=False):
            draw_share_solved(axes, spent[solved], solved.size, budget, color=colour, label=name)
        axes.set_ylabel("share of runs with all solved")

    words = f"Share of runs of {counted(len(methods), 'method')} that solve all environments, against evaluations"
    section = StudySection(
        "Methods",
        "Runs of each method",
        ("Method", "Runs", "Solve all", "Evaluations, mean", "Median"),
        [
            (name, solved.size, int(solved.sum()), float(spent.mean()), _median(spent, solved, budget))
            for name, spent, solved in methods
        ],
        digits=1,
        note="A run that fails counts with all that it used up in the mean, and as longest of all in the median.",
        charts={words: draw},
        size=(5.0, 3.0),
    )
    return StudyReport(
        "training",
        "Evaluations until a controller solves all four environments, in bodies of vehicles.",
        {"bodies": len(found.designs), "methods": len(methods)},
        settings,
        [section],
        {"methods": list(found.methods)},
    )
