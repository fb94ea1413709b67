"""The picture of a robot in motion: a film strip of its gait above the chart of its actuators."""

from dataclasses import replace
from os import PathLike
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from robots.inflatable.cores import kilopascals
from robots.inflatable.gaits import GaitDesign, PlayedGait, played, simulate, steps_of
from robots.inflatable.robot import ACTUATION, PUBLISHED, InflatableActuation, InflatableGeometry, InflatableResult
from robots.inflatable.schedule import BLADDERS
from robots.view import shape
from robots.view.drawing import draw_pose, draw_schedule
from robots.view.scene import INK, Camera
from robots.view.still import figure_content
from robots.view.strip import draw_strip
from robots.world import Terrain
from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import whole_number
from taichi_sim.base.files import write_bytes

__all__ = ["draw_pose", "draw_schedule", "motion_picture", "save_motion_picture"]

PATH_POINTS = 8  # poses recorded for each pose drawn, so that the path of the middle is a curve
WIDTH, CHART_HEIGHT, TITLE_HEIGHT, AXIS_HEIGHT = 8.0, 1.6, 0.45, 0.45  # [inches]
DOTS_PER_INCH = 160


def save_motion_picture(
    design: GaitDesign,
    terrain: Terrain,
    path: str | PathLike[str],
    *,
    geometry: InflatableGeometry = PUBLISHED,
    actuation: InflatableActuation = ACTUATION,
    frames: int = 6,
    counted_steps: int | None = None,
) -> InflatableResult:
    """Simulate a design in single precision and write the picture of its motion.

    Args:
        design: what to simulate.
        terrain: where.
        path: of the picture; its suffix chooses the format (png, pdf, svg).
        geometry: shape and materials of the robot.
        actuation: timing, friction and rates.
        frames: poses to draw, at equal times from the beginning of the gait to its end; at least 2.
        counted_steps: time steps by which the title counts the speed; None is the published convention.

    Returns:
        The result, with the frames recorded for the picture.

    Raises:
        ValueError: in one line, for a value that is not allowed.
    """
    frames = whole_number("frames", frames, 2)
    every = max(steps_of(design, actuation) // ((frames - 1) * PATH_POINTS), 1)
    result = simulate(design, terrain, geometry=geometry, actuation=actuation, precision="f32", record_every=every)
    if counted_steps is not None:
        result = replace(result, speed=result.speed_simulated * (result.steps / counted_steps))
    figure = motion_picture(result, design, terrain, actuation=actuation, frames=frames)
    form = Path(path).suffix[1:].lower() or "png"
    write_bytes(path, figure_content(figure, form, DOTS_PER_INCH))
    return result


def motion_picture(
    result: InflatableResult,
    design: GaitDesign,
    terrain: Terrain,
    *,
    actuation: InflatableActuation = ACTUATION,
    frames: int = 6,
    robot: int = 0,
) -> Figure:
    """The picture of a gait already simulated.

    Args:
        result: of ``simulate``, with frames.
        design: of the robot.
        terrain: where it was.
        actuation: how it was driven.
        frames: poses to draw.
        robot: place in the batch.
    """
    gait = played(design, actuation)
    edges = gait.edges.astype(float) * result.time_step
    times = shape.recorded(result).times
    # A robot has no poses after its gait, which may be shorter than others of the batch, nor once it diverged.
    there = np.flatnonzero(np.isfinite(shape.path(result, robot)).all(axis=1))
    poses = there[np.unique(np.linspace(0, len(there) - 1, frames).round().astype(int))] if len(there) else there
    figure = Figure(figsize=(WIDTH, TITLE_HEIGHT), facecolor="white")
    strip, chart = (figure.add_axes((0, 0, 1, 1), label=name) for name in ("strip", "chart"))
    figure.text(0, 0, _title(result, design, terrain, robot), va="top", fontsize=11, color=INK)
    if len(poses):
        grips = [_gripping(gait, edges, times[i]) for i in poses]
        camera = Camera(design.orientation, terrain.slope)
        draw_strip(strip, result, poses.tolist(), camera, grips, robot, not terrain.is_fluid)
    else:
        strip.set(xlim=(0, 1), ylim=(0, 0.01))
        strip.axis("off")
    draw_schedule(chart, design.schedule, edges)
    chart.vlines(times[poses], *chart.get_ylim(), color=INK, lw=0.8, ls=(0, (2, 2)))
    chart.set_xlabel("time [s]", fontsize=8, color=INK)
    _arrange(figure)
    return figure


def _arrange(figure: Figure) -> None:
    """Title, strip and chart one below the other, as high as the strip is in its full width."""
    strip, chart = figure.axes
    strip_height = 0.96 * WIDTH * float(np.ptp(strip.get_ylim()) / np.ptp(strip.get_xlim()))
    total = TITLE_HEIGHT + strip_height + CHART_HEIGHT + AXIS_HEIGHT
    figure.set_size_inches(WIDTH, total)
    strip.set_position((0.02, (AXIS_HEIGHT + CHART_HEIGHT) / total, 0.96, strip_height / total))
    chart.set_position((0.095, AXIS_HEIGHT / total, 0.885, (CHART_HEIGHT - 0.15) / total))
    figure.texts[0].set_position((0.02, 1 - 0.14 / total))


def _gripping(gait: PlayedGait, edges: Floats, time: float) -> tuple[bool, bool]:
    """Which feet the gait has gripping, rather than sliding, at a time [s]; before it begins both do."""
    column = int(np.searchsorted(edges[:-1], time)) - 1
    first, second = gait.levels[BLADDERS:, column] if column >= 0 else (1.0, 1.0)
    return bool(first >= 0.5), bool(second >= 0.5)


def _title(result: InflatableResult, design: GaitDesign, terrain: Terrain, robot: int) -> str:
    cores = "cores" if isinstance(design.pressure, tuple) else "core"
    body = f"{cores} at {kilopascals(design.pressure)}, heading {design.orientation:.3g}°"
    ok = result.status[robot] == "ok"
    what = f"{result.speed[robot]:.4f} BL/s" if ok else f"{result.status[robot]}"
    return f"{what} {terrain.spoken}; {body}".replace("-", "\N{MINUS SIGN}")
