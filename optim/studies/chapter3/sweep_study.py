"""The sweep of chapters 3 and 4, its metrics and its pictures."""

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from optim.experiments.results import Progress
from optim.experiments.study import Study
from optim.studies.chapter3.sensor_placement_figures import save_figures
from optim.studies.chapter3.sweep_table import sample_designs, sweep_published
from robots.braitenberg import DESIGNS, Sweep
from taichi_sim.base.results_folder import ResultsFolder

NOTABLE = (162, 6553)  # the best body and the baseline, always among those swept


@dataclass(frozen=True)
class SensorPlacement:
    """Bodies that are swept, and how."""

    sample: int = DESIGNS  # bodies drawn from the published grid, beside those in ``NOTABLE``
    sweep: Sweep = field(default_factory=Sweep)  # settings of the sweep

    def __post_init__(self) -> None:
        _ = self.designs  # refuses a sample that there is not

    @property
    def designs(self) -> list[int]:
        """Numbers of the bodies, ascending."""
        return sorted({*NOTABLE, *sample_designs(self.sample)})

    def describe(self) -> dict[str, Any]:
        """All that results depend on."""
        return {**asdict(self.sweep), "bodies": len(self.designs)}


def study(folder: Path, settings: SensorPlacement, progress: Progress = None, sweep_folder: Path | None = None) -> None:
    """Write ``table.csv`` and pictures.

    Args:
        sweep_folder: takes the overlaps; one beside the results if None.
    """
    ResultsFolder(folder, "sensor-placement", settings.describe())
    overlaps = sweep_folder or folder / "overlaps"
    table = sweep_published(settings.designs, settings.sweep, overlaps, progress)
    table.write(folder / "table.csv")
    save_figures(table, overlaps, folder)


STUDY = Study(
    title="all controllers in bodies of the published grid: learnability and resistance to interference",
    source="chapters 3 and 4, figures of designs, metrics and their correlation",
    scales={"small": SensorPlacement(98, Sweep(weights=41)), "full": SensorPlacement()},
    run=study,
    writes=("table.csv", "distributions.png", "correlation.png", "examples.png"),
)
