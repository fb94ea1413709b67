"""Plots of Pareto fronts with two or three objectives, and of elites."""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from optim.experiments.figures import COLOURS
from optim.measures.pareto import non_dominated
from optim.plots.curves import drawable
from optim.search.method import Grid

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def draw_front(axes: "Axes", objectives: ArrayLike, names: "Sequence[str]", *, best: int | None = None) -> Any:
    """Draw designs by two objectives to be maximised, or by three, with the third as colour; ``best`` is marked.

    Dominated designs are small and pale. Through the front of two objectives goes the staircase that bounds what it
    dominates. Objectives have shape (N, K), K = 2 or 3; rows with NaN are left out. Returns the drawn points, for
    :func:`add_bar`, with three objectives, None with two. Raises ValueError for other numbers of objectives, and no
    designs.
    """
    values = np.asarray(objectives, float)
    if values.ndim != 2 or values.shape[1] not in (2, 3) or len(names) != values.shape[1]:
        given = f"shape {values.shape} with {len(names)} names"
        raise ValueError(f"objectives: {given} is not allowed; give 2 or 3 of each")
    front = non_dominated(values)
    if not front.any():
        raise ValueError("objectives: no design has succeeded; give at least one that did")
    values = drawable(axes, values)
    axes.scatter(values[~front, 0], values[~front, 1], s=6, color="0.7", linewidths=0)
    shown = None
    if values.shape[1] == 2:
        stairs = values[front][np.argsort(values[front, 0])]
        axes.step(*stairs.T, where="pre", color=COLOURS[0], linewidth=0.8, alpha=0.6)
        draw_points(axes, *stairs.T, colour=COLOURS[0])
    else:
        shown = axes.scatter(values[front, 0], values[front, 1], c=values[front, 2], s=18, cmap="viridis", linewidths=0)
    if best is not None:
        ring: Any = {"color": COLOURS[1], "markersize": 8, "fillstyle": "none", "markeredgewidth": 1.4}
        axes.plot(*values[best, :2], "o", label="best mean", **ring)
    axes.set(xlabel=names[0], ylabel=names[1])
    return shown


def add_bar(figure: "Figure", axes: "Axes", shown: Any, name: str) -> None:
    """Add a colour bar of the third objective beside a front."""
    figure.colorbar(shown, ax=axes, label=name, fraction=0.05, aspect=30)


def draw_points(
    axes: "Axes", x: ArrayLike, y: ArrayLike, filled: ArrayLike | None = None, *, colour: str, label: str = ""
) -> None:
    """Draw designs at places of shape (N,) as circles; those that are not ``filled``, shape (N,), are hollow."""
    x, y = np.asarray(x), np.asarray(y)
    full = np.ones(len(x), bool) if filled is None else np.asarray(filled, bool)
    axes.plot(x, y, "o", color=colour, markersize=3, fillstyle="none", markeredgewidth=0.6, label=label or None)
    axes.plot(x[full], y[full], "o", color=colour, markersize=3)


def draw_elites(axes: "Axes", grid: Grid, scores: ArrayLike) -> Any:
    """Draw a map of elites, the best designs of many kinds, coloured by their scores; see :func:`add_bar`.

    Args:
        axes: to draw on.
        grid: its cells, along one or two descriptors; of more, cells show their best elite along the first two.
        scores: of the elites, shape (C,).
    """
    names, ends = list(grid.axes)[:2], list(grid.axes.values())[:2]
    best = np.full((grid.bins, grid.bins if len(names) == 2 else 1), np.nan)
    places = grid.places[:, :2] if len(names) == 2 else np.column_stack([grid.places, np.zeros(len(grid.cells), int)])
    np.fmax.at(best, tuple(places.T), np.asarray(scores, float))
    edges = [np.linspace(*each, grid.bins + 1) for each in ends] + [np.array([0.0, 1.0])] * (2 - len(names))
    axes.set(xlabel=names[0].replace("_", " "), facecolor="0.93")
    if len(names) == 2:
        axes.set_ylabel(names[1].replace("_", " "))
    else:
        axes.set_yticks([])
    return axes.pcolormesh(*edges, drawable(axes, best.T), rasterized=True)
