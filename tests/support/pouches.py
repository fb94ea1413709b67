"""Lattices under pressure: a hollow box, and a pouch that is neither symmetric nor closed at its ends."""

import numpy as np

from taichi_sim.lattice import LatticeBody, Material

EDGE, TIME_STEP = 0.01, 1e-4
RUBBER = Material(4e5, 3000.0, internal_damping=1.0)


def shell(shape=(4, 4, 4), **options) -> LatticeBody:
    """A hollow box, its outer faces under pressure."""
    places = np.argwhere(np.ones(shape))
    low, high = places == 0, places == np.array(shape) - 1
    skin = (low | high).any(axis=1)
    options = {"pressure_normals": (high.astype(int) - low)[skin]} | options
    return LatticeBody(places[skin], (RUBBER,), np.zeros(skin.sum(), int), EDGE, **options)


def two_boxes(**options) -> LatticeBody:
    """Two hollow boxes of 3 x 3 x 3 voxels, the second inside out, on a bridge of two voxels between them."""
    box = shell((3, 3, 3))
    bridge = np.array([[3, 1, 1], [4, 1, 1]])
    voxels = np.concatenate([box.voxels, bridge, box.voxels + np.array([5, 0, 0])])
    normals = np.concatenate([box.pressure_normals, 0 * bridge, -box.pressure_normals])
    options = {"pressure_normals": normals} | options
    return LatticeBody(voxels, (RUBBER,), np.zeros(len(voxels), int), EDGE, **options)


def lopsided() -> LatticeBody:
    """A flat pouch, open at both ends, that carries a fin on one corner of its upper skin."""
    skins = np.array([(x, y, z) for z in (0, 1) for x in range(5) for y in range(4)])
    fin = np.array([(3, y, z) for z in (2, 3) for y in (0, 1)])
    voxels = np.concatenate([skins, fin])
    cut = [(i, i + 20) for i in range(20) if 0 < skins[i, 0] < 4]
    normals = np.zeros_like(voxels)
    normals[:20, 2], normals[20:40, 2] = -1, 1
    return LatticeBody(voxels, (RUBBER,), np.zeros(len(voxels), int), EDGE, cut_links=cut, pressure_normals=normals)
