"""Poses, grounds and gait charts on matplotlib axes."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike

from robots.inflatable.relaxed_schedule import Schedule
from robots.inflatable.robot import InflatableResult
from robots.view import scene, shape
from robots.view.scene import BLADDERS, FEET, GROUND, GROUND_LINE, INK, PAPER, SHADOW, Camera, Polygons
from taichi_sim.base.arrays import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MARGIN = 0.15  # of ground around a pose, in lengths of the pose
LINES = 0.05  # between the lines on the ground [m]
NO_SHIFT = np.zeros(2)


@dataclass(frozen=True, eq=False)
class Stretch:
    """A stretch of ground, and who looks at it.

    Attributes:
        camera: that looks at it.
        travel: from where to where along the way [m], shape (2,).
        across: from where to where to the left of the way [m], shape (2,).
        level: z of the ground [m].
        spacing: of the lines across the way [m].
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
        """Its corners on paper, the first two on the near edge [m], shape (4, 2)."""
        return self.camera.on_ground(self.travel[[0, 1, 1, 0]], self.across[[0, 0, 1, 1]], self.level)


def draw_pose(
    axes: "Axes",
    result: InflatableResult,
    robot: int = 0,
    frame: int = -1,
    *,
    camera: Camera | None = None,
    grips: tuple[bool, bool] = (True, True),
) -> None:
    """Draw a recorded pose on its ground; the units of the axes are metres on paper.

    A bladder and its counterpart on the other side have one hue, pale when deflated, full when inflated.
    Feet are pale when they slide.

    Args:
        axes: to draw on; their frame is hidden, their scales become equal.
        result: of ``simulate``, with frames.
        robot: place in the batch.
        frame: which of the frames.
        camera: ``Camera(heading, slope)``; by default for a robot that rolls on flat ground.
        grips: whether foot 1 and foot 2 grip.
    """
    camera = camera or Camera()
    travel, across = footprint(result, camera, [frame], robot)
    margin = MARGIN * np.ptp([travel, across], axis=1).max() * np.array([-1, 1])
    draw_ground(axes, Stretch(camera, travel + margin, across + margin, scene.ground_level(result)))
    draw_polygons(axes, scene.build(result, robot, frame, camera, grips))
    axes.set_aspect("equal")
    axes.axis("off")
    axes.autoscale_view()


def draw_polygons(
    axes: "Axes", robot: Polygons, shift: Floats = NO_SHIFT, zorder: float = 1.0, outlined: bool = True
) -> None:
    """Draw a robot and its shadow, shifted on paper [m], with outlines of its faces or without."""
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
    """Draw a stretch of ground, shifted on paper [m]; nothing in a fluid."""
    if not stretch.solid:
        return
    rim, (first, last) = stretch.rim + shift, stretch.travel / stretch.spacing
    axes.add_collection(PolyCollection([rim], facecolors=[GROUND], edgecolors="none", zorder=zorder))
    marks = np.arange(np.ceil(first), np.floor(last) + 1) * stretch.spacing
    place = stretch.camera.on_ground
    lines = np.stack([place(marks, np.full_like(marks, side), stretch.level) + shift for side in stretch.across], 1)
    axes.add_collection(LineCollection(list(lines), colors=[GROUND_LINE], linewidths=0.6, zorder=zorder))
    axes.add_collection(LineCollection([rim[:2]], colors=[INK], linewidths=0.9, zorder=zorder))


def footprint(result: InflatableResult, camera: Camera, frames: list[int], robot: int = 0) -> Floats:
    """Ranges along and across the way that poses cover [m], shape (2, 2)."""
    return covered(np.concatenate([shape.surface(result, robot, i).quads.reshape(-1, 3) for i in frames]), camera)


def covered(points: Floats, camera: Camera) -> Floats:
    """Ranges along and across the way that points cover, shape (N, 3) [m], shape (2, 2)."""
    h = np.deg2rad(camera.heading)
    places = points[:, :2] @ np.array([[np.cos(h), -np.sin(h)], [np.sin(h), np.cos(h)]])
    return np.stack([places.min(axis=0), places.max(axis=0)], axis=1)


def draw_schedule(axes: "Axes", schedule: Schedule, edges: ArrayLike | None = None) -> None:
    """Draw when actuators are on, as played: ten rows, bladder 1 on top, in the colours of the robot.

    An actuator that is on by parts fills that part of its row.

    Args:
        axes: to draw on.
        schedule: of T columns, played R times, of either kind.
        edges: where columns begin and end, such as times [s], shape (T R + 1,); by default columns count.
    """
    played = np.tile(schedule.levels, schedule.repeats)
    ticks = np.arange(played.shape[1] + 1.0) if edges is None else np.asarray(edges, float)
    tops = np.arange(len(played)) + 0.35 * (np.arange(len(played)) >= len(BLADDERS))  # feet stand apart
    empty, told = np.argwhere(played < 1), np.argwhere(played > 0)
    row, column = np.concatenate([empty, told]).T
    height = np.append(np.ones(len(empty)), played[played > 0])
    left, right, bottom = ticks[column], ticks[column + 1], tops[row] + 0.94
    top = bottom - 0.88 * height
    cells = np.stack([[left, top], [right, top], [right, bottom], [left, bottom]]).transpose(2, 0, 1)
    colours = np.concatenate([np.tile(GROUND, (len(empty), 1)), np.array([*BLADDERS, *FEET])[told[:, 0]]])
    axes.add_collection(PolyCollection(list(cells), facecolors=colours, edgecolors=[PAPER], linewidths=0.6))
    axes.set_xlim(ticks[0], ticks[-1])
    axes.xaxis.set_major_locator(MaxNLocator(integer=edges is None))
    axes.set_ylim(tops[-1] + 1.0, 0.0)
    numbers = [str(i + 1) for group in (BLADDERS, FEET) for i in range(len(group))]
    numbers[0], numbers[len(BLADDERS)] = "bladder 1", "foot 1"
    axes.set_yticks(tops + 0.5, numbers)
    axes.tick_params(length=0, labelsize=7, labelcolor=INK)
    axes.spines[:].set_visible(False)
