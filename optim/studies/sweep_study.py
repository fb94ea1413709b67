"""The sweep of chapters 3 and 4, its metrics and its pictures."""

from dataclasses import asdict
from pathlib import Path

from optim.studies.results import Budget, Progress, scale_of
from optim.studies.sensor_placement_figures import save_figures
from optim.studies.sweep_table import overlaps_of, read_sweep_table
from optim.studies.training import sample_designs
from robots.braitenberg import DESIGNS, Sweep, VehicleBody
from robots.results_folder import ResultsFolder


def run(folder: Path, budget: Budget = "full", progress: Progress = None, sweep_folder: Path | None = None) -> None:
    """Sweep 100 random bodies coarsely (``"small"``) or all of them; ``table.csv`` and pictures. Resumable.

    Args:
        folder: takes table and pictures.
        budget: ``"small"`` or ``"full"``.
        progress: called with the fraction done.
        sweep_folder: takes the overlaps; one beside the results if None.

    Raises:
        ValueError: in one line, for an unknown budget or a folder of something else.
    """
    weights, count = scale_of(budget, {"small": (41, 98), "full": (121, DESIGNS)})
    settings, designs = Sweep(weights=weights), sorted({162, 6553, *sample_designs(count)})
    ResultsFolder(folder, "sensor-placement", {**asdict(settings), "bodies": len(designs)})
    overlaps = sweep_folder or folder / "overlaps"
    overlaps_of([VehicleBody.published(design) for design in designs], settings, overlaps, progress=progress)
    table = read_sweep_table(overlaps).rows(designs)
    table.write(folder / "table.csv")
    save_figures(table, overlaps, folder)
