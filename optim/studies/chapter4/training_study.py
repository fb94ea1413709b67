"""Whether the metrics of bodies predict how many evaluations trainers need in them (chapter 4)."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from optim.experiments.figures import COLOURS, PAGE, caption, figure, note
from optim.experiments.results import Progress, part_of, write_json
from optim.experiments.study import Study
from optim.experiments.tables import write_columns
from optim.studies.chapter3.sensor_placement import correlation_of_metrics
from optim.studies.chapter3.sweep_table import SweepTable, sample_designs, sweep_published
from optim.studies.chapter4.training import TRAINERS, Training, train
from optim.studies.chapter4.training_table import TrainingTable, metric_correlations
from robots.braitenberg import DESIGNS, Sweep
from taichi_sim.base.results_folder import ResultsFolder


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
    """Four trainers in random bodies: write ``runs.csv``, ``summary.json`` and ``training.png``.

    Args:
        sweep_folder: of a sweep of these bodies, or that takes it; one beside the results if None.
    """
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
