"""Charts of vehicles: which controllers succeed in a body, and the paths they drive."""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from robots.view.scene import CHART_COLOURS
from taichi_sim.base.arrays import Bytes, Floats

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# From pale (none) over yellow and brown to dark blue (all), so that the order is visible in black and white.
OVERLAP_COLOURS = ("#f2f2f2", "#fee391", "#fe9929", "#b84a0c", "#08306b")
# Colours of the dissertation, as far as it names them: chapter 3 none blue, all cyan; chapter 4 none red, all blue.
CHAPTER_3_COLOURS = ("#1f3fa8", "#7a4fb5", "#d9568b", "#f7b23c", "#3df5ff")
CHAPTER_4_COLOURS = ("#d7191c", "#fdae61", "#ffffbf", "#abd9e9", "#2c7bb6")


def draw_overlap(
    axes: "Axes", overlap: Bytes, weights: Floats | None = None, colours: "Sequence[str]" = OVERLAP_COLOURS
) -> Any:
    """Draw the number of environments that each controller solves, with one colour for each number from 0.

    Weight w1 goes to the right and w2 upwards; ``weights``, if given, is a controller marked by a cross.
    """
    from matplotlib.colors import ListedColormap

    outer = 1 + 1 / (len(overlap) - 1)  # cells are centred on their weights
    image = axes.imshow(
        overlap.T,
        origin="lower",
        extent=(-outer, outer, -outer, outer),
        interpolation="nearest",
        cmap=ListedColormap(colours),
        vmin=-0.5,
        vmax=len(colours) - 0.5,
    )
    if weights is not None:
        cross = CHART_COLOURS[4] if colours is OVERLAP_COLOURS else "black"
        axes.plot(*weights, "+", color=cross, markersize=6, markeredgewidth=1.2)
    axes.set(xlabel="$w_1$", ylabel="$w_2$")
    return image


def add_overlap_bar(drawn: "Figure", image: Any, axes: "Sequence[Axes]") -> None:
    """Add a colour bar of the success matrices beside their axes."""
    bar = drawn.colorbar(image, ax=axes, ticks=range(len(OVERLAP_COLOURS)), aspect=40)
    bar.set_label("environments solved")


def draw_paths(axes: "Axes", places: ArrayLike, lights: ArrayLike, reach: float | None = None) -> None:
    """Draw paths seen from above, each starting at a dot, and lights as stars.

    Args:
        axes: axes to draw on.
        places: positions of P vehicles at T times [m], shape (P, T, 2); NaN after their ends.
        lights: positions of the lights [m], shape (L, 2).
        reach: distance from the origin to the sides of the panel [m]; by default large enough for all paths.
    """
    places = np.asarray(places, float)
    for number, path in enumerate(places):
        colour = CHART_COLOURS[number % len(CHART_COLOURS)]
        axes.plot(*path.T, color=colour, linewidth=0.8)
        axes.plot(*path[0], "o", color=colour, markersize=3)
    for light in np.asarray(lights, float):
        axes.plot(
            *light, "*", color=CHART_COLOURS[6], markeredgecolor="black", markeredgewidth=0.5, markersize=9, zorder=4
        )
    reach = 1.1 * float(np.nanmax(np.abs(places))) if reach is None else reach
    axes.set(aspect="equal", xlim=(-reach, reach), ylim=(-reach, reach), xlabel="x [m]", ylabel="y [m]")
