"""Faces of all solids of a motion in one frame."""

from functools import lru_cache

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from robots.view.motion import BALL, Motion
from taichi_sim.base.arrays import Floats, Ints
from taichi_sim.lattice import LatticeBody
from taichi_sim.lattice.faces import FACE_CORNERS, rotate
from taichi_sim.rigid.model.shapes import Box, Capsule, Solid, Sphere

BOX_CELLS = 6  # along each edge of a box; large faces are divided because faces are painted in order of distance
RINGS, SECTORS = 6, 20  # of a hemisphere
SIGNS = np.array([[i, j, k] for i in (-0.5, 0.5) for j in (-0.5, 0.5) for k in (-0.5, 0.5)])


def faces(motion: Motion, frame: int = -1, inner: Ints | None = None) -> tuple[Floats, Ints]:
    """Faces of a motion in a frame, and the node that each belongs to.

    Args:
        motion: motion to draw.
        frame: number of the frame.
        inner: faces of joined cubes to show beside those of their skin: cube and side, shape (M, 2).

    Returns:
        Corners, counter-clockwise as seen from outside [m], shape (N, 4, 3), of which two may coincide; numbers of
        the nodes, shape (N,).
    """
    if motion.skin is not None:
        seen = motion.skin.faces if inner is None else np.concatenate([motion.skin.faces, inner])
        return joined_faces(boxes(motion, frame), motion.skin.knots, seen)
    places, turns, scales = motion.translation[frame], motion.rotation[frame], motion.scale[frame]
    forms = [_form(node.solid) for node in motion.nodes]
    owners = np.repeat(np.arange(len(forms)), [len(form) for form in forms])
    quads = np.concatenate(forms) * scales[owners, None]
    return places[owners, None] + rotate(turns[owners, None], quads), owners


@lru_cache(maxsize=64)
def _form(solid: Solid) -> Floats:
    """Faces of a centred solid, shape (N, 4, 3) [m]."""
    if isinstance(solid, Box):
        return _box(np.asarray(solid.size, float))
    half = np.linspace(0, np.pi / 2, RINGS + 1)
    length = solid.length if isinstance(solid, Capsule) else 0.0
    radius = solid.radius
    assert isinstance(solid, Capsule | Sphere)
    upper = np.stack([np.sin(half), np.cos(half)], axis=1) * radius + [0.0, length / 2]
    lower = upper[::-1] * [1.0, -1.0]
    between = np.linspace(upper[-1], lower[0], BOX_CELLS + 1)[1:-1] if length else np.empty((0, 2))
    return _turned(np.concatenate([upper, between, lower if length else lower[1:]]))


def _box(size: Floats) -> Floats:
    """Faces of a centred cuboid; each side is divided into ``BOX_CELLS`` by ``BOX_CELLS`` cells."""
    u, v = (grid.ravel() for grid in np.meshgrid(*2 * [np.arange(BOX_CELLS) / BOX_CELLS]))
    step = 1 / BOX_CELLS
    cells = np.stack([[u, v], [u + step, v], [u + step, v + step], [u, v + step]]).transpose(2, 0, 1)[..., None]
    corners = (SIGNS * size)[FACE_CORNERS]
    first, along, across = (corners[:, None, None, k] for k in (0, 1, 3))
    return (first + cells[:, :, 0] * (along - first) + cells[:, :, 1] * (across - first)).reshape(-1, 4, 3)


def _turned(profile: Floats) -> Floats:
    """Faces of the surface of revolution about z of a profile (radius, z), given from top to bottom."""
    angle = np.linspace(0, 2 * np.pi, SECTORS + 1)
    x, y = (profile[:, :1] * along for along in (np.cos(angle), np.sin(angle)))
    points = np.stack([x, y, np.broadcast_to(profile[:, 1:], x.shape)], axis=-1)
    quads = np.stack([points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]], axis=2)
    return quads.reshape(-1, 4, 3)


def boxes(motion: Motion, frame: int) -> Floats:
    """Corners of a motion's cubes in a frame [m], shape (N, 8, 3); corner 4 i + 2 j + k is at the signs (i, j, k)."""
    offsets = SIGNS * motion.scale[frame][:, None]
    return motion.translation[frame][:, None] + rotate(motion.rotation[frame][:, None], offsets)


def ball_at(place: Floats, radius: float) -> Floats:
    """Faces of a ball, shape (N, 4, 3) [m]."""
    return place + 2 * radius * _form(BALL)


def joined_faces(loose: Floats, knot: Ints, seen: Ints) -> tuple[Floats, Ints]:
    """Faces of boxes that are joined at their corners, and the box of each, as :func:`faces` returns them.

    Args:
        loose: corners of the boxes [m], shape (V, 8, 3), ordered as in ``taichi_sim.lattice.faces.corners``.
        knot: number of the point that each corner belongs to, shape (V, 8); the point is the mean of its corners.
        seen: faces to return: box and side, shape (N, 2).
    """
    boxes, sides = seen.T
    return joined_corners(loose, knot)[knot[boxes[:, None], FACE_CORNERS[sides]]], boxes


def joined_corners(loose: Floats, knot: Ints) -> Floats:
    """Points that joined corners of boxes share: the means of these corners [m], shape (K, 3).

    Args:
        loose: corners of the boxes [m], shape (V, 8, 3).
        knot: number of the point that each corner belongs to, shape (V, 8).
    """
    size = np.bincount(knot.ravel())
    return np.stack([np.bincount(knot.ravel(), along) / size for along in loose.reshape(-1, 3).T], axis=-1)


@lru_cache(maxsize=16)
def knots(body: LatticeBody) -> Ints:
    """Number the corners of voxels, shape (V, 8); corners that links join have the same number.

    Corners are ordered as in ``taichi_sim.lattice.faces.corners``.
    """
    corner = np.arange(8 * body.voxel_count).reshape(-1, 8)
    minus, plus = body.topology.links.T
    bit = 4 >> body.topology.link_axes  # bit of a corner's number that gives its side along the link's axis
    across = np.array([[c for c in range(8) if not c & b] for b in (4, 2, 1)])[body.topology.link_axes]
    # The corners on side + of the one voxel meet those on side - of the other.
    first = corner[minus[:, None], across + bit[:, None]].ravel()
    second = corner[plus[:, None], across].ravel()
    joints = sparse.coo_array((np.ones(first.size, bool), (first, second)), shape=(corner.size, corner.size))
    return csgraph.connected_components(joints, directed=False)[1].reshape(corner.shape)
