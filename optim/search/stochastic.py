"""Stochastic gradient ascent: each move follows the gradient in only a few of the worlds or draws."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from optim.problem import Evaluation, Minibatch
from optim.search import method
from optim.search.base import number, positive, whole
from optim.search.independent import IndependentSearches, best_of_each
from optim.search.step_rules import Adam, free_variables
from taichi_sim.base import checks
from taichi_sim.base.arrays import Arrays, Bools, Floats, Indices

STARTING, CLIMBING, EVALUATING = range(3)  # phases of a round
FORGETS = 0.99  # beta_2 of Adam: in a few hundred moves slopes change


@dataclass(eq=False, kw_only=True)
class StochasticAscent(IndependentSearches):
    """Search by stochastic gradient ascent: C climbers follow gradients in a few of the problem's worlds or draws.

    A gradient in one of 16 draws costs a sixteenth of that in all, and points nearly the same way on average, so a
    climber makes 16 times as many moves (Robbins & Monro, Ann. Math. Stat. 22, 1951). Moves are those of Adam with a
    rate that falls linearly in the course of a round. What counts is not where a climber is, which the last
    minibatches have shaken, but the average of where it has been (Polyak & Juditsky, SIAM J. Control Optim. 30, 1992),
    here one that forgets: it is judged in all worlds every few moves, and only these judgements are results. After a
    round all climbers begin anew.

    Only true designs are judged: values without a gradient, such as binary ones, stay as they were at the start. A
    climber whose point or gradient failed goes on from its average.

    Attributes:
        climbers: number C of climbers; all move in the same minibatches.
        minibatch_size: number of worlds or draws in a move, or all of a problem that has no more.
        candidates: random points of which a climber starts at the best, judged in the first minibatch.
        moves: number of moves in a round.
        judging: moves between two evaluations in all worlds or draws.
        learning_rate: typical step at the start of a round [ranges of the variables].
        settling: part of the learning rate that is left at the end of a round.
        clip: length to which longer gradients are shortened [objective per range].
        memory: part of the average that each move leaves as it is; 0 judges where the climbers are.
    """

    along_true_gradients = True
    takes_gradients = True
    independent_climbers = False  # all move in the same minibatches

    arrays: ClassVar[tuple[str, ...]] = ("here", "average", "move", "batch", "phase")

    climbers: int = whole(1, 1, method.MOST_POINTS)
    minibatch_size: int = whole(1, 1)
    candidates: int = whole(16, 1, method.MOST_POINTS)
    moves: int = whole(300, 2)
    judging: int = whole(20, 1)
    learning_rate: float = positive(0.02, 1.0)
    settling: float = number(0.1, 0.0, 1.0)
    clip: float = positive(1.0, 1e12)
    memory: float = number(0.8, 0.0, 0.999)

    def __post_init__(self) -> None:
        super().__post_init__()
        method.refuse_integers(self.space)
        checks.integer("candidates", self.candidates, 1, method.MOST_POINTS // self.climbers)
        shape = (self.climbers, self.space.size)
        self.steps = Adam(*shape, 1.0, self.clip, FORGETS)
        self.here, self.average = np.full(shape, np.nan), np.full(shape, np.nan)
        self.move, self.batch, self.phase = 0, 0, STARTING
        method.with_values(self.space, self.space.low[None], self.start)

    @property
    def wants(self) -> method.Wants:
        """Gradients; for candidate starts and averages only scores."""
        return "gradients" if self.phase == CLIMBING else "points"

    @property
    def sharpness(self) -> float:
        """Sharpness of the points: infinite, as gradients are taken at true designs."""
        return np.inf

    @property
    def minibatch(self) -> Minibatch | None:
        """Minibatch of the next move; None, for all worlds or draws, to evaluate averages."""
        return None if self.phase == EVALUATING else Minibatch(self.minibatch_size, self.batch, self.seed)

    def ask(self) -> Floats:
        """Return candidate starts, shape (C * candidates, D); or the climbers' points or averages, shape (C, D)."""
        if self.phase == STARTING:
            return self._random_starts(self.space, self._seeking.tolist(), self.candidates)
        return self.space.round(self.average if self.phase == EVALUATING else self.here)

    def tell(self, points: Floats, evaluation: Evaluation) -> None:
        """Choose the starts, move the climbers, or keep averages that are better in all worlds or draws."""
        scores = method.single_objective(evaluation, len(points))
        if self.phase == STARTING:
            self._begin(points, scores)
        elif self.phase == EVALUATING:
            self._keep(points, scores)
            self.phase = CLIMBING
            if self.move == self.moves:
                self._end_round()
        else:
            self._climb(scores, method.slopes_per_range(evaluation, self.space, len(points)))
        self.generation += 1

    @property
    def _seeking(self) -> Indices:
        """Climbers without a place."""
        return np.flatnonzero(np.isnan(self.here).any(axis=1))

    def result(self) -> method.SearchResult:
        """Return the best average of all climbers, and of each climber, in all rounds."""
        return replace(super().result(), numbers={"move": self.move})

    def _begin(self, points: Floats, scores: Floats) -> None:
        """Put each climber without a place at the best of its candidates; where all failed, others are tried."""
        seeking = self._seeking
        places, best = best_of_each(points, scores, len(seeking))
        found = np.isfinite(best)
        self.here[seeking[found]] = self.average[seeking[found]] = places[found]
        if found.all():
            self.batch, self.phase = self.batch + 1, EVALUATING

    def _climb(self, scores: Floats, slopes: Floats) -> None:
        """Move each climber by a step of Adam, or back to its average if it failed."""
        valid = method.sound(scores, slopes)
        slopes = np.where(valid[:, None], slopes, 0.0)
        free = free_variables(self.space, self.here, slopes) & ~self.space.integers
        rate = self.learning_rate * (1 - (1 - self.settling) * self.move / self.moves)
        moved = self.here + rate * self.steps.steps(valid, slopes, free) * self.space.span
        self._go(np.where(valid[:, None], self.space.bound(moved), self.average), ~valid)
        self.move, self.batch = self.move + 1, self.batch + 1
        if self.move % self.judging == 0 or self.move == self.moves:
            self.phase = EVALUATING

    def _go(self, there: Floats, lost: Bools) -> None:
        """Move the climbers, and their averages towards them; ``lost`` ones forget their steps."""
        self.here = there
        towards = (1 - self.memory) * self.space.offset(there, self.average) * self.space.span
        self.average = self.space.bound(self.average + np.where(lost[:, None], 0.0, towards))
        self.steps.forget(lost)

    def _end_round(self) -> None:
        """Have all climbers begin anew."""
        self.here[:] = self.average[:] = np.nan
        self.steps.forget(np.ones(self.climbers, bool))
        self.move, self.phase = 0, STARTING

    def _groups(self) -> Mapping[str, Arrays]:
        return {"rule": self.steps.arrays}
