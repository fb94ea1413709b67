"""How far the speed of a soft robot can be trusted: noisy starts, other friction, half the time step, other links.

Contact makes robots sensitive: a gait that a search has found may live on one friction, one step size or one stance.
"""

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from robots.control.cyclic import LEAST_FREQUENCY, MOST_FREQUENCY
from robots.lattice_robot.gains import Gains
from robots.lattice_robot.ground import without_friction
from robots.robot import Progress, Trial
from robots.trust import FINER, FRICTIONS, Trust
from robots.uncertainty import Perturbation
from robots.world import Terrain
from taichi_sim.base.compute import Compute
from taichi_sim.lattice.body import BALANCED

if TYPE_CHECKING:
    from robots.lattice_robot.drive import Drive
    from robots.lattice_robot.robot import LatticeRobot

STARTS = 8
NOISE = 1e-3  # of an edge: standard deviation of the start positions, unless the robot has its own
OTHER_LINKS = "balanced links"  # a change of how a robot is computed, not of the robot


def trust_in(
    robot: "LatticeRobot", terrain: Terrain, *, seed: int = 0, compute: Compute, progress: Progress | None = None
) -> Trust:
    """Try a robot, of which nothing is free, from noisy starts, with other friction, time steps and links."""
    robot, terrain = robot.on(terrain), without_friction(terrain)  # a part of this friction is tried, too
    noise = robot.perturbation or NOISE * robot.body.voxel_size
    noisy = replace(robot, perturbation=noise, seed=seed)
    trials = [("", replace(noisy, seed=seed + number)) for number in range(STARTS)]
    if not terrain.is_fluid:
        trials += [(f"{part:g} of the friction", _slippery(noisy, part)) for part in FRICTIONS]
    trials.append((FINER, replace(noisy, time_step_safety=2 * robot.time_step_safety)))
    if not (terrain.is_wet or robot.body.is_balanced):  # in water all links are
        trials.append((OTHER_LINKS, replace(noisy, body=replace(noisy.body, links=BALANCED))))
    names, robots = zip(*trials, strict=True)
    told = Trial(terrain, compute, progress=progress)
    outcomes = robot.run_in(robot.points(()), [terrain] * len(trials), told, robots)
    speeds = [float(np.nan_to_num(outcome.measures["speed"][0])) for outcome in outcomes]
    changed = dict(zip(names[STARTS:], speeds[STARTS:], strict=True))
    return Trust(np.array(speeds[:STARTS]), changed, recomputed=(FINER, OTHER_LINKS))


def _slippery(robot: "LatticeRobot", part: float) -> "LatticeRobot":
    """The robot with a part of the friction of each of its materials, and of that to which drives bring its regions."""
    materials = (Perturbation(part, part).rubbed(material) for material in robot.body.materials)
    drives = tuple(_with_part(drive, part) if drive.quantity == "friction" else drive for drive in robot.drives)
    return replace(robot, body=robot.body.with_materials(materials), drives=drives)


def _with_part(drive: "Drive", part: float) -> "Drive":
    """A drive of which nothing is free, to a part of its values."""
    values = {name: getattr(drive, name) for name in ("mean", "amplitude")}
    times = {name: tuple((part * np.ravel(value)).tolist()) for name, value in values.items() if value is not None}
    changed: dict[str, Any] = {name: given if len(given) > 1 else given[0] for name, given in times.items()}
    return replace(drive, **changed)


def perturbed_robot(robot: "LatticeRobot", drawn: Perturbation) -> "LatticeRobot":
    """The robot with the friction of its materials, the amplitudes of its drives and the period multiplied as drawn."""
    levels, drives = iter(drawn.levels), []
    for drive in robot.drives:
        gains = None
        if drawn.levels and drive.quantity != "friction":
            limit = robot.largest_amplitude if drive.quantity == "scale" else None
            factors = tuple(next(levels) for _ in drive.regions)
            gains = Gains(factors, drawn.largest_level, math.inf if limit is None else limit)
        drives.append(replace(drive, gains=gains))
    frequency = min(max(robot.frequency / drawn.timing, LEAST_FREQUENCY), MOST_FREQUENCY)
    robot = replace(robot, drives=tuple(drives), frequency=frequency)
    return robot if drawn.gripping == 1 else _slippery(robot, drawn.gripping)
