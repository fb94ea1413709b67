"""Still pictures: one frame of a motion on matplotlib axes, or in a file."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from io import BytesIO
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from PIL import Image

from robots.view.beams import arrows, draw_beams
from robots.view.colour_names import BEAMS
from robots.view.colouring import PLAIN, STRAINS, Colouring, colouring
from robots.view.drawing import NO_SHIFT, draw_path, draw_polygons, draw_scale_bar, draw_uneven
from robots.view.lattice_states import LatticeStates
from robots.view.mesh import ball_at, faces
from robots.view.motion import LIGHT_COLOUR, Motion
from robots.view.scene import GROUND, GROUND_LINE, INK, Camera, Polygons, paint
from robots.view.uneven import WATER_TINT, Pieces, below_water, hidden, pieces
from taichi_sim.base.arrays import Bools, Floats
from taichi_sim.base.checks import number
from taichi_sim.base.files import new_path, write_bytes
from taichi_sim.base.short_text import printable

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WIDTH, TITLE_HEIGHT, KEY_HEIGHT, EDGE = 6.4, 0.36, 0.5, 0.12  # [inches]
KEY_LETTERS = 90  # of a line of a key
DOTS_PER_INCH = 150
MARGIN = 0.25  # ground around a robot, in lengths of the robot
REACH = 6.0  # default length of the ground in a picture, in lengths of the robot
LINES_APART = np.array([0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0])  # spacings of lines on the ground [m]
SEEN_FROM_ABOVE = 0.45  # Camera.shift_up for rigid robots


@dataclass(frozen=True, eq=False)
class Setting:
    """Camera, ground and colours that all pictures of a motion share.

    Attributes:
        motion: motion to show.
        camera: camera that looks at it.
        area: visible ground: its limits along the heading, and to the left of it [m], shape (2, 2).
        colouring: colours of the nodes; the one named beams shows links and pressure, with the scale of strains.
    """

    motion: Motion
    camera: Camera
    area: Floats
    colouring: Colouring

    @property
    def rim(self) -> Floats:
        """Corners of the ground, below it where it is uneven, on paper [m], shape (4, 2).

        The first two are on the near edge.
        """
        (first, last), (right, left) = self.area
        base = self.motion.ground.level if self.pieces is None else self.pieces.base
        return self.camera.on_ground([first, last, last, first], [right, right, left, left], base)

    @cached_property
    def pieces(self) -> Pieces | None:
        """Visible pieces of uneven ground; None if it is a plane."""
        ground = self.motion.ground
        return None if ground.relief is None else pieces(ground.relief, ground.level, self.camera, self.area)

    @property
    def outline(self) -> Floats:
        """The rim and, after it, all corners of uneven ground on paper [m], shape (4 + N, 2)."""
        if self.pieces is None:
            return self.rim
        return np.concatenate([self.rim, self.camera.project(self.pieces.quads).reshape(-1, 2)])

    @property
    def level(self) -> float | None:
        """Height of the ground, z [m]; None in a fluid."""
        return self.motion.ground.level if self.motion.ground.solid else None

    @property
    def lights(self) -> Floats:
        """Positions of the lights above the visible ground, shape (L, 3) [m]."""
        return self.motion.lights[self.shows(self.motion.lights)]

    @property
    def beams(self) -> LatticeStates | None:
        """The lattice, if its links and pressure are drawn in place of its faces."""
        return self.motion.lattice if self.colouring.name == BEAMS else None

    def shows(self, points: Floats) -> Bools:
        """Whether points in space, shape (N, 3) [m], are above the visible ground, shape (N,)."""
        places = self.camera.by_the_way(points)
        inside = (places >= self.area[:, 0]) & (places <= self.area[:, 1])
        return np.asarray(inside.all(axis=1))

    def polygons(self, frame: int) -> Polygons:
        """Polygons of a frame on paper, with the lights."""
        quads, owners = faces(self.motion, frame, self.colouring.inner)
        colours, relief = self.colouring.of(frame)[owners], self.motion.ground.relief
        opacity = None if self.colouring.opacity is None else self.colouring.opacity[owners]
        if relief is not None:
            seen = ~hidden(quads.mean(axis=1), relief, self.motion.ground.level, self.camera)
            quads, colours, opacity = quads[seen], colours[seen], None if opacity is None else opacity[seen]
            wet = below_water(quads[..., 2].mean(axis=1) - self.motion.ground.level, relief)
            colours = colours * np.where(wet[:, None], WATER_TINT, 1.0)
        for light in self.lights:
            ball = ball_at(light, self.motion.light_radius)
            quads, colours = np.concatenate([quads, ball]), np.concatenate([colours, [LIGHT_COLOUR] * len(ball)])
            opacity = None if opacity is None else np.append(opacity, np.ones(len(ball)))
        return paint(quads, colours, self.camera, self.level, relief, opacity)

    def way(self, frame: int) -> Floats:
        """Path up to a frame on paper, shape (K, 2) [m], from where it last enters the visible ground."""
        passed = self.motion.path[: frame + 1]
        outside = np.flatnonzero(~self.shows(passed))
        return self.camera.project(passed[outside[-1] + 1 if len(outside) else 0 :])


def setting(
    motion: Motion,
    frames: Sequence[int],
    *,
    colour: str = "material",
    camera: Camera | None = None,
    reach: float = REACH,
) -> Setting:
    """Choose camera, ground and colour scale for pictures of some frames.

    Args:
        motion: motion to show.
        frames: numbers of the frames that must fit on the ground.
        colour: one of ``robots.view.colour_names.COLOURS``.
        camera: by default it looks from the robot's right.
        reach: longest path shown [lengths of the robot]; the rest is cut off. Lights are shown if they need little or
            no more ground.

    Raises:
        ValueError: for colours that are unknown or that the robot does not support.
    """
    camera = camera or default_camera(motion)
    colours = colouring(motion, colour, frames)
    reach = number("reach", reach, 1.0) if reach != math.inf else reach
    return Setting(motion, camera, _area(motion, frames, camera, reach), colours)


def default_camera(motion: Motion) -> Camera:
    """Camera along the direction of travel: the heading of a voxel robot, or the line from start to end."""
    if motion.lattice is not None or motion.ground.slope:
        return Camera(motion.ground.heading, motion.ground.slope)
    gone = motion.path[-1] - motion.path[0]
    heading = float(np.rad2deg(np.arctan2(gone[1], gone[0]))) if np.hypot(*gone[:2]) > 1e-9 else 0.0
    return Camera(heading, 0.0, shift_up=SEEN_FROM_ABOVE)


def draw_motion(axes: "Axes", given: Setting, frame: int, outlined: bool = True) -> None:
    """Draw a frame with its ground, shadow, lights, travelled path and a scale bar; axes in metres on paper.

    Args:
        axes: axes to draw on.
        given: setting that all pictures of the motion share.
        frame: number of the frame.
        outlined: whether voxels have outlines.
    """
    motion = given.motion
    draw_ground(axes, given)
    if given.beams is not None:
        draw_beams(axes, given.beams, frame, given.camera, given.level, given.colouring.limit)
    else:
        draw_polygons(axes, given.polygons(frame), outlined=outlined and motion.skin is not None)
        if given.colouring.name == "contact":
            _draw_seen_through(axes, given, frame)
    draw_path(axes, given.way(frame), 5.0)
    rim = given.rim
    draw_scale_bar(axes, rim[:2] - (0.0, 0.025 * np.ptp(rim[:, 0])))
    axes.set_aspect("equal")
    axes.axis("off")


def draw_ground(axes: "Axes", given: Setting, shift: Floats = NO_SHIFT, zorder: float = 1.0) -> None:
    """Draw the ground, shifted by ``shift`` on paper [m]; in a fluid this draws nothing.

    A plane has lines across the heading; uneven ground is shaded by light and shows its cut sides.
    """
    if given.level is None:
        return
    if given.pieces is not None:
        draw_uneven(axes, given.pieces, given.camera, shift, zorder)
        return
    rim, (travel, across) = given.rim + shift, given.area
    apart = LINES_APART[np.abs(np.log(LINES_APART / (np.ptp(travel) / 12))).argmin()]
    marks = np.arange(np.ceil(travel[0] / apart), np.floor(travel[1] / apart) + 1) * apart
    sides = [given.camera.on_ground(marks, np.full_like(marks, side), given.level) + shift for side in across]
    axes.add_collection(PolyCollection([rim], facecolors=[GROUND], edgecolors="none", zorder=zorder))
    lines = list(np.stack(sides, axis=1))
    axes.add_collection(LineCollection(lines, colors=[GROUND_LINE], linewidths=0.6, zorder=zorder))
    axes.add_collection(LineCollection([rim[:2]], colors=[INK], linewidths=0.9, zorder=zorder))


def draw_pose(axes: "Axes", motion: Motion, frame: int = -1, *, camera: Camera | None = None) -> None:
    """Draw one frame of a motion on given axes, which get equal scales; ``camera`` is that of :func:`setting`."""
    frame %= len(motion.times)
    _draw_alone(axes, setting(motion, [frame], camera=camera), frame)


def _draw_alone(axes: "Axes", given: Setting, frame: int) -> None:
    draw_motion(axes, given, frame)
    across, up = limits(given, [frame])
    axes.set(xlim=across, ylim=up)


def limits(given: Setting, frames: Sequence[int]) -> tuple[tuple[float, float], tuple[float, float]]:
    """Limits of pictures of some frames on paper [m]: (left, right) and (lowest, highest)."""
    motion, camera = given.motion, given.camera
    points = [given.outline, given.way(max(frames)), camera.project(given.lights) + motion.light_radius]
    for frame in frames:
        points.append(camera.project(faces(motion, frame)[0]).reshape(-1, 2))
        if given.beams is not None:
            points.append(camera.project(arrows(given.beams, frame)[1]))
    (left, bottom), (right, top) = (f(np.concatenate(points), axis=0) for f in (np.min, np.max))
    wide = right - left
    return (left - 0.01 * wide, right + 0.01 * wide), (bottom - 0.085 * wide, top + 0.02 * wide)


def still_picture(
    motion: Motion,
    *,
    at: float | None = None,
    colour: str = "material",
    camera: Camera | None = None,
    reach: float = REACH,
) -> Figure:
    """Draw a robot at a time, with a title and a key of its colours.

    Args:
        motion: motion to show.
        at: time [s]; the end by default.
        colour: one of ``robots.view.colour_names.COLOURS``.
        camera: by default it looks from the robot's right.
        reach: longest path shown [lengths of the robot].

    Raises:
        ValueError: for times outside the motion, and as :func:`setting`.
    """
    frame = frame_at(motion, at)
    given = setting(motion, [frame], colour=colour, camera=camera, reach=reach)
    figure = Figure(facecolor="white")
    axes = figure.add_axes((0, 0, 1, 1))
    _draw_alone(axes, given, frame)
    arrange(axes, f"{motion.name}, {motion.times[frame]:.2f} s", WIDTH, colours=given.colouring)
    return figure


def arrange(axes: "Axes", title: str, width: float, below: float = 0.0, colours: Colouring | None = None) -> float:
    """Lay out a figure: a title, a drawing whose height follows from its limits, and space below.

    Args:
        axes: axes of the drawing, with their limits set.
        title: title above the drawing.
        width: width of the figure [inches].
        below: height left free at the bottom [inches].
        colours: colouring whose key is drawn below the drawing, if it has one.

    Returns:
        Height of the figure [inches].
    """
    figure, inner = axes.get_figure(root=True), width - 2 * EDGE
    assert figure is not None
    keyed = KEY_HEIGHT if colours and colours.has_key else 0.0
    drawn = inner * float(np.ptp(axes.get_ylim()) / np.ptp(axes.get_xlim()))
    total = TITLE_HEIGHT + drawn + below + keyed + EDGE
    figure.set_size_inches(width, total)
    axes.set_position((EDGE / width, (EDGE + below + keyed) / total, inner / width, drawn / total))
    figure.text(EDGE / width, 1 - 0.5 * TITLE_HEIGHT / total, printable(title), va="center", fontsize=11, color=INK)
    if colours:
        draw_key(figure, colours, (EDGE / width, (EDGE + below) / total, inner / width, 0.8 * keyed / total))
    return total


def save_still(motion: Motion, path: str | PathLike[str], **options: Any) -> int:
    """Write the picture of :func:`still_picture`; the suffix of the path chooses the format (png, pdf, svg).

    Returns:
        Bytes written.

    Raises:
        ValueError: if the file exists, and as :func:`still_picture`.
    """
    return save_figure(still_picture(motion, **options), path)


def save_figure(figure: Figure, path: str | PathLike[str]) -> int:
    """Write a figure to a new file, and return its size in bytes.

    Raises:
        ValueError: if the file exists, or matplotlib does not support its format.
    """
    form = new_path(path).suffix[1:].lower()
    if form not in figure.canvas.get_supported_filetypes():
        raise ValueError(f"path: {path} is not allowed; give a name that ends in .png, .pdf or .svg")
    content = figure_content(figure, form, DOTS_PER_INCH)
    write_bytes(path, content)
    return len(content)


def figure_content(figure: Figure, form: str, dots_per_inch: int) -> bytes:
    """Content of a figure's file; a PNG has a palette of 256 colours, which makes it a third as large."""
    content = BytesIO()
    figure.savefig(content, format=form, dpi=dots_per_inch)
    if form == "png":
        with Image.open(content) as image:
            few = image.convert("RGB").quantize(256, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
        content = BytesIO()
        few.save(content, "png", optimize=True)
    return content.getvalue()


def frame_at(motion: Motion, at: float | None) -> int:
    """Number of the frame nearest to a time [s]; the last one by default."""
    if at is None:
        return len(motion.times) - 1
    time = number("at", at, round(float(motion.times[0]), 9), math.ceil(motion.times[-1] * 1e6) / 1e6, "s")
    return int(np.abs(motion.times - time).argmin())


def draw_key(figure: Figure, colours: Colouring, place: tuple[float, float, float, float]) -> None:
    """Draw names of colours, or a colour bar of strains; ``place`` is left, bottom, width, height in the figure."""
    left, bottom, width, height = place
    if colours.limit:
        bar = figure.add_axes((left + 0.25 * width, bottom + 0.72 * height, 0.5 * width, 0.24 * height))
        scale = ScalarMappable(Normalize(-100 * colours.limit, 100 * colours.limit), STRAINS)
        figure.colorbar(scale, cax=bar, orientation="horizontal", extend="both")
        bar.set_xlabel("strain of links [%]", fontsize=8, color=INK, labelpad=1)
        bar.tick_params(labelsize=7, labelcolor=INK, length=2)
    elif colours.key:
        rows = 1 + (sum(len(name) + 4 for name, _ in colours.key) > KEY_LETTERS)
        figure.legend(
            handles=[Line2D([], [], marker="s", ls="", ms=8, color=colour, label=name) for name, colour in colours.key],
            loc="center",
            ncols=-(-len(colours.key) // rows),
            frameon=False,
            fontsize=8,
            labelcolor=INK,
            bbox_to_anchor=place,
            handletextpad=0.3,
        )


def _draw_seen_through(axes: "Axes", given: Setting, frame: int) -> None:
    """Draw the faces of voxels in contact over the robot, as they are often hidden below it."""
    quads, owners = faces(given.motion, frame)
    colours = given.colouring.of(frame)[owners]
    touching = (colours != PLAIN).any(axis=1)
    corners = given.camera.project(quads[touching])
    axes.add_collection(PolyCollection(list(corners), facecolors=colours[touching], edgecolors="none", alpha=0.4))


def _area(motion: Motion, frames: Sequence[int], camera: Camera, reach: float) -> Floats:
    """Choose the ground that shows some frames, the path to the last of them and lights, as ``Setting.area``."""
    poses = [camera.by_the_way(faces(motion, frame)[0].reshape(-1, 3)) for frame in frames]
    length = max(float(np.ptp(pose, axis=0).max()) for pose in poses)
    robot = _around(*poses)
    most = max(reach * length, float(np.ptp(robot, axis=1).max()))
    spare = (most - np.ptp(robot, axis=1))[:, None] * [-1.0, 1.0]
    passed = camera.by_the_way(motion.path[: max(frames) + 1])
    whole = np.clip(_around(robot.T, passed), *(robot + spare).T[:, :, None])
    most = max(REACH * length, float(np.ptp(whole, axis=1).max()))
    for light in camera.by_the_way(motion.lights):
        wider = _around(whole.T, light[None])
        whole = wider if np.ptp(wider, axis=1).max() <= most else whole
    return whole + MARGIN * length * np.array([-1, 1])


def _around(*places: Floats) -> Floats:
    """Limits along the heading and to its left, shape (2, 2) [m], of arrays of places, shape (N, 2) each."""
    every = np.concatenate(places)
    return np.stack([every.min(axis=0), every.max(axis=0)], axis=1)
