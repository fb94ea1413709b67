"""Recorded poses of robots made of voxels, for pictures, films and the player."""

from dataclasses import dataclass, fields, replace

import numpy as np

from taichi_sim.base.short_text import ShortText
from taichi_sim.lattice import LatticeResult


@dataclass(frozen=True, eq=False, repr=False)
class Frames(ShortText):
    """Recorded poses of a batch of B robots of V voxels, at F times.

    Attributes:
        positions: voxel centres [m], shape (F, B, V, 3), voxels ordered as ``body.voxels``; NaN after a robot's end.
        orientations: quaternions (w, x, y, z), shape (F, B, V, 4).
        times: times of the poses [s] from the end of the initialisation, shape (F,).
        extents: distances from each voxel's centre to its sides -x, +x, -y, ... [m], shape (F, B, V, 6).
        sizes: rest sizes of the voxels along their own axes [m], shape (F, B, V, 3).
    """

    positions: np.ndarray
    orientations: np.ndarray
    times: np.ndarray
    extents: np.ndarray
    sizes: np.ndarray

    def since(self, seconds: float) -> "Frames":
        """The poses from a time on."""
        kept = self.times >= seconds
        return Frames(*(getattr(self, each.name)[kept] for each in fields(self)))


def frames_of(run: LatticeResult, extents: np.ndarray, first: int, times: np.ndarray) -> Frames:
    """The frames that a run recorded as its snapshots from number ``first`` on.

    Args:
        run: of B robots, with S snapshots.
        extents: of all snapshots [m], shape (B, S, V, 6).
        first: snapshots before it are not frames.
        times: of the frames [s], shape (S - first,).
    """
    positions, orientations, sides, rest = (
        np.moveaxis(each[:, first:], 0, 1) for each in (run.positions, run.orientations, extents, run.sizes)
    )
    return Frames(positions, orientations, times, sides, rest)


def last_whole(before: LatticeResult, now: LatticeResult) -> LatticeResult:
    """A run's snapshots, for robots that have diverged those of the run before; both have as many."""
    lost = now.status != "ok"
    if not lost.any():
        return now
    names = ("positions", "orientations", "strains", "sizes")
    pairs = {name: (getattr(before, name), getattr(now, name)) for name in names}
    kept = {n: np.where(lost.reshape(-1, *[1] * (new.ndim - 1)), old, new) for n, (old, new) in pairs.items()}
    return replace(now, **kept)
