"""Robots of which the world holds voxels, on uneven ground: these are held where the ground has raised them to."""

from typing import Any

import numpy as np

from taichi_sim.base.arrays import Floats
from taichi_sim.lattice import LatticeBody, Quantity
from taichi_sim.lattice.program import EVENT


def held_up(body: LatticeBody, rises: Floats) -> Any:
    """Events that hold the voxels of B robots as much higher as each is raised, shape (B,) [m].

    What the world does not hold is free, also in a region of voxels that it holds; the level floor needs no events.
    """
    rows, regions = np.flatnonzero(rises), np.unique(np.asarray(body.regions)[np.asarray(body.fixed)[:, 2]])
    events = np.zeros((len(rows), len(regions)), EVENT)
    events["robot"], events["region"] = rows[:, None], regions
    events["quantity"], events["value"] = Quantity.TRANSLATION + 2, rises[rows, None]
    return events.ravel()
