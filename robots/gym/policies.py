"""Policies that act in the environments, and episodes: for tests, baselines and comparisons."""

from typing import Any, Protocol

import gymnasium
import numpy as np
from numpy.typing import ArrayLike

from robots.gym.environment import Observation


class Policy(Protocol):
    """What acts on observations."""

    def reset(self) -> None:
        """Forget the last episode."""

    def __call__(self, observation: Observation) -> Any:
        """An action."""


class RandomPolicy:
    """Actions drawn from the action space, the same in every episode of a seed."""

    def __init__(self, space: gymnasium.Space[Any], seed: int = 0) -> None:
        """Draw from a space."""
        self._space, self._seed = space, seed

    def reset(self) -> None:
        """Draw from the start again."""
        self._space.seed(self._seed)

    def __call__(self, observation: Observation) -> Any:
        """A random action."""
        return self._space.sample()


class LinearPolicy:
    """Actions W (s, 1) within the bounds of a box: weights of observations, then a bias."""

    def __init__(self, space: gymnasium.spaces.Box, weights: ArrayLike) -> None:
        """Take weights of shape (actions, observations + 1)."""
        self._low, self._high, self._weights = space.low, space.high, np.asarray(weights, float)

    def reset(self) -> None:
        """Nothing to forget."""

    def __call__(self, observation: Observation) -> Observation:
        """The action."""
        action: Observation = np.clip(self._weights @ [*observation, 1.0], self._low, self._high)
        return action


class NeuronPolicy:
    """The published controllers of quadrupeds: neurons m = tanh(memory m + gain sum of W s), one for each motor.

    Source: dissertation, chapter 2.
    """

    def __init__(self, weights: ArrayLike, memory: float = 1.0, gain: float = 1.0) -> None:
        """Take weights as of ``robots.quadruped.simulate``, of shape (5, 8)."""
        self._weights, self._memory, self._gain = np.asarray(weights, float), memory, gain
        self.reset()

    def reset(self) -> None:
        """Neurons at rest."""
        self._neurons = np.zeros(self._weights.shape[1])

    def __call__(self, observation: Observation) -> Observation:
        """The neurons' values."""
        self._neurons = np.tanh(self._memory * self._neurons + self._gain * (observation @ self._weights))
        return self._neurons


def episode(
    environment: gymnasium.Env[Any, Any], policy: Policy, seed: int = 0, options: dict[str, Any] | None = None
) -> tuple[float, dict[str, Any]]:
    """Play an episode; its return and the last ``info``."""
    policy.reset()
    observation, info = environment.reset(seed=seed, options=options)
    gained, over = 0.0, False
    while not over:
        observation, reward, terminated, truncated, info = environment.step(policy(observation))
        gained, over = gained + float(reward), terminated or truncated
    return gained, info
