"""Independent hill climbers, the search of the published experiments.

Source: Powers 2021 dissertation, ch. 5, "Optimization": 60 climbers, 200 generations. Every generation each
mutates all of its parameters by normal deviates, and keeps the child if it is better.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from optim.search.base import choice, table
from optim.search.independent import IndependentSearches, random_starts
from optim.search.method import generator, with_values
from taichi_sim.base.arrays import Floats


@dataclass(eq=False, kw_only=True)
class HillClimb(IndependentSearches):
    """C hill climbers that know nothing of each other.

    Generation 0 evaluates random starts. Afterwards a climber's child is its best point with every variable x
    changed to x + N(0, step), integers rounded, brought back into the bounds.
    (differs: the published program wrapped values round, which could leave the bounds.)

    Attributes:
        start: values by name with which every climber starts; the other variables start at random.
        bounds: what happens to a child beyond them: ``"reflect"`` folds it back as by a mirror, ``"clip"`` moves
            it to the nearest bound, ``"none"`` leaves it, for problems that take any value.
        streams: ``"climbers"`` have random numbers of their own, so that none depends on how many there are;
            with ``"generations"`` all climbers of a generation draw from one stream, as in chapter 2.
    """

    start: Mapping[str, float] | None = table()
    bounds: Literal["reflect", "clip", "none"] = choice("reflect", ("reflect", "clip", "none"))
    streams: Literal["climbers", "generations"] = choice("climbers", ("climbers", "generations"))

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.space.step.all():
            name = self.space.names[int(np.argmin(self.space.step))]
            raise ValueError(f"step: 0 of {name} is not allowed; it would never change")
        self.given: dict[str, float] = dict(self.start or {})
        self._starts()

    def ask(self) -> Floats:
        """The starts, then one child per climber, shape (C, D)."""
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
            return with_values(self.space, self.space.sample(generator(self.seed, 0), self.climbers), self.given)
        return random_starts(self.space, self.seed, 0, range(self.climbers), self.given)
