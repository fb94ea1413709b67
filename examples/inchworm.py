"""A robot of an array: a bar on two feet that lengthens and shortens between feet that grip in turn.

morpholab view examples/inchworm.py --out inchworm.html
morpholab codesign --robot examples/inchworm.py --method gradient --climbers 8 --generations 20 --out runs/inchworm
morpholab gradient-check --robot examples/inchworm.py
"""

import numpy as np

from robots.lattice_robot import Drive, Free, LatticeRobot
from taichi_sim.lattice import Material, body_from_array

rubber = Material(youngs_modulus=1e5, density=1e3, static_friction=1.0, kinetic_friction=0.8, name="rubber")
foam = Material(youngs_modulus=5e4, density=5e2, name="foam")

# x, y, z: two feet of rubber, and a bar of foam between them.
body = np.full((8, 2, 2), 2)
body[2:6, :, 0] = 0
body[:2] = body[6:] = 1
# Regions: 0 the back foot, 1 the bar, 2 the front foot.
regions = np.ones(body.shape, int)
regions[:2], regions[6:] = 0, 2

robot = LatticeRobot(
    body=body_from_array(body, (rubber, foam), voxel_size=0.01, regions=regions),
    drives=(
        Drive("bar", (1,), "scale", mean=Free(0.9, 1.1), amplitude=Free(0.0, 0.25, start=0.2), axes="x"),
        Drive("back", (0,), "friction", mean=0.8, amplitude=Free(0.0, 0.7), phase=Free(0.0, 1.0, start=0.25)),
        Drive("front", (2,), "friction", mean=0.8, amplitude=Free(0.0, 0.7), phase=Free(0.0, 1.0, start=0.75)),
    ),
    moduli={"foam": Free(3e4, 2e5)},
    frequency=4.0,
    cycles=3,
)
