"""Quadrupeds as Gymnasium environments.

Source: dissertation, chapter 2 ("The robots").
"""

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np

from robots.control.neural import check_lights
from robots.gym.environment import Observation, RobotEnvironment, checked_action
from robots.quadruped import AS_RUN, ENVIRONMENTS, LIGHT_HEIGHT, MOTORS, SENSORS, Kind, Quadruped, Variant, engine
from taichi_sim.rigid import RigidResult

BRIGHTEST = 100.0  # 1/m^2


class QuadrupedEnvironment(RobotEnvironment[Observation]):
    """Environment in which a quadruped goes towards a light on legs, wheels or whegs.

    Action: values of the eight motor neurons, shape (8,), from -1 to 1, kept for one step of 0.05 s (20 Hz). Motors of
    legs take them as angles, those of wheels as speeds, in units of what the variant allows, within the robot's torque;
    in the order of ``robots.quadruped``.

    Observation: shape (5,): four touch sensors, as the variant has them (0 apart from the ground, 1 on it), and the
    light 1/d^2 [1/m^2].

    Reward: how much nearer the light is after the step, seen from above [m].

    Reset: with the light at one of four places, drawn by the seed, or ``options={"light": k}``. ``info`` has the
    position of the main body [m], the distance from the light [m] and the light's reading, the published fitness.
    """

    def __init__(
        self,
        kind: Kind = "legged",
        robot: Quadruped | None = None,
        variant: Variant = AS_RUN,
        lights: Sequence[Sequence[float]] = ENVIRONMENTS,
        render_mode: None = None,
    ) -> None:
        """Take a kind or a robot, the variant of the simulation, and places of the light [m], shape (E, 2)."""
        low = np.array([min(variant.touch_values)] * (SENSORS - 1) + [0.0])
        high = np.array([max(variant.touch_values)] * (SENSORS - 1) + [BRIGHTEST])
        super().__init__(low, high)
        self.render_mode = render_mode
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (MOTORS,), np.float64)
        self.robot = Quadruped(kind) if robot is None else robot
        self.lights = check_lights(lights)
        self._engine = engine(self.robot, variant, precision="f64", threads=1)
        self._light, self._distance = self.lights[0], 0.0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode."""
        super().reset(seed=seed)
        self._light = self.lights[self._chosen(options, "light", len(self.lights))]
        self._session = self._engine.session(lights=np.array([[*self._light, LIGHT_HEIGHT]]))
        found = self._session.advance(steps=0)
        info = self._info(found)
        self._distance = info["distance"]
        return self._begin(found.readings[0], info)

    def step(self, action: Observation) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Apply the motors' commands for one time step."""
        found = self._session.advance(checked_action(action, self.action_space)[None])
        info = self._info(found)
        gained, self._distance = self._distance - info["distance"], info["distance"]
        failed = str(found.status[0]) != "ok" or not np.isfinite(gained)
        return self._outcome(found.readings[0], gained, False, failed, info)

    def _info(self, found: RigidResult) -> dict[str, Any]:
        distance = float(np.hypot(*(found.position[0, :2] - self._light)))
        return {"position": found.position[0], "distance": distance, "light": float(found.readings[0, -1])}
