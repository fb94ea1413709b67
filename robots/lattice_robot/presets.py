"""Lattice robots that come with the lab, by name: bodies for tasks, with free waves and, in some, free reflexes."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from robots.lattice_robot.drive import Drive, Free
from robots.lattice_robot.reflexes import Reflexes
from robots.lattice_robot.robot import LatticeRobot
from taichi_sim.base.arrays import Bools
from taichi_sim.lattice import Material, body_from_array

EDGE = 0.01  # of a voxel [m]
RUBBER = Material(1e5, 1e3, static_friction=1.0, kinetic_friction=0.8, internal_damping=1.0, name="rubber")
MOST = 0.2  # amplitude of a muscle, part of its length
FREQUENCY, SETTLING = 4.0, 0.1  # Hz, s
MUSCLE = 2  # voxels along x and y that swell together; above each other every layer does by itself
SAID = "strain", "touch", "tilt", "velocity", "clock"


def _muscles(filled: Bools, name: str, cycles: int, reflexes: Reflexes | None = None) -> LatticeRobot:
    """A body of rubber whose columns of 2 x 2 voxels have a muscle in every layer, with free amplitudes and phases."""
    x, y, z = np.indices(filled.shape)
    regions = (x // MUSCLE * ((filled.shape[1] + 1) // MUSCLE) + y // MUSCLE) * filled.shape[2] + z
    regions = np.unique(regions[filled], return_inverse=True)[1]
    numbers = np.zeros(filled.shape, int)
    numbers[filled] = regions
    body = body_from_array(filled.astype(int), RUBBER, EDGE, regions=numbers)
    count = int(regions.max()) + 1
    amplitude, phase = Free(0.0, MOST), Free(0.0, 1.0)
    drive = Drive("muscle", tuple(range(count)), amplitude=(amplitude,) * count, phase=(phase,) * count)
    return LatticeRobot(
        body, (drive,), frequency=FREQUENCY, cycles=cycles, settling=SETTLING, name=name, reflexes=reflexes
    )


def _legged() -> Bools:
    """A slab of 8 x 4 x 2 voxels on four legs of 2 x 2 x 1, shape (8, 4, 3)."""
    filled = np.ones((8, 4, 3), bool)
    filled[2:6, :, 0] = False
    return filled


def soft_quadruped(cycles: int = 4) -> LatticeRobot:
    """A slab of muscles on four legs, which plays waves."""
    return _muscles(_legged(), "soft quadruped", cycles)


def feeling_quadruped(cycles: int = 8) -> LatticeRobot:
    """The quadruped with reflexes: strain, touch, tilt, velocity and time change its waves, linearly."""
    return replace(soft_quadruped(cycles), name="feeling quadruped", reflexes=Reflexes(SAID))


def light_seeker(cycles: int = 8) -> LatticeRobot:
    """The quadruped that feels a light at every muscle, and the time; a network of 16 hidden nodes answers."""
    reflexes = Reflexes(("light", "clock"), (16,), gain=MOST)
    return replace(soft_quadruped(cycles), name="light seeker", reflexes=reflexes)


def soft_swimmer(cycles: int = 4) -> LatticeRobot:
    """A flat bar of muscles, 12 x 4 x 2 voxels, for water."""
    return _muscles(np.ones((12, 4, 2), bool), "soft swimmer", cycles)


OFFERED: Mapping[str, Callable[[], LatticeRobot]] = MappingProxyType(
    {
        "soft-quadruped": soft_quadruped,
        "feeling-quadruped": feeling_quadruped,
        "light-seeker": light_seeker,
        "soft-swimmer": soft_swimmer,
    }
)
