"""Quadrupeds as Gymnasium environments.

Source: dissertation, chapter 2 ("The robots").
"""

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np

from robots.control.neural import check_lights
from robots.gym.environment import Observation, RobotEnvironment
from robots.quadruped import AS_RUN, ENVIRONMENTS, LIGHT_HEIGHT, MOTORS, SENSORS, Kind, Quadruped, Variant, engine
from taichi_sim.base.arrays import Floats
from taichi_sim.rigid import RigidResult

BRIGHTEST = 100.0  # 1/m^2


class QuadrupedEnvironment(RobotEnvironment):
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
        super().__init__(low, high, gymnasium.spaces.Box(-1.0, 1.0, (MOTORS,), np.float64), render_mode)
        self.robot = Quadruped(kind) if robot is None else robot
        self.lights = check_lights(lights)
        self._engine = engine(self.robot, variant, precision="f64", threads=1)

    def _begin(self, options: dict[str, Any]) -> Observation:
        self._light = self.lights[self._chosen(options, "light", len(self.lights))]
        self._session = self._engine.session(lights=np.array([[*self._light, LIGHT_HEIGHT]]))
        return self._observe(self._session.advance(steps=0))

    def _advance(self, action: Floats) -> tuple[Observation, float, bool, bool]:
        """Apply the motors' commands for one time step."""
        before = self._distance
        found = self._session.advance(action[None])
        observation, gained = self._observe(found), before - self._distance
        return observation, gained, False, str(found.status[0]) != "ok" or not np.isfinite(gained)

    def _observe(self, found: RigidResult) -> Observation:
        """Sensors, as they now are."""
        self._found, self._distance = found, float(np.hypot(*(found.position[0, :2] - self._light)))
        readings: Observation = found.readings[0]
        return readings

    def _info(self) -> dict[str, Any]:
        light = float(self._found.readings[0, -1])
        return {"position": self._found.position[0], "distance": self._distance, "light": light}
