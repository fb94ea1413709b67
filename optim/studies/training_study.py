"""Whether the metrics of bodies predict how many evaluations trainers need in them (chapter 4)."""

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

from optim.studies.results import part_of, write_json
from optim.studies.sensor_placement import correlation_of_metrics
from optim.studies.sweep_table import overlaps_of, read_sweep_table
from optim.studies.training import TRAINERS, Training, sample_designs, train
from optim.studies.training_figures import save_training
from optim.studies.training_table import metric_correlations
from robots.braitenberg import DESIGNS, Sweep, VehicleBody


def run(
    folder: Path,
    budget: str = "full",
    progress: Callable[[float], None] | None = None,
    sweep_folder: Path | None = None,
) -> None:
    """Four trainers in 20 random bodies, twice (``"small"``), or in all bodies, five times; resumable.

    Writes ``runs.csv``, ``summary.json`` and ``training.png``.

    Args:
        folder: takes the results.
        budget: ``"small"`` or ``"full"``.
        progress: called with the fraction done.
        sweep_folder: of a sweep of these bodies, or that takes it; one beside the results if None.

    Raises:
        ValueError: in one line, for an unknown budget or a folder of something else.
    """
    if budget not in ("small", "full"):
        raise ValueError(f"budget: {budget!r} is unknown; choose one of small, full")
    small = budget == "small"
    designs = sample_designs(20) if small else list(range(1, DESIGNS + 1))
    swept = sweep_folder or folder / "overlaps"
    bodies = [VehicleBody.published(design) for design in designs]
    overlaps_of(bodies, Sweep(weights=41) if small else Sweep(), swept, progress=part_of(progress, 0, 2))
    sweep = read_sweep_table(swept).rows(designs)
    settings = Training(repetitions=2 if small else 5)
    table = train(designs, TRAINERS, settings, out=folder / "runs", progress=part_of(progress, 1, 2))
    table.write(folder / "runs.csv")
    found = [asdict(one) for one in metric_correlations(table, sweep)]
    write_json(folder / "summary.json", {"correlations": found, "metrics": asdict(correlation_of_metrics(sweep))})
    save_training(table, sweep, folder / "training.png")
