"""Uniform random search: the yardstick that every other method has to beat."""

import numpy as np

from optim.search.independent import IndependentSearches
from optim.search.method import generator
from taichi_sim.base.arrays import Floats


class RandomSearch(IndependentSearches):
    """C searches that draw a uniform point of the space in every generation."""

    def ask(self) -> Floats:
        """One fresh point per search, shape (C, D)."""
        rngs = [generator(self.seed, self.generation, climber) for climber in range(self.climbers)]
        return np.concatenate([self.space.sample(rng, 1) for rng in rngs])
