"""Success of all controllers in the canonical and the best body of chapter 3, in both of its models.

Source: dissertation, chapter 3, figures "landscape" (D to F) and section "Empirical results", and the theoretical model
of the same bodies (``robots.braitenberg``).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.figures import COLUMN, caption, figure, letter, save_arrays
from optim.experiments.results import Budget, Progress, check_folder, part_of, write_json
from optim.experiments.study import Study
from optim.experiments.tables import write_table
from optim.measures.overlap import interference, learnability
from optim.studies.chapter3.rover_grid import RoverGrid, successes
from optim.studies.chapter3.sweep_table import overlaps_of
from robots.braitenberg import Sweep
from robots.rover import BEST, CANONICAL, Rover
from robots.view.vehicle_charts import add_overlap_bar, draw_overlap
from taichi_sim.base.arrays import Bytes

Overlap = Bytes
BODIES = {"canonical": Rover(CANONICAL), "best": Rover(BEST)}
# Of 121 x 121 controllers: those that solve all environments, M_L and M_CF.
PUBLISHED = {"canonical": (1, 0.000068, 0.00052), "best": (57, 0.0039, 0.038)}
MODELS = ("rigid bodies", "theoretical")
COLUMNS = (
    *("body", "model", "controllers", *(f"solving_{lights}" for lights in range(5)), "M_L", "M_CF"),
    *("published_solving_4", "published_M_L", "published_M_CF"),
)
FILES = tuple(f"rover-success.{end}" for end in ("csv", "npz", "png"))


@dataclass(frozen=True)
class RoverSuccess:
    """Settings.

    Attributes:
        grid: of weights, of the rigid bodies.
        theory: of the theoretical model.
    """

    grid: RoverGrid = field(default_factory=RoverGrid)
    theory: Sweep = field(default_factory=Sweep)


SCALES: Mapping[Budget, RoverSuccess] = {"small": RoverSuccess(RoverGrid(31), Sweep(31)), "full": RoverSuccess()}


def study(folder: Path, settings: RoverSuccess, progress: Progress = None) -> None:
    """Write ``summary.json``, a table and a figure, its numbers beside it.

    For the arguments see :class:`optim.experiments.study.Study`.
    """
    check_folder(folder, ("success", "theory", "summary.json", *FILES))
    vehicles = [rover.vehicle for rover in BODIES.values()]
    designs = [vehicle.design for vehicle in vehicles if vehicle.design is not None]  # both are of the grid
    reached = successes(designs, settings.grid, folder / "success", progress=part_of(progress, 0, 2))
    expected = overlaps_of(vehicles, settings.theory, folder / "theory", progress=part_of(progress, 1, 2))
    overlaps = {
        (body, model): overlap
        for model, found in zip(MODELS, (reached.sum(-1, dtype=np.uint8), expected), strict=True)
        for body, overlap in zip(BODIES, found, strict=True)
    }
    rows = [_row(body, model, overlap) for (body, model), overlap in overlaps.items()]
    write_table(folder / "rover-success.csv", COLUMNS, rows)
    lights = {body: found.sum((0, 1)).tolist() for body, found in zip(BODIES, reached, strict=True)}
    summary = {"rows": [dict(zip(COLUMNS, row, strict=True)) for row in rows], "reaching_each_light": lights}
    write_json(folder / "summary.json", summary)
    draw(overlaps, folder / "rover-success.png")


def _row(body: str, model: str, overlap: Overlap) -> tuple[Any, ...]:
    counts = np.bincount(overlap.ravel(), minlength=5).tolist()
    measured = float(learnability(overlap)), float(interference(overlap))
    return body, model, overlap.size, *counts, *measured, *(PUBLISHED[body] if model == MODELS[0] else [None] * 3)


def draw(overlaps: dict[tuple[str, str], Overlap], path: Path) -> None:
    """Success matrices, a column a body and a row a model; their numbers beside it as ``.npz``."""
    with figure(path, 2 * COLUMN, 5.6, nrows=len(MODELS), ncols=len(BODIES)) as (drawn, panels):
        for axes, ((body, model), overlap) in zip(panels.flat, overlaps.items(), strict=True):
            image = draw_overlap(axes, overlap)
            caption(axes, f"{body} body, {model}: {np.count_nonzero(overlap == 4)} solve all")
        add_overlap_bar(drawn, image, panels.ravel().tolist())
        letter(panels)
    save_arrays(path.with_suffix(".npz"), {f"{body}, {model}": found for (body, model), found in overlaps.items()})


STUDY = Study(
    title="all controllers in the canonical and the best body of the two-wheel vehicle, as rigid bodies",
    source="chapter 3, figure of landscapes, empirical model",
    scales=SCALES,
    run=study,
    writes=("summary.json", "rover-success.csv", "rover-success.png"),
)
