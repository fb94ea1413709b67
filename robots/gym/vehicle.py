"""The Braitenberg vehicle as a Gymnasium environment.

Source: dissertation, chapters 3 and 4; the physics is that of ``taichi_sim.vehicle``, Euler step for Euler step.
"""

from typing import Any

import gymnasium
import numpy as np

from robots.braitenberg import BASELINE, PUBLISHED, VehicleBody
from robots.gym.environment import Observation, RobotEnvironment
from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import number
from taichi_sim.vehicle import VehicleTask
from taichi_sim.vehicle.equations import move, readings

BRIGHTEST = 1e4  # 1/m^2: readings are cut off there, 1 cm from the light


class VehicleEnvironment(RobotEnvironment):
    """Environment in which a vehicle steers to a light by its two motors.

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
        render_mode: None = None,
    ) -> None:
        """Take a body, starts, radius and time step, and the fastest motor command [m/s]."""
        count, commands = len(body.sensors), gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float64)
        super().__init__(np.zeros(count), np.full(count, BRIGHTEST), commands, render_mode)
        self.body, self.task, self.fastest = body, task, number("fastest", fastest, 1e-6, unit="m/s")
        self._sites = np.array(body.sensors).ravel().tolist()

    def _begin(self, options: dict[str, Any]) -> Observation:
        start = self._chosen(options, "start", len(self.task.starts))
        x, y = self.task.seen[start].tolist()
        self._seen, self._heading = (x, y), float(self.task.starts[start, 2])
        return self._observation()

    def _advance(self, action: Floats) -> tuple[Observation, float, bool, bool]:
        """Drive for one time step."""
        first, second = (action * self.fastest).tolist()
        before = float(np.hypot(*self._seen))
        x, y, turn = move(*self._seen, first, second, self.task.time_step)
        self._seen, self._heading = (float(x), float(y)), self._heading + float(turn)
        after = float(np.hypot(*self._seen))
        return self._observation(), before - after, after < self.task.radius, not np.isfinite(after)

    def _observation(self) -> Observation:
        with np.errstate(divide="ignore", invalid="ignore"):
            seen = np.array(readings(*map(np.float64, self._seen), self._sites), float)
        return np.nan_to_num(seen, nan=BRIGHTEST, posinf=BRIGHTEST)

    def _info(self) -> dict[str, Any]:
        (x, y), cosine, sine = self._seen, np.cos(self._heading), np.sin(self._heading)
        with np.errstate(invalid="ignore"):  # of a vehicle that diverged
            pose = np.array([cosine * x - sine * y, sine * x + cosine * y, self._heading])
        return {"pose": pose, "distance": float(np.hypot(x, y))}
