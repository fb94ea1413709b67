"""Records of motions that were never simulated, whose measures are known."""

import numpy as np

from robots.control.cyclic import FRAMES_FROM, LAST_CYCLE
from robots.lattice_robot.measures import Constants, Record
from taichi_sim.lattice import LatticeBody, Material

EDGE, MODULUS = 0.01, 1e5
RUBBER = Material(MODULUS, 1e3, static_friction=1.0, kinetic_friction=0.8, name="rubber")
BAR = LatticeBody(np.argwhere(np.ones((3, 1, 1))), (RUBBER,), np.zeros(3, int), EDGE)


def recorded(body=BAR, density=None, driven=None, **changes):
    """Constants and a record in which nothing moves, of one robot."""
    count = body.voxel_count
    constants = Constants(
        np.full((1, count), 1e3) if density is None else np.array([density]),
        np.full((1, count), MODULUS),
        np.ones((1, count)) if driven is None else np.array([driven]),
        body,
        np.array([1.0, 0.0, 0.0]),
        0.03,
        0.5,
        4.0,
        np.linspace(0.0, 0.25, LAST_CYCLE.stop - LAST_CYCLE.start),
        changes.pop("target", None),
        is_light=changes.pop("is_light", False),
    )
    positions = np.tile(body.start_positions, (1, FRAMES_FROM, 1, 1))
    strains = np.zeros((1, FRAMES_FROM, len(body.topology.links)))
    sizes = np.full((1, FRAMES_FROM, count, 3), EDGE)
    return constants, Record(positions, strains, sizes)
