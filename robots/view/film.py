"""Draw film strips of motions, and write films as GIF, or as MP4 if imageio-ffmpeg is installed."""

import importlib.util
import math
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from io import BytesIO
from itertools import chain, pairwise
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from robots.view.colour_names import check_colour_of_strip
from robots.view.drawing import draw_path, draw_polygons, draw_scale_bar, write_below
from robots.view.motion import Motion
from robots.view.scene import INK, Polygons
from robots.view.still import Setting, arrange, draw_ground, draw_key, draw_motion, limits, save_figure, setting
from taichi_sim.base.arrays import Bytes, Floats
from taichi_sim.base.checks import number, whole_number
from taichi_sim.base.disk_faults import told_as
from taichi_sim.base.files import new_path, replacing, write_bytes
from taichi_sim.base.foreign import install_extra
from taichi_sim.base.short_text import printable

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WIDTH = 8.0  # of a strip [inches]
GAP = 0.06  # between pictures of a strip, in lengths of the robot
TEXT = 0.026  # height of a line of text, in widths of the strip
ASPECT = 2.0  # desired ratio of width to height of a strip
CAPTION, KEY = 14, 48  # heights of the caption above and of the colour key below each robot of a film [pixels]
SAMPLES = 6  # pictures from which a GIF's colours are chosen
ALMOST_WHITE = 249  # of 255; brighter colours become white, so that paper has no tint


def strip_picture(motion: Motion, *, frames: int = 6, colour: str = "material") -> Figure:
    """Draw a film strip: poses on one ground if they do not overlap, otherwise each in a picture of its own.

    Args:
        motion: motion to show.
        frames: number of poses, equally spaced in time, see :func:`poses_of`; at least 2.
        colour: one of ``robots.view.colour_names.COLOURS`` except beams.

    Raises:
        ValueError: for values that are not allowed.
    """
    figure = Figure(facecolor="white")
    axes = figure.add_axes((0, 0, 1, 1))
    given = draw_strip(axes, motion, poses_of(motion, frames), colour)
    arrange(axes, motion.name, WIDTH, colours=given.colouring)
    return figure


def draw_strip(axes: "Axes", motion: Motion, poses: Sequence[int], colour: str = "material") -> Setting:
    """Draw poses of a motion, with its path, times and a scale bar; axes in metres on paper.

    Poses that do not overlap share one ground. Otherwise each has a picture of its own with the same stretch of
    ground, so that its place there shows how far the robot has come; the pictures are arranged like lines of text.

    Args:
        axes: axes to draw on; this sets their limits.
        motion: motion to show.
        poses: numbers of its frames.
        colour: one of ``robots.view.colour_names.COLOURS`` except beams.

    Returns:
        Camera, ground and colours that the poses share.

    Raises:
        ValueError: for a colour that strips do not support.
    """
    check_colour_of_strip(colour)
    given = setting(motion, poses, colour=colour, reach=math.inf)
    robots, path, rim = [given.polygons(frame) for frame in poses], given.camera.project(motion.path), given.rim
    together = _apart(robots)
    shifts = (
        np.zeros((len(poses), 2))
        if together
        else _places(robots, given.outline, GAP * float(np.ptp(given.area[0])) / 4)
    )
    times = motion.times[list(poses)]
    digits = next((d for d in range(1, 6) if len({f"{time:.{d}f}" for time in times}) == len(set(times))), 6)
    for k, (frame, shift) in enumerate(zip(poses, shifts, strict=True)):
        if k == 0 or not together:
            draw_ground(axes, given, shift, 10.0 * k)
        draw_polygons(axes, robots[k], shift, 10.0 * k + 1, outlined=motion.skin is not None)
        passed = path[poses[k - 1] if k and together else 0 : frame + 1]
        draw_path(axes, passed + shift, 10.0 * k + 5)
        at = path[frame, 0] if together else rim[0, 0]
        foot = np.interp(at, rim[:2, 0], rim[:2, 1])
        write_below(axes, f"{motion.times[frame]:.{digits}f} s", (at + shift[0], foot + shift[1]), centred=together)
    line = TEXT * (np.ptp(shifts[:, 0]) + np.ptp(rim[:, 0]))
    lowest = draw_scale_bar(axes, rim[:2] + shifts[-1] - (0.0, (1.6 if together else 0.4) * line))
    drawn = [np.concatenate([given.outline, robot.corners.reshape(-1, 2)]) for robot in robots]
    corners = np.concatenate([each + shift for each, shift in zip(drawn, shifts, strict=True)])
    (left, bottom), (right, top) = corners.min(axis=0), corners.max(axis=0)
    axes.set(xlim=(left, right), ylim=(min(bottom, lowest) - 1.5 * line, top + 0.3 * line))
    axes.set_aspect("equal")
    axes.axis("off")
    return given


def _apart(robots: list[Polygons]) -> bool:
    """Whether no two poses overlap horizontally on paper."""
    ranges = sorted((r.corners[..., 0].min(), r.corners[..., 0].max()) for r in robots)
    return all(before[1] < after[0] for before, after in pairwise(ranges))


def _places(robots: list[Polygons], rim: Floats, gap: float) -> Floats:
    """Shifts on paper that arrange the pictures in lines, shape (N, 2) [m]; ``rim`` is ``Setting.outline``."""
    count = len(robots)
    right, climb = np.ptp(rim[:, 0]) + gap, rim[1, 1] - rim[0, 1]
    # Heights are measured from the near edge of the ground, as the grounds of a column are parallel.
    rise = climb / (rim[1, 0] - rim[0, 0])
    corners = np.concatenate([rim[4:], *(r.corners.reshape(-1, 2) for r in robots)]) - rim[0]
    high = (corners[:, 1] - rise * corners[:, 0]).max()

    def down(columns: int) -> float:
        return float(high + gap + TEXT * columns * right)

    def misfit(columns: int) -> float:
        tall = -(-count // columns) * down(columns) + abs(climb)
        return abs(float(np.log(columns * right / tall / ASPECT)))

    columns = min(range(1, count + 1), key=misfit)
    row, column = np.divmod(np.arange(count), columns)
    return np.stack([column * right, -row * down(columns)], axis=1)


def poses_of(motion: Motion, frames: int) -> list[int]:
    """Numbers of ``frames`` frames of a motion (at least 2), equally spaced in time from its beginning to its end.

    Where a robot whose drives repeat would be shown again and again in one or two phases of its cycle, the last pose is
    up to a period before the end, so that phases are spread.
    """
    count, last = whole_number("frames", frames, 2), len(motion.times) - 1
    poses = _equally_spaced(last, count)
    if not 0 < motion.period <= np.ptp(motion.times):
        return poses
    if (_phase_gaps(motion, poses) > 0.5 / count).sum() >= count / 2:
        return poses
    ends = np.flatnonzero(motion.times >= motion.times[-1] - motion.period)[::-1].tolist()
    choices = [some for end in ends if len(some := _equally_spaced(end, count)) == len(poses)]
    return max(choices, key=lambda some: _phase_gaps(motion, some).min())


def _equally_spaced(last: int, count: int) -> list[int]:
    """Up to ``count`` numbers of frames from 0 to ``last``."""
    return np.unique(np.linspace(0, last, count).round().astype(int)).tolist()


def _phase_gaps(motion: Motion, poses: list[int]) -> Floats:
    """Differences between the phases of poses [cycles] and the next higher ones, shape (N,)."""
    phases = np.sort(motion.times[poses] / motion.period % 1)
    return np.diff(phases, append=phases[:1] + 1)


def save_strip(motion: Motion, path: str | PathLike[str], **options: Any) -> int:
    """Write the picture of :func:`strip_picture` to a file, and return its size in bytes.

    Raises:
        ValueError: if the file exists, and as :func:`strip_picture`.
    """
    return save_figure(strip_picture(motion, **options), path)


def pictures(
    motions: Motion | Sequence[Motion],
    *,
    seconds: float | None = None,
    rate: float = 15.0,
    width: int = 640,
    colour: str = "material",
    one_scale: bool = True,
) -> Iterator[Bytes]:
    """Draw the pictures of a film that shows motions above each other, each on its own ground.

    All motions play at the same pace; one that ends before the others keeps its last pose.

    Args:
        motions: motions to show.
        seconds: duration of the film [s]; by default that of the longest motion.
        rate: pictures per second [Hz].
        width: width of a picture [pixels].
        colour: one of ``robots.view.colour_names.COLOURS``.
        one_scale: whether the grounds of all robots have the same length.

    Yields:
        Red, green, blue, shape (H, W, 3); H and W are even.

    Raises:
        ValueError: for values that are not allowed.
    """
    motions = [motions] if isinstance(motions, Motion) else list(motions)
    if not motions:
        raise ValueError("motions: there are none; give at least one")
    width = whole_number("width", width, 64) // 2 * 2
    rate = number("rate", rate, 0.1, 120.0, "Hz")
    longest = max(float(np.ptp(m.times)) for m in motions)
    seconds = longest if seconds is None else number("seconds", seconds, 0.1, unit="s")
    passed = np.linspace(0.0, longest, max(round(seconds * rate), 2))
    plans = [np.abs(m.times[:, None] - m.times[0] - passed).argmin(axis=0).tolist() for m in motions]
    settings = [
        setting(m, sorted(set(plan)), colour=colour, reach=math.inf) for m, plan in zip(motions, plans, strict=True)
    ]
    if one_scale:
        longest_way = max(float(np.ptp(given.area[0])) for given in settings)
        settings = [_lengthened(given, longest_way) for given in settings]
    panels = _panels(settings, plans, width, longest / seconds)
    return (_drawn(panels, settings, moment) for moment in zip(*plans, strict=True))


def save_gif(
    motions: Motion | Sequence[Motion],
    path: str | PathLike[str],
    *,
    rate: float = 15.0,
    colours: int = 64,
    **options: Any,
) -> int:
    """Write a film as a GIF that plays in a loop, with one small palette for all pictures.

    Args:
        motions: motions to show.
        path: path of the file.
        rate: pictures per second [Hz]; the time of a picture is rounded to hundredths of a second, the unit of GIF.
        colours: number of colours of the palette, 4 to 256.
        **options: keyword arguments of :func:`pictures`.

    Returns:
        Bytes written.

    Raises:
        ValueError: if the file exists, and for values that are not allowed.
    """
    new_path(path)
    colours = int(number("colours", colours, 4, 256))
    frames = [Image.fromarray(p) for p in pictures(motions, rate=rate, **options)]
    palette = _palette(frames[:: max(len(frames) // SAMPLES, 1)], colours)
    first, *rest = (frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames)
    pause = 10 * max(round(100 / rate), 1)  # [ms]
    content = BytesIO()
    first.save(content, "GIF", save_all=True, append_images=rest, duration=pause, loop=0, optimize=True)
    write_bytes(path, content.getvalue())
    return len(content.getvalue())


def save_mp4(
    motions: Motion | Sequence[Motion], path: str | PathLike[str], *, rate: float = 30.0, **options: Any
) -> int:
    """Write a film as an MP4 video (H.264); this needs imageio-ffmpeg. ``options`` are those of :func:`pictures`.

    Returns:
        Bytes written.

    Raises:
        ValueError: if imageio-ffmpeg is missing, the file exists, or a value is not allowed.
        RuntimeError: if the disk is full or broken.
    """
    new_path(path)
    need_video()
    from imageio_ffmpeg import write_frames

    film = pictures(motions, rate=rate, **options)
    first = next(film)
    size = first.shape[1], first.shape[0]
    with told_as(f"{path}: cannot be written"), replacing(Path(path)) as aside:
        writing = write_frames(str(aside), size, fps=rate, codec="libx264", quality=8, macro_block_size=2)
        with closing(writing) as writer:
            writer.send(None)
            for picture in chain([first], film):
                writer.send(np.ascontiguousarray(picture))
    return Path(path).stat().st_size


def _palette(pictures: list[Image.Image], count: int) -> Image.Image:
    """Choose one palette of ``count`` colours for all pictures; colours of small areas get extra weight."""
    seen = np.concatenate([np.asarray(picture).reshape(-1, 3) for picture in pictures])
    colours, counts = np.unique(seen, axis=0, return_counts=True)
    weighted = np.repeat(colours, np.ceil(np.sqrt(counts)).astype(int), axis=0)
    found = Image.fromarray(weighted[None]).quantize(count - 1, Image.Quantize.MEDIANCUT, kmeans=1)
    palette = np.array((found.getpalette() or [])[: 3 * (count - 1)]).reshape(-1, 3)
    palette[palette.min(axis=1) >= ALMOST_WHITE] = 255
    found.putpalette([255, 255, 255, *palette.ravel().tolist()])
    return found


def need_video() -> None:
    """Check that videos can be written.

    Raises:
        ValueError: if imageio-ffmpeg is missing.
    """
    if importlib.util.find_spec("imageio_ffmpeg") is None:
        raise ValueError(f"mp4: imageio-ffmpeg is missing; {install_extra('video')}")


def _lengthened(given: Setting, length: float) -> Setting:
    """Copy of a setting whose ground has a given length along the heading [m]."""
    (first, _), across = given.area
    return replace(given, area=np.array([[first, first + length], across]))


def _panels(settings: list[Setting], plans: list[list[int]], width: int, pace: float) -> list["Axes"]:
    """Make axes for each robot, below its name and playback speed, in one figure that is ``width`` pixels wide."""
    pace_note = f", {pace:.2g}× as fast" if abs(pace - 1) > 0.05 else ""
    frames = [sorted(set(plan)) for plan in plans]
    ranges = [limits(given, some[:: max(len(some) // 40, 1)]) for given, some in zip(settings, frames, strict=True)]
    drawn = [width * (up[1] - up[0]) / (across[1] - across[0]) for across, up in ranges]
    keyed = [KEY if given.colouring.has_key else 0 for given in settings]
    total = math.ceil(sum(drawn) + sum(keyed) + CAPTION * len(drawn)) // 2 * 2 + 2
    figure = Figure(figsize=(width / 100, total / 100), dpi=100, facecolor="white")
    FigureCanvasAgg(figure)
    top, panels = float(total), []
    for given, height, key, (across, up) in zip(settings, drawn, keyed, ranges, strict=True):
        caption = (top - 0.6 * CAPTION) / total
        figure.text(0.012, caption, printable(given.motion.name) + pace_note, va="center", fontsize=8, color=INK)
        top -= CAPTION + height
        panels.append(figure.add_axes((0, top / total, 1, height / total), xlim=across, ylim=up))
        top -= key
        draw_key(figure, given.colouring, (0.02, (top + 0.1 * key) / total, 0.96, 0.85 * key / total))
    return panels


def _drawn(panels: list["Axes"], settings: list[Setting], moment: tuple[int, ...]) -> Bytes:
    """Draw one picture of a film as red, green and blue, shape (H, W, 3)."""
    for axes, given, frame in zip(panels, settings, moment, strict=True):
        across, up = axes.get_xlim(), axes.get_ylim()
        axes.clear()
        draw_motion(axes, given, frame, outlined=False)
        axes.set(xlim=across, ylim=up)
    canvas = panels[0].figure.canvas
    assert isinstance(canvas, FigureCanvasAgg)
    canvas.draw()  # type: ignore[no-untyped-call]
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()  # type: ignore[no-untyped-call]
