"""Film strips of motions, and films: GIF, and MP4 where imageio-ffmpeg is installed."""

import importlib.util
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from io import BytesIO
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from robots.view.motion import Motion
from robots.view.scene import INK
from robots.view.still import Setting, draw_key, draw_motion, limits, save_figure, setting
from robots.view.strip import draw_robots
from taichi_sim.base.arrays import Bytes
from taichi_sim.base.checks import install_extra, number, whole_number
from taichi_sim.base.files import new_path, write_bytes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WIDTH, TITLE_HEIGHT, KEY_HEIGHT = 8.0, 0.4, 0.5  # of a strip [inches]
CAPTION, KEY = 14, 48  # heights of a line above each robot of a film, and of the key of its colours below [pixels]
SAMPLES = 6  # pictures that a GIF's colours are chosen from
ALMOST_WHITE = 249  # of 255: paper has no tint

Picture = Bytes


def strip_picture(motion: Motion, *, frames: int = 6, colour: str = "material") -> Figure:
    """Draw a film strip: poses on one ground if they do not overlap, else each in a picture of its own.

    Args:
        motion: to show.
        frames: poses, at equal times; at least 2.
        colour: "material", "strain", "contact" or "friction".

    Raises:
        ValueError: for values that are not allowed.
    """
    figure = Figure(figsize=(WIDTH, WIDTH), facecolor="white")
    axes = figure.add_axes((0.02, 0, 0.96, 1))
    given = draw_strip(axes, motion, poses_of(motion, frames), colour)
    drawn = 0.96 * WIDTH * float(np.ptp(axes.get_ylim()) / np.ptp(axes.get_xlim()))
    keyed = KEY_HEIGHT if given.colouring.key or given.colouring.limit else 0.0
    total = TITLE_HEIGHT + drawn + keyed + 0.05
    figure.set_size_inches(WIDTH, total)
    axes.set_position((0.02, (keyed + 0.05) / total, 0.96, drawn / total))
    figure.text(0.02, 1 - 0.5 * TITLE_HEIGHT / total, motion.name, va="center", fontsize=11, color=INK)
    draw_key(figure, given.colouring, (0.02, 0.05 / total, 0.96, 0.8 * keyed / total))
    return figure


def draw_strip(axes: "Axes", motion: Motion, poses: list[int], colour: str = "material") -> Setting:
    """Draw poses of a motion, with its path, times and a scale bar; return the setting that they share.

    Raises:
        ValueError: for a colour that a strip does not have.
    """
    if colour == "beams":
        raise ValueError("colour: beams is not allowed for a strip; give material, strain, contact or friction")
    given = setting(motion, poses, colour=colour, reach=math.inf)
    robots = [given.polygons(frame) for frame in poses]
    path, length = given.camera.project(motion.path), float(np.ptp(given.stretch.travel)) / 4
    draw_robots(axes, robots, given.stretch, path, poses, motion.times[poses], length, motion.skin is not None)
    return given


def poses_of(motion: Motion, frames: int) -> list[int]:
    """Numbers of ``frames`` frames of a motion, at least 2, at equal times from its beginning to its end."""
    count = whole_number("frames", frames, 2)
    return np.unique(np.linspace(0, len(motion.times) - 1, count).round().astype(int)).tolist()


def save_strip(motion: Motion, path: str | PathLike[str], **options: Any) -> int:
    """Write the picture of :func:`strip_picture` to a file, and return its size in bytes.

    Raises:
        ValueError: for a file that exists, and as :func:`strip_picture`.
    """
    return save_figure(strip_picture(motion, **options), path)


def pictures(
    motions: Sequence[Motion],
    *,
    seconds: float | None = None,
    rate: float = 15.0,
    width: int = 640,
    colour: str = "material",
    one_scale: bool = True,
) -> Iterator[Picture]:
    """Draw the pictures of a film, which shows one motion above the other, each on its own ground.

    Motions play together, all at the same pace; one that ends before the others stays as it is.

    Args:
        motions: to show.
        seconds: length of the film [s]; by default that of the longest motion.
        rate: pictures a second [Hz].
        width: width of a picture [pixels].
        colour: "material", "strain", "contact", "friction" or "beams".
        one_scale: whether all robots are drawn on equally long ground.

    Yields:
        Red, green, blue, shape (H, W, 3); H and W are even.

    Raises:
        ValueError: for values that are not allowed.
    """
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
        longest_way = max(float(np.ptp(given.stretch.travel)) for given in settings)
        settings = [_lengthened(given, longest_way) for given in settings]
    figure, panels = _panels(settings, plans, width, longest / seconds)
    canvas = FigureCanvasAgg(figure)
    return (_drawn(canvas, panels, settings, moment) for moment in zip(*plans, strict=True))


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
        motions: to show.
        path: path of the file.
        rate: pictures a second [Hz]; GIF counts hundredths of a second, to which it is rounded.
        colours: colours of the palette, 4 to 256.
        **options: keyword arguments of :func:`pictures`.

    Returns:
        Bytes written.

    Raises:
        ValueError: for a file that exists, and values that are not allowed.
    """
    new_path(path)
    colours = int(number("colours", colours, 4, 256))
    frames = [Image.fromarray(p) for p in pictures(_several(motions), rate=rate, **options)]
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
        ValueError: if imageio-ffmpeg is missing, for a file that exists, and values that are not allowed.
    """
    new_path(path)
    need_video()
    from imageio_ffmpeg import write_frames

    film = pictures(_several(motions), rate=rate, **options)
    first = next(film)
    size = first.shape[1], first.shape[0]
    writer = write_frames(str(path), size, fps=rate, codec="libx264", quality=8, macro_block_size=2)
    writer.send(None)
    for picture in (first, *film):
        writer.send(np.ascontiguousarray(picture))
    writer.close()
    return Path(path).stat().st_size


def _palette(pictures: list[Image.Image], count: int) -> Image.Image:
    """Find one palette of ``count`` colours for all pictures; small things get more weight than their area."""
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


def _several(motions: Motion | Sequence[Motion]) -> list[Motion]:
    return [motions] if isinstance(motions, Motion) else list(motions)


def _lengthened(given: Setting, length: float) -> Setting:
    """Copy of a setting whose ground has a given length along the way [m]."""
    travel = given.stretch.travel[0] + np.array([0.0, length])
    return replace(given, stretch=replace(given.stretch, travel=travel))


def _panels(settings: list[Setting], plans: list[list[int]], width: int, pace: float) -> tuple[Figure, list[Any]]:
    """Make a figure ``width`` pixels wide, with axes for each robot below its name and the speed of playback."""
    told = f", {pace:.2g}× as fast" if abs(pace - 1) > 0.05 else ""
    ranges = [
        limits(given, sorted(set(plan))[:: max(len(set(plan)) // 40, 1)])
        for given, plan in zip(settings, plans, strict=True)
    ]
    drawn = [width * (up[1] - up[0]) / (across[1] - across[0]) for across, up in ranges]
    keyed = [KEY if given.colouring.key or given.colouring.limit else 0 for given in settings]
    total = math.ceil(sum(drawn) + sum(keyed) + CAPTION * len(drawn)) // 2 * 2 + 2
    figure = Figure(figsize=(width / 100, total / 100), dpi=100, facecolor="white")
    top, panels = float(total), []
    for given, height, key, (across, up) in zip(settings, drawn, keyed, ranges, strict=True):
        caption = (top - 0.6 * CAPTION) / total
        figure.text(0.012, caption, given.motion.name + told, va="center", fontsize=8, color=INK)
        top -= CAPTION + height
        panels.append((figure.add_axes((0, top / total, 1, height / total)), across, up))
        top -= key
        draw_key(figure, given.colouring, (0.02, (top + 0.1 * key) / total, 0.96, 0.85 * key / total))
    return figure, panels


def _drawn(canvas: FigureCanvasAgg, panels: list[Any], settings: list[Setting], moment: tuple[int, ...]) -> Picture:
    for (axes, across, up), given, frame in zip(panels, settings, moment, strict=True):
        axes.clear()
        draw_motion(axes, given, frame, outlined=False)
        axes.set(xlim=across, ylim=up)
    canvas.draw()  # type: ignore[no-untyped-call]
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()  # type: ignore[no-untyped-call]
