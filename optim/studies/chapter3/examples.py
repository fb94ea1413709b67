"""Examples of a sweep's bodies, the baseline and the best: sensors, paths and success matrices, kept and drawn.

Source: dissertation, chapter 3, figures "best_morphology" and "landscape"; chapter 4, figure "neurips_metrics_results".
Panels have their arrangement, letters and colours.
"""

import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from optim.experiments.allowed import Allowed
from optim.experiments.data import Data
from optim.experiments.figures import COLOURS, PAGE, caption, figure, save_arrays
from optim.experiments.tables import write_table
from optim.measures.overlap import learnability, resistance
from optim.studies.chapter3.sensor_placement import (
    as_symbols,
    best_bodies,
    central_controller,
    paths,
    persistent,
    solving_controllers,
)
from optim.studies.chapter3.sweep_table import SweepTable, overlaps_of
from optim.studies.chapter3.trajectories import check_paths, packed
from robots.braitenberg import DESIGNS, PUBLISHED, VehicleBody
from robots.braitenberg.body import HALF_SIDE
from robots.rover import BEST, Rover
from robots.view.vehicle_charts import (
    CHAPTER_3_COLOURS,
    CHAPTER_4_COLOURS,
    add_overlap_bar,
    draw_overlap,
    draw_paths,
)
from taichi_sim.base import checks
from taichi_sim.base.arrays import Arrays, Bytes, Floats

ENVIRONMENTS = len(PUBLISHED.starts)
SIDE = 4.0  # m, from the light to the sides of a panel of paths
LABEL = 0.1  # m, from the line to a sensor to its name
STEPS_PER_POINT = 2  # of the path that is thinned
KINDS = ("overlap", "weights", "paths", "persistent")  # of a body's arrays
NUMBERS = "examples.npz"


@dataclass(frozen=True, eq=False)
class Example:
    """A body of the published grid, what its controllers do, and how the one that is safest to succeed drives."""

    design: int  # number of the body
    overlap: Bytes  # environments solved by each controller, (n, n)
    weights: Floats  # of the controller that is safest to succeed, (2,); NaN if none does
    paths: NDArray[np.floating]  # of that controller [m], (E, F, 2), thinned; of no points if there is none
    persistent: int  # controllers that reach the light and stay, in all environments

    @property
    def body(self) -> VehicleBody:
        """The body itself."""
        return VehicleBody.published(self.design)

    def arrays(self) -> Arrays:
        """What is kept of it, by names with its number."""
        values: Sequence[NDArray[Any]] = (self.overlap, self.weights, self.paths, np.array(self.persistent))
        return {f"{kind}_{self.design}": value for kind, value in zip(KINDS, values, strict=True)}


def examples_of(table: SweepTable, sweep: Path) -> dict[int, Example]:
    """The baseline and the best bodies of a sweep's folder, by number."""
    designs = list(dict.fromkeys(best_bodies(table).values()))
    overlaps = overlaps_of([VehicleBody.published(design) for design in designs], table.settings, sweep)
    return {design: _example(design, table, overlap) for design, overlap in zip(designs, overlaps, strict=True)}


def _example(design: int, table: SweepTable, overlap: Bytes) -> Example:
    body, task = VehicleBody.published(design), table.settings.task
    weights, solving = central_controller(overlap), solving_controllers(overlap)
    if weights is None:
        return Example(design, overlap, np.full(2, np.nan), np.zeros((ENVIRONMENTS, 0, 2), np.float32), 0)
    places = packed(paths(body, weights[None], task, STEPS_PER_POINT)[0])
    return Example(design, overlap, weights, places, int(persistent(body, solving, task).all(axis=1).sum()))


def read_examples(data: Data, file: str, table: SweepTable) -> dict[int, Example]:
    """Read what :func:`examples_of` found of a table's bodies; raises ValueError if it is anything else."""
    designs = list(dict.fromkeys(best_bodies(table).values()))
    arrays = data.arrays(file, _names(designs))
    try:
        return {design: _checked(design, table, arrays) for design in designs}
    except ValueError as error:
        raise ValueError(f"{data.folder / file}: {error}") from None


def has_examples(data: Data, file: str, table: SweepTable) -> bool:
    """Whether a folder has examples of a table's bodies; others, as of earlier versions, are named in a warning.

    Raises:
        ValueError: if the file cannot be read.
    """
    if not data.has(file):
        return False
    missing = set(_names(best_bodies(table).values())) - set(data.array_names(file))
    if missing:
        reason = f"it has no array {min(missing)!r} of the table's best bodies"
        warnings.warn(f"{data.folder / file}: {reason}; figures of examples are left out", stacklevel=2)
    return not missing


def _names(designs: Iterable[int]) -> list[str]:
    """What the arrays of bodies are called."""
    return [f"{kind}_{design}" for design in designs for kind in KINDS]


def _checked(design: int, table: SweepTable, arrays: Arrays) -> Example:
    """The example of a body whose arrays are what they must be, and have the counts of the table."""
    names = [f"{kind}_{design}" for kind in KINDS]
    overlap, weights, places, stays = (arrays[name] for name in names)
    count, row = table.settings.weights, table.rows([design])
    if overlap.dtype != np.uint8 or overlap.shape != (count, count) or overlap.max() > ENVIRONMENTS:
        raise ValueError(f"{names[0]}: give {count} x {count} bytes up to {ENVIRONMENTS}")
    found = np.count_nonzero(overlap == ENVIRONMENTS), np.count_nonzero(overlap)
    if found != (row.solving_all[0], row.solving_any[0]):
        raise ValueError(
            f"{names[0]}: {found[0]} controllers solve all, {found[1]} any; the table has {row.solving_all[0]} and "
            f"{row.solving_any[0]}"
        )
    if found[0]:
        Allowed((2,), -1.0, 1.0).check(names[1], weights)
        check_paths(names[2], places, (ENVIRONMENTS,))
    else:
        Allowed((ENVIRONMENTS, 0, 2)).check(names[2], places)
        if weights.shape != (2,) or not np.isnan(weights).all():
            raise ValueError(f"{names[1]}: give two NaN, as no controller solves all")
    if stays.shape:
        raise ValueError(f"{names[3]}: shape {stays.shape} is not allowed; give one number")
    return Example(design, overlap, weights, places, checks.integer(names[3], stays.item(), 0, int(found[0])))


def save_figures_of_examples(found: Mapping[int, Example], table: SweepTable, folder: Path) -> list[str]:
    """Sensors, success matrices, and both with paths; the names of the pictures. Beside them arrays and a table.

    The arrays are what :func:`read_examples` reads. The table has how many controllers solve all environments, and how
    many of these show persistent phototaxis in all of them.
    """
    bodies = {name: found[design] for name, design in best_bodies(table).items()}
    best = {name: example for name, example in bodies.items() if name != "baseline"}
    sketches = {f"theory, {chapter_3_name(name)}": example.body for name, example in best.items()}
    if len(table.designs) == DESIGNS:  # beside the best of all, the published best rigid body
        sketches["rigid bodies, best of both"] = Rover(BEST).vehicle
    save_sketches(sketches, folder / "bodies.png")
    matrices = {f"{chapter_3_name(name)}, design {each.design}": each.overlap for name, each in bodies.items()}
    save_landscape(matrices, folder / "landscape.png")
    save_examples(bodies, np.unique(table.settings.task.lights, axis=0), folder / "examples.png")
    save_arrays(folder / NUMBERS, {name: array for each in found.values() for name, array in each.arrays().items()})
    header = ("design", "name", "l1x", "l1y", "l2x", "l2y", "all", "persistent")
    write_table(folder / "examples.csv", header, [_row(name, each) for name, each in bodies.items()])
    return ["bodies.png", "landscape.png", "examples.png"]


def _row(name: str, each: Example) -> tuple[Any, ...]:
    solving = int(np.count_nonzero(each.overlap == ENVIRONMENTS))
    return each.design, name, *np.ravel(each.body.sensors).tolist(), solving, each.persistent


def save_examples(bodies: Mapping[str, Example], lights: Floats, path: Path) -> None:
    """Draw a row for each body: its sensors, the paths of the controller that is safest to succeed, its success matrix.

    All paths have one scale, and leave the panel where they leave that part of the world.
    """
    with figure(path, PAGE, 2.35 * len(bodies), "", nrows=len(bodies), ncols=3) as (drawn, panels):
        for number, (row, (name, example)) in enumerate(zip(panels, bodies.items(), strict=True)):
            draw_body(row[0], example.body)
            row[0].set_title(chr(ord("A") + number), loc="left", fontweight="bold")
            caption(row[0], f"design {example.design}, {as_symbols(name)}")
            _draw_drive(row[1], example, lights)
            image = draw_overlap(row[2], example.overlap, _cross(example), CHAPTER_4_COLOURS)
            metrics = learnability(example.overlap), resistance(example.overlap)
            caption(row[2], "$M_L = {:.4f}$, $M_{{CI}} = {:.4f}$".format(*map(float, metrics)))
        add_overlap_bar(drawn, image, panels[:, 2].tolist())


def _cross(example: Example) -> Floats | None:
    """The controller whose paths are shown, if there is one."""
    return example.weights if np.isfinite(example.weights).all() else None


def _draw_drive(axes: Any, example: Example, lights: Floats) -> None:
    """Paths of the controller that is safest to succeed, or words instead."""
    if _cross(example) is None:
        axes.axis("off")
        axes.annotate("no controller solves all", (0.5, 0.5), xycoords="axes fraction", ha="center")
        return
    draw_paths(axes, example.paths, lights, SIDE)
    caption(axes, "$w_1 = {:.2f}$, $w_2 = {:.2f}$".format(*example.weights))


def save_landscape(overlaps: Mapping[str, Bytes], path: Path, first: str = "A") -> None:
    """Success matrices side by side, by their names, in the colours of chapter 3; letters begin with the first one."""
    with figure(path, PAGE, 2.5, first, ncols=len(overlaps), sharey=True) as (drawn, panels):
        for axes, (name, overlap) in zip(panels[0], overlaps.items(), strict=True):
            image = draw_overlap(axes, overlap, colours=CHAPTER_3_COLOURS)
            solving = np.count_nonzero(overlap == ENVIRONMENTS)
            caption(axes, f"{name}\n{solving} of {overlap.size} solve all")
            axes.set_ylabel("")
        panels[0, 0].set_ylabel("$w_2$")
        add_overlap_bar(drawn, image, panels.ravel().tolist())


def save_sketches(bodies: Mapping[str, VehicleBody], path: Path) -> None:
    """Draw the places of bodies' sensors side by side, by their names."""
    with figure(path, PAGE, 2.6, "A", ncols=len(bodies), sharey=True) as (_, panels):
        for axes, (name, body) in zip(panels[0], bodies.items(), strict=True):
            draw_body(axes, body)
            caption(axes, f"{name}: {body.design}")
            axes.set_ylabel("")
        panels[0, 0].set_ylabel("to the left [m]")


def draw_body(axes: Any, body: VehicleBody) -> None:
    """Draw the places of a body's sensors, seen from above; it drives to the right."""
    corners = HALF_SIDE * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]])
    axes.plot(*corners.T, color="black", linewidth=0.8)
    axes.annotate("", (1.5 * HALF_SIDE, 0), (0, 0), arrowprops={"arrowstyle": "->", "color": "grey"})
    places: dict[tuple[float, float], list[str]] = {}
    for number, place in enumerate(body.sensors, 1):
        places.setdefault(place, []).append(rf"$\ell_{number}$")
    for (x, y), names in places.items():
        axes.annotate("", (x, y), (0, 0), arrowprops={"arrowstyle": "-", "color": COLOURS[1], "linewidth": 0.8})
        axes.plot(x, y, "o", color=COLOURS[1], markersize=5, clip_on=False)
        beside = np.array([x, y]) * 0.75 + LABEL * np.array([-y, x]) / max(np.hypot(x, y), LABEL)
        axes.annotate(", ".join(names), (x, y), tuple(beside), va="center", ha="center")
    limits, ticks = (-1.6 * HALF_SIDE, 1.6 * HALF_SIDE), (-HALF_SIDE, 0, HALF_SIDE)
    axes.set(aspect="equal", xlim=limits, ylim=limits, xticks=ticks, yticks=ticks)
    axes.set(xlabel="ahead [m]", ylabel="to the left [m]")


def chapter_3_name(text: str) -> str:
    """The name of a body as chapter 3 has it, which calls the baseline canonical, and M_CI M_CF."""
    return text.replace("baseline", "canonical body").replace("M_CI", "$M_{CF}$").replace("M_L", "$M_L$")
