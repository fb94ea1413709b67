"""Still pictures: one frame of a motion on matplotlib axes, or in a file."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from PIL import Image

from robots.view.beams import arrows, draw_beams
from robots.view.colouring import PLAIN, STRAINS, Colouring, colouring, strain_limit
from robots.view.drawing import Stretch, covered, draw_ground, draw_polygons
from robots.view.mesh import ball_at, faces
from robots.view.motion import LIGHT_COLOUR, Motion
from robots.view.scene import INK, Camera, Polygons, paint
from robots.view.strip import draw_path, draw_scale_bar
from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import number
from taichi_sim.base.files import new_path, write_bytes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WIDTH, TITLE_HEIGHT, KEY_HEIGHT, EDGE = 6.4, 0.36, 0.5, 0.12  # [inches]
DOTS_PER_INCH = 150
MARGIN = 0.25  # of ground around a robot, in its lengths
REACH = 6.0  # ground in all, in lengths of the robot, that a picture shows unless more is asked for
LINES_APART = np.array([0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0])  # on the ground [m]
SEEN_FROM_ABOVE = 0.45  # how far up paper rigid robots' ground goes, of what it goes away


@dataclass(frozen=True, eq=False)
class Setting:
    """Camera, ground and colours that all pictures of a motion share.

    Attributes:
        motion: to show.
        colour: "material", "strain", "contact", "friction", or "beams": links and pressure.
        colouring: colouring of the nodes; for beams with the scale of the strains.
        stretch: the ground.
    """

    motion: Motion
    colour: str
    colouring: Colouring
    stretch: Stretch

    @property
    def camera(self) -> Camera:
        """The camera of the pictures."""
        return self.stretch.camera

    def polygons(self, frame: int) -> Polygons:
        """Polygons of a frame on paper, with the lights that stand on the stretch of ground."""
        quads, owners = faces(self.motion, frame)
        colours = self.colouring.of(frame)[owners]
        for light in self.motion.lights[_within(self.stretch, self.motion.lights)]:
            ball = ball_at(light, self.motion.light_radius)
            quads, colours = np.concatenate([quads, ball]), np.concatenate([colours, [LIGHT_COLOUR] * len(ball)])
        robot = paint(quads, colours, self.camera, self.stretch.level)
        return robot if self.stretch.solid else robot.floating


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
        motion: to show.
        frames: numbers of the frames that must fit on the ground.
        colour: "material", "strain", "contact", "friction" or "beams".
        camera: by default it looks from the right, on the way that the robot goes.
        reach: longest way shown [lengths of the robot]; the rest is cut off. Lights are seen if they add no ground, or
            little.

    Raises:
        ValueError: for colours that are not known or that the robot does not have.
    """
    camera = camera or default_camera(motion)
    colours = _beam_colouring(motion, frames) if colour == "beams" else colouring(motion, colour, frames)
    reach = number("reach", reach, 1.0) if reach != math.inf else reach
    return Setting(motion, colour, colours, _stretch(motion, frames, camera, reach))


def default_camera(motion: Motion) -> Camera:
    """Camera that follows the motion's way: the heading of a voxel robot, or the line from start to end."""
    if motion.lattice is not None or motion.ground.slope:
        return Camera(motion.ground.heading, motion.ground.slope)
    gone = motion.path[-1] - motion.path[0]
    heading = float(np.rad2deg(np.arctan2(gone[1], gone[0]))) if np.hypot(*gone[:2]) > 1e-9 else 0.0
    return Camera(heading, 0.0, shift_up=SEEN_FROM_ABOVE)


def draw_motion(axes: "Axes", given: Setting, frame: int, outlined: bool = True) -> None:
    """Draw a frame with its ground, shadow, lights, travelled path and a scale bar; axes in metres on paper.

    Args:
        axes: to draw on; this sets their limits.
        given: what all pictures of the motion share.
        frame: number of the frame.
        outlined: whether voxels have outlines.
    """
    motion, stretch = given.motion, given.stretch
    draw_ground(axes, stretch)
    if given.colour == "beams":
        assert motion.lattice is not None
        draw_beams(axes, motion.lattice, frame, stretch, given.colouring.limit)
    else:
        draw_polygons(axes, given.polygons(frame), outlined=outlined and motion.skin is not None)
        if given.colour == "contact":
            _draw_seen_through(axes, given, frame)
    draw_path(axes, _way(given, frame), 5.0)
    rim = stretch.rim
    draw_scale_bar(axes, rim[:2] - (0.0, 0.025 * np.ptp(rim[:, 0])))
    axes.set_aspect("equal")
    axes.axis("off")


def draw_pose(axes: "Axes", motion: Motion, frame: int = -1, *, camera: Camera | None = None) -> None:
    """Draw one frame of a motion on given axes, which get equal scales; ``camera`` is that of :func:`setting`."""
    given = setting(motion, [frame], camera=camera)
    draw_motion(axes, given, frame)
    across, up = limits(given, [frame])
    axes.set(xlim=across, ylim=up)


def limits(given: Setting, frames: Sequence[int]) -> tuple[tuple[float, float], tuple[float, float]]:
    """Limits of pictures of some frames on paper [m]: (left, right) and (lowest, highest)."""
    points = [given.stretch.rim]
    for frame in frames:
        corners = given.camera.project(faces(given.motion, frame)[0]).reshape(-1, 2)
        points.append(np.stack([corners.min(axis=0), corners.max(axis=0)]))
        if given.colour == "beams" and given.motion.lattice is not None:
            points.append(given.camera.project(arrows(given.motion.lattice, frame)[1]))
    points.append(_way(given, max(frame % len(given.motion.times) for frame in frames)))
    lights = given.motion.lights[_within(given.stretch, given.motion.lights)]
    points.append(given.camera.project(lights) + given.motion.light_radius)
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
        motion: to show.
        at: time [s]; the end by default.
        colour: "material", "strain", "contact", "friction" or "beams".
        camera: by default it looks from the right, on the way that the robot goes.
        reach: longest way shown [lengths of the robot].

    Raises:
        ValueError: for times that the motion does not have, and as :func:`setting`.
    """
    frame = frame_at(motion, at)
    given = setting(motion, [frame], colour=colour, camera=camera, reach=reach)
    figure = Figure(figsize=(WIDTH, WIDTH), facecolor="white")
    axes = figure.add_axes((0, 0, 1, 1))
    draw_motion(axes, given, frame)
    across, up = limits(given, [frame])
    axes.set(xlim=across, ylim=up)
    keyed = KEY_HEIGHT if given.colouring.key or given.colouring.limit else 0.0
    inner = WIDTH - 2 * EDGE
    drawn = inner * (up[1] - up[0]) / (across[1] - across[0])
    total = TITLE_HEIGHT + drawn + keyed + EDGE
    figure.set_size_inches(WIDTH, total)
    axes.set_position((EDGE / WIDTH, (EDGE + keyed) / total, inner / WIDTH, drawn / total))
    title = f"{motion.name}, {motion.times[frame]:.2f} s"
    figure.text(EDGE / WIDTH, 1 - 0.5 * TITLE_HEIGHT / total, title, va="center", fontsize=10, color=INK)
    draw_key(figure, given.colouring, (EDGE / WIDTH, EDGE / total, inner / WIDTH, 0.8 * keyed / total))
    return figure


def save_still(motion: Motion, path: str | PathLike[str], **options: Any) -> int:
    """Write the picture of :func:`still_picture`; the suffix of the path chooses the format (png, pdf, svg).

    Returns:
        Bytes written.

    Raises:
        ValueError: for a file that exists, and as :func:`still_picture`.
    """
    return save_figure(still_picture(motion, **options), path)


def save_figure(figure: Figure, path: str | PathLike[str]) -> int:
    """Write a figure to a new file, and return its size in bytes.

    Raises:
        ValueError: for a file that exists, and formats that matplotlib does not have.
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
        spots = [Line2D([], [], marker="s", ls="", ms=8, color=colour, label=name) for name, colour in colours.key]
        figure.legend(
            handles=spots,
            loc="center",
            ncols=len(spots),
            frameon=False,
            fontsize=8,
            labelcolor=[*INK],
            bbox_to_anchor=(left, bottom, width, height),
            handletextpad=0.3,
        )


def _draw_seen_through(axes: "Axes", given: Setting, frame: int) -> None:
    """Draw the faces of voxels in contact over the robot, as they are often hidden below it."""
    quads, owners = faces(given.motion, frame)
    colours = given.colouring.of(frame)[owners]
    touching = (colours != PLAIN).any(axis=1)
    corners = given.camera.project(quads[touching])
    axes.add_collection(PolyCollection(list(corners), facecolors=colours[touching], edgecolors="none", alpha=0.4))


def _beam_colouring(motion: Motion, frames: Sequence[int]) -> Colouring:
    if motion.lattice is None:
        raise ValueError(f"colour: beams is not allowed for {motion.name}, which has no lattice; give material")
    strains = motion.lattice.part(np.array(frames)).strains()
    return Colouring(colouring(motion).of, limit=strain_limit(strains))


def _stretch(motion: Motion, frames: Sequence[int], camera: Camera, reach: float) -> Stretch:
    """Choose the ground below some frames, with the way to the last of them and the lights."""
    quads = [faces(motion, frame)[0].reshape(-1, 3) for frame in frames]
    length = max(float(np.ptp(covered(q, camera), axis=1).max()) for q in quads)
    robot = covered(np.concatenate(quads), camera)
    most = max(reach * length, float(np.ptp(robot, axis=1).max()))
    spare = (most - np.ptp(robot, axis=1))[:, None] * [-1.0, 1.0]
    passed = covered(motion.path[: max(f % len(motion.times) for f in frames) + 1], camera)
    whole = np.clip(_both(robot, passed), *(robot + spare).T[:, :, None])
    most = max(REACH * length, float(np.ptp(whole, axis=1).max()))
    for light in motion.lights:
        wider = _both(whole, covered(light[None], camera))
        whole = wider if np.ptp(wider, axis=1).max() <= most else whole
    room = MARGIN * length * np.array([-1, 1])
    travel, across = whole + room
    apart = LINES_APART[np.abs(np.log(LINES_APART / (np.ptp(travel) / 12))).argmin()]
    return Stretch(camera, travel, across, motion.ground.level, float(apart), motion.ground.solid)


def _way(given: Setting, frame: int) -> Floats:
    """Way up to a frame, projected on paper, shape (K, 2) [m]; it starts where it last enters the stretch."""
    passed = given.motion.path[: frame % len(given.motion.times) + 1]
    outside = np.flatnonzero(~_within(given.stretch, passed))
    return given.camera.project(passed[outside[-1] + 1 if len(outside) else 0 :])


def _both(first: Floats, second: Floats) -> Floats:
    """Smallest ranges that contain both given ones, shape (2, 2)."""
    return np.stack([np.minimum(first, second)[:, 0], np.maximum(first, second)[:, 1]], axis=1)


def _within(stretch: Stretch, points: Floats) -> Any:
    """Whether points are above a stretch of ground, shape (N,)."""
    h = np.deg2rad(stretch.camera.heading)
    turn = np.array([[np.cos(h), -np.sin(h)], [np.sin(h), np.cos(h)]])
    places = points[:, :2] @ turn
    low, high = np.stack([stretch.travel, stretch.across]).T
    return ((places >= low) & (places <= high)).all(axis=1)
