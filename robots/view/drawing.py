"""Polygons, paths, scale bars and levels over time on matplotlib axes."""

from typing import TYPE_CHECKING, Literal

import numpy as np
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from matplotlib.patheffects import withStroke

from robots.view.scene import GROUND, INK, PAPER, SHADOW, Camera, Polygons
from robots.view.uneven import Pieces
from taichi_sim.base.arrays import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SCALE_BARS = np.array([0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0])  # [m]
NO_SHIFT = np.zeros(2)
SIDE, END = 0.88 * np.array(GROUND), 0.8 * np.array(GROUND)  # cut sides of uneven ground: the near one, the right one
RIDGE = 0.75 * np.array(GROUND)
SHADE = 0.12  # opacity of a shadow on uneven ground, which has several colours


def draw_polygons(
    axes: "Axes", robot: Polygons, shift: Floats = NO_SHIFT, zorder: float = 1.0, outlined: bool = True
) -> None:
    """Draw a robot and its shadow, shifted by ``shift`` on paper [m]; ``outlined`` draws the edges of its faces."""
    shadow = PolyCollection(list(robot.shadow + shift), facecolors=[SHADOW], edgecolors="none")
    faces = PolyCollection(
        list(robot.corners + shift),
        facecolors=robot.colours,
        edgecolors=0.82 * robot.colours if outlined else robot.colours,
        linewidths=0.25,
    )
    if robot.uneven and len(robot.shadow):
        # One path, because overlapping transparent faces would be darker.
        outline = Path.make_compound_path(*map(Path, robot.shadow + shift))
        axes.add_patch(PathPatch(outline, facecolor=INK, alpha=SHADE, edgecolor="none", zorder=zorder))
    for collection in (faces,) if robot.uneven else (shadow, faces):
        collection.set_zorder(zorder)
        axes.add_collection(collection)


def draw_uneven(axes: "Axes", ground: Pieces, camera: Camera, shift: Floats, zorder: float) -> None:
    """Draw uneven ground with its cut sides, shifted by ``shift`` on paper [m]."""
    flat = camera.project(ground.quads) + shift
    shown = PolyCollection(list(flat), facecolors=ground.colours, edgecolors=ground.colours, linewidths=0.5)
    shown.set_zorder(zorder)
    axes.add_collection(shown)
    ridges = list(camera.project(ground.lines) + shift)
    axes.add_collection(LineCollection(ridges, colors=[RIDGE], linewidths=0.6, zorder=zorder))
    for edge, colour in ((ground.end, END), (ground.profile, SIDE)):
        below = edge * [1.0, 1.0, 0.0] + [0.0, 0.0, ground.base]
        outline = camera.project(np.concatenate([edge, below[::-1]])) + shift
        axes.add_collection(PolyCollection([outline], facecolors=[colour], edgecolors="none", zorder=zorder))
    near = camera.project(ground.profile) + shift
    axes.add_collection(LineCollection([near], colors=[INK], linewidths=0.9, zorder=zorder))


def draw_path(axes: "Axes", path: Floats, zorder: float) -> None:
    """Draw the path of a robot's middle on paper [m], shape (F, 2), with a dot at its end."""
    halo = [withStroke(linewidth=2.4, foreground="white", alpha=0.9)]
    axes.plot(*path.T, color=INK, lw=1.0, zorder=zorder, path_effects=halo, solid_capstyle="round")
    axes.plot(*path[-1], "o", color=INK, ms=3.2, mec="white", mew=0.7, zorder=1000.0)


def draw_scale_bar(axes: "Axes", edge: Floats) -> float:
    """Draw a scale bar at the right end of a line on paper, shape (2, 2) [m], and return its lowest y."""
    stretch = float(np.hypot(*(edge[1] - edge[0])))
    bar = SCALE_BARS[max(int(np.searchsorted(SCALE_BARS, stretch / 4)) - 1, 0)]
    ends = edge[1] + np.array([[bar], [0.0]]) * (edge[0] - edge[1]) / stretch
    axes.plot(*ends.T, color=INK, lw=2.2, solid_capstyle="butt")
    lowest = float(ends[:, 1].min())
    write_below(axes, f"{100 * bar:.0f} cm" if bar < 1 else f"{bar:.0f} m", (float(ends[:, 0].mean()), lowest))
    return lowest


def write_below(axes: "Axes", text: str, place: tuple[float, float], centred: bool = True) -> None:
    """Write a text below a place on paper [m], centred on it or with its left end there."""
    side: Literal["center", "left"] = "center" if centred else "left"
    axes.annotate(text, place, (0, -3), textcoords="offset points", ha=side, va="top", fontsize=8, color=INK)


def draw_levels(axes: "Axes", levels: Floats, edges: Floats, colours: Floats, names: list[str], apart: int = 0) -> None:
    """Draw levels over time as rows of bars; a level from 0 to 1 fills that part of its row's height.

    Args:
        axes: to draw on.
        levels: from 0 to 1, shape (N, K).
        edges: times at which the levels begin and end, shape (K + 1,).
        colours: colours of the rows, shape (N, 3).
        names: names of the rows.
        apart: number of the row above which there is a gap; 0 for no gap.
    """
    tops = np.arange(len(levels)) + 0.35 * ((np.arange(len(levels)) >= apart) & (apart > 0))
    empty, filled = np.argwhere(levels < 1), np.argwhere(levels > 0)
    row, column = np.concatenate([empty, filled]).T
    height = np.append(np.ones(len(empty)), levels[levels > 0])
    left, right, bottom = edges[column], edges[column + 1], tops[row] + 0.94
    top = bottom - 0.88 * height
    cells = np.stack([[left, top], [right, top], [right, bottom], [left, bottom]]).transpose(2, 0, 1)
    shades = np.concatenate([np.tile(GROUND, (len(empty), 1)), colours[filled[:, 0]]])
    axes.add_collection(PolyCollection(list(cells), facecolors=shades, edgecolors=[PAPER], linewidths=0.6))
    axes.set_xlim(edges[0], edges[-1])
    axes.set_ylim(tops[-1] + 1.0, 0.0)
    label_rows(axes, tops + 0.5, names)


def label_rows(axes: "Axes", places: Floats, names: list[str]) -> None:
    """Write the names of rows at their left, and hide the frame of the axes."""
    axes.set_yticks(places, names)
    axes.tick_params(length=0, labelsize=7, labelcolor=INK)
    axes.spines[:].set_visible(False)
