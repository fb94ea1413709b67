"""The sweep of chapters 3 and 4: its metrics, its pictures, and what a report tells of it."""

from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.data import Data
from optim.experiments.results import Progress
from optim.experiments.study import Study, StudyReport, StudySection
from optim.studies.chapter3 import trajectories
from optim.studies.chapter3.examples import examples_of, has_examples, read_examples, save_figures_of_examples
from optim.studies.chapter3.sensor_placement import notable_designs, save_metrics
from optim.studies.chapter3.sweep_table import (
    SweepTable,
    overlaps_of,
    read_sweep_table,
    sample_designs,
    sweep_published,
)
from robots.braitenberg import DESIGNS, Sweep, VehicleBody
from robots.view.vehicle_charts import add_overlap_bar, draw_overlap
from taichi_sim.base.arrays import Bytes
from taichi_sim.base.files import make_folder
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
        """All that results depend on, as JSON values."""
        return {**asdict(self.sweep), "bodies": len(self.designs)}


def study(folder: Path, settings: SensorPlacement, progress: Progress = None, sweep_folder: Path | None = None) -> None:
    """Write ``table.csv``, pictures, and arrays from which they are drawn."""
    ResultsFolder(folder, "sensor-placement", settings.describe())
    overlaps = sweep_folder or folder / "overlaps"
    table = sweep_published(settings.designs, settings.sweep, overlaps, progress)
    table.write(folder / "table.csv")
    save_figures(table, overlaps, folder)
    trajectories.save_trajectories(trajectories.trajectories(), folder)


def save_figures(table: SweepTable, sweep: Path, folder: Path) -> list[str]:
    """Metrics, their correlation, and the most notable bodies of a sweep's folder; the names of the pictures."""
    found = examples_of(table, sweep)
    return [*save_metrics(table, folder), *save_figures_of_examples(found, table, folder)]


# Tables of complete sweeps in ``docs/data`` and that of this study, the folder of what is told of each, and the file of
# examples of its bodies.
TABLES = {
    "vehicle-sweep.csv": ("", "vehicle-examples.npz"),
    "vehicle-sweep-radius-0.2.csv": ("radius-0.2", "vehicle-examples-radius-0.2.npz"),
    "table.csv": ("", "examples.npz"),
}
TRAJECTORIES = ("vehicle-trajectories.npz", trajectories.NUMBERS)


def rewrite(data: Data, folder: Path) -> None:
    """Write the table of each sweep and pictures of its metrics; also those of which there are arrays."""
    there = [name for name in TABLES if data.has(name)]
    if not there:
        raise ValueError(f"from-data: {data.folder} has no table of a sweep; give one with {' or '.join(TABLES)}")
    paths = [name for name in TRAJECTORIES if data.has(name)]
    for names, parts in ((there, {TABLES[name][0] for name in there}), (paths, {"trajectories"})):
        if len(names) > len(parts):
            raise ValueError(
                f"from-data: {data.folder} has {' and '.join(names)}; give a folder with one sweep of its own"
            )
    for name in there:
        part, examples = TABLES[name]
        table, told = read_sweep_table(data.path(name)), folder / part
        found = read_examples(data, examples, table) if has_examples(data, examples, table) else None
        make_folder(told)
        table.write(told / "table.csv")
        save_metrics(table, told)
        if found is not None:
            save_figures_of_examples(found, table, told)
    for name in paths:
        trajectories.save_trajectories(trajectories.read_trajectories(data, name), folder)


PICTURES = (
    "distributions.png",
    "correlation.png",
    "bodies.png",
    "landscape.png",
    "examples.png",
    *trajectories.PICTURES,
)

STUDY = Study(
    title="all controllers in bodies of the published grid: learnability and resistance to interference",
    source="chapters 3 and 4, figures of designs, metrics and their correlation",
    scales={"small": SensorPlacement(98, Sweep(weights=41)), "full": SensorPlacement()},
    run=study,
    rewrite=rewrite,
    writes=("table.csv", *PICTURES),
)


MOST_BODIES, MOST_MATRICES = 30, 6


def report(folder: Path) -> StudyReport:
    """What a report tells of a sweep; raises ValueError for a sweep without bodies."""
    found = read_sweep_table(folder)
    controllers = found.settings.weights**2
    best = found.rows(found.designs[np.argsort(-found.learnability, kind="stable")[:MOST_BODIES]])
    names = notable_designs(found)
    designs = list({**names, **dict.fromkeys(best.designs.tolist())})[:MOST_MATRICES]
    overlaps = overlaps_of([VehicleBody.published(design) for design in designs], found.settings, folder)
    charts = {}
    for design, solving, overlap in zip(designs, found.rows(designs).solving_all, overlaps, strict=True):
        known = f" ({names[design]})" if design in names else ""
        words = f"Design {design}{known}: {solving} of {controllers} controllers solve all environments"
        charts[words] = partial(_draw_matrix, overlap)
    labels = [f"design {design}" for design in best.designs]
    columns = (best.solving_all, best.solving_any, best.learnability, best.resistance)
    part = "" if len(labels) == len(found.designs) else f", the best {len(labels)} of {len(found.designs)} by M_L"
    bodies = StudySection(
        "Bodies",
        f"Controllers that succeed{part}",
        ("Body", "Solve all", "Solve any", "M_L", "M_CI"),
        list(zip(labels, *(column.tolist() for column in columns), strict=True)),
        digits=5,
        note="M_L is the share of all controllers that solve every environment, M_CI their share of those that solve "
        "any.",
    )
    return StudyReport(
        "sweep",
        "Every controller on a grid of two weights, in bodies of Braitenberg vehicles, in four environments.",
        {"bodies": len(found.designs), "controllers each": controllers},
        asdict(found.settings),
        [bodies, StudySection("Success matrices", charts=charts)],
        {"matrices": designs},
    )


def _draw_matrix(overlap: Bytes, axes: Any) -> None:
    """Draw a success matrix with its colours beside it."""
    add_overlap_bar(axes.figure, draw_overlap(axes, overlap), [axes])
