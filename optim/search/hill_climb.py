"""Independent hill climbers, the search of the published experiments.

Source: Powers 2021 dissertation, ch. 5, "Optimization": 60 climbers, 200 generations. Every generation each
mutates all of its parameters by normal deviates, and keeps the child if it is better.
"""

from collections.abc import Mapping

import numpy as np

from optim.search.independent import IndependentSearches, random_starts
from optim.search.method import generator
from optim.space import Space
from taichi_sim.base.arrays import Floats


class HillClimb(IndependentSearches):
    """C hill climbers that know nothing of each other.

    Generation 0 evaluates random starts. Afterwards a climber's child is its best point with every variable x
    changed to x + N(0, step), integers rounded, reflected at the bounds.
    (differs: the published program wrapped values round, which could leave the bounds.)
    """

    def __init__(
        self, space: Space, *, climbers: int = 60, seed: int = 0, start: Mapping[str, float] | None = None
    ) -> None:
        """Set up the climbers.

        Args:
            space: what may be changed; its variables carry the steps of the mutation.
            climbers: C.
            seed: of all random numbers.
            start: values by name with which every climber starts; the other variables start at random.
        """
        super().__init__(space, climbers=climbers, seed=seed)
        if not space.step.all():
            raise ValueError(
                f"step: 0 of {space.names[int(np.argmin(space.step))]} is not allowed; it would never change"
            )
        self.start = dict(start or {})
        self._starts()

    def ask(self) -> Floats:
        """The starts, then one child per climber, shape (C, D)."""
        if self.generation == 0:
            return self._starts()
        rngs = [generator(self.seed, self.generation, climber) for climber in range(self.climbers)]
        deviates = np.stack([rng.standard_normal(self.space.size) for rng in rngs])
        return self.space.reflect(self.space.round(self.points + self.space.step * deviates))

    def _starts(self) -> Floats:
        return random_starts(self.space, self.seed, 0, range(self.climbers), self.start)
