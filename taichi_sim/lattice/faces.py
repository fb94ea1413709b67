"""Corners and faces of deformed voxels (Hiller & Lipson 2014): what a body's surface looks like and where it is.

Poses, strains and sizes may be traced arrays, so that what is computed from them has derivatives (see ``arrays``).
"""

import numpy as np

from taichi_sim.autodiff.arrays import placed
from taichi_sim.lattice.body import LatticeBody
from taichi_sim.lattice.topology import SIDES


def half_extents(body: LatticeBody, strains: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Distance from each voxel's centre to its six sides [m].

    A side with a link takes the voxel's share of the link's strain, 2 eps E_other / (E_self + E_other).

    Args:
        body: gives links and moduli.
        strains: strain of every link, shape (..., L).
        sizes: rest size of every voxel along its axes [m], shape (..., V, 3).

    Returns:
        shape (..., V, 6), sides ordered as in ``topology.SIDES``.
    """
    voxel, side, share = _link_shares(body)
    shape = (*strains.shape[:-1], body.voxel_count, 6)
    shares = placed(shape, (..., voxel, side), np.concatenate([strains, strains], axis=-1) * share)
    extents: np.ndarray = 0.5 * np.repeat(sizes, 2, axis=-1) * (1 + shares)
    return extents


def _link_shares(body: LatticeBody) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The - ends of all links, then the + ends: voxel, its side, its share of the strain; shape (2 L,) each."""
    links, axes = body.topology.links, body.topology.link_axes
    moduli = np.array([m.youngs_modulus for m in body.materials])[body.material_index][links]
    share = 2 * moduli[:, ::-1] / moduli.sum(axis=1, keepdims=True)
    return links.T.ravel(), np.concatenate([2 * axes + 1, 2 * axes]), share.T.ravel()


def rotate(quaternions: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Turn vectors (..., 3) from the voxel frame to the world by unit quaternions (w, x, y, z), shape (..., 4)."""
    w, v = quaternions[..., :1], quaternions[..., 1:]
    t = 2 * np.cross(v, vectors)
    return vectors + w * t + np.cross(v, t)


def corners(positions: np.ndarray, orientations: np.ndarray, extents: np.ndarray) -> np.ndarray:
    """The eight corners of every voxel [m], shape (..., V, 8, 3); corner 4 i + 2 j + k is at side signs (i, j, k)."""
    signs = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    offsets = np.stack([(2 * signs[:, a] - 1) * extents[..., 2 * a + signs[:, a]] for a in range(3)], axis=-1)
    return positions[..., None, :] + rotate(orientations[..., None, :], offsets)


# Corners of the face on each side, counter-clockwise seen from outside.
FACE_CORNERS = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])


def mean_of_face_corners(
    body: LatticeBody, positions: np.ndarray, orientations: np.ndarray, extents: np.ndarray
) -> np.ndarray:
    """Mean of the corners of all exposed faces, each face counting its four [m], shape (..., 3).

    The four corners of a face average to its middle, so only the middles are needed.
    """
    voxel, side = body.topology.faces.T
    middle = 0.5 * (extents[..., 1::2] - extents[..., 0::2])[..., voxel, :]
    axis = side // 2
    reach = np.take_along_axis(
        extents[..., voxel, :], np.broadcast_to(side[:, None], (*extents.shape[:-2], len(side), 1)), -1
    )
    along = SIDES[side] * reach
    offset = np.where(np.arange(3) == axis[:, None], along, middle)
    return (positions[..., voxel, :] + rotate(orientations[..., voxel, :], offset)).mean(axis=-2)
