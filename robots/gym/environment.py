"""Base classes of the Gymnasium environments: of one robot, and of many as one batch."""

import inspect
from typing import Any, cast

import gymnasium
import numpy as np

from robots.gym.batch import Account, Batch, Observation, checked_actions
from robots.gym.pictures import RENDER_MODES, Pictures
from robots.world import Terrain
from taichi_sim.base.arrays import Bools, Bytes, Ints
from taichi_sim.base.checks import shown, whole_number
from taichi_sim.base.compute import Compute, ComputeOptions

LARGEST_SEED = 2**128 - 1  # as NumPy draws seeds of its own
FARTHEST = 100.0  # of what is felt: numbers beyond are cut off
# A robot that was interrupted within a step stands somewhere between two.
UNBEGUN = "reset the environment before its first step, and after one that was interrupted"


def compute_of(environment: type, given: ComputeOptions) -> Compute:
    """Where an environment of soft robots computes, in single precision by default, as searches do.

    Raises:
        ValueError: for what the environment does not take, which would go unnoticed among these options.
    """
    options = tuple(ComputeOptions.__annotations__)
    known = [name for name in inspect.signature(environment).parameters if name != "compute"]
    for name in given:
        if name not in options:
            raise ValueError(f"{name}: is unknown to {environment.__name__}; give {', '.join([*known, *options])}")
    return Compute.given({"precision": "f32", **given})


def named_world(given: object, allowed: str = "give a terrain, or its name") -> Terrain:
    """The terrain that is given, or that a name means.

    Raises:
        ValueError: for anything else.
    """
    if isinstance(given, Terrain):
        return given
    if not isinstance(given, str):
        raise ValueError(f"world: {shown(given)} is not allowed; {allowed}")
    try:
        return Terrain.parse(given)
    except ValueError as error:
        raise ValueError(f"world: {str(error).removeprefix('terrain: ')}") from None


def _seed(given: Any) -> int:
    """A seed as an int, of a number or an array of a single one; a ValueError for what is not whole."""
    return whole_number("seed", given.item() if isinstance(given, np.ndarray) else given, 0, LARGEST_SEED)


class RobotEnvironment(gymnasium.Env[Observation, Any]):
    """Base class of Gymnasium environments whose reward is progress; a robot that diverges loses its rewards.

    A subclass says what is simulated, as a batch of one.
    """

    metadata = {"render_modes": list(RENDER_MODES)}  # noqa: RUF012 - what Gymnasium asks for

    def __init__(self, batch: Batch, render_mode: str | None) -> None:
        """Take the robot, and how pictures are given: ``"rgb_array"``, or None for none."""
        self._batch, self._account, self._pictures = batch, Account(batch), Pictures(batch, render_mode)
        self.observation_space = cast(gymnasium.Space[Observation], batch.observed)
        self.action_space, self.render_mode = batch.acted, render_mode
        self.metadata = {**self.metadata, "render_fps": 1 / batch.seconds}
        self._begun = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode; return its first observation and ``info``."""
        super().reset(seed=seed)
        which = np.arange(1)
        way = self._batch.way(dict(options or {}), self.np_random)
        self._begun = False
        self._account.begin(which, self._batch.begin(which, np.array([way])))
        self._pictures.begin(which)
        info, self._begun = self._info(), True
        return self._account.observed[0].copy(), info

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Apply an action for one step; return observation, reward, terminated, truncated and ``info``.

        A robot that diverged keeps its last finite observation and loses all that it has gained.

        Raises:
            ValueError: for an action that is not in its space.
        """
        if not self._begun:
            raise RuntimeError(UNBEGUN)
        if self._batch.left == 0:
            raise RuntimeError("reset the environment: its episode is over")
        given = checked_actions(self.action_space, action)
        self._begun = False  # until the step is whole
        reward = self._account.book(*self._batch.advance(given[None]))
        ended, observed, info = bool(self._account.ended[0]), self._account.observed[0].copy(), self._info()
        self._begun = True
        return observed, float(reward[0]), ended, self._batch.left == 0, info

    def render(self) -> Bytes | None:
        """Draw the robot as it is, as an RGB image of shape (H, W, 3); None without a render mode."""
        return None if self.render_mode is None else self._pictures.draw(0)

    def _info(self) -> dict[str, Any]:
        """What people may want to know, as arrays and as numbers of Python, which wrappers can convert."""
        own = {name: values[0] for name, values in self._account.info().items()}
        return {name: value if value.ndim else value.item() for name, value in own.items()}


class RobotVector(gymnasium.vector.VectorEnv[Any, Any, Any]):
    """Base class of vector environments: a batch of robots, each of which moves as it does alone, to the bit.

    The step after the last of an episode begins it anew, whatever the action (``AutoresetMode.NEXT_STEP``). Most
    robots begin together: then one that diverges or falls rests until the episodes of all are over, and only then its
    own is told to be over, as whoever counts episodes takes the next step to begin another one.
    """

    metadata = {  # noqa: RUF012 - what Gymnasium asks for
        "render_modes": list(RENDER_MODES),
        "autoreset_mode": gymnasium.vector.AutoresetMode.NEXT_STEP,
    }

    def __init__(self, batch: Batch, max_episode_steps: int | None, render_mode: str | None) -> None:
        """Take the robots, the steps after which episodes are cut off, and ``"rgb_array"`` or None for pictures."""
        self._batch, self._account, self._pictures = batch, Account(batch), Pictures(batch, render_mode)
        self.num_envs, self.render_mode, self._most = batch.count, render_mode, max_episode_steps
        self.single_observation_space, self.single_action_space = batch.observed, batch.acted
        self.observation_space = gymnasium.vector.utils.batch_space(batch.observed, batch.count)
        self.action_space = gymnasium.vector.utils.batch_space(batch.acted, batch.count)
        self.metadata = {**self.metadata, "render_fps": 1 / batch.seconds}
        self._generators = [np.random.default_rng() for _ in range(batch.count)]
        self._steps, self._over = np.zeros(batch.count, np.int64), np.ones(batch.count, bool)
        self._whole = False  # begun, and no step was interrupted

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin an episode of each robot; return the first observations and ``info``.

        Args:
            seed: seed of the first robot; those of the others follow it. Or a list of one each.
            options: of the environment of one robot, a value for all or a list of one each.
        """
        seeds = self._seeds(seed)
        for robot, one in enumerate(seeds):
            if one is not None:
                self._generators[robot], _ = gymnasium.utils.seeding.np_random(one)
        self._begin(np.arange(self.num_envs), options or {})
        info, self._whole = self._info(), True
        return self._account.observed.copy(), info

    def _seeds(self, seed: Any) -> list[int | None]:
        """The seed of each robot, or None for those that draw on.

        Raises:
            ValueError: for what is no whole number, or as many as there are not robots.
        """
        if seed is not None and np.ndim(seed) == 0:
            first = _seed(seed)
            return [first + robot for robot in range(self.num_envs)]
        return [None if one is None else _seed(one) for one in self._each("seed", seed)]

    def _begin(self, which: Ints, options: dict[str, Any]) -> None:
        """Begin episodes of some robots."""
        each = {name: self._each(name, value) for name, value in options.items()}
        own = [{name: values[robot] for name, values in each.items()} for robot in which]
        ways = [self._batch.way(one, self._generators[robot]) for one, robot in zip(own, which, strict=True)]
        self._whole = False
        self._account.begin(which, self._batch.begin(which, np.array(ways)))
        self._pictures.begin(which)
        self._steps[which], self._over[which] = 0, False

    def _each(self, name: str, given: Any) -> Any:
        """A value for each robot, of one for all or of as many as there are."""
        values = [given] * self.num_envs if np.ndim(given) == 0 else given
        if len(values) != self.num_envs:
            raise ValueError(f"{name}: {len(values)} are not allowed for {self.num_envs} robots; give one each")
        return values

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Apply an action of each robot, shape (N, ...); those whose episodes are over begin anew instead."""
        if not self._whole:
            raise RuntimeError(UNBEGUN)
        anew, reward = self._over.copy(), np.zeros(self.num_envs)
        if not anew.all():
            given = checked_actions(self.action_space, actions)
            self._whole = False
            reward = np.where(anew, 0.0, self._account.book(*self._batch.advance(given)))
            self._steps += 1
        if anew.any():
            self._begin(np.flatnonzero(anew), {})
        ended, cut = self._account.ended, self._cut(anew)
        over = ended | cut
        self._over = np.full(self.num_envs, over.all()) if self._batch.together else over
        info, self._whole = self._info(), True
        return self._account.observed.copy(), reward, ended & self._over, cut & self._over, info

    def _cut(self, anew: Bools) -> Bools:
        """Which episodes are cut off before they ended; none that has only begun."""
        cut = np.full(self.num_envs, self._batch.left == 0) | (self._steps == self._most)
        return cut & ~anew & ~self._account.ended

    def render(self) -> tuple[Bytes, ...] | None:
        """Draw each robot as it is, as an RGB image of shape (H, W, 3); None without a render mode."""
        return None if self.render_mode is None else tuple(map(self._pictures.draw, range(self.num_envs)))

    def _info(self) -> dict[str, Any]:
        """What people may want to know, with a mask beside each array, as Gymnasium has them."""
        found = self._account.info()
        return {**found, **{f"_{name}": np.ones(self.num_envs, bool) for name in found}}
