"""Quadrupeds as Gymnasium environments, one or a batch.

Source: dissertation, chapter 2 ("The robots").
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np

from robots.control.neural import check_lights
from robots.gym.batch import Batch, Observation
from robots.gym.environment import RobotEnvironment, RobotVector
from robots.quadruped import AS_RUN, ENVIRONMENTS, LIGHT_HEIGHT, MOTORS, SENSORS, Kind, Quadruped, Variant, engine
from taichi_sim.base.arrays import Bools, Floats, Ints
from taichi_sim.base.checks import instance
from taichi_sim.rigid import Frames, RigidResult

if TYPE_CHECKING:
    from robots.view.motion import Motion

BRIGHTEST = 100.0  # 1/m^2


class Quadrupeds(Batch):
    """Quadrupeds of one body side by side, each with its light."""

    option = "light"

    def __init__(self, count: int, robot: Quadruped, variant: Variant, lights: Sequence[Sequence[float]]) -> None:
        """Take what a ``QuadrupedEnvironment`` takes."""
        robot = instance("robot", robot, Quadruped, "robots.quadruped.LEGGED")
        variant = instance("variant", variant, Variant, "robots.quadruped.Variant()")
        low = np.array([min(variant.touch_values)] * (SENSORS - 1) + [0.0])
        high = np.array([max(variant.touch_values)] * (SENSORS - 1) + [BRIGHTEST])
        self._engine = engine(robot, variant, precision="f64", threads=1)
        observed = gymnasium.spaces.Box(low, high, dtype=np.float64)
        acted = gymnasium.spaces.Box(-1.0, 1.0, (MOTORS,), np.float64)
        super().__init__(count, observed, acted, self._engine.world.time_step)
        self._robot, self._lights = robot, check_lights(lights)
        self.choices = len(self._lights)

    def begin(self, which: Ints, ways: Ints) -> Observation:
        """Begin the episodes of all, with the lights that are chosen."""
        assert len(which) == self.count
        self._light, self._steps = self._lights[ways], 0
        places = np.column_stack([self._light, np.full(self.count, LIGHT_HEIGHT)])
        self._session = self._engine.session(lights=places)
        self._commands: Floats = np.zeros((self.count, MOTORS))
        return self._observe(self._session.advance(steps=0))

    def advance(self, actions: Floats) -> tuple[Observation, Floats, Bools, Bools]:
        """Apply the motors' commands for one time step."""
        before, self._commands = self._distance, actions
        found = self._session.advance(actions)
        self._steps += 1
        observation, gained = self._observe(found), before - self._distance
        return observation, gained, np.zeros(self.count, bool), (found.status != "ok") | ~np.isfinite(gained)

    def _observe(self, found: RigidResult) -> Observation:
        """Sensors, as they now are."""
        self._found, self._distance = found, np.hypot(*(found.position[:, :2] - self._light).T)
        now, ok = (found.position, found.orientation, found.angles, found.readings), found.status == "ok"
        seen = self._seen if self._steps else now
        self._seen: tuple[Floats, ...] = tuple(
            np.where(ok[:, None], each, before) for each, before in zip(now, seen, strict=True)
        )
        return found.readings

    def info(self) -> dict[str, Any]:
        """Positions, distances from the lights, and readings of them."""
        found = self._found
        return {"position": found.position, "distance": self._distance, "light": found.readings[:, -1]}

    def motion(self, robot: int) -> "Motion":
        """A quadruped and its light."""
        from robots.quadruped.motion import quadruped_frames

        frames = Frames(np.array([self._steps * self.seconds]), *(each[None] for each in (*self._seen, self._commands)))
        return quadruped_frames(self._robot, frames, robot, self._light[robot])


class QuadrupedEnvironment(RobotEnvironment):
    """Gymnasium environment in which a quadruped goes towards a light on legs, wheels or whegs.

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
        render_mode: str | None = None,
    ) -> None:
        """Take a kind or a robot, the variant of the simulation, and places of the light [m], shape (E, 2).

        ``render_mode`` is ``"rgb_array"`` for pictures, or None.
        """
        super().__init__(Quadrupeds(1, robot or Quadruped(kind), variant, lights), render_mode)


class QuadrupedVector(RobotVector):
    """Vector environment of quadrupeds in one batch."""

    def __init__(
        self,
        num_envs: int = 1,
        kind: Kind = "legged",
        robot: Quadruped | None = None,
        variant: Variant = AS_RUN,
        lights: Sequence[Sequence[float]] = ENVIRONMENTS,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
    ) -> None:
        """Take the number of quadrupeds, and what a ``QuadrupedEnvironment`` takes."""
        batch = Quadrupeds(num_envs, robot or Quadruped(kind), variant, lights)
        super().__init__(batch, max_episode_steps, render_mode)
