"""A robot that can be built from fields: whole cells, in one piece, of a palette, with few channels."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import cluster, ndimage

from robots.freeform.fields import Fields
from robots.freeform.grid import Grid
from robots.freeform.palette import Palette
from robots.lattice_robot.drive import Drive
from taichi_sim.base.arrays import Bools, Floats, Indices
from taichi_sim.lattice import LatticeBody

LEAST_CELLS = 4
ROUNDS = 30  # of clustering: assignments settle long before


@dataclass(frozen=True, eq=False)
class Solid:
    """The cells of a robot that can be built.

    Attributes:
        cells: the C cells that are there, numbers in the grid, shape (C,).
        tissues: of each, shape (C,).
        channels: channel that drives each, -1 for passive cells, shape (C,).
        count: of the channels.
        waves: how many of these differ; mirrored muscles have equal ones.
        fault: why it is no robot; empty if it is one.
    """

    cells: Indices
    tissues: Indices
    channels: Indices
    count: int
    waves: int
    fault: str = ""

    def body(self, grid: Grid, palette: Palette) -> LatticeBody:
        """Its lattice: a region for each channel, and a last one for passive cells."""
        regions = np.where(self.channels < 0, self.count, self.channels)
        return LatticeBody(grid.places[self.cells], palette.materials, self.tissues, grid.voxel_size, regions)

    @property
    def members(self) -> Floats:
        """Share of each cell in the mean of each channel, shape (count, C)."""
        member = (self.channels == np.arange(self.count)[:, None]).astype(float)
        return np.asarray(member / np.maximum(member.sum(axis=1, keepdims=True), 1.0))


def solid_of(grid: Grid, palette: Palette, fields: Fields, row: int, feature: int, channels: int | None) -> Solid:
    """The robot that one row of fields says.

    Cells above a half that lie in a cube of ``feature`` cells that all are, so that nothing is thinner; the largest
    part whose cells share faces and that is as symmetric as the grid, the first of equals; of each the tissue of the
    largest weight.

    Args:
        grid, palette: of the robot.
        fields: plain arrays.
        row: which of their N points.
        feature: least thickness [cells].
        channels: at most so many; None for one for each muscle.
    """
    there = thick(fields.presence[row].reshape(grid.shape) > 0.5, feature)
    cells = np.flatnonzero(largest_part(there, grid.symmetry))
    tissues = fields.tissue[row, cells].argmax(axis=1) if len(cells) else np.zeros(0, np.int64)
    muscles = palette.muscles[tissues] > 0
    channel = np.full(len(cells), -1)
    swing = fields.swing[row, cells[muscles]]
    channel[muscles], count = clustered(swing, channels)
    waves = len(np.unique(swing, axis=0)) if count == len(swing) else count
    fault = ""
    if not len(cells):
        fault = "its mirrored parts do not touch" if there.any() else "the body is empty"
    elif len(cells) < LEAST_CELLS:
        fault = f"the body has {len(cells)} connected cells; it needs {LEAST_CELLS}"
    elif not muscles.any():
        fault = "the body has no muscle"
    return Solid(cells, tissues, channel, count, waves, fault)


def thick(there: Bools, feature: int) -> Bools:
    """Mask of the cells that lie in some cube of ``feature`` cells a side that all are there."""
    if feature == 1:
        return there
    found: Bools = ndimage.binary_opening(there, np.ones((feature,) * 3))
    return found


def largest_part(there: Bools, symmetry: str = "") -> Bools:
    """The largest part of a grid whose cells share faces and that is its own mirror image, the first of equals."""
    part, count = ndimage.label(there)
    sizes = np.bincount(part.ravel(), minlength=count + 1)
    sizes[0] = 0
    for axis in symmetry:  # a part that is mirrored into another is half a body
        sizes[np.unique(part[part != np.flip(part, "xyz".index(axis))])] = 0
    if not sizes.any():
        return np.zeros(there.shape, bool)
    return np.asarray(part == np.argmax(sizes))


def clustered(swing: Floats, channels: int | None) -> tuple[NDArray[np.int64], int]:
    """Which channel drives each muscle, and how many there are, by k-means of their waves.

    The first centres are spread over the waves, each the farthest from those before it, so that equal waves have equal
    channels (Gonzalez, Theoretical Computer Science 38, 1985).

    Args:
        swing: components of the waves, shape (M, 2).
        channels: at most so many; None for one each.
    """
    if channels is None or len(swing) <= channels:
        return np.arange(len(swing)), len(swing)
    centres = swing[np.argmax((swing * swing).sum(axis=1))][None]
    while len(centres) < channels:
        away = ((swing[:, None] - centres) ** 2).sum(axis=2).min(axis=1)
        if not away.max() > 0:
            break
        centres = np.concatenate([centres, swing[away.argmax()][None]])
    for _ in range(ROUNDS):
        nearest = cluster.vq.vq(swing, centres)[0]
        used = np.unique(nearest)
        moved = np.stack([swing[nearest == one].mean(axis=0) for one in used])
        if moved.shape == centres.shape and np.array_equal(moved, centres):
            break
        centres = moved
    used, nearest = np.unique(cluster.vq.vq(swing, centres)[0], return_inverse=True)
    return nearest.astype(np.int64), len(used)


def channels_of_cells(solid: Solid, swing: Floats) -> NDArray[np.int64]:
    """Channel of every cell of a grid, shape (V,): the one that drives it, else the one whose wave is the nearest.

    Args:
        solid: whose channels they are; of one without any, all cells have the first.
        swing: components of the waves of all cells, shape (V, 2).
    """
    if not solid.count:
        return np.zeros(len(swing), np.int64)
    found = cluster.vq.vq(swing, solid.members @ swing[solid.cells])[0].astype(np.int64)
    driven = solid.channels >= 0
    found[solid.cells[driven]] = solid.channels[driven]
    return found


def drives_of(solid: Solid, amplitude: Floats, phase: Floats, apart: bool) -> tuple[Drive, ...]:
    """What drives the channels of a solid: a drive for each, or one for all.

    Args:
        solid: whose channels they are.
        amplitude, phase: of the channels, shape (count,) each; phases in cycles.
        apart: whether each channel has a drive of its own, as those of a rig have.
    """
    if not apart:
        return (Drive("muscles", tuple(range(solid.count)), amplitude=tuple(amplitude), phase=tuple(phase)),)
    return tuple(
        Drive(f"channel_{number + 1}", (number,), amplitude=a, phase=p)
        for number, (a, p) in enumerate(zip(amplitude.tolist(), phase.tolist(), strict=True))
    )
