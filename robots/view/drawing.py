"""Poses, grounds and gait charts on matplotlib axes."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike

from robots.inflatable.schedule import GaitSchedule
from robots.view.scene import BLADDERS, FEET, GROUND, GROUND_LINE, INK, PAPER, SHADOW, Camera, Polygons
from taichi_sim.base.arrays import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LINES = 0.05  # between the lines on the ground [m]
NO_SHIFT = np.zeros(2)


@dataclass(frozen=True, eq=False)
class Stretch:
    """A rectangle of ground, and the camera that looks at it.

    Attributes:
        camera: how it is projected on paper.
        travel: first and last place along the way [m], shape (2,).
        across: first and last place to the left of the way [m], shape (2,).
        level: z of the ground [m].
        spacing: distance between the lines across the way [m].
        solid: whether there is any ground; in a fluid only its extent matters.
    """

    camera: Camera
    travel: Floats
    across: Floats
    level: float
    spacing: float = LINES
    solid: bool = True

    @property
    def rim(self) -> Floats:
        """Corners of the ground on paper [m], shape (4, 2); the first two are on the near edge."""
        return self.camera.on_ground(self.travel[[0, 1, 1, 0]], self.across[[0, 0, 1, 1]], self.level)


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
    for collection in (shadow, faces):
        collection.set_zorder(zorder)
        axes.add_collection(collection)


def draw_ground(axes: "Axes", stretch: Stretch, shift: Floats = NO_SHIFT, zorder: float = 1.0) -> None:
    """Draw a stretch of ground, shifted by ``shift`` on paper [m]; in a fluid this draws nothing."""
    if not stretch.solid:
        return
    rim, (first, last) = stretch.rim + shift, stretch.travel / stretch.spacing
    axes.add_collection(PolyCollection([rim], facecolors=[GROUND], edgecolors="none", zorder=zorder))
    marks = np.arange(np.ceil(first), np.floor(last) + 1) * stretch.spacing
    place = stretch.camera.on_ground
    lines = np.stack([place(marks, np.full_like(marks, side), stretch.level) + shift for side in stretch.across], 1)
    axes.add_collection(LineCollection(list(lines), colors=[GROUND_LINE], linewidths=0.6, zorder=zorder))
    axes.add_collection(LineCollection([rim[:2]], colors=[INK], linewidths=0.9, zorder=zorder))


def covered(points: Floats, camera: Camera) -> Floats:
    """Smallest and largest place of points, shape (N, 3) [m], along and across the way, shape (2, 2) [m]."""
    h = np.deg2rad(camera.heading)
    places = points[:, :2] @ np.array([[np.cos(h), -np.sin(h)], [np.sin(h), np.cos(h)]])
    return np.stack([places.min(axis=0), places.max(axis=0)], axis=1)


def draw_schedule(axes: "Axes", schedule: GaitSchedule, edges: ArrayLike | None = None) -> None:
    """Draw when the actuators of the inflatable robot are on, as played: ten rows, bladder 1 on top.

    Args:
        axes: to draw on.
        schedule: schedule of T columns, played R times.
        edges: where columns begin and end, such as times [s], shape (T R + 1,); by default columns count.
    """
    played = np.tile(schedule.levels, schedule.repeats)
    ticks = np.arange(played.shape[1] + 1.0) if edges is None else np.asarray(edges, float)
    numbers = [str(i + 1) for group in (BLADDERS, FEET) for i in range(len(group))]
    numbers[0], numbers[len(BLADDERS)] = "bladder 1", "foot 1"
    draw_levels(axes, played, ticks, np.array([*BLADDERS, *FEET]), numbers, apart=len(BLADDERS))
    axes.xaxis.set_major_locator(MaxNLocator(integer=edges is None))


def draw_levels(axes: "Axes", levels: Floats, edges: Floats, colours: Floats, names: list[str], apart: int = 0) -> None:
    """Draw levels over time as rows of bars; a level from 0 to 1 fills that part of its row's height.

    Args:
        axes: to draw on.
        levels: from 0 to 1, shape (N, K).
        edges: times at which the levels begin and end, shape (K + 1,).
        colours: colours of the rows, shape (N, 3).
        names: names of the rows.
        apart: number of the row above which there is a gap; 0 for none.
    """
    tops = np.arange(len(levels)) + 0.35 * ((np.arange(len(levels)) >= apart) & (apart > 0))
    empty, told = np.argwhere(levels < 1), np.argwhere(levels > 0)
    row, column = np.concatenate([empty, told]).T
    height = np.append(np.ones(len(empty)), levels[levels > 0])
    left, right, bottom = edges[column], edges[column + 1], tops[row] + 0.94
    top = bottom - 0.88 * height
    cells = np.stack([[left, top], [right, top], [right, bottom], [left, bottom]]).transpose(2, 0, 1)
    shades = np.concatenate([np.tile(GROUND, (len(empty), 1)), colours[told[:, 0]]])
    axes.add_collection(PolyCollection(list(cells), facecolors=shades, edgecolors=[PAPER], linewidths=0.6))
    axes.set_xlim(edges[0], edges[-1])
    axes.set_ylim(tops[-1] + 1.0, 0.0)
    label_rows(axes, tops + 0.5, names)


def label_rows(axes: "Axes", places: Floats, names: list[str]) -> None:
    """Write the names of rows at their left, and hide the frame of the axes."""
    axes.set_yticks(places, names)
    axes.tick_params(length=0, labelsize=7, labelcolor=INK)
    axes.spines[:].set_visible(False)
