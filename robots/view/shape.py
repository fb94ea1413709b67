"""Surfaces of recorded poses of the inflatable robot, and numbers: width, height, curvature, path."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from robots.frames import Frames
from robots.inflatable.body import FIRST_BLADDER, kinds_of
from robots.inflatable.simulation import InflatableResult
from taichi_sim.base.arrays import Floats, Ints
from taichi_sim.lattice import LatticeBody
from taichi_sim.lattice.faces import FACE_CORNERS, corners, mean_of_face_corners, rotate


@dataclass(frozen=True, eq=False)
class Surface:
    """Outer faces of a pose, in the world frame.

    Attributes:
        quads: corners of every face [m], shape (N, 4, 3), counter-clockwise seen from outside.
        voxels: voxel that each face belongs to, shape (N,).
    """

    quads: Floats
    voxels: Ints


def surface(result: InflatableResult, robot: int = 0, frame: int = -1) -> Surface:
    """Surface of a recorded pose, without gaps where links join voxels.

    Raises:
        ValueError: if nothing was recorded.
    """
    frames, body = recorded(result), result.body
    pose = (a[frame, robot] for a in (frames.positions, frames.orientations, frames.extents))
    return joined_surface(corners(*pose), knots(body), body.topology.faces)


def joined_surface(loose: Floats, knot: Ints, faces: Ints) -> Surface:
    """Surface of boxes that are joined at their corners.

    Args:
        loose: corners of the boxes [m], shape (V, 8, 3), ordered as in ``taichi_sim.lattice.faces.corners``.
        knot: which corners are one point, in the middle of them, shape (V, 8).
        faces: that are seen: box and side, shape (N, 2).
    """
    voxels, sides = faces.T
    return Surface(joined_corners(loose, knot)[knot[voxels[:, None], FACE_CORNERS[sides]]], voxels)


def joined_corners(loose: Floats, knot: Ints) -> Floats:
    """Points that joined corners of boxes share, their means [m], shape (K, 3).

    Args:
        loose: corners of the boxes [m], shape (V, 8, 3).
        knot: number of the point that each corner belongs to, shape (V, 8).
    """
    size = np.bincount(knot.ravel())
    return np.stack([np.bincount(knot.ravel(), along) / size for along in loose.reshape(-1, 3).T], axis=-1)


def width(result: InflatableResult, robot: int = 0, frame: int = 0) -> float:
    """Extent of the skin across the pouch, along x [m]; bladders do not count."""
    return float(_skin_extent(result, robot, frame)[0])


def height(result: InflatableResult, robot: int = 0, frame: int = 0) -> float:
    """Extent of the skin upwards, along z [m]; bladders do not count."""
    return float(_skin_extent(result, robot, frame)[2])


def ratio(result: InflatableResult, robot: int = 0, frame: int = 0) -> float:
    """Width per height: about 1 for a round pouch, more for a flat one.

    Read it off the first frame: a robot that has rolled by a quarter shows its width upwards.
    """
    extent = _skin_extent(result, robot, frame)
    return float(extent[0] / extent[2])


def curvature(result: InflatableResult, robot: int = 0, frame: int = 0) -> float:
    """Mean curvature of the two skins across the pouch [1/m]; positive where they bulge outwards.

    Each row of voxels across a skin is a line through their centres. Its curvature at a voxel is that of the circle
    through it and its two neighbours (Menger's), seen along the pouch; the mean is taken over all voxels that have two.
    So flat skins have 0, whatever their distance, and a round pouch whose skins have the radius R has 1 / R.
    """
    body, frames = result.body, recorded(result)
    skin = kinds(body) < FIRST_BLADDER
    layers = np.unique(body.voxels[skin, 2])
    found = []
    for layer, outward in zip(layers, (-1.0, 1.0), strict=True):
        voxels = np.flatnonzero(skin & (body.voxels[:, 2] == layer))
        places, counts = body.voxels[voxels, :2], np.ptp(body.voxels[voxels, :2], axis=0) + 1
        rows = voxels[np.lexsort((places[:, 0], places[:, 1]))].reshape(counts[1], counts[0])
        points = frames.positions[frame, robot][rows].astype(float)
        along = rotate(frames.orientations[frame, robot][rows].astype(float), np.array([0.0, 1.0, 0.0]))
        found.append(outward * menger_curvature(points, along[:, 1:-1]))
    return float(np.mean(found))


def menger_curvature(points: Floats, axis: Floats) -> Floats:
    """Curvature of the circles through each three consecutive points [1/m], shape (..., N - 2).

    Args:
        points: points of lines, shape (..., N, 3) [m].
        axis: unit vectors about which a line of positive curvature turns, shape (..., N - 2, 3).
    """
    first, second = points[..., 1:-1, :] - points[..., :-2, :], points[..., 2:, :] - points[..., 1:-1, :]
    turn = (np.cross(first, second) * axis).sum(axis=-1)
    lengths = [np.linalg.norm(side, axis=-1) for side in (first, second, first + second)]
    return 2 * turn / (lengths[0] * lengths[1] * lengths[2])


def path(result: InflatableResult, robot: int = 0) -> Floats:
    """Path of the robot's middle, which is the mean of the corners of its faces [m], shape (F, 3)."""
    frames = recorded(result)
    poses = (a[:, robot] for a in (frames.positions, frames.orientations, frames.extents))
    return mean_of_face_corners(result.body, *poses)


def recorded(result: InflatableResult) -> Frames:
    """Return the recorded frames of a result.

    Raises:
        ValueError: if nothing was recorded.
    """
    if result.frames is None:
        raise ValueError("frames: nothing was recorded; simulate with record_every")
    return result.frames


def kinds(body: LatticeBody) -> Ints:
    """Region of every voxel, shape (V,), numbered as in ``robots.inflatable.body``; all cores count as one."""
    return kinds_of(np.asarray(body.regions))


def _skin_extent(result: InflatableResult, robot: int, frame: int) -> Floats:
    seen = surface(result, robot, frame)
    skin = seen.quads[kinds(result.body)[seen.voxels] < FIRST_BLADDER]
    return np.ptp(skin.reshape(-1, 3), axis=0)


@lru_cache(maxsize=16)
def knots(body: LatticeBody) -> Ints:
    """Number the corners of voxels, shape (V, 8): corners that links join have the same number.

    Corners are ordered as in ``taichi_sim.lattice.faces.corners``.
    """
    corner = np.arange(8 * body.voxel_count).reshape(-1, 8)
    minus, plus = body.topology.links.T
    bit = 4 >> body.topology.link_axes  # of a corner's number that says on which side of the axis it is
    across = np.array([[c for c in range(8) if not c & b] for b in (4, 2, 1)])[body.topology.link_axes]
    # The corners on side + of the one voxel meet those on side - of the other.
    first = corner[minus[:, None], across + bit[:, None]].ravel()
    second = corner[plus[:, None], across].ravel()
    joints = sparse.coo_array((np.ones(first.size, bool), (first, second)), shape=(corner.size, corner.size))
    return csgraph.connected_components(joints, directed=False)[1].reshape(corner.shape)
