"""How far the speed of a rigid robot can be trusted: numbers of a design that differ a little, friction, time steps.

Contact makes robots sensitive: a gait that a search has found may live on one friction or one time step.
"""

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from robots.outcome import Judgement
from robots.robot import HERE, FixedRobot, Progress, World, part_of
from robots.trust import FINER, FRICTIONS, Trust
from robots.world import Terrain
from taichi_sim.base.arrays import Floats
from taichi_sim.base.compute import Compute

if TYPE_CHECKING:
    from robots.articulated.robot import ArticulatedRobot

DESIGNS = 8
NOISE = 1e-3  # of the range of each parameter: standard deviation of what designs differ by
FINEST = "a quarter of the time step"


class ArticulatedDesign(FixedRobot):
    """An articulated robot of which nothing is free, whose speed can be judged."""

    robot: "ArticulatedRobot"

    @property
    def can_be_judged(self) -> bool:  # type: ignore[override]
        """Whether there is friction, or a rhythm's time step, to change."""
        return self.robot.controller == "rhythm" or bool(_frictions(self.robot))

    def judge(
        self, world: World, *, seed: int = 0, compute: Compute = HERE, progress: Progress | None = None
    ) -> Judgement:
        """What remains of its speed if its numbers differ a little, with less friction, and with shorter steps."""
        return trust_in(self.robot, self.point, world, seed=seed, compute=compute, progress=progress).judgement


def trust_in(
    robot: "ArticulatedRobot",
    point: Floats,
    world: World,
    *,
    seed: int = 0,
    compute: Compute,
    progress: Progress | None = None,
) -> Trust:
    """Try a design, shape (P,), with its numbers a little off, with less friction, and with shorter time steps.

    Infinite friction gives way to that of the robot's file, whole and less. It is left out where it is 0, has no limit
    there either, or does not act, as afloat. Networks decide once a time step, so
    shorter ones would change what they do, and are left out.

    Raises:
        ValueError: for a network without friction that could change.
    """
    low, high = np.array([(each.low, each.high) for each in robot.parameters]).T
    noise = NOISE * (high - low) * np.random.default_rng(seed).standard_normal((DESIGNS, len(point)))
    near = np.clip(point + noise, low, high)
    variants: dict[str, ArticulatedRobot] = {}
    afloat = isinstance(world, Terrain) and world.is_fluid
    step = robot.physics.time_step
    if not afloat:
        variants |= {name: replace(robot, friction=friction) for name, friction in _frictions(robot).items()}
    if robot.controller == "rhythm":
        rate = 1 / (robot.hold * step)  # which stays
        for name, shorter in ((FINER, 2), (FINEST, 4)):
            variants[name] = replace(robot, time_step=step / shorter, command_rate=rate)
    if not variants:
        helps = "leave --judge out" if afloat else "give --friction"
        raise ValueError(f"judge: a network without friction that could change has nothing to change; {helps}")
    speeds = []
    for number, (tried, points) in enumerate([(robot, near), *((each, point[None]) for each in variants.values())]):
        tick = part_of(progress, number, 1 + len(variants))
        found = tried.simulate(points, world, compute=compute, progress=tick)
        speeds.append(np.nan_to_num(found.measures["speed"]))
    changed = {name: float(speed[0]) for name, speed in zip(variants, speeds[1:], strict=True)}
    alike = f"designs that differ by {100 * NOISE:g} % of their ranges"
    return Trust(speeds[0], changed, (FINER, FINEST), "m/s", alike)


def _frictions(robot: "ArticulatedRobot") -> dict[str, float]:
    """Coefficients of friction with which a robot is tried, by what they are called; none where none can be lower."""
    friction, of_file = robot.physics.friction, robot.model.world.friction
    if 0 < friction < math.inf:
        return {f"{part:g} of the friction": part * friction for part in FRICTIONS}
    if friction == math.inf and 0 < of_file < math.inf:
        return {f"friction={part * of_file:g}": part * of_file for part in (*FRICTIONS, 1.0)}
    return {}
