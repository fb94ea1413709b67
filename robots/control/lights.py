"""Robots that a network steers to a light, as kinds of robots: their worlds are places of the light."""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from robots.control.neural import TIME_STEP, Lights
from robots.environments import Environment
from robots.outcome import recorded
from robots.robot import HERE, Option, Outcome, Robot, RobotKind, Trial, World
from taichi_sim.base import checks
from taichi_sim.base.arrays import Floats
from taichi_sim.base.compute import Compute
from taichi_sim.base.options import value_of
from taichi_sim.base.short_text import counted, shortest


@dataclass(frozen=True)
class LightAt(World):
    """A world with a light.

    Attributes:
        x: where it is [m].
        y: where it is [m].
    """

    x: float
    y: float

    def __post_init__(self) -> None:
        for name in ("x", "y"):
            object.__setattr__(self, name, checks.number("light", getattr(self, name), unit="m"))

    @property
    def name(self) -> str:
        """Its place, such as ``9,0``, in as few digits as say it exactly: run folders keep it."""
        return f"{shortest(self.x)},{shortest(self.y)}"

    @property
    def spoken(self) -> str:
        """Its place, for people."""
        return f"to a light at ({self.x:g}, {self.y:g}) m"

    @property
    def place(self) -> tuple[float, float]:
        """Its place [m]."""
        return self.x, self.y


class LightKind(RobotKind):
    """A kind of robot whose worlds are places of a light."""

    world_option = "light"
    world_hint = "its place in metres, such as 9,0"

    def places(self) -> tuple[tuple[float, float], ...]:
        """Places of the light in the four published environments [m]."""
        raise NotImplementedError

    @property
    def world_options(self) -> tuple[Option, ...]:
        """A place of the light, or the number of an environment."""
        told = "place of the light, by the number of an environment, from 1 to 4 (default: 1)"
        return (*super().world_options, Option("environment", told, metavar="N"))

    def chosen_world(self, options: Mapping[str, Any]) -> World | None:
        """The world of a place, or of an environment's number.

        Raises:
            ValueError: for both of them, and unknown environments.
        """
        light, number = options.get("light"), options.get("environment")
        if number is None:
            return super().chosen_world(options)
        if light is not None:
            raise ValueError(f"environment: {number} is not allowed beside --light {light}; give one of them")
        return LightAt(*self.places()[Environment.parse(number).number - 1])

    def world(self, text: Any) -> LightAt:
        """The world with a light at ``x,y`` [m]."""
        values = [value_of(part) for part in text.split(",")]
        if len(values) != 2 or any(isinstance(value, str) for value in values):
            raise ValueError(f"light: {text!r} is not allowed; give its place in metres, such as 9,0")
        return LightAt(float(values[0]), float(values[1]))


class LightSeeker(Robot):
    """A robot that a network steers to a light, by weights that are free.

    Attributes:
        looks: at the sensors in a trial, each before a time step.
    """

    looks: int
    differentiable = True
    feels = True

    @abstractmethod
    def rollout(self, points: Floats, trial: Trial, lights: Lights) -> Any:
        """The kind's own result for N controllers and lights at places (E, 2) [m]; with gradients if wanted."""

    @abstractmethod
    def judged(self, found: Any, light: LightAt) -> tuple[dict[str, Any], dict[str, Any]]:
        """Measures of a result, and the gradients of those that have them."""

    def run(self, points: Floats, trial: Trial) -> Outcome:
        """Let N controllers steer to the light."""
        light = light_of(trial.world)
        found = self.rollout(points, trial, [light.place])
        measures, gradients = self.judged(found, light)
        rollouts, frames = found.rollouts, recorded(found.rollouts.frames)
        return Outcome(
            measures, rollouts.status, steps=rollouts.steps, gradients=gradients, frames=frames, result=found
        )

    def readings(self, points: ArrayLike, world: World, samples: int, compute: Compute = HERE) -> Floats:
        """What the sensors of N controllers read over time, shape (N, S, T)."""
        every = max(1, self.steps // samples)
        found = self.simulate(points, world, compute=compute, record_every=every).result.rollouts.frames.readings
        return np.asarray(np.moveaxis(found, 0, -1), float)

    @property
    def steps(self) -> int:
        """Time steps of a trial."""
        return self.looks - 1

    @property
    def lasts(self) -> float:
        """Time that a trial takes [s]."""
        return self.steps * TIME_STEP

    def at_horizon(self, length: int) -> tuple[str, Self]:
        """The robot for so many seconds."""
        return counted(length, "second"), replace(self, looks=round(length / TIME_STEP) + 1)  # type: ignore[type-var]


def light_of(world: World) -> LightAt:
    """The world, which must have a light.

    Raises:
        ValueError: for any other.
    """
    if not isinstance(world, LightAt):
        raise ValueError(f"light: {world.name!r} is not allowed; give its place, such as 9,0")
    return world


def approach(distance: Any, light: LightAt) -> Any:
    """How much nearer than at the start a robot is to the light, (N,) [m]; robots start at the origin."""
    return np.hypot(light.x, light.y) - distance
