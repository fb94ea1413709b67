"""Pictures of what the places of sensors do, each with its numbers beside it.

Source: dissertation, chapter 3, figures "histogram" and "landscape"; chapter 4, figures "neurips_metrics_results" and
"neurips_ml_mci_correlation".
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.figures import COLOURS, COLUMN, PAGE, caption, figure, note, save_arrays
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
from robots.braitenberg import VehicleBody
from robots.braitenberg.body import HALF_SIDE
from robots.view.vehicle_charts import add_overlap_bar, draw_overlap, draw_paths
from taichi_sim.base.arrays import Arrays

MEANINGS = {"M_L": "learnability $M_L$", "M_CI": "resistance to interference $M_{CI}$"}
STEPS_PER_POINT = 2


def save_figures(table: SweepTable, sweep: Path, folder: Path) -> list[str]:
    """Metrics, their correlation, and the most notable bodies of a sweep's folder; the names of the pictures."""
    notable, names = notable_designs(table), ["distributions.png", "correlation.png", "examples.png"]
    distributions, correlation, examples = (folder / name for name in names)
    save_distributions(table, distributions)
    save_correlation(table, notable, correlation)
    save_examples(table, notable, sweep, examples)
    return names


def save_distributions(table: SweepTable, path: Path) -> None:
    """Histograms of both metrics over the bodies of a sweep; beside them the counts as CSV."""
    rows = []
    with figure(path, PAGE, 2.4, ncols=2, sharey=True) as (_, panels):
        for axes, (name, values) in zip(panels.flat, table.metrics.items(), strict=True):
            counts, edges = distribution(values)
            axes.stairs(counts, edges, fill=True, color=COLOURS[0])
            axes.set(xlabel=MEANINGS[name], yscale="log", ylim=(0.7, 1.5 * counts.max()))
            note(axes, f"{np.count_nonzero(values == 0)} of {len(values)} bodies at 0", 0.93)
            bins = zip(edges[:-1].tolist(), edges[1:].tolist(), counts.tolist(), strict=True)
            rows += [(name, *each) for each in bins]
        panels[0, 0].set_ylabel("bodies")
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


def save_examples(table: SweepTable, designs: Mapping[int, str], sweep: Path, path: Path) -> None:
    """A row for each body: its sensors, the paths of the controller that is safest to succeed, its success matrix.

    Matrices, weights and paths are written beside it, by the numbers of the bodies, and as CSV how many controllers
    solve all environments, and how many of these show persistent phototaxis in all of them.
    """
    task, bodies = table.settings.task, [VehicleBody.published(design) for design in designs]
    overlaps = overlaps_of(bodies, table.settings, sweep)
    arrays: Arrays = {}
    rows = []
    with figure(path, PAGE, 2.3 * len(designs), nrows=len(designs), ncols=3) as (drawn, panels):
        for row, (design, name), body, overlap in zip(panels, designs.items(), bodies, overlaps, strict=True):
            arrays[f"overlap_{design}"], weights = overlap, central_controller(overlap)
            _draw_body(row[0], body)
            caption(row[0], f"design {design}\n{_named(name)}")
            if weights is not None:
                places = paths(body, weights[None], task, STEPS_PER_POINT)[0]
                arrays |= {f"weights_{design}": weights, f"paths_{design}": places}
                draw_paths(row[1], places, np.unique(task.lights, axis=0))
                caption(row[1], "$w_1 = {:.2f}$, $w_2 = {:.2f}$".format(*weights))
            else:
                row[1].axis("off")
                row[1].annotate("no controller solves all", (0.5, 0.5), xycoords="axes fraction", ha="center")
            image = draw_overlap(row[2], overlap, weights)
            solving = solving_controllers(overlap)
            stays = int(persistent(body, solving, task).all(axis=1).sum()) if len(solving) else 0
            rows.append((design, name, *np.ravel(body.sensors).tolist(), len(solving), stays))
        add_overlap_bar(drawn, image, panels[:, 2].tolist())
    save_arrays(path.with_suffix(".npz"), arrays)
    header = ("design", "name", "l1x", "l1y", "l2x", "l2y", "all", "persistent")
    write_table(path.with_suffix(".csv"), header, rows)


def _draw_body(axes: Any, body: VehicleBody) -> None:
    """Seen from above, driving to the right."""
    corners = HALF_SIDE * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]])
    axes.plot(*corners.T, color="black", linewidth=0.8)
    axes.annotate("", (1.5 * HALF_SIDE, 0), (0, 0), arrowprops={"arrowstyle": "->", "color": "grey"})
    places: dict[tuple[float, float], list[str]] = {}
    for number, place in enumerate(body.sensors, 1):
        places.setdefault(place, []).append(rf"$\ell_{number}$")
    for (x, y), names in places.items():
        axes.plot(x, y, "o", color=COLOURS[1], markersize=5, clip_on=False)
        axes.annotate(", ".join(names), (x, y), (0.75 * x - 0.04, 0.75 * y), va="center", ha="center")
    limits, ticks = (-1.6 * HALF_SIDE, 1.6 * HALF_SIDE), (-HALF_SIDE, 0, HALF_SIDE)
    axes.set(aspect="equal", xlim=limits, ylim=limits, xticks=ticks, yticks=ticks)
    axes.set(xlabel="ahead [m]", ylabel="to the left [m]")


def _named(text: str) -> str:
    """A name with its metrics as symbols."""
    return text.replace("M_CI", "$M_{CI}$").replace("M_L", "$M_L$")
