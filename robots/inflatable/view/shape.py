"""Surface, width, height and curvature of the inflatable robot in recorded poses."""

import numpy as np

from robots.inflatable.body import FIRST_BLADDER, kinds_of
from robots.inflatable.simulation import InflatableResult
from robots.view.mesh import joined_faces, knots
from robots.view.motion import recorded
from taichi_sim.base.arrays import Bools, Floats, Ints
from taichi_sim.lattice.faces import corners, rotate


def surface(result: InflatableResult, robot: int = 0, frame: int = -1) -> tuple[Floats, Ints]:
    """Surface of a recorded pose, without gaps where links join voxels, as :func:`robots.view.mesh.joined_faces`.

    Raises:
        ValueError: if nothing was recorded.
    """
    frames, body = recorded(result.frames), result.body
    pose = (a[frame, robot] for a in (frames.positions, frames.orientations, frames.extents))
    return joined_faces(corners(*pose), knots(body), body.topology.faces)


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

    The centres of each row of voxels across a skin form a line. Its curvature at a voxel is that of the circle
    through the voxel and its two neighbours (Menger curvature), with the sign of its turn about the axis along the
    pouch; the mean is taken over all voxels with two neighbours. It is 0 for flat skins, whatever their distance, and
    1 / R for a round pouch whose skins have the radius R.
    """
    body, frames = result.body, recorded(result.frames)
    skin = _is_skin(result)
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


def _skin_extent(result: InflatableResult, robot: int, frame: int) -> Floats:
    quads, voxels = surface(result, robot, frame)
    return np.ptp(quads[_is_skin(result)[voxels]].reshape(-1, 3), axis=0)


def _is_skin(result: InflatableResult) -> Bools:
    """Which voxels are skin, seams and feet included, shape (V,)."""
    return kinds_of(np.asarray(result.body.regions)) < FIRST_BLADDER
