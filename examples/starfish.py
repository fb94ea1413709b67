"""A robot of a mesh: a star of five arms, each bent by its lower half at a phase of its own.

morpholab view examples/starfish.py --out starfish.html
morpholab codesign --robot examples/starfish.py --climbers 8 --generations 20 --out runs/starfish
"""

import numpy as np
import trimesh

from robots.lattice_robot import Drive, Free, LatticeRobot
from taichi_sim.lattice import Material, body_from_array
from taichi_sim.lattice.files.mesh import voxelise

ARMS, PITCH = 5, 0.01  # [m]
rubber = Material(youngs_modulus=1e5, density=1e3, static_friction=0.9, kinetic_friction=0.6, name="rubber")

# The surface: an outline with five tips, drawn upwards; a file would do as well, voxelise("starfish.stl", ...).
angles = np.arange(2 * ARMS) * np.pi / ARMS
radii = np.where(np.arange(2 * ARMS) % 2, 0.032, 0.093)
outline = np.column_stack([radii * np.cos(angles), radii * np.sin(angles)])
ring = np.column_stack([np.zeros(2 * ARMS, int), 1 + np.arange(2 * ARMS), 1 + (np.arange(2 * ARMS) + 1) % (2 * ARMS)])
mesh = trimesh.creation.extrude_triangulation(np.vstack([[0.0, 0.0], outline]), ring, height=2 * PITCH)
found = voxelise(mesh, PITCH)

# Regions: 0 the hub; upper halves of the arms 1 to 5, lower halves 6 to 10.
places = np.argwhere(np.ones(found.filled.shape)) * PITCH + found.origin
arm = 1 + np.rint(np.arctan2(places[:, 1], places[:, 0]) / (2 * np.pi / ARMS)).astype(int) % ARMS
upper = places[:, 2] > mesh.bounds[:, 2].mean()
region = np.where(np.hypot(places[:, 0], places[:, 1]) < 0.025, 0, np.where(upper, arm, arm + ARMS))
body = body_from_array(found.filled, rubber, PITCH, regions=region.reshape(found.filled.shape))

phases = tuple(Free(0.0, 1.0, start=n / ARMS) for n in range(ARMS))
lift = Drive("lift", tuple(range(ARMS + 1, 2 * ARMS + 1)), amplitude=Free(0.0, 0.3, start=0.2), phase=phases, axes="xy")
swing = Drive("swing", tuple(range(1, ARMS + 1)), amplitude=Free(0.0, 0.3, start=0.1), phase=Free(0.0, 1.0), axes="xy")
robot = LatticeRobot(body, (lift, swing), frequency=3.0, cycles=3, name="starfish")
