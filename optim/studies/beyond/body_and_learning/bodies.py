"""Soft walkers that feel, with bodies drawn by number: a back on legs of different length and place."""

from collections.abc import Sequence
from functools import cache

import numpy as np

from robots.lattice_robot import Drive, Free, LatticeRobot
from robots.lattice_robot.reflexes import Reflexes
from robots.world import Terrain
from taichi_sim.base.arrays import Floats, Ints
from taichi_sim.lattice import Material, body_from_array

EDGE = 0.01  # of a voxel [m]
ALONG, ACROSS, WIDE = 3, 2, 2  # columns, each of so many voxels each way; each is a muscle
LONGEST, THICKEST = 2, 2  # voxels of a leg, and of the back
RUBBER = Material(1e5, 1e3, static_friction=1.0, kinetic_friction=0.8, internal_damping=1.0, name="rubber")
REFLEXES = Reflexes(("touch", "tilt", "light", "clock"), gain=0.2)
AMPLITUDE, FREQUENCY, SETTLING = 0.25, 5.0, 0.1  # most of a muscle; Hz; s

LIGHT_AT = 0.25  # m: how far the light is in every world
_AHEAD, _ASIDE = f"light:{LIGHT_AT},0", "light:{0:.4f},{0:.4f}".format(LIGHT_AT / np.sqrt(2))
WORLDS = tuple(
    Terrain.parse(text) for text in (f"flat+{_AHEAD}", f"hill:5+{_AHEAD}", f"rough:0.004+{_AHEAD}", f"flat+{_ASIDE}")
)


@cache
def columns_of(number: int) -> tuple[Ints, Ints]:
    """Length of the leg and thickness of the back in every column of a walker [voxels], shape (3, 2) each.

    The back is one or two voxels thick and legs are up to two long, at least two of them the longest.
    """
    rng = np.random.default_rng((number, 36))
    while True:
        legs = rng.integers(0, LONGEST + 1, (ALONG, ACROSS))
        thick = rng.integers(1, THICKEST + 1, (ALONG, ACROSS))
        if (legs == legs.max()).sum() >= 2 and legs.max() > 0:
            return legs, thick


def described(number: int) -> Floats:
    """A body in numbers from -1 to 1, and a one, shape (13,): legs, then thickness, column by column."""
    legs, thick = columns_of(number)
    return np.concatenate([legs.ravel() - 1.0, 2.0 * thick.ravel() - 3.0, [1.0]])


def different(first: int, count: int, met: Sequence[int] = ()) -> Ints:
    """Numbers of walkers from a first one on, shape (N,), that all differ in their bodies, from those met, too."""
    known = {described(number).tobytes() for number in met}
    numbers: list[int] = []
    while len(numbers) < count:
        if (body := described(first).tobytes()) not in known:
            known.add(body)
            numbers.append(first)
        first += 1
    return np.array(numbers)


@cache
def walker(number: int, cycles: int = 3) -> LatticeRobot:
    """The walker of a number; its waves and the weights of its reflexes are free.

    All walkers have as many muscles, so that controllers of one fit all others.
    """
    return walker_of(*columns_of(number), cycles, f"walker {number}")


def walker_of(legs: Ints, thick: Ints, cycles: int, name: str = "walker") -> LatticeRobot:
    """The walker with legs and a back of so many voxels in every column, shape (3, 2) each."""
    filled = np.zeros((ALONG * WIDE, ACROSS * WIDE, LONGEST + THICKEST), bool)
    for i in range(ALONG):
        for j in range(ACROSS):
            low, high = legs.max() - legs[i, j], legs.max() + thick[i, j]
            filled[WIDE * i : WIDE * (i + 1), WIDE * j : WIDE * (j + 1), low:high] = True
    x, y, _ = np.indices(filled.shape)
    columns = np.where(filled, x // WIDE * ACROSS + y // WIDE, 0)
    body = body_from_array(filled.astype(int), RUBBER, EDGE, regions=columns)
    count = ALONG * ACROSS
    amplitudes, phases = (Free(0.0, AMPLITUDE),) * count, (Free(0.0, 1.0),) * count
    drive = Drive("muscle", tuple(range(count)), amplitude=amplitudes, phase=phases)
    return LatticeRobot(
        body,
        (drive,),
        frequency=FREQUENCY,
        cycles=cycles,
        settling=SETTLING,
        name=name,
        reflexes=REFLEXES,
    )
