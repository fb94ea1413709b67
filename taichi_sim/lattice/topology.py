"""What follows from the places of the voxels: links, neighbours, exposed faces, contact exclusions."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

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

    @cached_property
    def parts(self) -> np.ndarray:
        """Which of the parts that links join each voxel belongs to, shape (V,)."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        count, (minus, plus) = len(self.order), self.links.T
        joined = coo_array((np.ones(len(minus)), (minus, plus)), (count, count))
        found: np.ndarray = connected_components(joined, directed=False)[1]
        return found


def build_topology(voxels: np.ndarray, cut_links: np.ndarray) -> Topology:
    """Derive the topology of voxels, shape (V, 3), without the links ``cut_links``, shape (C, 2)."""
    count = len(voxels)
    order = np.lexsort(voxels.T[::-1])
    minus, axes = (each.ravel() for each in np.meshgrid(order, np.arange(3), indexing="ij"))
    plus = _voxels_at(voxels, voxels[minus] + SIDES[2 * axes + 1])
    ends = np.column_stack([minus, plus])
    joined = plus >= 0
    if len(cut_links):
        pairs, cut = (np.sort(each, axis=1) @ [count, 1] for each in (ends, cut_links))
        joined &= ~np.isin(pairs, cut)
    link_array, axis_array = ends[joined].astype(np.int64), axes[joined].astype(np.int64)
    sides = np.full((count, 6), -1, np.int64)
    sides[link_array[:, 0], 2 * axis_array + 1] = np.arange(len(link_array))
    sides[link_array[:, 1], 2 * axis_array] = np.arange(len(link_array))
    is_surface: np.ndarray = np.any(sides < 0, axis=1)
    surface = order[is_surface[order]]
    near = _near(link_array, axis_array, surface, count)
    return Topology(order, link_array, axis_array, sides, surface, np.argwhere(sides < 0), near)


def _voxels_at(voxels: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Voxels at places, shape (N, 3), -1 where there is none."""
    _, number = np.unique(np.concatenate([voxels, places]), axis=0, return_inverse=True)
    number = number.reshape(-1)
    found = np.full(number.max() + 1, -1)
    found[number[: len(voxels)]] = np.arange(len(voxels))
    return found[number[len(voxels) :]]


def _near(links: np.ndarray, axes: np.ndarray, surface: np.ndarray, count: int) -> np.ndarray:
    """Pairs of surface voxels at most ``CONTACT_EXCLUSION_LINKS`` links apart, shape (S, S)."""
    neighbours = np.tile(np.arange(count)[:, None], (1, 6))  # a voxel itself where there is none
    neighbours[links[:, 0], 2 * axes + 1], neighbours[links[:, 1], 2 * axes] = links[:, 1], links[:, 0]
    each = np.arange(len(surface))
    bits = np.zeros((count, -(-len(surface) // 8)), np.uint8)  # whom a voxel reaches, eight to a byte
    bits[surface, each // 8] = 128 >> (each % 8)
    for _ in range(CONTACT_EXCLUSION_LINKS):
        before = bits.copy()
        for side in neighbours.T:
            bits |= before[side]
    return np.unpackbits(bits[surface], axis=1, count=len(surface)).astype(bool)
