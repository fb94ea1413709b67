"""Parallel hill climbers of quadrupeds' controllers, and what they kept.

Source: dissertation, chapter 2, "The fitness functions" (Eq. fitnesses) and "The evolutionary algorithm" (Eq. mutation
and survival): 100 climbers; a child is its parent plus N(0, 0.05), and replaces it if it is strictly better.
"""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Protocol

import numpy as np

from optim.search.method import generator
from optim.studies.chapter2.settings import FITNESS_NAMES, Interference, Treatment
from robots.quadruped.robot import MOTORS, SENSORS
from taichi_sim.base.arrays import Arrays, Bools, Floats

STEP = 0.05  # standard deviation of mutations
FITNESS: Mapping[str, Callable[..., Floats]] = MappingProxyType(
    dict(zip(FITNESS_NAMES, (np.sum, np.prod, np.min), strict=True))
)


class Climbers(Protocol):
    """One run of climbers that the study evaluates, generation by generation: ask, then tell.

    Another way to train controllers, as by gradients, offers the same and takes a place in
    ``interference_trainers.TRAINERS``.

    Attributes:
        generation: how many have been told.
    """

    generation: int

    def ask(self) -> Floats:
        """Controllers to evaluate next, one for each climber, (P, 5, 8); changes nothing."""

    def tell(self, weights: Floats, light: Floats, distance: Floats) -> None:
        """Take in the last light readings [1/m^2] and distances [m] of those asked for, each (P, E); NaN failed."""

    def state(self) -> Arrays:
        """All that ``restore`` needs to go on exactly; ``generation``, ``weights`` of the climbers now, (P, 5, 8),
        and what was kept so far: ``born`` (generation) and ``climber``, (N,), ``light`` and ``distance``, (N, E).
        """

    def restore(self, state: Arrays) -> None:
        """Take over what :meth:`state` returned."""


class HillClimbers:
    """P hill climbers that know nothing of each other; see :class:`Climbers`."""

    def __init__(self, treatment: Treatment, run: int, settings: Interference, threads: int | None = None) -> None:
        """Set up the climbers.

        Args:
            treatment: with a fitness of ``FITNESS``.
            run: seed of all random numbers. The same run of another treatment draws the same.
            settings: P, and whether weights stay between -1 and 1, as the text has it.
            threads: CPU threads of trainers that simulate on their own.
        """
        self.fitness, self.run, self.bounded = FITNESS[treatment.fitness], run, settings.variant == "text"
        self.generation = 0
        self.weights: Floats = np.zeros((settings.population, SENSORS, MOTORS))
        self.scores: Floats = np.full(settings.population, -np.inf)
        self._kept: list[Arrays] = []

    def ask(self) -> Floats:
        """Starts between -1 and 1, then a child of each climber."""
        random = generator(self.run, self.generation)
        if self.generation == 0:
            return random.uniform(-1, 1, self.weights.shape)
        children = self.weights + STEP * random.standard_normal(self.weights.shape)
        return np.clip(children, -1, 1) if self.bounded else children

    def tell(self, weights: Floats, light: Floats, distance: Floats) -> None:
        """Keep what is strictly better, Eq. survival; at the start, all."""
        self._keep(weights, light, distance)

    def _keep(self, weights: Floats, light: Floats, distance: Floats) -> Bools:
        """What was kept, (P,)."""
        scores = np.nan_to_num(self.fitness(light, axis=-1), nan=-np.inf)
        kept = (scores > self.scores) | (self.generation == 0)
        self.weights = np.where(kept[:, None, None], weights, self.weights)
        self.scores = np.where(kept, scores, self.scores)
        which = np.flatnonzero(kept)
        self._kept.append(
            {
                "born": np.full(len(which), self.generation, np.int32),
                "climber": which.astype(np.int32),
                "light": light[which],
                "distance": distance[which].astype(np.float32),
            }
        )
        self.generation += 1
        return kept

    def state(self) -> Arrays:
        """Weights, scores, and all that was kept."""
        self._kept = [{name: np.concatenate([part[name] for part in self._kept]) for name in self._kept[0]}]
        return {
            "generation": np.array(self.generation),
            "weights": self.weights,
            "scores": self.scores,
            **self._kept[0],
        }

    def restore(self, state: Arrays) -> None:
        """Continue from :meth:`state`."""
        self.generation = int(state["generation"])
        self.weights, self.scores = state["weights"], state["scores"]
        self._kept = [{name: state[name] for name in ("born", "climber", "light", "distance")}]
