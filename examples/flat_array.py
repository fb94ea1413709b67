"""A robot of an array as EvoGym's: rows from the top, 1 rigid, 2 soft, 3 and 4 what lengthens along and across.

morpholab view examples/flat_array.py --strip flat_array.png
morpholab codesign --robot examples/flat_array.py --method cma --generations 20 --out runs/flat
"""

import numpy as np

from robots.lattice_robot import Drive, Free, LatticeRobot
from taichi_sim.lattice import Material, body_from_array

rows = np.array([[3, 3, 3, 3, 3], [3, 3, 1, 3, 3], [4, 4, 2, 4, 4], [4, 4, 0, 4, 4], [4, 4, 0, 4, 4]])
rigid = Material(youngs_modulus=1e6, density=1e3, static_friction=1.0, kinetic_friction=0.8, name="rigid")
soft = Material(youngs_modulus=1e5, density=1e3, static_friction=1.0, kinetic_friction=0.8, name="soft")

body = rows[::-1].T[:, None]  # x along, one voxel across, z up
kinds = np.where(body > 1, 2, body)  # muscles are soft
regions = np.arange(body.size).reshape(body.shape)  # each voxel is told by itself
held = np.zeros((*body.shape, 6), bool)
held[..., [1, 3, 5]] = True  # no way across and no turn out of the plane, or it would fall over sideways


def drive(name: str, axes: str, code: int) -> Drive:
    """Voxels of a code lengthen and shorten along an axis, each with a phase of its own."""
    driven = tuple(int(n) for n in regions[body == code])
    phases = tuple(Free(0.0, 1.0, start=float(n // len(rows)) / 5) for n in driven)
    return Drive(name, driven, amplitude=Free(0.0, 0.3, start=0.15), phase=phases, axes=axes)


robot = LatticeRobot(
    body=body_from_array(kinds, (rigid, soft), voxel_size=0.01, regions=regions, fixed=held),
    drives=(drive("along", "x", 3), drive("across", "z", 4)),
    frequency=4.0,
    cycles=3,
)
