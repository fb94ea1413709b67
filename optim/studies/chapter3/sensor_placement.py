"""What the places of two light sensors do to a vehicle: metrics, controllers that succeed, and how they move.

Source: dissertation, chapters 3 and 4: distributions and correlation of the metrics, persistent phototaxis. Figures
"histogram" (A and B) of chapter 3 and "neurips_ml_mci_correlation" of chapter 4, each with its numbers beside it.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from optim.experiments.figures import COLOURS, COLUMN, PAGE, figure, note
from optim.experiments.tables import write_table
from optim.measures.statistics import Correlation, pearson
from optim.studies.chapter3.sweep_table import SweepTable
from robots.braitenberg import BASELINE, VehicleBody, VehicleTask, contralateral, simulate, trace, weight_grid
from taichi_sim.base.arrays import Bools, Bytes, Floats, Ints

NEAR = 0.5  # m, half a side of the body: the light remains under it
EVERY = 5  # steps between samples
AT_ONCE = 100  # controllers whose traces fit into memory


def distribution(values: ArrayLike, bins: int = 40, most: float = 0.0) -> tuple[Ints, Floats]:
    """The distribution of a metric over bodies, from 0 to its largest value, or to ``most`` if that is more.

    Returns:
        Bodies in each bin, shape (B,), of which the last has its upper edge, too; and the edges, shape (B + 1,).
    """
    return np.histogram(values, bins, (0.0, max(float(np.max(values)), most) or 1.0))


def correlation_of_metrics(table: SweepTable) -> Correlation:
    """Pearson's correlation of M_L with M_CI over bodies, its p two-sided."""
    return pearson(table.learnability, table.resistance, "two-sided")


def best_bodies(table: SweepTable) -> dict[str, int]:
    """The baseline, if it is there, the best body by M_L and that by M_CI, by these names; of equals the first."""
    best = {f"best {name}": int(table.designs[np.argmax(each)]) for name, each in table.metrics.items()}
    baseline = BASELINE.design if BASELINE.design in table.designs else None
    return best if baseline is None else {"baseline": baseline, **best}


def notable_designs(table: SweepTable) -> dict[int, str]:
    """The bodies of :func:`best_bodies`, each once, with all its names."""
    found: dict[int, str] = {}
    for name, design in best_bodies(table).items():
        found[design] = f"{found[design]}, {name}" if design in found else name
    return found


def solving_controllers(overlap: Bytes, environments: int = 4) -> Floats:
    """Weights (w1, w2) of the controllers of a sweep that solve every environment, shape (C, 2)."""
    return weight_grid(len(overlap))[np.argwhere(overlap == environments)]


def some_solving_controllers(overlap: Bytes, count: int, seed: Sequence[int]) -> Floats:
    """At most so many solving controllers, drawn without replacement, in the order of the sweep, shape (C, 2)."""
    weights = solving_controllers(overlap)
    drawn = np.random.default_rng(seed).permutation(len(weights))[:count]
    return np.asarray(weights[np.sort(drawn)])


def central_controller(overlap: Bytes, environments: int = 4) -> Floats | None:
    """The solving controller with most of its kind around it, shape (2,), the first of equals; None without any.

    It is the farthest from all controllers that fail, those beyond the grid among them.
    """
    from scipy.ndimage import distance_transform_edt  # slow to import

    depth = distance_transform_edt(np.pad(overlap == environments, 1))[1:-1, 1:-1]
    if not depth.any():
        return None
    return weight_grid(len(overlap))[list(np.unravel_index(np.argmax(depth), depth.shape))]


def paths(body: VehicleBody, weights: ArrayLike, task: VehicleTask, every: int = EVERY) -> Floats:
    """Paths of a body with controllers of weights, shape (C, 2): x and y [m], shape (C, E, F, 2)."""
    return trace([body], contralateral(weights)[None], task, every=every).poses[0, ..., :2]


def persistent(body: VehicleBody, weights: ArrayLike, task: VehicleTask, near: float = NEAR) -> Bools:
    """Whether controllers, (C, 2), show persistent phototaxis: having reached the light, they stay by it to the end.

    The centre must stay within ``near`` [m] of the light, by samples every ``EVERY`` steps. Shape (C, E); False where a
    controller never reaches the light.
    """
    values = np.atleast_2d(np.asarray(weights, float))
    arrival = simulate([body], contralateral(values)[None], task).arrival[0]
    found = arrival >= 0
    for first in range(0, len(values), AT_ONCE):
        part = slice(first, first + AT_ONCE)
        distances = np.linalg.norm(paths(body, values[part], task) - task.lights[:, None], axis=-1)
        before = np.arange(distances.shape[-1]) * EVERY < arrival[part, :, None]
        found[part] &= (before | (distances < near)).all(axis=-1)
    return found


MEANINGS = {"M_L": "learnability $M_L$", "M_CI": "resistance to interference $M_{CI}$"}


def save_metrics(table: SweepTable, folder: Path) -> list[str]:
    """Metrics of a sweep and their correlation; the names of the pictures."""
    save_distributions(table, folder / "distributions.png")
    save_correlation(table, notable_designs(table), folder / "correlation.png")
    return ["distributions.png", "correlation.png"]


def save_distributions(table: SweepTable, path: Path) -> None:
    """Histograms of both metrics over the bodies of a sweep; beside them the counts as CSV."""
    rows = []
    with figure(path, PAGE, 2.4, "A", ncols=2, sharey=True) as (_, panels):
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
            axes.scatter(*table.rows([design]).metrics.values(), color=colour, label=as_symbols(name), **diamond)
        axes.set(xlabel=MEANINGS["M_L"], ylabel=MEANINGS["M_CI"])
        axes.legend(loc="lower right")
        if found.r is not None:
            axes.annotate(f"$r = {found.r:.3f}$, {found.n} bodies", (0.03, 0.97), xycoords="axes fraction", va="top")
    table.write(path.with_suffix(".csv"))


def as_symbols(text: str) -> str:
    """A name with its metrics as symbols."""
    return text.replace("M_CI", "$M_{CI}$").replace("M_L", "$M_L$")
