"""The smallest and largest rest sizes that the drives of a lattice robot can give its voxels."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from robots.lattice_robot.drive import Drive, Free, Value, Values, driven_voxels
from robots.lattice_robot.faults import SMALLEST
from taichi_sim.base.arrays import Floats
from taichi_sim.lattice.time_steps import HALF

if TYPE_CHECKING:
    from robots.lattice_robot.robot import LatticeRobot

# A bound of the sum of the harmonics of a wave, which oscillators shift, over the largest value of its knots.
HARMONICS = 4.0


def usual_range(robot: "LatticeRobot") -> tuple[float, float]:
    """Smallest and largest rest size of a robot's voxels [edges] without gains of its drives: those given, or reached.

    Those reached count whatever is free of it.
    """
    lowest, highest = robot.lowest_size, robot.highest_size
    if lowest is not None and highest is not None:
        return lowest, highest
    least, most = _reached(robot, False)
    return lowest or least, highest or most


def size_range(robot: "LatticeRobot") -> tuple[float, float]:
    """Smallest and largest rest size of a robot's voxels [edges] with the largest gains that its drives may be drawn.

    Sizes that are given are those of a search without gains, which move them away from the means of drives.
    """
    drawn = [drive for drive in robot.drives if drive.gains]
    if not drawn:
        return usual_range(robot)
    least, most = _reached(robot, True)
    gains = [drive.gains for drive in drawn if drive.gains]
    ends = [_means(robot, drive) if drive.quantity == "scale" else (np.ones(1), np.ones(1)) for drive in drawn]
    low, high = min(float(lows.min()) for lows, _ in ends), max(float(highs.max()) for _, highs in ends)
    if robot.lowest_size is not None:
        least = min(least, low - max(float(each.reached(low - robot.lowest_size)) for each in gains))
    if robot.highest_size is not None:
        most = max(most, high + max(float(each.reached(robot.highest_size - high)) for each in gains))
    return max(least, SMALLEST), most


def kept(robot: "LatticeRobot", design: "LatticeRobot") -> "LatticeRobot":
    """A design of a robot with the sizes for which the robot's time steps are, where its own are others.

    They are without gains, whatever the robot has: gains of the design move them on.
    """
    given = zip(("lowest_size", "highest_size"), usual_range(robot), usual_range(design), strict=True)
    changed: dict[str, Any] = {name: size for name, size, own in given if own != size}
    return replace(design, **changed)


def _reached(robot: "LatticeRobot", drawn: bool) -> tuple[float, float]:
    """Smallest and largest rest size for which the time steps of a robot are [edges], see :func:`reached_sizes`.

    A smallest size above half an edge is told as that: it changes no time step. Sizes below ``SMALLEST`` are refused
    when they come, so none is smaller.
    """
    least, most = reached_sizes(robot, robot.drives, drawn)
    return min(max(float(least.min()), SMALLEST), HALF), float(most.max())


def reached_sizes(robot: "LatticeRobot", drives: Sequence[Drive], drawn: bool = False) -> tuple[Floats, Floats]:
    """Smallest and largest rest size that each voxel of a robot can reach [edges], shape (V,) each.

    That is by some of its drives, whatever is free of it. What reflexes answer is counted, and gains if ``drawn``.
    """
    body = robot.body
    of_voxels = [body.materials[number] for number in body.material_index]
    scales = [np.array([pick(material.scale) for material in of_voxels]) for pick in (min, max)]
    heats = [np.array([material.temperature for material in of_voxels]) for _ in scales]
    expansion = np.array([material.thermal_expansion for material in of_voxels])
    for drive in drives:
        if drive.quantity not in ("scale", "temperature"):
            continue
        rows = driven_voxels(drive, body)
        known_ends = scales if drive.quantity == "scale" else heats
        found = zip(_range(robot, drive, drawn), known_ends, (np.minimum, np.maximum), strict=True)
        for end, known, pick in found:
            of_region = dict(zip(drive.regions, end.tolist(), strict=True))
            reached = [of_region[region] for region in np.asarray(body.regions)[rows].tolist()]
            known[rows] = pick(known[rows], reached)  # they settle from what the materials say
    warm = [1 + expansion * heat for heat in heats]
    least = scales[0] * np.minimum(np.minimum(*warm), 1.0)
    most = scales[1] * np.maximum(np.maximum(*warm), 1.0)
    return least, most


def _range(robot: "LatticeRobot", drive: Drive, drawn: bool) -> tuple[Floats, Floats]:
    """The least and the most that a drive can make of its quantity in each of its regions, shape (G,) each.

    With its gains, if ``drawn``.
    """
    share, (low, high) = max(map(abs, drive.shares)), _means(robot, drive)
    knots = max((abs(bound) for knot in drive.knots for bound in _bounds(knot)), default=1.0)
    amplitudes = _each(drive.amplitude, len(drive.regions))
    swing = np.array([max(map(abs, _bounds(value))) for value in amplitudes]) * knots
    if drawn and drive.gains:
        swing = drive.gains.reached(swing)
    swing = swing * share
    if robot.reflexes is None or drive.quantity != "scale":
        return low - swing, high + swing
    if robot.reflexes.kind == "network":
        more = swing + robot.reflexes.gain * share
        return low - more, high + more
    more = swing * (1 + robot.reflexes.gain)
    # The bound of harmonics is wide: what shrinks hardly comes near it, and would take steps many times as short.
    return low - more, high + more * (HARMONICS if drive.knots else 1.0)


def _means(robot: "LatticeRobot", drive: Drive) -> tuple[Floats, Floats]:
    """The lowest and the highest that the mean of a drive may be in each of its regions, shape (G,) each."""
    if drive.mean is None:
        rest = robot.rest_of(drive)
        return rest.min(axis=0), rest.max(axis=0)
    return _ends(drive.mean, len(drive.regions))


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
