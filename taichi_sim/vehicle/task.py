"""Tasks of vehicles, and batches of vehicles in the arrays that kernels take."""

from dataclasses import dataclass
from functools import cached_property, partial
from typing import Annotated

import numpy as np

from taichi_sim.base.arrays import Floats, Indices
from taichi_sim.base.checks import Positive, check_fields, integer, numbers

Wiring = tuple[tuple[int, ...], tuple[int, ...]]

MOST_STEPS = 10_000_000  # f32 counts them exactly
MOST_ROLLOUTS = 2**31 - 1


@dataclass(frozen=True, eq=False)
class VehicleTask:
    """A task for Braitenberg vehicles: E environments, and the time to reach the light in each.

    Attributes:
        starts: pose (x, y, heading) at which an environment begins [m, m, rad], shape (E, 3).
        lights: place (x, y) of its light [m], shape (E, 2) or (2,); the origin by default.
        radius: a vehicle succeeds when its centre comes closer than this to the light, the start included [m].
        time_step: time step of Euler's method [s].
        steps: number of time steps.

    Raises:
        ValueError: if a shape, radius, time step, number of steps or start is not allowed.
    """

    starts: Floats
    lights: Floats = (0.0, 0.0)  # type: ignore[assignment]
    radius: Positive = 0.075
    time_step: Positive = 0.05
    steps: Annotated[int, partial(integer, low=1, high=MOST_STEPS)] = 10_000

    def __post_init__(self) -> None:
        check_fields(self)
        starts = numbers("starts", self.starts, "E", 3)
        lights = [self.lights] * len(starts) if np.ndim(self.lights) == 1 else self.lights
        object.__setattr__(self, "starts", starts)
        object.__setattr__(self, "lights", numbers("lights", lights, len(starts), 2))
        near = np.flatnonzero(np.hypot(*self._relative.T) < self.radius)
        if near.size:
            place = starts[near[0], :2].tolist()
            raise ValueError(
                f"starts: {place} is not allowed; it is closer to the light than the radius, {self.radius:g}"
            )

    @property
    def _relative(self) -> Floats:
        return self.starts[:, :2] - self.lights

    @cached_property
    def seen(self) -> Floats:
        """Places of the vehicles relative to the lights, in their own frames, at the start, shape (E, 2)."""
        (x, y), heading = self._relative.T, self.starts[:, 2]
        cosine, sine = np.cos(heading), np.sin(heading)
        return np.stack([cosine * x + sine * y, cosine * y - sine * x], axis=1)


@dataclass(frozen=True, eq=False)
class VehicleBatch:
    """A batch of Braitenberg vehicles: B bodies, each with C controllers and S sensors.

    Attributes:
        sites: places of the sensors in the frame of the body [m], shape (B, S, 2).
        controllers: W of m = W s [m^3/s]: a row for each motor (the first turns the vehicle to the left), shape
            (B, C, 2, S), or (1, C, 2, S) where all bodies have the same.

    Raises:
        ValueError: if a shape is another, or a number is not finite.
    """

    sites: Floats
    controllers: Floats

    def __post_init__(self) -> None:
        sites = numbers("sites", self.sites, "B", "S", 2)
        bodies, sensors, _ = sites.shape
        controllers = numbers("controllers", self.controllers, "B", "C", 2, sensors)
        if len(controllers) not in (1, bodies):
            raise ValueError(f"controllers: shape {controllers.shape} is not allowed beside {bodies} bodies")
        object.__setattr__(self, "sites", sites)
        object.__setattr__(self, "controllers", controllers)

    @property
    def sensors(self) -> int:
        """Number of sensors of each body, S."""
        return self.sites.shape[1]

    @property
    def shared(self) -> bool:
        """Whether all bodies have the same controllers."""
        return len(self.controllers) == 1

    def shape(self, task: VehicleTask) -> tuple[int, int, int]:
        """Numbers of bodies, of controllers of each, and of environments: a rollout for each combination."""
        return len(self.sites), self.controllers.shape[1], len(task.starts)

    @cached_property
    def connections(self) -> tuple[Indices, ...]:
        """Motors and sensors that any controller connects, in the order of motors."""
        return np.nonzero(np.abs(self.controllers).max(axis=(0, 1)) > 0)

    @cached_property
    def wiring(self) -> Wiring:
        """The sensors that any controller connects to each motor."""
        motors, sensors = self.connections
        return tuple(sensors[motors == 0].tolist()), tuple(sensors[motors == 1].tolist())

    @cached_property
    def weights(self) -> Floats:
        """Connections by controller, in the order of the wiring, shape (B * C or C, connections or 1)."""
        motors, sensors = self.connections
        each: Floats = self.controllers.reshape(-1, 2, self.sensors)
        rows: Floats = each[:, motors, sensors]
        return rows if rows.shape[1] else np.zeros((len(rows), 1))

    def rollouts(self, task: VehicleTask, numbers: range) -> tuple[Indices, Floats, Floats]:
        """Environments of some rollouts, (n,), the sites of their sensors, (n, 2 S), and their weights."""
        body, controller, environment = np.unravel_index(numbers, self.shape(task))
        row = controller if self.shared else body * self.controllers.shape[1] + controller
        return environment, self.sites.reshape(len(self.sites), -1)[body], self.weights[row]

    @cached_property
    def speed_bounds(self) -> Floats:
        """Sum of |W| / 2 of every controller: at distance d from all sensors the speed is at most this / d^2."""
        return 0.5 * np.abs(self.controllers).sum(axis=(2, 3)).reshape(-1)

    @cached_property
    def reach(self) -> Floats:
        """Distance of the outermost sensor from the centre [m], shape (B,)."""
        return np.hypot(self.sites[..., 0], self.sites[..., 1]).max(axis=1)
