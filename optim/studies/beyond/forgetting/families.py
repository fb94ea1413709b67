"""Three robots whose bodies are drawn by number, and the two environments that their controllers learn in turn."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType

import numpy as np

from optim.experiments.body_metrics import Environments
from optim.space import Space
from optim.studies.beyond.body_and_learning.bodies import LIGHT_AT, walker
from robots.braitenberg import VehicleBody
from robots.braitenberg.body import DESIGNS
from robots.braitenberg.experiment import DISTANCE
from robots.braitenberg.robot import VehicleRobot
from robots.control.lights import LightAt
from robots.environments import Environment
from robots.quadruped.body import ENVIRONMENTS, Kind, Quadruped
from robots.quadruped.robot import QuadrupedRobot
from robots.robot import Robot, Trial, World
from robots.tasks import Success
from robots.world import Terrain
from taichi_sim.base.arrays import Floats
from taichi_sim.base.compute import Compute

LOST = -1.0  # share of the way that a failed trial has covered: it is as far away again
KINDS: tuple[Kind, ...] = ("legged", "wheeled", "whegged")
LOOKS = 200  # at the sensors in a quadruped's trial, of 10 s
CYCLES = 2  # of a walker's trial
ASIDE = round(LIGHT_AT / np.sqrt(2), 4)  # m: the light of walkers is ahead to the left, then to the right


@dataclass(frozen=True)
class Family:
    """A robot that may have one of many bodies, all with the same controllers, and two environments.

    Attributes:
        title: as tables say it.
        body: the robot of a number; what is free of it is its controller.
        worlds: environments A and B.
        measure: that has gradients, from which ``covered`` follows.
        covered: the share of the way to the light that was covered, of a measure, and its derivative by that.
        success: what a controller has to keep in either environment, for M_L and M_CI.
        rate: of steps of training, in ranges of the variables.
        precision: of trials.
    """

    title: str
    body: Callable[[int], Robot]
    worlds: tuple[World, World]
    measure: str
    covered: Callable[[Floats], tuple[Floats, Floats]]
    success: Success
    rate: float
    precision: str = "f64"

    @property
    def compute(self) -> Compute:
        """How trials are computed."""
        return Compute(precision=self.precision, threads=1)

    @property
    def environments(self) -> Environments:
        """Both environments with what has to be kept in them."""
        return Environments(self.worlds, ((self.success,),) * 2)


@dataclass(frozen=True, eq=False)
class Learning:
    """Controllers of one body at work, at points in ranges of the variables."""

    family: Family
    robot: Robot

    @property
    def space(self) -> Space:
        """What is free: the controller."""
        return Space(tuple(self.robot.parameters))

    def values(self, points: Floats) -> Floats:
        """Shares of the way covered in A and B at points, shape (N, D): (N, 2)."""
        trial = Trial(self.family.worlds[0], self.family.compute)
        outcomes = self.robot.run_in(self._inside(points), self.family.worlds, trial)
        found = np.stack(
            [self.family.covered(np.asarray(o.measures[self.family.measure]))[0] for o in outcomes], axis=1
        )
        return np.nan_to_num(found, nan=LOST)

    def look(self, points: Floats, environment: int) -> tuple[Floats, Floats]:
        """Share of the way covered in one environment, (N,), with its gradients, (N, D), zero if a trial fails."""
        name = self.family.measure
        trial = Trial(self.family.worlds[environment], self.family.compute, gradients=(name,))
        found = self.robot.run(self._inside(points), trial)
        values, by_measure = self.family.covered(np.asarray(found.measures[name]))
        slopes = found.gradients[name] * by_measure[:, None] * self.space.span
        return np.nan_to_num(values, nan=LOST), np.nan_to_num(slopes, nan=0.0, posinf=0.0, neginf=0.0)

    def _inside(self, points: Floats) -> Floats:
        space = self.space
        return self.robot.points(space.low + space.span * points)


def vehicle(number: int) -> Robot:
    """A vehicle with two eyes at drawn places of the published grid; a full matrix of weights is free."""
    design = int(np.random.default_rng((number, 41)).integers(1, DESIGNS + 1))
    return VehicleRobot(VehicleBody.published(design), "full")


def quadruped(number: int) -> Robot:
    """A quadruped of a drawn kind and drawn lengths; all weights from sensors to motors are free."""
    rng = np.random.default_rng((number, 42))
    kind = KINDS[int(rng.integers(len(KINDS)))]
    width, limb, wheel = rng.uniform((0.2, 0.2, 0.07), (0.6, 0.5, 0.15)).round(3).tolist()
    return QuadrupedRobot(Quadruped(kind, body_width=width, limb_length=limb, wheel_radius=wheel), looks=LOOKS)


def _by_distance(far: float) -> Callable[[Floats], tuple[Floats, Floats]]:
    """The share covered of a way [m], of the distance that is left, and its derivative."""
    return lambda distance: (1 - distance / far, np.full(distance.shape, -1 / far))


def _by_light(light: Floats) -> tuple[Floats, Floats]:
    """The share covered of a quadruped's way, of the light that it reads, which is one over the distance squared."""
    far = ENVIRONMENTS[0][0]
    return 1 - light**-0.5 / far, 0.5 * light**-1.5 / far


FAMILIES = MappingProxyType(
    {
        "vehicle": Family(
            "vehicle",
            vehicle,
            (Environment(1), Environment(2)),
            "closest",
            _by_distance(DISTANCE),
            Success("closest", "<=", 0.075),
            0.06,
        ),
        "quadruped": Family(
            "quadruped",
            quadruped,
            (LightAt(*ENVIRONMENTS[0]), LightAt(*ENVIRONMENTS[1])),
            "light",
            _by_light,
            Success("approach", ">=", 0.5),
            0.06,
        ),
        "walker": Family(
            "soft walker",
            partial(walker, cycles=CYCLES),
            (Terrain(light=(ASIDE, ASIDE)), Terrain(light=(ASIDE, -ASIDE))),
            "remaining",
            _by_distance(LIGHT_AT),
            Success("remaining", "<=", LIGHT_AT - 0.005),
            0.06,
            "f32",
        ),
    }
)
