"""Whether the metrics of bodies predict how many evaluations trainers need in them (chapter 4); and their report."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.figures import COLOURS, PAGE, caption, figure, note
from optim.experiments.results import Progress, part_of, write_json
from optim.experiments.study import Study, StudyReport, StudySection
from optim.experiments.tables import write_columns
from optim.plots.curves import draw_share_solved
from optim.studies.chapter3.sensor_placement import correlation_of_metrics
from optim.studies.chapter3.sweep_table import SweepTable, sample_designs, sweep_published
from optim.studies.chapter4.training import (
    TRAINERS,
    Training,
    TrainingTable,
    metric_correlations,
    read_training_table,
    train,
)
from optim.wording import counted
from robots.braitenberg import DESIGNS, Sweep
from taichi_sim.base.results_folder import ResultsFolder, read_settings


@dataclass(frozen=True)
class TrainingInBodies:
    """Bodies in which trainers are tried, and their sweep."""

    bodies: int = DESIGNS  # how many, drawn from the published grid
    weights: int = 121  # values of each weight in the sweep that gives their metrics
    # repetitions, budget and seed of the trainers
    training: Training = Training()  # noqa: RUF009 (immutable)

    def __post_init__(self) -> None:
        _ = self.designs, Sweep(weights=self.weights)  # refuse numbers that are not allowed

    @property
    def designs(self) -> list[int]:
        """Numbers of the bodies, ascending."""
        return sample_designs(self.bodies)

    def describe(self) -> dict[str, Any]:
        """All that results depend on."""
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
    found = [asdict(one) for one in metric_correlations(table, sweep)]
    write_json(folder / "summary.json", {"correlations": found, "metrics": asdict(correlation_of_metrics(sweep))})
    save_training(table, sweep, folder / "training.png")


NAMES = {
    "random": "random search",
    "generating-set": "generating set search",
    "nes": "natural evolution strategy",
    "de": "differential evolution",
}
SYMBOLS = {"M_L": "$M_L$", "M_CI": "$M_{CI}$"}


def save_training(table: TrainingTable, sweep: SweepTable, path: Path) -> None:
    """A column for each method, a row for each metric; a point for each body, the mean of its runs. Beside it: CSV."""
    part, means = sweep.rows(table.designs), table.evaluations.mean(axis=2)
    found = {(c.method, c.metric): c.found for c in metric_correlations(table, part) if c.over == "bodies"}
    width = PAGE * max(len(table.methods), 2) / len(NAMES)
    with figure(path, width, 3.6, nrows=2, ncols=len(table.methods), sharex="row", sharey=True) as (_, panels):
        for row, (metric, values) in zip(panels, part.metrics.items(), strict=True):
            for axes, method, mean in zip(row, table.methods, means, strict=True):
                axes.scatter(values, mean, s=5, color=COLOURS[0], alpha=0.4, linewidths=0, rasterized=True)
                axes.set_xlabel(SYMBOLS[metric])
                correlation = found[method, metric]
                if correlation.r is not None:
                    p = "p < 0.001" if correlation.p < 0.001 else f"p = {correlation.p:.3f}"
                    note(axes, f"$r = {correlation.r:.2f}$, {p}", 0.95)
            row[0].set_ylabel("mean evaluations")
        for axes, method in zip(panels[0], table.methods, strict=True):
            caption(axes, NAMES.get(method, method))
    columns = {"design": table.designs, **part.metrics, **dict(zip(table.methods, means, strict=True))}
    write_columns(path.with_suffix(".csv"), columns)


STUDY = Study(
    title="evaluations that four trainers need, against what a sweep says of the bodies",
    source="chapter 4, figure of sample efficiency",
    scales={"small": TrainingInBodies(20, 41, Training(repetitions=2)), "full": TrainingInBodies()},
    run=study,
    writes=("summary.json", "runs.csv", "training.png"),
)


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
            (name, solved.size, int(solved.sum()), float(spent.mean()), float(np.median(spent)))
            for name, spent, solved in methods
        ],
        digits=1,
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
