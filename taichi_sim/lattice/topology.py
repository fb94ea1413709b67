"""What follows from the places of the voxels: links, neighbours, exposed faces, contact exclusions."""

from dataclasses import dataclass

import numpy as np
from scipy import sparse

# Voxels this many links apart or fewer never collide (Voxelyze: they are joined by the lattice itself).
CONTACT_EXCLUSION_LINKS = 5

# Sides of a voxel: -x, +x, -y, +y, -z, +z. Side s looks along axis s // 2.
SIDES = np.array([[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]])


@dataclass(frozen=True, eq=False)
class Topology:
    """Links and faces of a body, in the body's own voxel numbering.

    Attributes:
        order: voxels sorted by (x, y, z), shape (V,): the order in which engines hold and visit them, so that the
            neighbours on the negative sides of a voxel always come before it.
        links: the two ends (-, +) of each link, shape (L, 2), sorted by the place of the first, then by axis.
        link_axes: axis of each link, shape (L,).
        side_links: link on each of the six sides, -1 without, shape (V, 6).
        surface: voxels with fewer than six links, in ``order``, shape (S,).
        faces: exposed faces as (voxel, side), shape (N, 2).
        excluded: whether two surface voxels are too near along the lattice to collide, shape (S, S).
    """

    order: np.ndarray
    links: np.ndarray
    link_axes: np.ndarray
    side_links: np.ndarray
    surface: np.ndarray
    faces: np.ndarray
    excluded: np.ndarray


def build_topology(voxels: np.ndarray, cut_links: np.ndarray) -> Topology:
    """Derive the topology of voxels, shape (V, 3), without the links ``cut_links``, shape (C, 2)."""
    count = len(voxels)
    order = np.lexsort(voxels.T[::-1])
    index = {tuple(place): i for i, place in enumerate(voxels.tolist())}
    cut = {tuple(sorted(pair)) for pair in cut_links.tolist()}
    links, axes = [], []
    for minus in order.tolist():
        for axis in range(3):
            plus = index.get(tuple((voxels[minus] + SIDES[2 * axis + 1]).tolist()), -1)
            if plus >= 0 and tuple(sorted((minus, plus))) not in cut:
                links.append((minus, plus))
                axes.append(axis)
    link_array = np.array(links, np.int64).reshape(-1, 2)
    axis_array = np.array(axes, np.int64)
    sides = np.full((count, 6), -1, np.int64)
    sides[link_array[:, 0], 2 * axis_array + 1] = np.arange(len(links))
    sides[link_array[:, 1], 2 * axis_array] = np.arange(len(links))
    is_surface: np.ndarray = np.any(sides < 0, axis=1)
    surface = order[is_surface[order]]
    return Topology(
        order, link_array, axis_array, sides, surface, np.argwhere(sides < 0), _near(link_array, count, surface)
    )


def _near(links: np.ndarray, count: int, surface: np.ndarray) -> np.ndarray:
    """Pairs of surface voxels at most ``CONTACT_EXCLUSION_LINKS`` links apart, shape (S, S)."""
    ones = np.ones(len(links), np.int32)
    adjacent = sparse.csr_matrix((ones, (links[:, 0], links[:, 1])), shape=(count, count))
    one_step = adjacent + adjacent.T + sparse.identity(count, np.int32, format="csr")
    reached = sparse.identity(count, np.int32, format="csr")
    for _ in range(CONTACT_EXCLUSION_LINKS):
        reached = reached @ one_step
        reached.data[:] = 1  # counts of paths would overflow
    return reached[surface][:, surface].toarray().astype(bool)
