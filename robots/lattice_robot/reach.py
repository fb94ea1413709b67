"""The largest rest sizes that the drives of a lattice robot can give its voxels."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from robots.lattice_robot.drive import Drive, Free, Value, Values, driven_voxels
from taichi_sim.base.arrays import Floats

if TYPE_CHECKING:
    from robots.lattice_robot.robot import LatticeRobot

# A bound of the sum of the harmonics of a wave, which oscillators shift, over the largest value of its knots.
HARMONICS = 4.0


def largest_size(robot: "LatticeRobot") -> float:
    """Largest rest size that a voxel of a robot can reach [edges], whatever is free of it, with what reflexes answer.

    Gains of drives, of which uncertain ones have some, are not counted: robots that differ in them share time steps,
    whose safety factor is more than what they add.
    """
    body = robot.body
    of_voxels = [body.materials[number] for number in body.material_index]
    scale = np.array([max(material.scale) for material in of_voxels])
    heat = np.array([material.temperature for material in of_voxels])
    expansion = np.array([material.thermal_expansion for material in of_voxels])
    for drive in robot.drives:
        if drive.quantity not in ("scale", "temperature"):
            continue
        most, middle = _most(robot, drive), scale if drive.quantity == "scale" else heat
        rows = driven_voxels(drive, body)
        of_region = dict(zip(drive.regions, most.tolist(), strict=True))
        reached = [of_region[region] for region in np.asarray(body.regions)[rows].tolist()]
        middle[rows] = np.maximum(middle[rows], reached)  # they settle from what the materials say
    return float((scale * np.maximum(1 + expansion * heat, 1.0)).max())


def _most(robot: "LatticeRobot", drive: Drive) -> Floats:
    """The most that a drive can make of its quantity in each of its regions, shape (G,)."""
    count, share = len(drive.regions), max(map(abs, drive.shares))
    middle = robot.rest_of(drive).max(axis=0) if drive.mean is None else _highest(drive.mean, count)
    knots = max((abs(bound) for knot in drive.knots for bound in _bounds(knot)), default=1.0)
    amplitudes = _each(drive.amplitude, count)
    swing = np.array([max(map(abs, _bounds(value))) for value in amplitudes]) * knots * share
    if robot.reflexes is None or drive.quantity != "scale":
        return middle + swing
    if robot.reflexes.kind == "network":
        return middle + swing + robot.reflexes.gain * share
    return middle + swing * (1 + robot.reflexes.gain) * (HARMONICS if drive.knots else 1.0)


def _highest(values: Values, count: int) -> Floats:
    """The highest that each of so many values may be."""
    return np.array([_bounds(value)[1] for value in _each(values, count)])


def _each(values: Values, count: int) -> Sequence[Value]:
    """A value for each of so many regions."""
    return values if isinstance(values, tuple) else (values,) * count


def _bounds(value: Value) -> tuple[float, float]:
    """The lowest and the highest that a value may be."""
    return (value.low, value.high) if isinstance(value, Free) else (value, value)
