"""Draw the picture of the inflatable robot in motion, with a title that gives speed, terrain and shape."""

from dataclasses import replace
from os import PathLike
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from robots.inflatable import simulation
from robots.inflatable.actuation import ACTUATION, InflatableActuation
from robots.inflatable.body import PUBLISHED, InflatableGeometry
from robots.inflatable.convention import SpeedConvention, counting_of, speeds_by
from robots.inflatable.design import InflatableDesign, kilopascals
from robots.inflatable.simulation import InflatableResult
from robots.inflatable.timing import gait_steps
from robots.inflatable.view.motion import inflatable_motion
from robots.view.picture import PATH_POINTS, WIDTH, motion_picture, save_picture
from robots.view.scene import INK
from robots.world import Terrain
from taichi_sim.base.checks import whole_number
from taichi_sim.base.short_text import decimal


def save_motion_picture(
    design: InflatableDesign,
    terrain: Terrain,
    path: str | PathLike[str],
    *,
    geometry: InflatableGeometry = PUBLISHED,
    actuation: InflatableActuation = ACTUATION,
    frames: int = 6,
    convention: SpeedConvention | None = None,
) -> InflatableResult:
    """Simulate a design of the inflatable robot in single precision and write the picture of its motion.

    Args:
        design: what to simulate.
        terrain: where.
        path: path of the picture; its suffix chooses the format (png, pdf, svg).
        geometry: shape and materials of the robot.
        actuation: timing, friction and rates.
        frames: poses to draw; at least 2.
        convention: by which the title's speed counts; None for the published one.

    Returns:
        The result, with the frames recorded for the picture.

    Raises:
        ValueError: for a value that is not allowed.
    """
    frames = whole_number("frames", frames, 2)
    every = max(gait_steps(design.schedule, actuation) // ((frames - 1) * PATH_POINTS), 1)
    result = simulation.simulate(
        design,
        terrain,
        geometry=geometry,
        actuation=actuation,
        counting=counting_of(convention),
        precision="f32",
        record_every=every,
    )
    result = replace(result, speed=speeds_by(convention, result, geometry, actuation))
    save_picture(inflatable_picture(result, design, terrain, actuation=actuation, frames=frames), Path(path))
    return result


def inflatable_picture(
    result: InflatableResult,
    design: InflatableDesign,
    terrain: Terrain,
    *,
    actuation: InflatableActuation = ACTUATION,
    frames: int = 6,
    robot: int = 0,
) -> Figure:
    """Draw a simulated gait of the inflatable robot; the title gives speed, terrain and shape.

    The result needs recorded frames. A robot that diverged is drawn up to its last finite pose.
    """
    title = inflatable_title(result, design, terrain, robot)
    if result.frames is not None and not np.isfinite(result.frames.positions[0, robot]).all():
        figure = Figure(figsize=(WIDTH, 0.45), facecolor="white")
        figure.text(0.02, 0.7, title, va="top", fontsize=11, color=INK)
        return figure
    motion = inflatable_motion(result, design, terrain, actuation=actuation, robot=robot)
    return motion_picture(motion, frames=frames, title=title)


def inflatable_title(result: InflatableResult, design: InflatableDesign, terrain: Terrain, robot: int = 0) -> str:
    """Title for an inflatable robot: speed, terrain, core pressure and heading in one line."""
    cores = "cores" if isinstance(design.pressure, tuple) else "core"
    body = f"{cores} at {kilopascals(design.pressure)}, heading {design.orientation:.3g}°"
    ok = result.status[robot] == "ok"
    what = f"{decimal(result.speed[robot])} BL/s" if ok else f"{result.status[robot]}"
    return f"{what} {terrain.spoken}; {body}".replace("-", "\N{MINUS SIGN}")
