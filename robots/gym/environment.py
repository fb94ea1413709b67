"""Base class of the Gymnasium environments."""

from abc import abstractmethod
from typing import Any

import gymnasium
import numpy as np

from taichi_sim.base.arrays import Floats

Observation = Floats

FAILED_RETURN = -1.0  # of an episode in which the simulation diverges, whatever it gained before


class RobotEnvironment(gymnasium.Env[Observation, Any]):
    """Gymnasium environment whose reward is progress, and in which a robot that diverges never wins.

    A subclass tells how an episode begins, what an action does, and what ``info`` has.
    """

    metadata = {"render_modes": []}  # noqa: RUF012 - what Gymnasium asks for

    def __init__(self, low: Observation, high: Observation, actions: gymnasium.Space[Any], render_mode: None) -> None:
        """Take the bounds of the observations, and the space of actions."""
        self.observation_space = gymnasium.spaces.Box(low, high, dtype=np.float64)
        self.action_space, self.render_mode = actions, render_mode
        self._gained, self._observed, self._begun = 0.0, low, False

    @abstractmethod
    def _begin(self, options: dict[str, Any]) -> Observation:
        """Begin an episode; the first observation."""

    @abstractmethod
    def _advance(self, action: Floats) -> tuple[Observation, float, bool, bool]:
        """Apply an action: observation, reward, whether the aim is reached, and whether the simulation diverged."""

    @abstractmethod
    def _info(self) -> dict[str, Any]:
        """What people may want to know."""

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode."""
        super().reset(seed=seed)
        self._gained, self._observed, self._begun = 0.0, self._within(self._begin(dict(options or {}))), True
        return self._observed.copy(), self._info()

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Apply an action.

        A robot that diverged keeps its last finite observation and loses all that it has gained.

        Raises:
            ValueError: for an action that is not in its space.
        """
        if not self._begun:
            raise RuntimeError("reset the environment before its first step")
        given = np.asarray(action)
        if given.dtype.kind in "biuf":
            given = given.astype(self.action_space.dtype or float)
        if not self.action_space.contains(given):
            text = np.array2string(given, threshold=12)
            raise ValueError(f"action: {text!r} is not allowed; give one of {self.action_space}")
        observation, reward, reached, failed = self._advance(given.astype(np.float64))
        if failed:
            reward = FAILED_RETURN - self._gained
        else:
            self._observed = self._within(observation)
        self._gained += reward
        status = "diverged" if failed else "ok"
        return self._observed.copy(), reward, reached or failed, False, {**self._info(), "status": status}

    def _within(self, observation: Observation) -> Observation:
        space = self.observation_space
        assert isinstance(space, gymnasium.spaces.Box)
        found: Observation = np.clip(observation, space.low, space.high)
        return found

    def _chosen(self, options: dict[str, Any], name: str, count: int) -> int:
        """Number below ``count`` that the option ``name`` gives; drawn at random without this option.

        Raises:
            ValueError: for an unknown option, or a number outside 0 to ``count`` - 1.
        """
        number = options.pop(name, None)
        if options:
            raise ValueError(f"options: {next(iter(options))!r} is unknown; give {name}")
        if number is None:
            return int(self.np_random.integers(count))
        if isinstance(number, bool) or not isinstance(number, int | np.integer) or not 0 <= number < count:
            raise ValueError(f"{name}: {number!r} is not allowed; give a whole number from 0 to {count - 1}")
        return int(number)
