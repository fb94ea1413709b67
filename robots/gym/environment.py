"""Base class of the Gymnasium environments."""

from typing import Any, TypeVar

import gymnasium
import numpy as np

from taichi_sim.base.arrays import Floats

Observation = Floats
Action = TypeVar("Action")

FAILED_RETURN = -1.0  # of an episode in which the simulation diverges, whatever it gained before


class RobotEnvironment(gymnasium.Env[Observation, Action]):
    """Gymnasium environment whose reward is progress, and in which a robot that diverges never wins."""

    metadata = {"render_modes": []}  # noqa: RUF012 - what Gymnasium asks for

    def __init__(self, low: Observation, high: Observation) -> None:
        """Take the bounds of the observations."""
        self.observation_space = gymnasium.spaces.Box(low, high, dtype=np.float64)
        self._gained, self._observed = 0.0, low

    def _begin(self, observation: Observation, info: dict[str, Any]) -> tuple[Observation, dict[str, Any]]:
        """Observation and info of a reset, as Gymnasium expects them."""
        self._gained, self._observed = 0.0, self._within(observation)
        return self._observed.copy(), info

    def _outcome(
        self, observation: Observation, reward: float, reached: bool, failed: bool, info: dict[str, Any]
    ) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Observation, reward, terminated, truncated and info of a step, as Gymnasium expects them.

        A robot that diverged keeps its last finite observation and loses all that it has gained.
        """
        if failed:
            reward = FAILED_RETURN - self._gained
        else:
            self._observed = self._within(observation)
        self._gained += reward
        return (
            self._observed.copy(),
            reward,
            reached or failed,
            False,
            {**info, "status": "diverged" if failed else "ok"},
        )

    def _within(self, observation: Observation) -> Observation:
        space = self.observation_space
        assert isinstance(space, gymnasium.spaces.Box)
        found: Observation = np.clip(observation, space.low, space.high)
        return found

    def _chosen(self, options: dict[str, Any] | None, name: str, count: int) -> int:
        """Number below ``count`` that the option ``name`` gives; drawn at random without this option.

        Raises:
            ValueError: for an unknown option, or a number outside 0 to ``count`` - 1.
        """
        given = dict(options or {})
        number = given.pop(name, None)
        if given:
            raise ValueError(f"options: {next(iter(given))!r} is unknown; give {name}")
        if number is None:
            return int(self.np_random.integers(count))
        if isinstance(number, bool) or not isinstance(number, int | np.integer) or not 0 <= number < count:
            raise ValueError(f"{name}: {number!r} is not allowed; give a whole number from 0 to {count - 1}")
        return int(number)


def checked_action(action: object, space: gymnasium.Space[Any]) -> Observation:
    """Convert an action to an array of numbers.

    Raises:
        ValueError: if it is not in its space.
    """
    found = np.asarray(action)
    if found.dtype.kind in "biuf":
        found = found.astype(space.dtype or float)
    if not space.contains(found):
        raise ValueError(f"action: {np.array2string(found, threshold=12)!r} is not allowed; give one of {space}")
    return found.astype(np.float64)
