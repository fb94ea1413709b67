"""Recorded poses as surfaces and as numbers: width, height, path."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from robots.inflatable import Frames, InflatableResult
from robots.inflatable_body import FIRST_BLADDER
from taichi_sim.lattice import LatticeBody
from taichi_sim.lattice.faces import FACE_CORNERS, corners, mean_of_face_corners

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Surface:
    """The exposed faces of a pose, in the world frame.

    Attributes:
        quads: corners of every face [m], shape (N, 4, 3), counter-clockwise seen from outside.
        voxels: to which voxel a face belongs, shape (N,).
    """

    quads: Array
    voxels: NDArray[np.int64]


def surface(result: InflatableResult, robot: int = 0, frame: int = -1) -> Surface:
    """The surface of a recorded pose, without gaps where links join voxels.

    Raises:
        ValueError: in one line, if nothing was recorded.
    """
    frames, body = recorded(result), result.body
    pose = (a[frame, robot] for a in (frames.positions, frames.orientations, frames.extents))
    loose = corners(body, *pose).reshape(-1, 3)
    knot = knots(body)
    size = np.bincount(knot.ravel())
    joined = np.stack([np.bincount(knot.ravel(), along) / size for along in loose.T], axis=-1)
    voxels, sides = body.topology.faces.T
    return Surface(joined[knot[voxels[:, None], FACE_CORNERS[sides]]], voxels)


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


def path(result: InflatableResult, robot: int = 0) -> Array:
    """Where the middle of the robot was, the mean of the corners of its faces [m], shape (F, 3)."""
    frames = recorded(result)
    poses = (a[:, robot] for a in (frames.positions, frames.orientations, frames.extents))
    return mean_of_face_corners(result.body, *poses)


def thickness(result: InflatableResult, robot: int = 0, frame: int = -1) -> Array:
    """Thickness of every voxel, in edges of the lattice, shape (V,): how full a bladder is."""
    extents = recorded(result).extents[frame, robot]
    return (extents[:, 4] + extents[:, 5]) / result.body.voxel_size


def recorded(result: InflatableResult) -> Frames:
    """The frames of a result that has some.

    Raises:
        ValueError: in one line, if nothing was recorded.
    """
    if result.frames is None:
        raise ValueError("frames: nothing was recorded; simulate with record_every")
    return result.frames


def regions(body: LatticeBody) -> NDArray[np.int64]:
    """Region of every voxel, shape (V,); see ``robots.inflatable_body``."""
    return np.asarray(body.regions)


def _skin_extent(result: InflatableResult, robot: int, frame: int) -> Array:
    seen = surface(result, robot, frame)
    skin = seen.quads[regions(result.body)[seen.voxels] < FIRST_BLADDER]
    return np.ptp(skin.reshape(-1, 3), axis=0)


@lru_cache(maxsize=16)
def knots(body: LatticeBody) -> NDArray[np.int64]:
    """Which corners of voxels are one point, because links join them: a number for each, shape (V, 8).

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
