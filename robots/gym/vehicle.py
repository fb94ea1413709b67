"""The Braitenberg vehicle as a Gymnasium environment, one or a batch.

Source: dissertation, chapters 3 and 4; the physics is that of ``taichi_sim.vehicle``, Euler step for Euler step.
"""

from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np

from robots.braitenberg import BASELINE, PUBLISHED, Traces, VehicleBody
from robots.gym.batch import Batch, Observation
from robots.gym.environment import RobotEnvironment, RobotVector
from taichi_sim.base.arrays import Bools, Floats, Ints
from taichi_sim.base.checks import instance, number
from taichi_sim.vehicle import VehicleTask
from taichi_sim.vehicle.equations import move, readings

if TYPE_CHECKING:
    from robots.view.motion import Motion

BRIGHTEST = 1e4  # 1/m^2: readings are cut off there, 1 cm from the light


class Vehicles(Batch):
    """Vehicles side by side; each begins anew when its own episode is over."""

    option, together = "start", False

    def __init__(self, count: int, body: VehicleBody, task: VehicleTask, fastest: float) -> None:
        """Take what a ``VehicleEnvironment`` takes."""
        body = instance("body", body, VehicleBody, "VehicleBody.published(162)")
        task = instance("task", task, VehicleTask, "VehicleTask(steps=1000)")
        sensors = len(body.sensors)
        observed = gymnasium.spaces.Box(np.zeros(sensors), np.full(sensors, BRIGHTEST), dtype=np.float64)
        super().__init__(count, observed, gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float64), task.time_step)
        self.choices = len(task.starts)
        self._body, self._task, self._fastest = body, task, number("fastest", fastest, 1e-6, unit="m/s")
        self._sites = np.array(body.sensors).ravel().tolist()
        self._seen, self._heading = np.ones((2, count)), np.zeros(count)
        self._start, self._steps = np.zeros(count, np.int64), np.zeros(count, np.int64)

    def begin(self, which: Ints, ways: Ints) -> Observation:
        """Put vehicles at the starts that are chosen."""
        self._seen[:, which], self._heading[which] = self._task.seen[ways].T, self._task.starts[ways, 2]
        self._start[which], self._steps[which] = ways, 0
        return self._observation()[which]

    def advance(self, actions: Floats) -> tuple[Observation, Floats, Bools, Bools]:
        """Drive for one time step."""
        before = np.hypot(*self._seen)
        with np.errstate(over="ignore", invalid="ignore"):  # of vehicles that diverge
            given = *self._numbers(self._seen), *self._numbers(actions.T * self._fastest)
            moved = np.array(move(*given, self._task.time_step)).reshape(3, self.count)
            after = np.hypot(*moved[:2])
        failed = ~np.isfinite(after)
        if failed.any():
            moved = np.where(failed, [*self._seen, np.zeros(self.count)], moved)
        self._seen, self._heading = moved[:2], self._heading + moved[2]
        self._steps += 1
        return self._observation(), before - after, after < self._task.radius, failed

    def _observation(self) -> Observation:
        with np.errstate(divide="ignore", invalid="ignore"):
            seen = np.array(readings(*self._numbers(self._seen), self._sites)).reshape(-1, self.count).T
        return np.where(seen < BRIGHTEST, seen, BRIGHTEST)

    def _numbers(self, values: Floats) -> Floats:
        """Rows as laws take them: of one vehicle its numbers, which are faster than arrays of one."""
        return values[:, 0] if self.count == 1 else values

    def info(self) -> dict[str, Any]:
        """Poses relative to the lights, and distances from them."""
        (x, y), cosine, sine = self._seen, np.cos(self._heading), np.sin(self._heading)
        pose = np.stack([cosine * x - sine * y, sine * x + cosine * y, self._heading], axis=1)
        return {"pose": pose, "distance": np.hypot(x, y)}

    def motion(self, robot: int) -> "Motion":
        """A vehicle and its light."""
        from robots.braitenberg.motion import vehicle_motion

        pose, start = self.info()["pose"][robot].copy(), int(self._start[robot])
        pose[:2] += self._task.lights[start]
        shape, times = (1, 1, len(self._task.starts)), np.array([float(self._steps[robot]) * self.seconds])
        seen = np.clip(self._observation()[robot], 1e-9, None)  # its sensors are shown by logarithms
        poses = np.broadcast_to(pose, (*shape, 1, 3))
        traces = Traces(times, poses, np.broadcast_to(seen[:, None], (*shape, len(seen), 1)))
        return vehicle_motion(traces, self._body, self._task, environment=start)


class VehicleEnvironment(RobotEnvironment):
    """Gymnasium environment in which a Braitenberg vehicle steers to a light by its two motors.

    Action: motor commands, shape (2,), from -1 to 1, in units of ``fastest``; the first turns the vehicle to the left.
    The vehicle drives at half their sum [m/s] and turns at their difference [rad/s]. A published controller W commands
    W s / ``fastest``, as long as that is within the bounds.

    Observation: readings of the sensors s_j = 1/d_j^2 [1/m^2], shape (S,), cut off at ``BRIGHTEST``.

    Reward: how much nearer the light is after the step [m]. An episode ends within the task's radius of the light.

    Reset: at one of the task's starts, drawn by the seed, or ``options={"start": k}``. ``info`` has the pose
    (x, y, heading) [m, m, rad] relative to the light and the distance [m].
    """

    def __init__(
        self,
        body: VehicleBody = BASELINE,
        task: VehicleTask = PUBLISHED,
        fastest: float = 1.0,
        render_mode: str | None = None,
    ) -> None:
        """Take a body, starts, radius and time step, the fastest motor command [m/s], and ``"rgb_array"`` or None."""
        super().__init__(Vehicles(1, body, task, fastest), render_mode)


class VehicleVector(RobotVector):
    """Vector environment of vehicles in one batch; each begins anew in the step after its own episode is over."""

    def __init__(
        self,
        num_envs: int = 1,
        body: VehicleBody = BASELINE,
        task: VehicleTask = PUBLISHED,
        fastest: float = 1.0,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
    ) -> None:
        """Take the number of vehicles, and what a ``VehicleEnvironment`` takes."""
        super().__init__(Vehicles(num_envs, body, task, fastest), max_episode_steps, render_mode)
