"""Pictures of what the places of sensors do, each with its numbers beside it.

Source: dissertation, chapter 3, figures "histogram" and "landscape"; chapter 4, figures "neurips_metrics_results" and
"neurips_ml_mci_correlation".
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from optim.experiments.figures import COLOURS, COLUMN, PAGE, caption, figure, letter, note, save_arrays
from optim.experiments.tables import write_table
from optim.studies.chapter3.sensor_placement import (
    central_controller,
    correlation_of_metrics,
    distribution,
    notable_designs,
    paths,
    persistent,
    solving_controllers,
)
from optim.studies.chapter3.sweep_table import SweepTable, overlaps_of
from robots.braitenberg import VehicleBody, VehicleTask
from robots.braitenberg.body import HALF_SIDE
from robots.view.vehicle_charts import add_overlap_bar, draw_overlap, draw_paths
from taichi_sim.base.arrays import Arrays, Bytes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MEANINGS = {"M_L": "learnability $M_L$", "M_CI": "resistance to interference $M_{CI}$"}
STEPS_PER_POINT = 2


def save_figures(table: SweepTable, sweep: Path, folder: Path) -> list[str]:
    """Metrics, their correlation, and the most notable bodies of a sweep's folder; the names of the pictures."""
    notable = notable_designs(table)
    save_distributions(table, folder / "distributions.png")
    save_correlation(table, notable, folder / "correlation.png")
    save_examples(examples(table, notable, sweep), folder / "examples.png")
    return ["distributions.png", "correlation.png", "examples.png"]


def save_distributions(table: SweepTable, path: Path) -> None:
    """Histograms of both metrics over the bodies of a sweep; beside them the counts as CSV."""
    found = {name: distribution(values) for name, values in table.metrics.items()}
    with figure(path, PAGE, 2.4, ncols=2, sharey=True) as (_, panels):
        for axes, (name, one) in zip(panels.flat, found.items(), strict=True):
            axes.stairs(one.counts, one.edges, fill=True, color=COLOURS[0])
            axes.set(xlabel=MEANINGS[name], yscale="log", ylim=(0.7, 1.5 * one.counts.max()))
            note(axes, f"{one.zeros} of {one.counts.sum()} bodies at 0", 0.93)
        panels[0, 0].set_ylabel("bodies")
        letter(panels)
    rows = [
        (name, *each)
        for name, one in found.items()
        for each in zip(one.edges[:-1].tolist(), one.edges[1:].tolist(), one.counts.tolist(), strict=True)
    ]
    write_table(path.with_suffix(".csv"), ("metric", "from", "to", "bodies"), rows)


def save_correlation(table: SweepTable, notable: Mapping[int, str], path: Path) -> None:
    """Every body by both metrics, some with their names; beside it the table of the sweep as CSV."""
    found = correlation_of_metrics(table)
    with figure(path, COLUMN, 2.8) as (_, panels):
        axes, every = panels[0, 0], table.metrics.values()
        axes.scatter(*every, s=3, color=COLOURS[0], alpha=0.25, linewidths=0, rasterized=True)
        diamond: Any = {"s": 22, "marker": "D", "edgecolors": "black", "linewidths": 0.5, "zorder": 3}
        for (design, name), colour in zip(notable.items(), COLOURS[1:], strict=False):
            axes.scatter(*table.rows([design]).metrics.values(), color=colour, label=_named(name), **diamond)
        axes.set(xlabel=MEANINGS["M_L"], ylabel=MEANINGS["M_CI"])
        axes.legend(loc="lower right")
        if found.r is not None:
            axes.annotate(f"$r = {found.r:.3f}$, {found.n} bodies", (0.03, 0.97), xycoords="axes fraction", va="top")
    table.write(path.with_suffix(".csv"))


@dataclass(frozen=True, eq=False)
class Example:
    """A body to be shown.

    Attributes:
        name: what it is.
        body: where its sensors are.
        overlap: environments that each controller solves, shape (n, n).
        task: environments and time of its traces.
    """

    name: str
    body: VehicleBody
    overlap: Bytes
    task: VehicleTask


def examples(table: SweepTable, designs: Mapping[int, str], folder: Path) -> dict[int, Example]:
    """Bodies of a sweep in a folder, by number and with what they are."""
    bodies = [VehicleBody.published(design) for design in designs]
    each = zip(designs.values(), bodies, overlaps_of(bodies, table.settings, folder), strict=True)
    examples = (Example(*one, table.settings.task) for one in each)
    return dict(zip(designs, examples, strict=True))


def save_examples(examples: Mapping[int, Example], path: Path) -> None:
    """A row for each body: its sensors, the paths of the controller that is safest to succeed, its success matrix.

    Matrices, weights and paths are written beside it, by the numbers of the bodies, and as CSV how many controllers
    solve all environments, and how many of these show persistent phototaxis in all of them.
    """
    arrays: Arrays = {}
    with figure(path, PAGE, 2.3 * len(examples), nrows=len(examples), ncols=3) as (drawn, panels):
        for (design, example), row in zip(examples.items(), panels, strict=True):
            weights = central_controller(example.overlap)
            _draw_body(row[0], example, design)
            arrays[f"overlap_{design}"] = example.overlap
            if weights is not None:
                places = paths(example.body, weights[None], example.task, STEPS_PER_POINT)[0]
                arrays |= {f"weights_{design}": weights, f"paths_{design}": places}
                draw_paths(row[1], places, np.unique(example.task.lights, axis=0))
                caption(row[1], "$w_1 = {:.2f}$, $w_2 = {:.2f}$".format(*weights))
            else:
                row[1].axis("off")
                row[1].annotate("no controller solves all", (0.5, 0.5), xycoords="axes fraction", ha="center")
            image = draw_overlap(row[2], example.overlap, weights)
        add_overlap_bar(drawn, image, panels[:, 2].tolist())
        letter(panels)
    save_arrays(path.with_suffix(".npz"), arrays)
    header = ("design", "name", "l1x", "l1y", "l2x", "l2y", "all", "persistent")
    write_table(path.with_suffix(".csv"), header, (_row(*item) for item in examples.items()))


def _row(design: int, example: Example) -> tuple[Any, ...]:
    weights = solving_controllers(example.overlap)
    stays = persistent(example.body, weights, example.task) if len(weights) else np.zeros((0, 1), bool)
    sites = np.ravel(example.body.sensors).tolist()
    return design, example.name, *sites, len(weights), int(stays.all(axis=1).sum())


def _draw_body(axes: "Axes", example: Example, design: int) -> None:
    """Seen from above, driving to the right."""
    corners = HALF_SIDE * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]])
    axes.plot(*corners.T, color="black", linewidth=0.8)
    axes.annotate("", (1.5 * HALF_SIDE, 0), (0, 0), arrowprops={"arrowstyle": "->", "color": "grey"})
    places: dict[tuple[float, float], list[str]] = {}
    for number, place in enumerate(example.body.sensors, 1):
        places.setdefault(place, []).append(rf"$\ell_{number}$")
    for (x, y), names in places.items():
        axes.plot(x, y, "o", color=COLOURS[1], markersize=5, clip_on=False)
        axes.annotate(", ".join(names), (x, y), (0.75 * x - 0.04, 0.75 * y), va="center", ha="center")
    limits, ticks = (-1.6 * HALF_SIDE, 1.6 * HALF_SIDE), (-HALF_SIDE, 0, HALF_SIDE)
    axes.set(aspect="equal", xlim=limits, ylim=limits, xticks=ticks, yticks=ticks)
    axes.set(xlabel="ahead [m]", ylabel="to the left [m]")
    caption(axes, f"design {design}\n{_named(example.name)}")


def _named(text: str) -> str:
    """A name with its metrics as symbols."""
    return text.replace("M_CI", "$M_{CI}$").replace("M_L", "$M_L$")
