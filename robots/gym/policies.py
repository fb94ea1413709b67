"""Simple policies for the environments, and a function that plays episodes, for tests and baselines."""

from collections.abc import Callable
from typing import Any, Protocol

import gymnasium
import numpy as np
from numpy.typing import ArrayLike

from robots.gym.batch import Observation


class Policy(Protocol):
    """Interface of policies, which choose an action for each observation."""

    def reset(self) -> None:
        """Begin a new episode without memory of the last one."""

    def __call__(self, observation: Observation) -> Any:
        """Action for an observation."""


class RandomPolicy:
    """Policy that draws actions at random from the action space; every episode has equal ones."""

    def __init__(self, space: gymnasium.Space[Any], seed: int = 0) -> None:
        """Take the action space and the seed."""
        self._space, self._seed = space, seed

    def reset(self) -> None:
        """Restart the random numbers from the seed."""
        self._space.seed(self._seed)

    def __call__(self, observation: Observation) -> Any:
        """A random action."""
        return self._space.sample()


class LinearPolicy:
    """Linear policy with actions W (s, 1), clipped to the bounds of a box: weights of observations, then a bias."""

    def __init__(self, space: gymnasium.spaces.Box, weights: ArrayLike) -> None:
        """Take weights of shape (actions, observations + 1)."""
        self._low, self._high, self._weights = space.low, space.high, np.asarray(weights, float)

    def reset(self) -> None:
        """Do nothing: the policy has no memory."""

    def __call__(self, observation: Observation) -> Observation:
        """Action for an observation."""
        action: Observation = np.clip(self._weights @ [*observation, 1.0], self._low, self._high)
        return action


class NeuronPolicy:
    """The published controllers of quadrupeds: neurons m = tanh(memory m + gain sum of W s), one for each motor.

    Source: dissertation, chapter 2.
    """

    def __init__(self, weights: ArrayLike, memory: float = 1.0, gain: float = 1.0) -> None:
        """Take the weights of one controller, shape (5, 8), ordered as in ``robots.quadruped.simulate``."""
        self._weights, self._memory, self._gain = np.asarray(weights, float), memory, gain
        self.reset()

    def reset(self) -> None:
        """Set all neurons to 0."""
        self._neurons = np.zeros(self._weights.shape[1])

    def __call__(self, observation: Observation) -> Observation:
        """Values of the neurons after an observation, which are the action."""
        self._neurons = np.tanh(self._memory * self._neurons + self._gain * (observation @ self._weights))
        return self._neurons


def episode(
    environment: gymnasium.Env[Any, Any],
    policy: Policy | Callable[[Observation], Any],
    seed: int = 0,
    options: dict[str, Any] | None = None,
) -> tuple[float, dict[str, Any]]:
    """Play one episode with a policy; return the sum of its rewards and the last ``info``.

    A policy may also be a plain function of the observation, which has nothing to reset.
    """
    if hasattr(policy, "reset"):
        policy.reset()
    observation, info = environment.reset(seed=seed, options=options)
    gained, over = 0.0, False
    while not over:
        observation, reward, terminated, truncated, info = environment.step(policy(observation))
        gained, over = gained + float(reward), terminated or truncated
    return gained, info
