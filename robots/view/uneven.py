"""Uneven ground below motions: nodes for files, pieces for pictures, and which points it hides."""

from dataclasses import dataclass, replace

import numpy as np

from robots.view.motion import Motion
from robots.view.scene import AMBIENT, GROUND, LIGHT, Camera
from taichi_sim.base.arrays import Bools, Floats, Ints
from taichi_sim.lattice import Relief

MOST_NODES = 10_000  # of the ground in files
MOST_PIECES = 6_000  # of the ground in pictures
MARGIN = 0.5  # ground around a motion in files, in lengths of the robot
DARKEST = 0.3  # darkening of the ground where its friction is largest
LEAST_LIT = 0.65  # least brightness of slopes
CONTRAST = 1.2  # of slopes, relative to the shading of robots
MOST_STEPS = 64  # along the ray from a point towards the viewer
WATER_TINT = (0.55, 0.78, 1.0)  # factors of red, green, blue below water
LEFT_BELOW = 0.04  # thickness of the ground at its lowest place, relative to the size of the visible ground


def cut(relief: Relief, low: Floats, high: Floats, most: int = MOST_NODES) -> Relief:
    """Cut out the part of a ground between two corners (x, y) [m].

    It keeps all nodes, or every second, third, ... node so that there are at most ``most``.
    """
    first = np.floor((low - relief.origin) / relief.spacing).astype(int)
    last = np.maximum(np.ceil((high - relief.origin) / relief.spacing).astype(int), first + 1)
    step = 1
    while (-((first - last) // step) + 1).prod() > most:
        step += 1
    nodes = [np.arange(a, b + step, step) for a, b in zip(first, last, strict=True)]
    table = np.ix_(*(np.clip(k, 0, count - 1) for k, count in zip(nodes, relief.heights.shape, strict=True)))
    x, y = (relief.origin + first * relief.spacing).tolist()
    friction = None if relief.friction is None else relief.friction[table]
    spacing = step * relief.spacing
    return replace(relief, heights=relief.heights[table], spacing=spacing, origin=(x, y), friction=friction)


def relief_around(motion: Motion) -> Relief | None:
    """Part of the uneven ground around a motion, for files; None if the ground is a plane."""
    if motion.ground.relief is None:
        return None
    places = motion.translation[..., :2].reshape(-1, 2)
    margin = MARGIN * float(np.ptp(motion.translation[0], axis=0).max())
    return cut(motion.ground.relief, places.min(axis=0) - margin, places.max(axis=0) + margin)


def nodes(relief: Relief, level: float) -> Floats:
    """Positions of the nodes of a ground above z = level [m], shape (X Y, 3)."""
    x, y = (start + relief.spacing * np.arange(n) for start, n in zip(relief.origin, relief.heights.shape, strict=True))
    return np.stack([*np.meshgrid(x, y, indexing="ij"), level + relief.heights], axis=-1).reshape(-1, 3)


def triangles(relief: Relief) -> Ints:
    """Numbers of the nodes of the triangles that a ground is made of, counter-clockwise from above, shape (N, 3)."""
    number = np.arange(relief.heights.size).reshape(relief.heights.shape)
    a, b, c, d = (part.ravel() for part in (number[:-1, :-1], number[1:, :-1], number[:-1, 1:], number[1:, 1:]))
    return np.stack([np.stack([a, b, d], axis=1), np.stack([a, d, c], axis=1)], axis=1).reshape(-1, 3)


def tints(heights: Floats, friction: Floats, whole: Relief) -> Floats:
    """Factors of the colour of ground, red, green, blue: darker the more it grips, blue below water, shape (N, 3).

    Args:
        heights: heights at N places on a ground [m], shape (N,).
        friction: factors of friction there, shape (N,).
        whole: the whole ground; it is not darkened where its friction is smallest.
    """
    low, high = (1.0, 1.0) if whole.friction is None else (float(whole.friction.min()), float(whole.friction.max()))
    shade = 1 - DARKEST * np.clip((friction - low) / max(high - low, 1e-12), 0, 1)
    return shade[:, None] * np.where(below_water(heights, whole)[:, None], WATER_TINT, 1.0)


def node_tints(relief: Relief, whole: Relief) -> Floats:
    """:func:`tints` of the nodes of a part of a ground."""
    friction = np.ones(relief.heights.shape) if relief.friction is None else relief.friction
    return tints(relief.heights.ravel(), friction.ravel(), whole)


def below_water(heights: Floats, relief: Relief) -> Bools:
    """Whether heights over the floor [m] are below the water of a ground."""
    found: Bools = heights < (relief.water.level if relief.water else -np.inf)
    return found


def is_plain(relief: Relief) -> bool:
    """Whether a ground has the same colour everywhere."""
    return relief.friction is None and relief.water is None


@dataclass(frozen=True, eq=False)
class Pieces:
    """Uneven ground as a picture shows it.

    Attributes:
        quads: corners of its pieces, those at the back first [m], shape (N, 4, 3).
        colours: of the pieces: red, green, blue from 0 to 1, shape (N, 3).
        profile: the near edge [m], shape (K, 3).
        end: the right edge, from near to far [m], shape (L, 3).
        lines: ends of ridge lines, beyond which it slopes away from the viewer [m], shape (M, 2, 3).
        base: z of the lower end of the cut sides [m].
    """

    quads: Floats
    colours: Floats
    profile: Floats
    end: Floats
    lines: Floats
    base: float


def pieces(relief: Relief, level: float, camera: Camera, area: Floats) -> Pieces:
    """Divide the visible part of a ground into pieces at least as large as its cells.

    Args:
        relief: the ground.
        level: z from which its heights are measured [m].
        camera: camera that looks at it.
        area: limits of the visible ground along the heading, and to the left of it [m], shape (2, 2).
    """
    step = relief.spacing * max(1, int(np.ceil(np.sqrt(np.ptp(area, axis=1).prod() / MOST_PIECES) / relief.spacing)))
    start = camera.by_the_way(np.array([[*relief.origin, 0.0]]))[0]
    marks = []
    for (low, high), begin in zip(area, start, strict=True):
        inner = begin + step * np.arange(np.ceil((low - begin) / step), np.floor((high - begin) / step) + 1)
        marks.append(np.unique(np.concatenate([[low], inner, [high]])))
    x, y = np.moveaxis(camera.in_space(*np.meshgrid(*marks, indexing="ij")), -1, 0)
    points = np.stack([x, y, level + relief.height(x, y)], axis=-1)
    quads = np.stack([points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]], axis=2).reshape(-1, 4, 3)
    normals = np.cross(quads[:, 2] - quads[:, 0], quads[:, 3] - quads[:, 1])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True) + 1e-30
    light = LIGHT @ camera.frame / np.linalg.norm(LIGHT)
    steep = CONTRAST * (1.05 - AMBIENT) * (np.clip(normals @ light, 0, None) - light[2])
    bright = np.clip(1 + steep, LEAST_LIT, 1.06)
    middles = quads.mean(axis=1)
    tinted = bright[:, None] * tints(middles[:, 2] - level, relief.factor(*middles[:, :2].T), relief)
    facing = normals @ camera.toward > 0
    lines = _ridges(points, facing.reshape(len(points) - 1, -1))
    lines = lines[~hidden(lines.mean(axis=1) + np.array([0.0, 0.0, 0.1 * step]), relief, level, camera)]
    seen = np.flatnonzero(facing)
    seen = seen[np.argsort(quads[seen].mean(axis=1) @ camera.toward, kind="stable")]
    base = float(points[..., 2].min() - LEFT_BELOW * np.ptp(area, axis=1).max())
    colours = np.clip(tinted[seen] * np.array(GROUND), 0, 1)
    end = points[-1 if camera.shift_right > 0 else 0]
    return Pieces(quads[seen], colours, points[:, 0], end, lines, base)


def _ridges(points: Floats, facing: Bools) -> Floats:
    """Edges between pieces that face the viewer and pieces that do not, shape (M, 2, 3); nodes have shape (K, L, 3)."""
    i, j = np.nonzero(facing[1:] != facing[:-1])
    across = np.stack([points[i + 1, j], points[i + 1, j + 1]], axis=1)
    i, j = np.nonzero(facing[:, 1:] != facing[:, :-1])
    return np.concatenate([across, np.stack([points[i, j + 1], points[i + 1, j + 1]], axis=1)])


def hidden(points: Floats, relief: Relief, level: float, camera: Camera) -> Bools:
    """Whether the ground hides points, shape (N, 3) [m], from the viewer, shape (N,)."""
    found = np.zeros(len(points), bool)
    toward = camera.toward
    if not len(points) or toward[2] <= 0:
        return found
    reach = (relief.heights.max() + level - points[:, 2].min()) / toward[2]
    steps = int(np.clip(np.ceil(reach / relief.spacing), 0, MOST_STEPS))
    for along in np.arange(1, steps + 1) * relief.spacing:
        x, y, z = np.moveaxis(points + along * toward, -1, 0)
        found |= level + relief.height(x, y) > z
    return found
