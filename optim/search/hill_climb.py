"""Independent hill climbers, the search of the published experiments.

Source: Powers 2021 dissertation, ch. 5, "Optimization": 60 climbers, 200 generations. Every generation each
mutates all of its parameters by normal deviates, and keeps the child if it is better.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from optim.search.independent import IndependentSearches
from optim.search.method import generator, with_values
from taichi_sim.base.arrays import Floats


@dataclass(eq=False, kw_only=True)
class HillClimb(IndependentSearches):
    """Search by C independent hill climbers: each mutates its best point and keeps the child if it is better.

    Generation 0 evaluates random starts. Afterwards a climber's child is its best point with every variable x
    changed to x + N(0, step), integers rounded, brought back into the bounds.
    (differs: the published program wrapped values round, which could leave the bounds.)

    Attributes:
        bounds: what happens to a child beyond them: ``"reflect"`` folds it back as by a mirror, ``"clip"`` moves
            it to the nearest bound, ``"none"`` leaves it, for problems that take any value.
        streams: ``"climbers"`` have random numbers of their own, so that none depends on how many there are;
            with ``"generations"`` all climbers of a generation draw from one stream, as in chapter 2.

    Raises:
        ValueError: for a setting that is not allowed, or a variable whose mutation step is 0.
    """

    bounds: Literal["reflect", "clip", "none"] = "reflect"
    streams: Literal["climbers", "generations"] = "climbers"

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.space.step.all():
            name = self.space.names[int(np.argmin(self.space.step))]
            raise ValueError(f"step: 0 of {name} is not allowed; it would never change")
        self._starts()

    def ask(self) -> Floats:
        """Return the starting points, and later one child per climber, shape (C, D)."""
        if self.generation == 0:
            return self._starts()
        return self._inside(self.points + self.space.step * self._deviates())

    def _inside(self, points: Floats) -> Floats:
        """Points with whole numbers where they must be, brought back into the bounds."""
        points = self.space.round(points)
        if self.bounds == "none":
            return points
        return self.space.clip(points) if self.bounds == "clip" else self.space.reflect(points)

    def _deviates(self) -> Floats:
        """Standard normal numbers of this generation, shape (C, D); the same as often as asked."""
        if self.streams == "generations":
            return generator(self.seed, self.generation).standard_normal((self.climbers, self.space.size))
        rngs = [generator(self.seed, self.generation, climber) for climber in range(self.climbers)]
        return np.stack([rng.standard_normal(self.space.size) for rng in rngs])

    def _starts(self) -> Floats:
        if self.streams == "generations":
            return with_values(self.space, self.space.sample(generator(self.seed, 0), self.climbers), self.start)
        return self._random_starts(self.space, range(self.climbers))
