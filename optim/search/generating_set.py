"""Generating set search: steps along directions, longer after a success, shorter when none of them helps.

Source: Kolda, Lewis & Torczon, "Optimization by direct search: new perspectives on some classical and modern methods",
SIAM Review 45, 2003 (generating sets; expansion and contraction of the step; bounds).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from optim.problem import Evaluation
from optim.search.base import number, whole
from optim.search.independent import IndependentSearches
from optim.search.method import below_all, generator, single_objective
from optim.search.variation import draw_inside
from taichi_sim.base.arrays import Floats

LONGEST = 1e300  # step [ranges] that is as good as none at all, and still a number


@dataclass(eq=False, kw_only=True)
class GeneratingSetSearch(IndependentSearches):
    """Search by C independent generating set searches, which step along directions from their best point so far.

    The first centre is a random start. A poll judges the points one step away from the centre, up and down every
    direction, in random order. It ends with the first that is better: this becomes the centre, and the step expands.
    If none is, the step contracts. With a step below the tolerance, the search begins anew, at a random point, and so
    it does where a start has failed.

    Steps are in ranges of the variables. Those of whole numbers are rounded and never less than 1; what they lead to
    is not judged a second time while only the steps of the others contract. What lies beyond a bound is drawn evenly
    between the centre and that bound, angles wrap round.

    A generation judges one point a search, so with one climber it is strictly sequential. With ``polled`` points at
    once, the best of them that is better than the centre ends the poll.

    Attributes:
        start: values by name with which every search starts, again and again; the others are random.
        directions: ``"axes"``: one variable at a time; ``"rotated"``: a random orthonormal basis for every poll,
            of all but the whole numbers, which keep their axes.
        step: length of the first step [ranges].
        expansion: factor of the step after a success.
        contraction: factor of the step after a poll without one.
        tolerance: step [ranges] below which a search begins anew.
        max_step: length of the longest step [ranges]. What is longer than 1 leads beyond a bound, so that a poll
            draws points on lines through the centre; a search may then take long to contract.
        polled: number of points of a poll that are evaluated at once; 2 D is all of them.
    """

    arrays: ClassVar[tuple[str, ...]] = ("centres", "centre_scores", "steps", "barren", "begun", "judged", "waiting")

    directions: Literal["axes", "rotated"] = "axes"
    step: float = number(0.5, 1e-12, 1.0)
    expansion: float = number(2.0, 1.0, 10.0)
    contraction: float = number(0.5, 0.01, 0.99)
    tolerance: float = number(1e-10, 1e-15, "step")
    max_step: float = number(1.0, "step", LONGEST)
    polled: int = whole(1, 1)

    def __post_init__(self) -> None:
        super().__post_init__()
        climbers = self.climbers
        self.integer = self.space.integers
        self.centres = np.full((climbers, self.space.size), np.nan)
        self.centre_scores, self.steps = np.full(climbers, np.nan), np.full(climbers, self.step)
        self.barren = np.full(climbers, np.nan)  # step of the last poll around this centre, which found nothing better
        self.begun, self.judged = np.zeros(climbers, int), np.zeros(climbers, int)  # of the poll: when, how many points
        self.waiting = np.ones(climbers, bool)  # for a start
        self.polls = [self.points[:0]] * climbers  # what follows from the state: the points of each poll
        self._starts()

    def ask(self) -> Floats:
        """Return the next points of each search: a start, or up to ``polled`` points of its poll, shape (N, D)."""
        return np.concatenate(self._asked())

    def tell(self, points: Floats, evaluation: Evaluation) -> None:
        """Keep points that are better, and continue each search's poll or begin the next one."""
        counts = [len(asked) for asked in self._asked()]
        scores = single_objective(evaluation, sum(counts))
        ends = np.cumsum(counts)
        best = [a + int(np.argmax(below_all(scores[a:b]))) for a, b in zip(ends - counts, ends, strict=True)]
        self._keep(points[best], scores[best])
        self.generation += 1
        for climber, (index, count) in enumerate(zip(best, counts, strict=True)):
            self._move(climber, points[index], scores[index], count)

    def _asked(self) -> list[Floats]:
        """The points asked for, of each search."""
        starts = iter(self._starts() if self.waiting.any() else ())
        return [
            next(starts)[None] if waiting else poll[judged : judged + self.polled]
            for waiting, poll, judged in zip(self.waiting, self.polls, self.judged, strict=True)
        ]

    def _starts(self) -> Floats:
        """A random point for every search that waits for one."""
        return self._random_starts(self.space, np.flatnonzero(self.waiting).tolist())

    def _move(self, climber: int, point: Floats, score: float, count: int) -> None:
        """Go on with a search after ``count`` of its points, of which this was the best."""
        if self.waiting[climber]:
            if not np.isnan(score):
                self._set_centre(climber, point, score, self.step)
        elif score > self.centre_scores[climber]:
            self._set_centre(climber, point, score, min(self.expansion * self.steps[climber], self.max_step))
        else:
            self.judged[climber] += count
            if self.judged[climber] == len(self.polls[climber]):
                self._contract(climber)
                self._begin_poll(climber)

    def _set_centre(self, climber: int, point: Floats, score: float, step: float) -> None:
        self.centres[climber], self.centre_scores[climber] = point, score
        self.steps[climber], self.barren[climber], self.waiting[climber] = step, np.nan, False
        self._begin_poll(climber)

    def _contract(self, climber: int) -> None:
        self.barren[climber] = self.steps[climber]
        self.steps[climber] *= self.contraction
        self.waiting[climber] = self.steps[climber] < self.tolerance

    def _begin_poll(self, climber: int) -> None:
        """Begin a poll, of a step at which there is anything new."""
        self.begun[climber], self.judged[climber] = self.generation, 0
        self.polls[climber] = self._poll(climber)
        while not (len(self.polls[climber]) or self.waiting[climber]):
            self._contract(climber)
            self.polls[climber] = self._poll(climber)

    def _poll(self, climber: int) -> Floats:
        """The points of the poll under way, in the order in which they are judged, shape (M, D), M <= 2 D."""
        rng = generator(self.seed, int(self.begun[climber]), climber, 1)
        centre, directions = self.centres[climber], self._directions(rng)
        lengths = self._lengths(self.steps[climber])
        points = self.space.round(draw_inside(self.space, centre + directions * lengths, centre, rng))
        judged = np.all(directions * (lengths - self._lengths(self.barren[climber])) == 0, axis=1)
        return points[rng.permutation(np.flatnonzero((points != centre).any(axis=1) & ~judged))]

    def _directions(self, rng: np.random.Generator) -> Floats:
        """A generating set, shape (2 D, D): a basis and its opposite."""
        basis = np.eye(self.space.size)
        if self.directions == "rotated":
            free = np.flatnonzero(~self.integer)
            basis[np.ix_(free, free)] = np.linalg.qr(rng.standard_normal((len(free), len(free))))[0]
        return np.concatenate([basis, -basis])

    def _lengths(self, step: float) -> Floats:
        """A step in the units of the variables, shape (D,)."""
        lengths = step * self.space.span
        return np.where(self.integer, np.maximum(1.0, np.rint(lengths)), lengths)

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Continue the search from what :meth:`state` returned."""
        super().restore(state)
        self.polls = [self.points[:0] if self.waiting[n] else self._poll(n) for n in range(self.climbers)]
