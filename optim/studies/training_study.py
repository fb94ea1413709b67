"""Whether the metrics of bodies predict how many evaluations trainers need in them (chapter 4)."""

from dataclasses import asdict
from pathlib import Path

from optim.studies.results import Budget, Progress, part_of, scale_of, write_json
from optim.studies.sensor_placement import correlation_of_metrics
from optim.studies.sweep_table import overlaps_of, read_sweep_table
from optim.studies.training import TRAINERS, Training, sample_designs, train
from optim.studies.training_figures import save_training
from optim.studies.training_table import metric_correlations
from robots.braitenberg import DESIGNS, Sweep, VehicleBody
from robots.results_folder import ResultsFolder


def run(folder: Path, budget: Budget = "full", progress: Progress = None, sweep_folder: Path | None = None) -> None:
    """Four trainers in 20 random bodies, twice (``"small"``), or in all bodies, five times; resumable.

    Writes ``runs.csv``, ``summary.json`` and ``training.png``.

    Args:
        folder, budget, progress: see :func:`optim.studies.sweep_study.run`.
        sweep_folder: of a sweep of these bodies, or that takes it; one beside the results if None.
    """
    count, weights, repetitions = scale_of(budget, {"small": (20, 41, 2), "full": (DESIGNS, 121, 5)})
    designs, settings = sample_designs(count), Training(repetitions)
    ResultsFolder(folder, "training", {**settings.describe(), "bodies": count, "weights": weights})
    swept = sweep_folder or folder / "overlaps"
    bodies = [VehicleBody.published(design) for design in designs]
    overlaps_of(bodies, Sweep(weights=weights), swept, progress=part_of(progress, 0, 2))
    sweep = read_sweep_table(swept).rows(designs)
    table = train(designs, TRAINERS, settings, out=folder / "runs", progress=part_of(progress, 1, 2))
    table.write(folder / "runs.csv")
    found = [asdict(one) for one in metric_correlations(table, sweep)]
    write_json(folder / "summary.json", {"correlations": found, "metrics": asdict(correlation_of_metrics(sweep))})
    save_training(table, sweep, folder / "training.png")
