"""The search for a base body of the two-wheel vehicle, with its sensors in the canonical places.

Source: dissertation, chapter 3, "The empirical model": masses, radius of the wheels, torque, speed and target rate are
free; one objective is the distance from the light, summed over the four environments, the other the sum of torque,
speed and target rate. The text does not say what steered the bodies. Of the 121 x 121 controllers of the base body that
was found, only the one with both weights at 1 solves all environments: probably the search had this one. So it is the
default; as an option the weights evolve along with each body.
"""

import math
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from optim.problem import Evaluation
from optim.space import Space, Variable
from robots.rover import CANONICAL, STEPS, Rover, simulate
from taichi_sim.base import checks
from taichi_sim.base.arrays import Floats

MASSES = ("body_mass", "wheel_mass", "castor_mass")
DRIVES = ("speed", "command_range", "torque")  # in units of pi
WEIGHTS = ("w1", "w2")
CONTROLLERS = ("unit", "evolved")
MASS_RANGE, RADIUS_RANGE, DRIVE_RANGE = (0.001, 1000.0), (0.075, 0.3), (0.25, 10.0)  # kg, m, pi
SENSOR_RADIUS, SENSOR_HEIGHT = 0.02, 0.0  # m, in this search only
STEP = 0.1  # of ranges, standard deviation of a mutation


@dataclass(frozen=True, eq=False)
class RoverProblem:
    """Objectives, maximised: minus the sum of smallest distances from the lights [m], minus torque + speed + rate [pi].

    Nearer than the distance of success counts as that distance, where the light stops the vehicle.
    """

    controller: str = "unit"  # ``"unit"``: both weights are 1; ``"evolved"``: they are variables, too
    steps: int = STEPS  # looks at the light in every rollout
    precision: str = "f32"  # ``"f32"`` or ``"f64"``
    device: str = "cpu"  # ``"cpu"``, ``"cuda"``, .
    threads: int | None = None  # CPU threads, all available if None; changes no result

    def __post_init__(self) -> None:
        checks.choice("controller", self.controller, CONTROLLERS)

    @cached_property
    def space(self) -> Space:
        """Masses [kg], radius of the wheels [m], drives [pi], and weights if they evolve."""
        ranges = {
            **dict.fromkeys(MASSES, MASS_RANGE),
            "wheel_radius": RADIUS_RANGE,
            **dict.fromkeys(DRIVES, DRIVE_RANGE),
            **dict.fromkeys(WEIGHTS if self.controller == "evolved" else (), (-1.0, 1.0)),
        }
        return Space(tuple(Variable(name, low, high, step=STEP * (high - low)) for name, (low, high) in ranges.items()))

    def named(self, point: ArrayLike) -> dict[str, float]:
        """Values of a point, shape (D,), by name, with the weights."""
        return {**self.space.to_dict(point), **(dict.fromkeys(WEIGHTS, 1.0) if self.controller == "unit" else {})}

    def rover(self, point: ArrayLike) -> Rover:
        """The body of a point, shape (D,), as in this search."""
        values = self.space.to_dict(point)
        drives = {name: values[name] * math.pi for name in DRIVES}
        others = {name: values[name] for name in (*MASSES, "wheel_radius")}
        return Rover(CANONICAL, **others, **drives, sensor_radius=SENSOR_RADIUS, sensor_height=SENSOR_HEIGHT)

    def evaluate(self, points: ArrayLike) -> Evaluation:
        """Roll out all points, shape (N, D).

        Details: ``solved``, in how many environments the light is reached, shape (N,).
        """
        points = self.space.validate(np.atleast_2d(points))
        rovers = [self.rover(point) for point in points]
        weights = points[:, -len(WEIGHTS) :] if self.controller == "evolved" else np.ones((len(points), len(WEIGHTS)))
        where: dict[str, Any] = {"precision": self.precision, "device": self.device, "threads": self.threads}
        done = simulate(rovers, weights, steps=self.steps, **where)
        objectives = np.column_stack([-distances(rovers, done.closest), -effort(rovers)])
        status = np.where((done.status == "ok").all(axis=1), "ok", "diverged")
        return Evaluation(objectives, status, {"solved": done.success.sum(axis=1)})

    def evaluate_relaxed(self, points: ArrayLike, sharpness: float, gradients: bool) -> Evaluation:
        """Judge points as :meth:`evaluate` does, as nothing is binary; raises ValueError if asked for gradients."""
        if gradients:
            raise ValueError("gradients: not allowed with several objectives; ask for points")
        return self.evaluate(points)

    def describe(self) -> dict[str, Any]:
        """All that results depend on."""
        numbers = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "threads"}
        return {**numbers, "variables": {v.name: [v.low, v.high] for v in self.space.variables}}


def distances(rovers: list[Rover], closest: Floats) -> Floats:
    """Sums over environments of smallest distances, (N, E), none below that of success [m], (N,)."""
    reached = np.array([rover.success_distance for rover in rovers])
    return np.asarray(np.maximum(closest, reached[:, None]).sum(axis=1))


def effort(rovers: list[Rover]) -> Floats:
    """Torque [N m], speed and rate [rad/s], in units of pi, summed, (N,)."""
    return np.array([rover.torque + rover.speed + rover.command_range for rover in rovers]) / math.pi
