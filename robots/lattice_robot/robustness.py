"""How far the speed of a soft robot can be trusted: noisy starts, other friction, half the time step, other links.

Contact makes robots sensitive: a gait that a search has found may live on one friction, one step size or one stance.
"""

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from robots.control.cyclic import LEAST_FREQUENCY, MOST_FREQUENCY
from robots.lattice_robot.gains import Gains
from robots.lattice_robot.ground import without_friction
from robots.outcome import Judgement
from robots.robot import Progress, Trial
from robots.uncertainty import Perturbation
from robots.world import Terrain
from taichi_sim.base.arrays import Floats
from taichi_sim.base.compute import Compute
from taichi_sim.base.short_text import decimal
from taichi_sim.lattice.body import BALANCED

if TYPE_CHECKING:
    from robots.lattice_robot.drive import Drive
    from robots.lattice_robot.robot import LatticeRobot

STARTS = 8
NOISE = 1e-3  # of an edge: standard deviation of the start positions, unless the robot has its own
FRICTIONS = (0.5, 0.625, 0.75, 0.875)  # parts of the coefficients of all materials and drives
FINER, OTHER_LINKS = "half the time step", "balanced links"  # changes of how a robot is computed, not of the robot
ENOUGH = 0.5  # part of the speed that shall remain in the median


@dataclass(frozen=True, eq=False)
class Trust:
    """Speeds of a robot in trials that differ from each other [body lengths/s]; one that diverges does not move.

    Attributes:
        starts: from noisy starts, shape (R,).
        changed: under changed conditions, by their names.
    """

    starts: Floats
    changed: dict[str, float]

    @property
    def speed(self) -> float:
        """Median of the noisy starts."""
        return float(np.median(self.starts))

    @property
    def kept(self) -> float:
        """Part of the speed, which may be backwards, that remains in the median of the changed conditions.

        It is 0 for a robot that goes nowhere.
        """
        return float(np.median(list(self.changed.values()))) / self.speed if self.speed else 0.0

    @property
    def broken_by(self) -> tuple[str, ...]:
        """Conditions under which less than half of the speed remains; of one backwards, that much backwards."""
        way = np.copysign(1.0, self.speed)
        return tuple(name for name, speed in self.changed.items() if way * speed < ENOUGH * abs(self.speed))

    @property
    def unsettled_by(self) -> tuple[str, ...]:
        """Other ways to compute it that make it more than half as fast again, and faster than from any noisy start."""
        way, speeds = np.copysign(1.0, self.speed), self.changed.items()
        most = max((2 - ENOUGH) * abs(self.speed), (way * self.starts).max())
        return tuple(name for name, speed in speeds if name in (FINER, OTHER_LINKS) and way * speed > most)

    @property
    def judgement(self) -> Judgement:
        """The trust in words, and as a document."""
        low, high = self.starts.min(), self.starts.max()
        spread = f"{decimal(self.speed)} BL/s, {decimal(low)} to {decimal(high)} from {len(self.starts)} noisy starts"
        told = ", ".join(f"{name} {decimal(speed)}" for name, speed in self.changed.items())
        text = f"{spread}\nchanged: {told}\n{self.kept:.2f} of the speed remains in the median"
        if self.broken_by:
            text += f"; less than half with {', '.join(self.broken_by)}"
        if self.unsettled_by:
            text += f"; more than half as fast again with {' and '.join(self.unsettled_by)}, so the speed is a guess"
        document: dict[str, Any] = {
            "speeds": self.starts.tolist(),
            "changed": self.changed,
            "kept": self.kept,
            "broken_by": list(self.broken_by),
            "unsettled_by": list(self.unsettled_by),
        }
        return Judgement(text, document, not self.kept >= ENOUGH)


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
    return Trust(np.array(speeds[:STARTS]), dict(zip(names[STARTS:], speeds[STARTS:], strict=True)))


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
