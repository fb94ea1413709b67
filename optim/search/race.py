"""Gradient ascent for many variables: a race of climbers, of which the worse half gives up again and again."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from optim.problem import Evaluation
from optim.search import method
from optim.search.base import number, positive, whole
from optim.search.independent import IndependentSearches
from optim.search.step_rules import Adam, free_variables
from taichi_sim.base.arrays import Arrays, Floats, Indices

NEAR = 0.05  # of the range of a variable: deviation of where climbers return


@dataclass(eq=False, kw_only=True)
class GradientRace(IndependentSearches):
    """Search by rounds of C climbers that follow gradients, of which the worse half gives up every few moves.

    So most gradients are spent on starts that turned out well (successive halving: Jamieson & Talwalkar, AISTATS 2016).
    A round begins at random points, later ones partly about the best design (``returning``). Where variables are
    binary, or say that they mix designs, the climbers go through mixtures that become ever sharper, from 1 to
    ``sharpest``; then they are rounded and go on as true designs, whose binary variables stay (continuation: Wang,
    Lazarov & Sigmund, Struct. Multidisc. Optim. 43, 2011).
    Only true designs are results: also those next to the climbers, judged at the start and every few moves.

    A point that failed, or whose gradient did, is taken back half way to the last that did not; without such a point,
    the climber starts anew.

    Attributes:
        climbers: number C of climbers at the start of a round.
        seed: seed of all random numbers.
        start: values by name with which every climber starts; the others are random.
        moves: number of moves in a round.
        returning: share of the climbers of later rounds, rounded up, that begin about the best design so far, with a
            standard deviation of ``NEAR`` of each range; the first of them at it. Steps are long again there (warm
            restarts: Loshchilov & Hutter, ICLR 2017).
        halving: moves between two halvings; the last climber goes on alone.
        learning_rate: typical step at the start of a round [ranges of the variables].
        settling: part of the learning rate that is left at the end of a round.
        clip: length to which longer gradients are shortened [objective per range].
        sharpest: largest sharpness of mixtures.
        mixed: part of a round in which climbers go through mixtures.
    """

    takes_gradients = True
    independent_climbers = False  # they give up by rank, and return about the best of all

    arrays: ClassVar[tuple[str, ...]] = (
        *("here", "anchor", "step", "scale", "record", "racing", "move", "round", "judging"),
    )

    climbers: int = whole(8, 1, method.MOST_POINTS)
    moves: int = whole(100, 2)
    returning: float = number(0.0, 0.0, 1.0)
    halving: int = whole(6, 1)
    learning_rate: float = positive(0.05, 1.0)
    settling: float = number(0.2, 0.0, 1.0)
    clip: float = positive(1.0, 1e12)
    sharpest: float = number(8.0, 1.0, 1e12)
    mixed: float = number(0.6, 0.0, 1.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        method.refuse_integers(self.space)
        self.relaxed = self.space.relaxed()
        self.between = round(self.mixed * self.moves) if self.space.mixes else 0  # moves through mixtures
        shape = (self.climbers, self.space.size)
        self.steps = Adam(*shape, 1.0, self.clip)
        self.here, self.anchor, self.step = np.empty((3, *shape))
        self.scale, self.record = np.empty((2, self.climbers))
        self.racing = np.zeros(self.climbers, bool)
        self.move, self.round, self.judging = 0, 0, False
        self._begin()

    @property
    def wants(self) -> method.Wants:
        """Gradients; true points after climbers have given up among mixtures."""
        return "points" if self.judging else "gradients"

    @property
    def through_mixtures(self) -> bool:  # type: ignore[override]
        """Whether some of the moves of a round go through mixtures."""
        return self.between > 0

    @property
    def sharpness(self) -> float:
        """Sharpness, which rises from 1 to ``sharpest`` through the mixtures of a round, then is infinite."""
        if self.move >= self.between:
            return np.inf
        return float(self.sharpest ** (self.move / max(self.between - 1, 1)))

    @property
    def _rows(self) -> Indices:
        return np.flatnonzero(self.racing)

    def ask(self) -> Floats:
        """Return the points of the climbers still in the race, shape (N, D), rounded where true points are wanted."""
        here = self.here[self.racing]
        return self.space.round(here) if self.judging else here.copy()

    def tell(self, points: Floats, evaluation: Evaluation) -> None:
        """Move the climbers on from the evaluated points, and let the worse half give up when it is time."""
        scores = method.single_objective(evaluation, len(points))
        if self.judging or self.sharpness == np.inf:
            kept, known = np.full(self.here.shape, np.nan), np.full(self.climbers, np.nan)
            kept[self.racing], known[self.racing] = self.space.round(points), scores
            self._keep(kept, known)
        if self.judging:
            self.judging = False
        else:
            slopes = method.slopes_per_range(evaluation, self.space, len(points))
            self._climb(scores, slopes)
            self.judging = self._next_move()
        self.generation += 1

    def result(self) -> method.SearchResult:
        """Return the best true design of all climbers, and of each climber, in all rounds."""
        numbers = {"round": self.round, "climbers racing": int(self.racing.sum())}
        return replace(super().result(), numbers=numbers)

    def _begin(self) -> None:
        """Begin a round with climbers at random points, or about the best design."""
        self._start_anew(range(self.climbers))
        if self.round and np.isfinite(self.scores).any():
            self._return(range(math.ceil(self.returning * self.climbers)))
        self.racing[:], self.judging = True, self.between > 0
        self.steps.forget(np.ones(self.climbers, bool))
        self._leave()

    def _start_anew(self, climbers: Sequence[int]) -> None:
        """Put some climbers at random points; those that fail there are put elsewhere in the next generation."""
        rngs = [method.generator(self.seed, self.generation, climber) for climber in climbers]
        self._put(climbers, np.reshape([self.relaxed.sample(rng, 1) for rng in rngs], (-1, self.space.size)))

    def _return(self, climbers: range) -> None:
        """Put the first of some climbers at the best design so far, and the others about it."""
        noises = [method.generator(self.seed, self.generation, c).normal(0.0, NEAR, self.space.size) for c in climbers]
        noise = np.reshape(noises, (-1, self.space.size))
        noise[:1] = 0.0
        self._put(climbers, self.relaxed.bound(super().result().point + noise * self.space.span))

    def _put(self, climbers: Sequence[int], places: Floats) -> None:
        """Put some climbers at places, one each, with the values that are given; rounded where designs are true."""
        places = method.with_values(self.relaxed, places, self.start)
        self.here[list(climbers)] = self.space.round(places) if self.move >= self.between else places

    def _leave(self) -> None:
        """Never go back to where climbers have been, as they are judged otherwise now."""
        self.anchor[:], self.step[:], self.scale[:], self.record[:] = np.nan, 0.0, 1.0, -np.inf

    def _climb(self, scores: Floats, slopes: Floats) -> None:
        """Move each climber that races by a step of Adam, or half way back if it failed."""
        rows = self._rows
        valid = method.sound(scores, slopes)
        self.record[rows] = np.maximum(self.record[rows], np.where(valid, scores, -np.inf))
        moved = np.zeros(self.climbers, bool)
        moved[rows[valid]] = True
        gradients = np.zeros(self.here.shape)
        gradients[rows] = np.where(valid[:, None], slopes, 0.0)
        free = free_variables(self.relaxed, self.here, gradients)
        if self.move >= self.between:  # what makes no difference stays, whatever led there before
            free &= gradients != 0
        rate = self.learning_rate * (1 - (1 - self.settling) * self.move / self.moves)
        steps = rate * self.steps.steps(moved, gradients, free)
        self.anchor[moved], self.step[moved] = self.here[moved], steps[moved]
        self.scale = np.where(moved, np.minimum(1.0, 2 * self.scale), self.scale / 2)
        there = self.relaxed.bound(self.anchor + self.scale[:, None] * self.step * self.space.span)
        known = self.racing & ~np.isnan(self.anchor).any(axis=1)
        self.here[known] = there[known]
        self._start_anew(np.flatnonzero(self.racing & ~known).tolist())

    def _next_move(self) -> bool:
        """Count the move; whether true points shall be judged next."""
        self.move += 1
        if self.move == self.moves:
            self.move, self.round = 0, self.round + 1
            self._begin()
            return self.judging
        among_mixtures = self.move < self.between
        halves = self.move % self.halving == 0
        if halves and self.racing.sum() > 1:
            order = self._rows[np.argsort(-self.record[self._rows], kind="stable")]
            self.racing[order[(len(order) + 1) // 2 :]] = False
        if halves:
            self.record[:] = -np.inf
        if self.move == self.between:  # true designs from here on, as quick as they were
            self.here = self.space.round(self.here)
            self._leave()
        return halves and among_mixtures

    def _groups(self) -> Mapping[str, Arrays]:
        return {"rule": self.steps.arrays}
