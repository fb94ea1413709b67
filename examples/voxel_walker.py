"""A robot of a VoxCAD file, in the style of evosoro and voxcraft: every voxel swells with heat, at a phase of its own.

morpholab view examples/voxel_walker.vxa --out walker.html
morpholab codesign --robot examples/voxel_walker.py --climbers 16 --generations 30 --out runs/walker
"""

from pathlib import Path

from robots.lattice_robot import Free, robot_of_voxel_file
from taichi_sim.lattice.files import load_voxel_file

# The phases of the file are a wave that runs along x; here a search may change all of them.
file = load_voxel_file(Path(__file__).with_name("voxel_walker.vxa"))
robot = robot_of_voxel_file(file, phase=Free(0.0, 1.0), name="voxel walker")
