"""Success of all controllers in the canonical and the best body of chapter 3, in both of its models.

Source: dissertation, chapter 3, figures "landscape" (D to F) and section "Empirical results", and the theoretical model
of the same bodies (``robots.braitenberg``).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.figures import COLUMN, caption, figure, save_arrays
from optim.experiments.results import Progress, check_folder, write_json
from optim.experiments.study import Study
from optim.experiments.tables import write_records
from optim.measures.overlap import interference, learnability
from optim.studies.chapter3.rover_grid import MODELS, RoverGrid, both_models
from robots.braitenberg import Sweep
from robots.braitenberg.sweeps import Overlap
from robots.rover import BEST, CANONICAL, Rover
from robots.view.vehicle_charts import add_overlap_bar, draw_overlap

BODIES = {"canonical": Rover(CANONICAL), "best": Rover(BEST)}
# Of 121 x 121 controllers: those that solve all environments, M_L and M_CF.
PUBLISHED = {"canonical": (1, 0.000068, 0.00052), "best": (57, 0.0039, 0.038)}
FILES = tuple(f"rover-success.{end}" for end in ("csv", "npz", "png"))


@dataclass(frozen=True)
class RoverSuccess:
    """Sweeps of two bodies in both models."""

    grid: RoverGrid = field(default_factory=RoverGrid)  # of weights, of the rigid bodies
    theory: Sweep = field(default_factory=Sweep)  # of the theoretical model


def study(folder: Path, settings: RoverSuccess, progress: Progress = None) -> None:
    """Write ``summary.json``, a table and a figure, its numbers beside it."""
    check_folder(folder, ("success", "theory", "summary.json", *FILES))
    bodies = [rover.vehicle for rover in BODIES.values()]
    reached, found = both_models(bodies, settings.grid, settings.theory, folder, progress)
    overlaps = {(body, model): overlap for model in MODELS for body, overlap in zip(BODIES, found[model], strict=True)}
    rows = [_row(body, model, overlap) for (body, model), overlap in overlaps.items()]
    write_records(folder / "rover-success.csv", rows)
    lights = {body: found.sum((0, 1)).tolist() for body, found in zip(BODIES, reached, strict=True)}
    write_json(folder / "summary.json", {"rows": rows, "reaching_each_light": lights})
    draw(overlaps, folder / "rover-success.png")


def _row(body: str, model: str, overlap: Overlap) -> dict[str, Any]:
    counts = np.bincount(overlap.ravel(), minlength=5).tolist()
    row = {"body": body, "model": model, "controllers": overlap.size}
    row |= {f"solving_{lights}": count for lights, count in enumerate(counts)}
    row |= {"M_L": float(learnability(overlap)), "M_CF": float(interference(overlap))}
    published = PUBLISHED[body] if model == MODELS[0] else (None,) * 3
    return row | {f"published_{name}": one for name, one in zip(("solving_4", "M_L", "M_CF"), published, strict=True)}


def draw(overlaps: Mapping[tuple[str, str], Overlap], path: Path) -> None:
    """Success matrices, a column a body and a row a model; their numbers beside it as ``.npz``."""
    with figure(path, 2 * COLUMN, 5.6, nrows=len(MODELS), ncols=len(BODIES)) as (drawn, panels):
        for axes, ((body, model), overlap) in zip(panels.flat, overlaps.items(), strict=True):
            image = draw_overlap(axes, overlap)
            caption(axes, f"{body} body, {model}: {np.count_nonzero(overlap == 4)} solve all")
        add_overlap_bar(drawn, image, panels.ravel().tolist())
    save_arrays(path.with_suffix(".npz"), {f"{body}, {model}": found for (body, model), found in overlaps.items()})


STUDY = Study(
    title="all controllers in the canonical and the best body of the two-wheel vehicle, as rigid bodies",
    source="chapter 3, figure of landscapes, empirical model",
    scales={"small": RoverSuccess(RoverGrid(31), Sweep(31)), "full": RoverSuccess()},
    run=study,
    writes=("summary.json", "rover-success.csv", "rover-success.png"),
)
