"""Which cells variables belong to, and patches of cells side by side that vary together."""

from collections import defaultdict

import numpy as np
from scipy import sparse, spatial

from optim.space import Space
from taichi_sim.base.arrays import Bools, Floats, Indices

BESIDE = 1 + 1e-9  # neighbours are at most so far apart
REACH = 0.25  # largest radius of a patch, part of the longest extent of all cells


class Neighbourhood:
    """The V cells of a space, whose variables have a :attr:`Variable.place`.

    Its variables fall into layers: the first continuous variables of all cells are one, the second ones another, and so
    are the first binary ones.

    Attributes:
        places: of the cells, shape (V, axes).
        cell: of each variable, shape (D,); -1 for one without a place.
        layers: the variable of each cell in each layer, shape (L, V); -1 where a cell has none.
    """

    def __init__(self, space: Space) -> None:
        placed = [n for n, variable in enumerate(space.variables) if variable.place is not None]
        given = [space.variables[n].place or () for n in placed]
        if not placed or len({len(place) for place in given}) > 1:
            raise ValueError("patches: only allowed where variables have places of as many axes; leave it out")
        self.places, cells = np.unique(np.array(given, float), axis=0, return_inverse=True)
        self.cell = np.full(space.size, -1)
        self.cell[placed] = cells
        met: dict[tuple[str, int], int] = defaultdict(int)
        layers: dict[tuple[str, int], Indices] = {}
        for n in placed:
            kind, cell = space.variables[n].kind, int(self.cell[n])
            layer = layers.setdefault((kind, met[kind, cell]), np.full(len(self.places), -1))
            layer[cell] = n
            met[kind, cell] += 1
        self.layers = np.array(list(layers.values()))
        self._binary = [kind == "binary" for kind, _ in layers]
        pairs = spatial.KDTree(self.places).query_pairs(BESIDE, output_type="ndarray")
        ends = (np.concatenate([pairs[:, 0], pairs[:, 1]]), np.concatenate([pairs[:, 1], pairs[:, 0]]))
        self._beside = sparse.csr_array((np.ones(len(ends[0])), ends), (len(self.places),) * 2)
        self._most = self._beside.sum(axis=1).max()
        self._reach = max(1.0, REACH * np.ptp(self.places, axis=0).max())

    def balls(self, rng: np.random.Generator, count: int) -> Bools:
        """All variables of the cells of random balls, shape (count, D)."""
        found = [self._any_ball(rng) for _ in range(count)]
        return np.array([(self.cell >= 0) & ball[self.cell] for ball in found]).reshape(count, len(self.cell))

    def patches(self, rng: np.random.Generator, points: Floats) -> Bools:
        """Which variables of each point change together, shape (N, D): one layer of some cells side by side.

        Of a binary layer they are those of a ball that are like its centre; or cells that are added (0) or removed (1)
        at the surface.
        """
        found = np.zeros(points.shape, bool)
        for point, chosen in zip(points, found, strict=True):
            layer = int(rng.integers(len(self.layers)))
            columns = self.layers[layer]
            cells = self._lump(rng, point[columns]) if self._binary[layer] else self._any_ball(rng)
            chosen[columns[cells & (columns >= 0)]] = True
        return found

    def _any_ball(self, rng: np.random.Generator) -> Bools:
        return self._ball(rng, np.arange(len(self.places)))

    def _lump(self, rng: np.random.Generator, values: Floats) -> Bools:
        """Cells of equal values (0 or 1, shape (V,)) that lie in a ball, or at the surface in a ball, shape (V,)."""
        there = values > 0.5
        beside = self._beside @ there.astype(float)
        surfaces = (~there & (beside > 0), there & (beside < self._most))  # beyond the last cells there is nothing
        way = int(rng.integers(3))
        if way < 2 and surfaces[way].any():
            return surfaces[way] & self._ball(rng, np.flatnonzero(surfaces[way]))
        centre = int(rng.integers(len(there)))
        return (there == there[centre]) & self._ball(rng, np.array([centre]))

    def _ball(self, rng: np.random.Generator, centres: Indices) -> Bools:
        """The cells of a ball about one of some cells, at least its neighbours, shape (V,)."""
        away = self.places - self.places[rng.choice(centres)]
        return np.asarray((away**2).sum(axis=1) <= max(rng.uniform(1.0, self._reach), BESIDE) ** 2)
