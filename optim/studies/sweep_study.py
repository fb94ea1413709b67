"""The sweep of chapters 3 and 4, its metrics and its pictures."""

from collections.abc import Callable
from pathlib import Path

from optim.studies.sensor_placement_figures import save_figures
from optim.studies.sweep_table import overlaps_of, read_sweep_table
from optim.studies.training import sample_designs
from robots.braitenberg import DESIGNS, Sweep, VehicleBody


def run(
    folder: Path,
    budget: str = "full",
    progress: Callable[[float], None] | None = None,
    sweep_folder: Path | None = None,
) -> None:
    """Sweep 100 random bodies coarsely (``"small"``) or all of them; ``table.csv`` and pictures. Resumable.

    Args:
        folder: takes table and pictures.
        budget: ``"small"`` or ``"full"``.
        progress: called with the fraction done.
        sweep_folder: takes the overlaps; one beside the results if None.

    Raises:
        ValueError: in one line, for an unknown budget or a folder of something else.
    """
    if budget not in ("small", "full"):
        raise ValueError(f"budget: {budget!r} is unknown; choose one of small, full")
    settings = Sweep(weights=41) if budget == "small" else Sweep()
    designs = sorted({162, 6553, *sample_designs(98)}) if budget == "small" else range(1, DESIGNS + 1)
    overlaps = sweep_folder or folder / "overlaps"
    overlaps_of([VehicleBody.published(design) for design in designs], settings, overlaps, progress=progress)
    table = read_sweep_table(overlaps).rows(list(designs))
    table.write(folder / "table.csv")
    save_figures(table, overlaps, folder)
