"""Closed surfaces of cells on a grid, each a manifold: no edge has more than two triangles, no vertex two fans.

Cells that touch only along an edge or at a corner are not joined by the lattice. Their surfaces would meet there, and
a mesh that meets itself is no manifold. So the walk from face to face stays inside a cell and the cells joined to it,
each fan of faces has a vertex of its own, and such vertices keep ``GAP`` of a cell away from each other.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from taichi_sim.base.arrays import Bools, Floats, Ints
from taichi_sim.lattice.body import LatticeBody
from taichi_sim.lattice.topology import SIDES

GAP = 1e-3  # of a cell's edge, along each axis: at most 0.6 % of the volume of a cell that touches at all its corners
# Corners of the face on each side, counter-clockwise seen from outside; corner 4 i + 2 j + k has side signs (i, j, k).
_SIGNS = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
_CORNERS = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
_OF_CORNER = np.array([[2 * axis + sign for axis, sign in enumerate(signs)] for signs in _SIGNS])  # its three sides


def _side_beyond(side: int, edge: int) -> int:
    """The side of a cell that meets a side of it along an edge, which goes from corner ``edge`` to the next."""
    first, last = _CORNERS[side, edge], _CORNERS[side, (edge + 1) % 4]
    return int(next(s for s in _OF_CORNER[first] if s in _OF_CORNER[last] and s != side))


_BEYOND = np.array([[_side_beyond(side, edge) for edge in range(4)] for side in range(6)])


@dataclass(frozen=True, eq=False)
class Surface:
    """A closed surface of triangles.

    Attributes:
        vertices: shape (N, 3).
        faces: indices of three vertices, counter-clockwise seen from outside, shape (F, 3).
    """

    vertices: Floats
    faces: Ints

    @property
    def volume(self) -> float:
        """Volume that the surface encloses, in its unit cubed."""
        a, b, c = np.moveaxis(self.vertices[self.faces] - self.vertices.mean(axis=0), 1, 0)
        return float(np.einsum("fi,fi->", a, np.cross(b, c)) / 6)

    def times(self, factor: float) -> "Surface":
        """The surface in another unit."""
        return Surface(self.vertices * factor, self.faces)

    def moved(self, shift: ArrayLike) -> "Surface":
        """The surface elsewhere, shifted by shape (3,)."""
        return Surface(self.vertices + np.asarray(shift, float), self.faces)


@dataclass(frozen=True, eq=False)
class CellSurface:
    """A closed surface around cells; cell (i, j, k) reaches from (i, j, k) to (i + 1, j + 1, k + 1).

    Attributes:
        places: of the vertices on the grid, shape (N, 3); halves are middles of edges and of faces.
        shifts: how far each vertex keeps away from others at its place [cells], shape (N, 3); zero elsewhere.
        faces: indices of three vertices, counter-clockwise seen from outside, shape (F, 3).
    """

    places: Floats
    shifts: Floats
    faces: Ints


def body_surface(body: LatticeBody, chosen: Bools | None = None) -> Surface:
    """The surface of a body that nothing deforms [m], or of some of its voxels; cut links are gaps.

    Voxel i has its centre at ``voxel_size * voxels[i]``, and edges by its material's ``scale``, about the origin.

    Args:
        body: with voxels whose materials have one ``scale`` in common.
        chosen: which voxels, shape (V,); by default all.

    Raises:
        ValueError: if no voxel is chosen, or materials in use have different scales: then no shape is free of stress.
    """
    numbers = np.unique(body.material_index)
    scales = {body.materials[n].scale: body.materials[n].name or f"material {n}" for n in numbers.tolist()}
    if len(scales) > 1:
        (one, name), (other, second), *_ = scales.items()
        raise ValueError(
            f"scale: {one} of {name} and {other} of {second} differ, so no shape is free of stress; give all one"
        )
    found = cell_surface(body.voxels, body.cut_links, chosen)
    edges = body.voxel_size * np.array(next(iter(scales)))
    return Surface((found.places + found.shifts - 0.5) * edges, found.faces)


def cell_surface(cells: Ints, cut: Iterable[Iterable[int]] = (), chosen: Bools | None = None) -> CellSurface:
    """The surface around cells, shape (V, 3), whole numbers.

    Args:
        cells: all of them, none twice.
        cut: pairs of neighbours, indices into ``cells``, between which there are two faces.
        chosen: which cells are in the surface, shape (V,); by default all.

    Raises:
        ValueError: if there are none.
    """
    cells = np.asarray(cells, np.int64)
    kept = np.ones(len(cells), bool) if chosen is None else np.asarray(chosen, bool)
    if not kept.any():
        raise ValueError("cells: there are none; give at least one")
    across = _neighbours(cells, np.array(list(cut), np.int64).reshape(-1, 2), kept)
    owner, side = np.nonzero((across < 0) & kept[:, None])
    number = np.full(across.shape, -1)
    number[owner, side] = np.arange(len(owner))
    corners = cells[owner][:, None] + _SIGNS[_CORNERS[side]]
    centres = (cells[owner] + 0.5).astype(np.float64)
    return _meshed(centres, side, corners, _next_faces(across, number, owner, side))


def _neighbours(cells: Ints, cut: Ints, kept: Bools) -> Ints:
    """The cell that is joined to each side of each cell, -1 for none, shape (V, 6)."""
    low = cells.min(axis=0) - 1
    size = cells.max(axis=0) - low + 2
    if np.prod(size, dtype=float) > 2**62:
        raise ValueError(f"cells: a grid of {' x '.join(map(str, size))} is not allowed; give cells closer together")
    flat = np.ravel_multi_index(tuple((cells - low).T), tuple(size))
    order = np.argsort(flat)
    found = np.full((len(cells), 6), -1)
    for side, step in enumerate(SIDES):
        wanted = np.ravel_multi_index(tuple((cells + step - low).T), tuple(size))
        at = order[np.minimum(np.searchsorted(flat, wanted, sorter=order), len(cells) - 1)]
        found[:, side] = np.where((flat[at] == wanted) & kept[at], at, -1)
    for one, other in cut.tolist():
        joined = cells[other] - cells[one]
        side = int(np.flatnonzero((joined == SIDES).all(axis=1))[0])
        found[one, side] = found[other, side ^ 1] = -1
    return found


def _next_faces(across: Ints, number: Ints, owner: Ints, side: Ints) -> Ints:
    """The face beyond each of the four edges of each face, walking through joined cells only, shape (N, 4)."""
    found = np.full((len(owner), 4), -1)
    for edge in range(4):
        cell, towards, wall = owner, _BEYOND[side, edge], side
        for _ in range(4):  # cells around an edge
            face = number[cell, towards]
            inside = face < 0
            found[:, edge] = np.where(inside | (found[:, edge] >= 0), found[:, edge], face)
            # Through a side into the neighbour: the wall that was followed is what comes next there.
            cell, towards, wall = (
                np.where(inside, across[cell, towards], cell),
                np.where(inside, wall, towards),
                np.where(inside, towards ^ 1, wall),
            )
    return found


def _fans(corners: Ints, next_face: Ints) -> tuple[int, Ints]:
    """How many fans of faces around corners there are, and which one each corner is in, shape (N, 4)."""
    count = len(corners)
    rows, columns = [], []
    for edge in range(4):
        beyond = next_face[:, edge]
        for corner in (edge, (edge + 1) % 4):
            same = (corners[beyond] == corners[:, corner][:, None]).all(axis=2)
            rows.append(4 * np.arange(count) + corner)
            columns.append(4 * beyond + same.argmax(axis=1))
    ends = (np.concatenate(rows), np.concatenate(columns))
    graph = coo_matrix((np.ones(8 * count, bool), ends), shape=(4 * count, 4 * count))
    fans, found = connected_components(graph, directed=False)
    return fans, found.reshape(count, 4)


def _means(groups: Ints, values: Floats, count: int) -> Floats:
    """The mean of the values, shape (N, 3), of each of so many groups."""
    sums = np.zeros((count, 3))
    np.add.at(sums, groups, values)
    return sums / np.maximum(np.bincount(groups, minlength=count), 1)[:, None]


def _fan_places(centres: Floats, corners: Ints, fan: Ints, count: int) -> tuple[Floats, Floats]:
    """The place of each fan's vertex, and its shift into the cells whose faces it has, shape (count, 3) each."""
    places = np.zeros((count, 3))
    places[fan.ravel()] = corners.reshape(-1, 3)
    _, group, several = np.unique(places, axis=0, return_inverse=True, return_counts=True)
    inwards = _means(fan.ravel(), (centres[:, None] - corners).reshape(-1, 3), count)
    return places, np.where((several[group.reshape(-1)] > 1)[:, None], 2 * GAP * inwards, 0.0)


def _meshed(centres: Floats, side: Ints, corners: Ints, next_face: Ints) -> CellSurface:
    """The surface of faces, shape (N,), of cells with these centres: two triangles each, if a face is like most.

    Two pairs of faces may have both ends of an edge in common, and both faces between two cells all corners. Then
    each pair has a vertex of its own in the middle of the edge, each face one in its middle.
    """
    fans, fan = _fans(corners, next_face)
    places, shifts = _fan_places(centres, corners, fan, fans)
    count, faces = len(side), np.arange(len(side))[:, None]
    ends = np.stack([fan, np.roll(fan, -1, axis=1)], axis=2)
    _, edge, uses = np.unique(np.sort(ends, axis=2).reshape(-1, 2), axis=0, return_inverse=True, return_counts=True)
    shared = uses[edge.reshape(-1)].reshape(count, 4) > 2
    pairs = np.stack([edge.reshape(count, 4), np.minimum(faces, next_face), np.maximum(faces, next_face)], axis=2)
    halves, half = np.unique(pairs[shared], axis=0, return_inverse=True)
    half, on = half.reshape(-1), np.nonzero(shared)[0]
    half_places = _means(half, places[ends[shared]].mean(axis=1), len(halves))
    half_shifts = 2 * GAP * _means(half, centres[on] - half_places[half], len(halves))
    _, square, walls = np.unique(corners.sum(axis=1), axis=0, return_inverse=True, return_counts=True)
    double = walls[square.reshape(-1)] > 1
    centred = double | shared.any(axis=1)
    middle_places = places[fan[centred]].mean(axis=1)
    middle_shifts = np.where(double[centred][:, None], -GAP * SIDES[side[centred]], 0.0)
    middle, halfway = np.full(count, -1), np.full((count, 4), -1)
    middle[centred] = fans + len(halves) + np.arange(len(middle_places))
    halfway[shared] = fans + half
    triangles = [fan[~centred][:, [0, 1, 2]], fan[~centred][:, [0, 2, 3]]]
    for n in range(4):
        first, last = ends[:, n].T
        whole, cut = centred & ~shared[:, n], shared[:, n]
        triangles.append(np.stack([first, last, middle], axis=1)[whole])
        triangles.append(np.stack([first, halfway[:, n], middle], axis=1)[cut])
        triangles.append(np.stack([halfway[:, n], last, middle], axis=1)[cut])
    return CellSurface(
        np.concatenate([places, half_places, middle_places]),
        np.concatenate([shifts, half_shifts, middle_shifts]),
        np.concatenate(triangles),
    )
