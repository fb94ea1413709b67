"""Lattice robots as environments, one or a batch: an action says how muscles differ from their waves for a while."""

from pathlib import Path
from typing import Any, Unpack

import gymnasium
import numpy as np

from robots.gym.environment import FAILED_RETURN, Observation, RobotEnvironment
from robots.lattice_robot.episodes import Episodes
from robots.lattice_robot.reflexes import SENSES
from robots.lattice_robot.robot import LatticeRobot
from robots.robot import find_robot_doing, make_robot
from robots.world import Terrain, terrain_of
from taichi_sim.base.arrays import Bools, Floats
from taichi_sim.base.checks import choice, number
from taichi_sim.base.compute import Compute, ComputeOptions

FARTHEST = 100.0  # of what is felt: numbers beyond are cut off
USUAL_SENSES = tuple(name for name in SENSES if name != "light")
GAINS = ("progress", "light", "prop", "turn", "rise")


def _lattice_robot(given: LatticeRobot | str | Path) -> LatticeRobot:
    """The robot that is given, or that a name or a file means.

    Raises:
        ValueError: for robots of other kinds.
    """
    found = given if isinstance(given, LatticeRobot) else make_robot(*find_robot_doing(str(given)), {})
    if not isinstance(found, LatticeRobot):
        raise ValueError(f"robot: {given} is no lattice robot; give a LatticeRobot, or its name or file")
    return found


class Rewarded:
    """A batch of robots and what they gain with every action.

    Attributes:
        episodes: of the robots.
        gain: what rewards count: progress along the heading, towards the light, or of the prop, or the rise of the
            middle above all before [body lengths]; or turning to the left [rad].
    """

    def __init__(
        self,
        batch: int,
        robot: LatticeRobot | str | Path,
        world: Terrain | str,
        senses: tuple[str, ...] | None,
        gain: str,
        strength: float,
        compute: Compute,
    ) -> None:
        terrain = Terrain.parse(world) if isinstance(world, str) else terrain_of(world)
        found = _lattice_robot(robot)
        feels = senses or (tuple(SENSES) if found.light_in(terrain) else USUAL_SENSES)
        self.episodes = Episodes(found, terrain, batch, feels, compute)
        self.gain = choice("gain", gain, GAINS)
        self._light = found.light_in(terrain)
        if self.gain == "light" and self._light is None:
            raise ValueError("gain: light is not allowed without one; give a world such as flat+light:0.1,0.05")
        if self.gain == "prop" and not terrain.props:
            raise ValueError(
                "gain: prop is not allowed without one; give a world such as flat+box:0.02,0.02,0.02,0.07,0"
            )
        self._strength = number("strength", strength, 0.0, 0.5)
        self.observed = gymnasium.spaces.Box(-FARTHEST, FARTHEST, (self.episodes.width,), np.float64)
        self.acted = gymnasium.spaces.Box(-1.0, 1.0, (self.episodes.regions,), np.float64)

    def begin(self) -> Observation:
        """Begin an episode of all robots; what they feel, shape (B, width)."""
        felt, e = self.episodes.begin(), self.episodes
        own = e.positions[:, : e.own]
        self.left, self._heights = e.steps, own[..., 2].mean(axis=1)
        self._start, self._turned = own.mean(axis=1), np.zeros(len(own))
        self._before = own
        self._value = self._values()
        self.failed = np.zeros(len(own), bool)
        return np.clip(felt, -FARTHEST, FARTHEST)

    def _values(self) -> Floats:
        e = self.episodes
        own, ahead = e.positions[:, : e.own], e.robot.direction
        if self.gain == "light":
            assert self._light is not None
            value = -np.hypot(*(own.mean(axis=1)[:, :2] - self._start[:, :2] - self._light).T)
        elif self.gain == "prop":
            assert e.robot.placed is not None
            value = e.positions[:, e.robot.placed.of(1)].mean(axis=1) @ ahead
        elif self.gain == "rise":
            self._heights = np.fmax(self._heights, own[..., 2].mean(axis=1))
            value = self._heights
        elif self.gain == "turn":
            (x0, y0), (x1, y1) = (
                [each[..., axis] - each[..., axis].mean(axis=1, keepdims=True) for axis in (0, 1)]
                for each in (self._before, own)
            )
            self._turned = self._turned + np.arctan2((x0 * y1 - y0 * x1).sum(axis=1), (x0 * x1 + y0 * y1).sum(axis=1))
            self._before = own
            return self._turned
        else:
            value = own.mean(axis=1) @ ahead
        found: Floats = value / e.robot.length
        return found

    def advance(self, actions: Floats) -> tuple[Observation, Floats, Bools]:
        """Play the next piece of the cycle: what is felt, what is gained, shape (B,), and which diverged."""
        felt, _, self.failed = self.episodes.advance(self._strength * np.asarray(actions, float))
        self.left -= 1
        before, value = self._value, self._values()
        self._value = np.where(self.failed, before, value)
        return np.clip(np.nan_to_num(felt), -FARTHEST, FARTHEST), self._value - before, self.failed


class LatticeRobotEnvironment(RobotEnvironment):
    """A lattice robot whose muscles are told, sixteen times a cycle, how to differ from their waves.

    Action, shape (R,): for each driven region from -1 to 1, times ``strength``: the difference of its scale from the
    wave a sixteenth of a cycle later, to which it goes in a straight line. All zero play the waves, to the bit.

    Observation: what ``senses`` feel, see ``robots.lattice_robot.reflexes``. Reward: what is gained, see ``Rewarded``.
    An episode ends with the robot's cycles.
    """

    def __init__(
        self,
        robot: LatticeRobot | str | Path = "soft-quadruped",
        world: Terrain | str = "flat",
        senses: tuple[str, ...] | None = None,
        gain: str = "progress",
        strength: float = 0.1,
        render_mode: None = None,
        **compute: Unpack[ComputeOptions],
    ) -> None:
        """Take the robot and its world.

        Args:
            robot: with its waves; what is free of it is as it starts. Or its name, or file.
            world: a terrain, or its name.
            senses: names; all by default, light where there is one.
            gain: what rewards count: ``"progress"``, ``"light"``, ``"prop"``, ``"turn"`` or ``"rise"``.
            strength: largest difference of a scale.
            render_mode: None.
            compute: ``precision`` (``"f32"`` by default), ``device`` and ``threads``.

        Raises:
            ValueError: for values that are not allowed.
        """
        chosen = Compute.given({"precision": "f32", **compute})
        self._batch = Rewarded(1, robot, world, senses, gain, strength, chosen)
        super().__init__(self._batch.observed.low, self._batch.observed.high, self._batch.acted, render_mode)

    def _begin(self, options: dict[str, Any]) -> Observation:
        if options:
            raise ValueError(f"options: {next(iter(options))!r} is unknown; there are none")
        found: Observation = self._batch.begin()[0]
        return found

    def _advance(self, action: Floats) -> tuple[Observation, float, bool, bool]:
        felt, gained, failed = self._batch.advance(action[None])
        return felt[0], float(gained[0]), False, bool(failed[0])

    def _info(self) -> dict[str, Any]:
        return {"left": self._batch.left}

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Apply an action; the episode is cut off when the robot's cycles are over."""
        if self._begun and self._batch.left == 0:
            raise RuntimeError("reset the environment: the robot's cycles are over")
        observed, reward, ended, _, info = super().step(action)
        return observed, reward, ended, self._batch.left == 0, info


class LatticeRobotVector(gymnasium.vector.VectorEnv[Any, Any, Any]):
    """A batch of the same robots, side by side; with the same actions each moves as it does alone, to the bit.

    All episodes are equally long and begin together: the step after the last begins all anew, whatever the actions
    (``AutoresetMode.NEXT_STEP``). A robot that diverges ends with a return of -1, and rests until then.
    """

    metadata = {"render_modes": [], "autoreset_mode": gymnasium.vector.AutoresetMode.NEXT_STEP}  # noqa: RUF012

    def __init__(
        self,
        num_envs: int = 1,
        robot: LatticeRobot | str | Path = "soft-quadruped",
        world: Terrain | str = "flat",
        senses: tuple[str, ...] | None = None,
        gain: str = "progress",
        strength: float = 0.1,
        max_episode_steps: int | None = None,
        render_mode: None = None,
        **compute: Unpack[ComputeOptions],
    ) -> None:
        """Take the number of robots, and what a ``LatticeRobotEnvironment`` takes."""
        chosen = Compute.given({"precision": "f32", **compute})
        self._batch = Rewarded(num_envs, robot, world, senses, gain, strength, chosen)
        self.num_envs, self.render_mode, self._most = num_envs, render_mode, max_episode_steps
        self.single_observation_space, self.single_action_space = self._batch.observed, self._batch.acted
        self.observation_space = gymnasium.vector.utils.batch_space(self._batch.observed, num_envs)
        self.action_space = gymnasium.vector.utils.batch_space(self._batch.acted, num_envs)
        self._over = True

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin an episode of all robots."""
        if options:
            raise ValueError(f"options: {next(iter(options))!r} is unknown; there are none")
        if isinstance(seed, int):
            super().reset(seed=seed)
        self._gained, self._ended, self._over, self._done = (
            np.zeros(self.num_envs),
            np.zeros(self.num_envs, bool),
            False,
            0,
        )
        return self._batch.begin(), {}

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Apply an action of each robot, shape (N, R)."""
        still = np.zeros(self.num_envs, bool)
        if self._over:
            observed, _ = self.reset()
            return observed, np.zeros(self.num_envs), still, still.copy(), {}
        given = np.asarray(actions, float)
        if given.shape != self.action_space.shape or not (np.abs(given) <= 1).all():
            raise ValueError(
                f"actions: shape {given.shape} is not allowed; give numbers from -1 to 1 of {self.action_space.shape}"
            )
        observed, gained, failed = self._batch.advance(given)
        gained = np.where(self._ended, 0.0, np.where(failed, FAILED_RETURN - self._gained, gained))
        self._gained, self._ended, self._done = self._gained + gained, self._ended | failed, self._done + 1
        self._over = self._batch.left == 0 or self._done == self._most or bool(self._ended.all())
        return observed, gained, self._ended.copy(), np.full(self.num_envs, self._over) & ~self._ended, {}
