"""Film strips: poses of one motion on the same stretch of ground."""

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.patheffects import withStroke

from robots.view.drawing import Stretch, draw_ground, draw_polygons
from robots.view.scene import INK, Polygons
from taichi_sim.base.arrays import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes

GAP = 0.06  # between pictures, in lengths of the robot
TEXT = 0.026  # height of a line of text, in widths of the strip
ASPECT = 2.0  # width per height of a strip that would be best
SCALE_BARS = np.array([0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0])  # [m]


def draw_robots(
    axes: "Axes",
    robots: list[Polygons],
    stretch: Stretch,
    path: Floats,
    poses: list[int],
    times: Floats,
    length: float,
    outlined: bool = True,
) -> None:
    """Draw poses with the path of the robot's middle, times and a scale bar; axes in metres on paper.

    Poses that are clear of each other share one ground. Else each is a picture of its own, with the same
    stretch of ground, so that its place there shows how far the robot has come; they read like lines of text.

    Args:
        axes: to draw on; this sets their limits.
        robots: its poses on paper.
        stretch: the ground below all of them.
        path: path of the robot's middle on paper [m], shape (F, 2).
        poses: how far along the path they are.
        times: times of the poses [s].
        length: length of the robot [m].
        outlined: whether faces have outlines.
    """
    rim, together = stretch.rim, _apart(robots)
    shifts = np.zeros((len(poses), 2)) if together else _places(robots, rim, GAP * length)
    for k, (i, shift) in enumerate(zip(poses, shifts, strict=True)):
        if k == 0 or not together:
            draw_ground(axes, stretch, shift, 10.0 * k)
        draw_polygons(axes, robots[k], shift, 10.0 * k + 1, outlined)
        passed = path[poses[k - 1] if k and together else 0 : i + 1]
        draw_path(axes, passed + shift, 10.0 * k + 5)
        at = path[i, 0] if together else rim[0, 0]
        foot = np.interp(at, rim[:2, 0], rim[:2, 1])
        _write(axes, f"{times[k]:.1f} s", (at + shift[0], foot + shift[1]), together)
    line = TEXT * (np.ptp(shifts[:, 0]) + np.ptp(rim[:, 0]))
    lowest = draw_scale_bar(axes, rim[:2] + shifts[-1] - (0.0, (1.6 if together else 0.4) * line))
    corners = np.concatenate(
        [c + shift for r, shift in zip(robots, shifts, strict=True) for c in (rim, r.corners.reshape(-1, 2))]
    )
    (left, bottom), (right, top) = corners.min(axis=0), corners.max(axis=0)
    axes.set_xlim(left, right)
    axes.set_ylim(min(bottom, lowest) - 1.5 * line, top + 0.3 * line)
    axes.set_aspect("equal")
    axes.axis("off")


def _apart(robots: list[Polygons]) -> bool:
    """Whether no two poses overlap on paper from left to right."""
    ranges = sorted((r.corners[..., 0].min(), r.corners[..., 0].max()) for r in robots)
    return all(before[1] < after[0] for before, after in pairwise(ranges))


def _places(robots: list[Polygons], rim: Floats, gap: float) -> Floats:
    """Shifts on paper that arrange the pictures in lines, shape (N, 2) [m]."""
    count = len(robots)
    right, climb = np.ptp(rim[:, 0]) + gap, rim[1, 1] - rim[0, 1]
    # Heights are over the near edge of the ground, as the grounds of a column are parallel.
    rise = climb / (rim[1, 0] - rim[0, 0])
    corners = np.concatenate([r.corners.reshape(-1, 2) for r in robots]) - rim[0]
    high = (corners[:, 1] - rise * corners[:, 0]).max()

    def down(columns: int) -> float:
        return float(high + gap + TEXT * columns * right)

    def misfit(columns: int) -> float:
        tall = -(-count // columns) * down(columns) + abs(climb)
        return abs(float(np.log(columns * right / tall / ASPECT)))

    columns = min(range(1, count + 1), key=misfit)
    row, column = np.divmod(np.arange(count), columns)
    return np.stack([column * right, -row * down(columns)], axis=1)


def draw_path(axes: "Axes", path: Floats, zorder: float) -> None:
    """Draw the path of a robot's middle, given on paper [m], shape (F, 2), with a dot at its end."""
    halo = [withStroke(linewidth=2.4, foreground="white", alpha=0.9)]
    axes.plot(*path.T, color=INK, lw=1.0, zorder=zorder, path_effects=halo, solid_capstyle="round")
    axes.plot(*path[-1], "o", color=INK, ms=3.2, mec="white", mew=0.7, zorder=1000.0)


def _write(axes: "Axes", text: str, place: tuple[float, float], centred: bool) -> None:
    """Write a text below a place on paper [m]."""
    side = "center" if centred else "left"
    axes.annotate(text, place, (0, -3), textcoords="offset points", ha=side, va="top", fontsize=8, color=INK)


def draw_scale_bar(axes: "Axes", edge: Floats) -> float:
    """Draw a bar at the right end of a line along the way, shape (2, 2) [m], and return its lowest y."""
    stretch = float(np.hypot(*(edge[1] - edge[0])))
    bar = SCALE_BARS[max(int(np.searchsorted(SCALE_BARS, stretch / 4)) - 1, 0)]
    ends = edge[1] + np.array([[bar], [0.0]]) * (edge[0] - edge[1]) / stretch
    axes.plot(*ends.T, color=INK, lw=2.2, solid_capstyle="butt")
    lowest = float(ends[:, 1].min())
    _write(axes, f"{100 * bar:.0f} cm" if bar < 1 else f"{bar:.0f} m", (float(ends[:, 0].mean()), lowest), True)
    return lowest
