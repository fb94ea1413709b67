"""The smallest and largest rest sizes that the drives of a lattice robot can give its voxels."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from robots.lattice_robot.drive import Drive, Free, Value, Values, driven_voxels
from robots.lattice_robot.faults import SMALLEST
from taichi_sim.base.arrays import Floats
from taichi_sim.lattice.time_steps import HALF

if TYPE_CHECKING:
    from robots.lattice_robot.robot import LatticeRobot

# A bound of the sum of the harmonics of a wave, which oscillators shift, over the largest value of its knots.
HARMONICS = 4.0


def size_range(robot: "LatticeRobot") -> tuple[float, float]:
    """Smallest and largest rest size that a voxel of a robot can reach [edges], whatever is free of it.

    What reflexes answer is counted. A smallest size above half an edge is told as that: it changes no time step. Sizes
    below ``SMALLEST`` are refused when they come, so none is smaller.

    Gains of drives, of which uncertain ones have some, are not counted: robots that differ in them share time steps,
    whose safety factor is more than what they add.
    """
    body = robot.body
    of_voxels = [body.materials[number] for number in body.material_index]
    scales = [np.array([pick(material.scale) for material in of_voxels]) for pick in (min, max)]
    heats = [np.array([material.temperature for material in of_voxels]) for _ in scales]
    expansion = np.array([material.thermal_expansion for material in of_voxels])
    for drive in robot.drives:
        if drive.quantity not in ("scale", "temperature"):
            continue
        rows = driven_voxels(drive, body)
        found = zip(
            _range(robot, drive), scales if drive.quantity == "scale" else heats, (np.minimum, np.maximum), strict=True
        )
        for end, known, pick in found:
            of_region = dict(zip(drive.regions, end.tolist(), strict=True))
            reached = [of_region[region] for region in np.asarray(body.regions)[rows].tolist()]
            known[rows] = pick(known[rows], reached)  # they settle from what the materials say
    warm = [1 + expansion * heat for heat in heats]
    least = scales[0] * np.minimum(np.minimum(*warm), 1.0)
    most = scales[1] * np.maximum(np.maximum(*warm), 1.0)
    return min(max(float(least.min()), SMALLEST), HALF), float(most.max())


def _range(robot: "LatticeRobot", drive: Drive) -> tuple[Floats, Floats]:
    """The least and the most that a drive can make of its quantity in each of its regions, shape (G,) each."""
    count, share = len(drive.regions), max(map(abs, drive.shares))
    if drive.mean is None:
        rest = robot.rest_of(drive)
        low, high = rest.min(axis=0), rest.max(axis=0)
    else:
        low, high = _ends(drive.mean, count)
    knots = max((abs(bound) for knot in drive.knots for bound in _bounds(knot)), default=1.0)
    amplitudes = _each(drive.amplitude, count)
    swing = np.array([max(map(abs, _bounds(value))) for value in amplitudes]) * knots * share
    if robot.reflexes is None or drive.quantity != "scale":
        return low - swing, high + swing
    if robot.reflexes.kind == "network":
        more = swing + robot.reflexes.gain * share
        return low - more, high + more
    more = swing * (1 + robot.reflexes.gain)
    # The bound of harmonics is wide: what shrinks hardly comes near it, and would take steps many times as short.
    return low - more, high + more * (HARMONICS if drive.knots else 1.0)


def _ends(values: Values, count: int) -> tuple[Floats, Floats]:
    """The lowest and the highest that each of so many values may be."""
    low, high = np.array([_bounds(value) for value in _each(values, count)]).T
    return low, high


def _each(values: Values, count: int) -> Sequence[Value]:
    """A value for each of so many regions."""
    return values if isinstance(values, tuple) else (values,) * count


def _bounds(value: Value) -> tuple[float, float]:
    """The lowest and the highest that a value may be."""
    return (value.low, value.high) if isinstance(value, Free) else (value, value)
