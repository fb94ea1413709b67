"""Centres of mass of robots of files."""

import numpy as np

from taichi_sim.base.arrays import Floats
from taichi_sim.rigid import Tree, poses


def centres(tree: Tree, position: Floats, orientation: Floats, angles: Floats) -> Floats:
    """Centres of mass, (..., 3) [m], at poses as of ``taichi_sim.rigid.poses``."""
    masses = tree.masses
    return np.asarray(masses @ poses(tree, position, orientation, angles)[0] / masses.sum())


def first_centre(tree: Tree) -> Floats:
    """Centre of mass of a robot as its file has it, from where distances count, (1, 3) [m]."""
    begin, still = np.array([tree.ordered[0][0].position], float), np.array([[1.0, 0.0, 0.0, 0.0]])
    return centres(tree, begin, still, np.zeros((1, len(tree.hinges))))
