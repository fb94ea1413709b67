"""Draw the picture of a robot in motion: a film strip of its poses above a chart of its channels."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from robots.robot import HERE, Robot, World
from robots.view.drawing import draw_levels, label_rows
from robots.view.film import draw_strip, poses_of
from robots.view.motion import Channel, Motion
from robots.view.scene import INK
from robots.view.still import arrange, figure_content
from taichi_sim.base.compute import Compute
from taichi_sim.base.files import write_bytes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PATH_POINTS = 8  # poses recorded for each pose drawn, so that the path of the middle is smooth
WIDTH, ROW_HEIGHT, AXIS_HEIGHT = 8.0, 0.145, 0.45  # [inches]
DOTS_PER_INCH = 160
LINE_ROWS = 2.2  # height of a curve in the chart, in rows of a switch


def motion_picture(motion: Motion, *, frames: int = 6, title: str | None = None) -> Figure:
    """Draw poses of a motion above its channels over time; dashed lines mark the times of the poses.

    Args:
        motion: motion of any robot.
        frames: number of poses, equally spaced in time, see ``robots.view.film.poses_of``; at least 2.
        title: title of the picture; by default the motion's name.

    Raises:
        ValueError: for fewer than 2 frames.
    """
    poses = poses_of(motion, frames)
    figure = Figure(facecolor="white")
    strip, chart = (figure.add_axes((0, 0, 1, 1), label=name) for name in ("strip", "chart"))
    draw_strip(strip, motion, poses)
    height = ROW_HEIGHT * draw_channels(chart, motion.channels)
    chart.vlines(motion.times[poses], *chart.get_ylim(), color=INK, lw=0.8, ls=(0, (2, 2)))
    chart.set_xlabel("time [s]", fontsize=8, color=INK)
    total = arrange(strip, motion.name if title is None else title, WIDTH, below=AXIS_HEIGHT + height)
    chart.set_position((0.125, AXIS_HEIGHT / total, 0.855, (height - 0.12) / total))
    return figure


def save_robot_picture(robot: Robot, world: World, path: Path, compute: Compute = HERE) -> None:
    """Simulate a robot without free variables and write a picture of its motion as png, pdf or svg, by the suffix."""
    if robot.pictured:
        robot.save_picture(world, path)
        return
    replay = robot.replay((), world, frames=PATH_POINTS * 6, compute=compute)
    save_picture(motion_picture(replay.motion, title=replay.title or None), path)


def save_picture(figure: Figure, path: Path) -> None:
    """Write a picture as PNG, PDF or SVG, chosen by the suffix of the path."""
    write_bytes(path, figure_content(figure, path.suffix[1:].lower() or "png", DOTS_PER_INCH))


def draw_channels(axes: "Axes", channels: tuple[Channel, ...]) -> float:
    """Draw the channels below each other: switches as rows of cells, or, if there are none, values as curves.

    Each curve is scaled to its own range; channels that do not change are left out.

    Returns:
        The height of the chart, in rows of a switch.
    """
    if switches := [channel for channel in channels if channel.switch]:
        _draw_switches(axes, switches)
        return len(switches) + 0.5  # the commands of actuators are enough
    curves = [channel for channel in channels if np.ptp(channel.values) > 0]
    for number, channel in enumerate(curves):
        heights = 0.92 - 0.84 * channel.levels(channel.times)
        axes.plot(channel.times, LINE_ROWS * (number + heights), color=channel.colour, lw=1.1)
    if curves:
        axes.set_ylim(LINE_ROWS * len(curves), 0.0)
        axes.set_xlim(min(c.times[0] for c in curves), max(c.times[-1] for c in curves))
        places = LINE_ROWS * np.arange(0.5, len(curves))
        label_rows(axes, places, [f"{c.name} [{c.unit}]" if c.unit else c.name for c in curves])
    return max(0.5, LINE_ROWS * len(curves))


def _draw_switches(axes: "Axes", switches: list[Channel]) -> None:
    groups = [channel.group for channel in switches]
    new = [k == 0 or groups[k] != groups[k - 1] for k in range(len(switches))]
    # Within a group, such as bladders 1 to 8, the number is enough.
    names = [
        channel.name if first else channel.name.removeprefix(channel.group).strip()
        for channel, first in zip(switches, new, strict=True)
    ]
    levels = np.array([channel.values[:-1] for channel in switches])
    colours = np.array([channel.colour for channel in switches])
    draw_levels(axes, levels, switches[0].times, colours, names, apart=new.index(True, 1) if any(new[1:]) else 0)
