"""Derivatives of a robot's distance by its heading on uneven ground, which turns under the robot.

In a simulation the world turns with the heading: the ground, its slope and the direction of travel. The laws are
symmetric under rotation about the vertical, so this is the same as the robot, and the noise of its start, turning the
other way in a world that stays. The derivative by the heading follows from those by the state at the start.
"""

import numpy as np

from taichi_sim.base.arrays import Floats
from taichi_sim.ground.relief import Relief
from taichi_sim.lattice import LatticeGradient, LatticeState

TURN = 1e-6  # by which a start is turned to differentiate how far it is raised [rad]


def turned_vectors(vectors: Floats) -> Floats:
    """Derivatives of vectors, shape (..., 3), by a turn about the vertical [1/rad]."""
    return np.stack([-vectors[..., 1], vectors[..., 0], np.zeros(vectors.shape[:-1])], axis=-1)


def turned_quaternions(quaternions: Floats) -> Floats:
    """Derivatives of orientations (w, x, y, z), shape (..., 4), by a turn about the vertical [1/rad]."""
    w, x, y, z = np.moveaxis(quaternions, -1, 0)
    return 0.5 * np.stack([-z, -y, x, w], axis=-1)


def by_turn_of_robots(state: LatticeState, gradient: LatticeGradient) -> Floats:
    """Derivatives of a cost by a turn of B robots about the vertical through the origin, at the start [1/rad]."""
    found = (gradient.orientations * turned_quaternions(state.orientations)).sum(axis=(1, 2))
    for name in ("positions", "velocities", "angular_velocities"):
        found = found + (getattr(gradient, name) * turned_vectors(getattr(state, name))).sum(axis=(1, 2))
    return np.asarray(found)


def rise_by_turn(relief: Relief, centres: Floats, edge: float) -> float:
    """Derivative of how far a robot is raised to stand on its ground, by a turn of the robot [m/rad].

    Args:
        relief: ground of the robot.
        centres: of its voxels at the start [m], shape (V, 3).
        edge: of the voxels [m].
    """
    x, y, z = centres.T

    def rise(turn: float) -> float:
        cosine, sine = np.cos(turn), np.sin(turn)
        return relief.rise(np.stack([cosine * x - sine * y, sine * x + cosine * y, z], axis=1), edge)

    return (rise(TURN) - rise(-TURN)) / (2 * TURN)
