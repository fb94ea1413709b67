"""Hill climbers that step along gradients, and mutate where gradients lead nowhere."""

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from optim.problem import Evaluation
from optim.search.base import positive, whole
from optim.search.hill_climb import HillClimb
from optim.search.method import Wants, check_slopes, single_objective, slopes_per_range
from taichi_sim.base.arrays import Bools, Floats

GROWTH, SHRINKAGE = 2.0, 0.5  # of a step, after a success and after a failure
MOST = 1e6  # ranges that a step may be long


@dataclass(eq=False, kw_only=True)
class GradientHillClimb(HillClimb):
    """Search by C hill climbers that step along their gradients, and mutate where such steps keep failing.

    A climber's step is twice as long after a success, half as long after a failure. Where steps keep failing, at a
    jump that gradients do not see or where chaos blows them up, the climber mutates as :class:`HillClimb` does until
    that helps. Gradients are asked for only where climbers have moved, in a turn of its own; only their directions
    count. Variables of no slope, such as times that last whole steps, can be left to mutation all along.

    Attributes:
        first_step: length of the first step, and of that after a mutation that helped [ranges].
        longest_step: the longest step [ranges].
        patience: failed steps before a climber mutates.
        blind: what a step does with variables whose slope is zero: ``"keep"`` or ``"mutate"`` them.
    """

    through_mixtures = True
    takes_gradients = True

    arrays: ClassVar[tuple[str, ...]] = ("uphill", "step", "failures", "moved")

    first_step: float = positive(0.05, MOST)
    longest_step: float = positive(0.5, MOST)
    patience: int = whole(5, 1)
    blind: Literal["keep", "mutate"] = "keep"

    def __post_init__(self) -> None:
        super().__post_init__()
        check_slopes(self.space)
        self.uphill = np.zeros((self.climbers, self.space.size))  # unit vectors, in ranges
        self.step = np.full(self.climbers, self.first_step)
        self.failures = np.zeros(self.climbers, int)  # in a row
        self.moved = np.zeros(self.climbers, bool)  # whose gradient is wanted

    @property
    def wants(self) -> Wants:
        """Gradients if climbers have moved, otherwise points."""
        return "gradients" if self.moved.any() else "points"

    def ask(self) -> Floats:
        """Return new best points, for their gradients; otherwise the starts, or a step or mutation of each climber."""
        if self.moved.any():
            return self.points[self.moved]
        mutated = super().ask()
        if self.generation == 0:
            return mutated
        stepped = self._inside(self.points + self.step[:, None] * self.uphill * self.space.span)
        if self.blind == "mutate":
            stepped = np.where(self.uphill == 0, mutated, stepped)
        return np.where(self._patient[:, None], stepped, mutated)

    def tell(self, points: Floats, evaluation: Evaluation) -> None:
        """Keep points that are better and choose the next steps; or store the gradients of the kept points."""
        if self.moved.any():
            self.uphill[self.moved] = _directions(slopes_per_range(evaluation, self.space, int(self.moved.sum())))
            self.moved = np.zeros(self.climbers, bool)
            self.generation += 1
            return
        stepping, before = self._patient & (self.generation > 0), self.points
        self._keep(points, single_objective(evaluation, self.climbers))
        self.moved = (self.points != before).any(axis=1)
        longer, shorter = np.minimum(GROWTH * self.step, self.longest_step), SHRINKAGE * self.step
        after_step = np.where(self.moved, longer, shorter)
        self.step = np.where(stepping, after_step, np.where(self.moved, self.first_step, self.step))
        self.failures = np.where(self.moved, 0, self.failures + 1)
        self.generation += int(not self.moved.any())

    @property
    def _patient(self) -> Bools:
        return np.asarray(self.failures < self.patience)


def _directions(slopes: Floats) -> Floats:
    """Unit vectors along slopes, shape (N, D); zero where there is no finite one."""
    with np.errstate(over="ignore", invalid="ignore"):
        lengths = np.sqrt((slopes**2).sum(axis=1, keepdims=True))
        found = np.divide(slopes, lengths, where=lengths > 0, out=np.zeros_like(slopes))
    return np.nan_to_num(found, posinf=0, neginf=0)
