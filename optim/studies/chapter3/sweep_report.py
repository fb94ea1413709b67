"""What a report tells of a sweep's folder: bodies by their metrics, success matrices of the most notable."""

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.study import StudyReport, StudySection
from optim.studies.chapter3.sensor_placement import notable_designs
from optim.studies.chapter3.sweep_table import overlaps_of, read_sweep_table
from robots.braitenberg import VehicleBody
from robots.view.vehicle_charts import add_overlap_bar, draw_overlap
from taichi_sim.base.arrays import Bytes

MOST_BODIES, MOST_MATRICES = 30, 6


def report(folder: Path) -> StudyReport:
    """What a report tells of a sweep.

    Raises:
        ValueError: for a sweep without bodies.
    """
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
        charts[words] = _matrix(overlap)
    labels = [f"design {design}" for design in best.designs]
    columns = (best.solving_all, best.solving_any, best.learnability, best.interference)
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


def _matrix(overlap: Bytes) -> Callable[[Any], None]:
    """Draws a success matrix with its colours beside it."""

    def draw(axes: Any) -> None:
        add_overlap_bar(axes.figure, draw_overlap(axes, overlap), [axes])

    return draw
