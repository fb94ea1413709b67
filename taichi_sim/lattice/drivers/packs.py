"""How the voxels of one body lie in native vectors, and where each lane finds its neighbours.

A *pack* is a vector whose lanes are voxels of one body, a *link pack* the links of a pack's voxels to their "+" sides
along one axis, in the same lanes. What a lane needs of a neighbour lies, for the whole pack,

    ALIGNED  in the same lane of another pack: plain loads
    NEXT     in the next lane of the same pack (of the "-" side: in the one before), but for the last (first) lane,
             which has its neighbour elsewhere, or nowhere: a permutation and one load
    GATHER   anywhere: one load per lane

so any body runs, and a regular one runs almost without gathers. Packs are cut from runs of voxels along an axis; those
of a body with many holes are better filled with any voxels that have links on the same sides. Counting decides.
"""

from dataclasses import dataclass

import numpy as np

from taichi_sim.lattice.stages import columns
from taichi_sim.lattice.stages.tables import Tables

NOTHING, ALIGNED, NEXT, GATHER = range(4)


@dataclass(frozen=True, eq=False)
class Reach:
    """Where packs find what they need of neighbours, one row for each pack that asks.

    Attributes:
        kind: ``NOTHING`` to ``GATHER``, shape (N,).
        target: pack in which the neighbours lie (ALIGNED), or lane number of the odd one out (NEXT), -1 without; shape
            (N,).
        element: lane number, pack * width + lane, of the neighbour of each lane; -1 without, shape (N, width).
    """

    kind: np.ndarray
    target: np.ndarray
    element: np.ndarray


@dataclass(frozen=True, eq=False)
class Packs:
    """The voxels and links of a body in packs.

    Attributes:
        width: lanes of a pack.
        voxel: voxel in each lane, engine order, -1 for nobody, shape (P, width).
        link: link in each lane of a link pack, -1 without, shape (Q, width).
        link_pack: pack at the "-" ends of a link pack, and its axis, shape (Q, 2).
        voxel_place, link_place: lane number of each voxel and link, shapes (V,), (L,).
        plus: of each link pack, where the voxels at its "+" ends lie.
        minus: of each pack and axis, where the links of its voxels' "-" sides lie: lane numbers of links.
        last: of each pack, the last of the packs whose links end or begin at its voxels, shape (P,).
    """

    width: int
    voxel: np.ndarray
    link: np.ndarray
    link_pack: np.ndarray
    voxel_place: np.ndarray
    link_place: np.ndarray
    plus: Reach
    minus: Reach
    last: np.ndarray


# Cycles of a pack and of a link pack, and what finding neighbours adds, by kind (rough, a CPU with AVX-512).
_PACK, _LINK_PACK = 210, 180
_FINDING = np.array([0, 10, 25, 150])
_RUNS = ((1.0, 0.75, 0.5, 0.25), (1.0, 0.75), (1.0,), ())  # least parts of a pack that runs fill, one after the other
_WELL_FILLED = 0.85  # so that no other layout is tried


def lay_out(tables: Tables, places: np.ndarray, width: int) -> Packs:
    """Put the voxels of a body, at whole-numbered places of shape (V, 3) in engine order, into packs, cheaply."""
    by_side, cells = _side_links(tables), _cells(places, width)  # (V, 3, 2): link on the "-" and "+" side
    best = _packed(tables, cut(cells, by_side, _RUNS[0]), by_side)
    if (best.voxel >= 0).mean() < _WELL_FILLED:
        others = [_packed(tables, cut(cells, by_side, parts), by_side) for parts in _RUNS[1:]]
        best = min([best, *others], key=_cost)
    return best


def _cost(packs: Packs) -> int:
    """Cycles of a step, roughly."""
    finding = _FINDING[packs.plus.kind].sum() + _FINDING[packs.minus.kind].sum()
    return int(len(packs.voxel) * _PACK + len(packs.link) * _LINK_PACK + finding)


def _packed(tables: Tables, voxel: np.ndarray, by_side: np.ndarray) -> Packs:
    """The links of packs of voxels, shape (P, width), and how both find each other."""
    width = voxel.shape[1]
    voxel_place = _places(voxel, len(by_side))
    links = np.where((voxel >= 0)[:, None], np.moveaxis(by_side[voxel, :, 1], 2, 1), -1)  # (P, 3, width)
    pack, axis = np.nonzero((links >= 0).any(axis=2))
    link = links[pack, axis]
    link_place = _places(link, len(tables.link_ends))
    beyond = np.where(link >= 0, voxel_place[tables.link_ends[link, 1]], -1)
    before = np.where((voxel >= 0)[:, None], np.moveaxis(by_side[voxel, :, 0], 2, 1), -1)  # (P, 3, width)
    giver = np.append(link_place, -1)[before].reshape(-1, width)
    own = np.full((len(voxel), 3), -1)
    own[pack, axis] = np.arange(len(pack))
    everywhere = np.arange(voxel.size).reshape(voxel.shape)
    plus = _reach(beyond, everywhere[pack], 1, everywhere)
    minus = _reach(
        giver, _lanes(own.reshape(-1), width), -1, np.where(link >= 0, _lanes(np.arange(len(link)), width), -1)
    )
    owner = np.where(giver >= 0, pack[giver // width], -1) if len(pack) else giver
    last = np.maximum(np.arange(len(voxel)), owner.reshape(len(voxel), -1).max(axis=1))
    return Packs(width, voxel, link, np.column_stack([pack, axis]), voxel_place, link_place, plus, minus, last)


@dataclass(frozen=True, eq=False)
class Cells:
    """All ways to cut the rows of voxels along an axis into cells of as many places as a pack has lanes.

    Attributes:
        width: lanes of a pack.
        order: voxels along each axis, shape (3, V).
        number: cell of each voxel, shape (3 width, V): a row for every axis and place at which cells begin. No two
            rows have a cell in common.
        starts: first cell of each row, and the number of all, shape (3 width + 1,).
    """

    width: int
    order: np.ndarray
    number: np.ndarray
    starts: np.ndarray

    def fullest(self, left: np.ndarray, least: int) -> list[np.ndarray]:
        """The voxels of those that are left, shape (V,), in cells that hold at least so many of them, cell by cell.

        Cells are those of the row whose cells hold most voxels, the first of several; without any such cell, nothing.
        """
        counts = np.bincount(self.number[:, left].ravel(), minlength=self.starts[-1])
        sizes = np.add.reduceat(np.where(counts >= least, counts, 0), self.starts[:-1])
        row = int(sizes.argmax())
        if not sizes[row]:
            return []
        along = self.order[row // self.width]
        along = along[left[along]]
        cell = self.number[row, along]
        chosen = along[counts[cell] >= least]
        cell = self.number[row, chosen]
        together = np.argsort(cell, kind="stable")
        return np.split(chosen[together], np.flatnonzero(np.diff(cell[together])) + 1)


def _cells(places: np.ndarray, width: int) -> Cells:
    """The cells of voxels at places, shape (V, 3)."""
    rows = []
    for axis in range(3):
        _, across = np.unique(np.delete(places, axis, axis=1), axis=0, return_inverse=True)
        cell = (places[:, axis] - np.arange(width)[:, None]) // width
        cell -= cell.min()
        rows.append(across.reshape(-1) * (cell.max() + 1) + cell)
    keys = np.concatenate(rows)
    apart = np.arange(len(keys) + 1) * (keys.max() + 1)
    known, number = np.unique(keys + apart[:-1, None], return_inverse=True)
    starts = np.searchsorted(known, apart)
    return Cells(width, np.argsort(places.T, axis=1, kind="stable"), number.reshape(keys.shape), starts)


def cut(cells: Cells, by_side: np.ndarray, parts: tuple[float, ...]) -> np.ndarray:
    """Packs of voxels in the order of voxels, -1 for nobody, shape (P, width).

    First the fullest runs along an axis, cut at common places, as long as they fill the parts of a pack that are asked
    for; the rest by the sides on which voxels have links, so that packs of links are full.
    """
    width, left, packs = cells.width, np.ones(len(by_side), bool), []
    for part in parts:
        while runs := cells.fullest(left, max(int(part * width), 1)):
            packs += runs
            left[np.concatenate(runs)] = False
    rest = np.flatnonzero(left)
    linked = (by_side[rest, :, 1] >= 0) @ (1 << np.arange(3))
    rest = rest[np.argsort(linked, kind="stable")]
    packs += [rest[i : i + width] for i in range(0, len(rest), width)]
    packs.sort(key=lambda pack: int(pack.min()))
    voxel = np.full((len(packs), width), -1)
    for row, pack in zip(voxel, packs, strict=True):
        row[: len(pack)] = pack
    return voxel


def _places(packs: np.ndarray, count: int) -> np.ndarray:
    place = np.full(count, -1)
    row, lane = np.nonzero(packs >= 0)
    place[packs[row, lane]] = row * packs.shape[1] + lane
    return place


def _lanes(pack: np.ndarray, width: int) -> np.ndarray:
    """Lane numbers of the lanes of packs, -1 for pack -1; shape (N, width)."""
    return np.where(pack[:, None] >= 0, pack[:, None] * width + np.arange(width), -1)


def _side_links(tables: Tables) -> np.ndarray:
    """Link on the "-" and on the "+" side of each voxel along each axis, -1 without, shape (V, 3, 2)."""
    table = tables.voxel.reshape(-1, columns.VOXEL_COLUMNS)
    return table[:, columns.SIDE_LINK : columns.SIDE_LINK + 6].reshape(-1, 3, 2).astype(int)


def _reach(wanted: np.ndarray, own: np.ndarray, step: int, valid: np.ndarray) -> Reach:
    """How rows of lanes get at lane numbers ``wanted`` (-1: nothing).

    Args:
        wanted: shape (N, width).
        own: lane numbers of the row's own pack of what is wanted (-1 without), shape (N, width).
        step: 1 if the neighbours of a run lie in the next lane, -1 if in the one before.
        valid: lane numbers that hold something, else -1, by pack: what an aligned load must not find where nothing is
            wanted, if a lane without a neighbour must find nothing there.
    """
    there, lane = wanted >= 0, np.arange(wanted.shape[1])
    asks = there.any(axis=1)
    kind, target = np.where(asks, GATHER, NOTHING), np.zeros(len(wanted), int)
    if not asks.any():
        return Reach(kind, target, wanted)
    first = np.where(asks, wanted[np.arange(len(wanted)), there.argmax(axis=1)] // len(lane), 0)
    aligned = asks & ((wanted == first[:, None] * len(lane) + lane) | ~there).all(axis=1)
    inner, odd = (slice(None, -1), -1) if step > 0 else (slice(1, None), 0)
    beside = np.roll(own, -step, axis=1)[:, inner]
    following = asks & (own.max(axis=1) >= 0) & ((wanted[:, inner] == beside) | ~there[:, inner]).all(axis=1)
    if step < 0:  # nothing may be found where nothing is wanted; of "+" sides it does not matter
        aligned &= ((valid[first] < 0) | there).all(axis=1)
        held = np.where(own >= 0, valid.reshape(-1)[own], -1)
        following &= ((np.roll(held, -step, axis=1)[:, inner] < 0) | there[:, inner]).all(axis=1)
    kind[following], target[following] = NEXT, wanted[following, odd]
    kind[aligned], target[aligned] = ALIGNED, first[aligned]
    return Reach(kind, target, wanted)
