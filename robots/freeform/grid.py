"""A grid of cells, its symmetry, and smooth maps over it."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse, spatial

from taichi_sim.base.arrays import Floats, Indices
from taichi_sim.base.checks import positive, whole_number


@dataclass(frozen=True)
class Grid:
    """A box-shaped grid of cubic cells for a robot that travels along +x; +z is up.

    Attributes:
        shape: number of cells along x, y and z.
        voxel_size: edge h of a cell [m].
        symmetry: axes, some of "xyz", along which both halves are alike: ``"y"`` makes left and right mirror images.

    Raises:
        ValueError: one line that names the field, the value and what is allowed.
    """

    shape: tuple[int, int, int] = (12, 4, 3)
    voxel_size: float = 0.01
    symmetry: str = ""

    def __post_init__(self) -> None:
        shape = tuple(self.shape) if isinstance(self.shape, Iterable) else self.shape
        if not isinstance(shape, tuple) or len(shape) != 3:
            raise ValueError(
                f"shape: {shape} is not allowed; give the numbers of cells along x, y and z, such as (12, 4, 3)"
            )
        object.__setattr__(self, "shape", tuple(whole_number("shape", side, 1) for side in shape))
        positive("voxel_size", self.voxel_size, 1e3)
        if set(self.symmetry) - set("xyz") or len(set(self.symmetry)) < len(self.symmetry):
            raise ValueError(f"symmetry: {self.symmetry!r} is not allowed; give some of xyz, each once")
        for axis in self.symmetry:
            if (side := self.shape["xyz".index(axis)]) < 2:
                raise ValueError(f"symmetry: {axis!r} does not fit {side} cell along {axis}; give at least 2 cells")

    @property
    def count(self) -> int:
        """Number V of cells."""
        return int(np.prod(self.shape))

    @cached_property
    def places(self) -> Indices:
        """Indices of each cell along x, y and z, shape (V, 3)."""
        return np.argwhere(np.ones(self.shape))

    @cached_property
    def _folded(self) -> Indices:
        """Place of the cell that each cell is like, shape (V, 3)."""
        places = self.places.copy()
        for axis in ("xyz".index(name) for name in self.symmetry):
            places[:, axis] = np.minimum(places[:, axis], self.shape[axis] - 1 - places[:, axis])
        return places

    @cached_property
    def free(self) -> Indices:
        """Numbers of the F independent cells, shape (F,); all others are their mirror images."""
        return np.unique(np.ravel_multi_index(tuple(self._folded.T), self.shape))

    @cached_property
    def source(self) -> Indices:
        """Number of the free cell whose mirror image each cell is, or which it is itself, shape (V,)."""
        return np.searchsorted(self.free, np.ravel_multi_index(tuple(self._folded.T), self.shape))

    @cached_property
    def coordinates(self) -> Floats:
        """Centres of the free cells [cells] from the middle of the grid, shape (F, 3)."""
        return self.places[self.free] - (np.array(self.shape) - 1) / 2

    def smoothing(self, radius: float) -> sparse.csr_array:
        """Return weights, shape (F, F), that average free cells around each, falling off linearly to a radius [cells].

        Source: Bruns & Tortorelli, Comput. Methods Appl. Mech. Engrg. 190, 2001 (density filter).
        """
        tree = spatial.KDTree(self.places)
        away = tree.sparse_distance_matrix(tree, radius, output_type="coo_matrix")
        weights = sparse.csr_array((radius - away.data, (away.row, away.col)), (self.count, self.count))
        gathered = weights[self.free] @ sparse.csr_array(
            (np.ones(self.count), (np.arange(self.count), self.source)), (self.count, len(self.free))
        )
        return sparse.csr_array(sparse.diags_array(1 / gathered.sum(axis=1)) @ gathered)
