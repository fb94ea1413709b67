"""Ways to learn one environment after another along exact gradients, several controllers and all ways side by side.

Sources: Kirkpatrick et al., Overcoming catastrophic forgetting in neural networks, PNAS 114, 2017 (elastic weights);
Robins, Connection Science 7, 1995 (replay); Mallya & Lazebnik, PackNet, CVPR 2018 (what mattered is frozen).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Protocol

import numpy as np

from optim.search.step_rules import Adam
from taichi_sim.base.arrays import Arrays, Bools, Floats

ENOUGH = 0.9  # share of what was gained in A at first: who has it again is back
STEEPEST = 1.0  # share of the way per range: longer gradients are shortened to it
SEQUENTIAL = MappingProxyType(
    {"plain": "plain", "elastic": "elastic weights", "replay": "replay", "frozen": "half of the weights frozen"}
)
METHODS = MappingProxyType({**SEQUENTIAL, "both": "both at once"})


class Task(Protocol):
    """Two environments, 0 for A and 1 for B, in which controllers are judged, at points from 0 to 1, shape (N, D)."""

    def values(self, points: Floats) -> Floats:
        """How good they are in A and in B, shape (N, 2)."""

    def look(self, points: Floats, environment: int) -> tuple[Floats, Floats]:
        """How good they are in one environment, shape (N,), and the gradients of that, shape (N, D)."""


@dataclass(frozen=True)
class Recipe:
    """How controllers are trained.

    Attributes:
        steps: along gradients in A, and as many in B.
        rate: of the first steps in each, in ranges; it falls to zero in a line.
        strength: pull of elastic weights at a distance of one range, where a weight matters as the mean one does.
        replay: the first of every so many steps in B is one in A instead.
    """

    steps: int
    rate: float
    strength: float
    replay: int


class Climb:
    """Points, shape (R, D), on their way along gradients; the best that was looked at is kept.

    Attributes:
        points: where they are.
        best: the best so far.
        heights: how good the best was at every look so far, arrays of shape (R,).
    """

    def __init__(self, points: Floats, recipe: Recipe) -> None:
        """Begin at points."""
        self.points, self.best = np.array(points, float), np.array(points, float)
        self.heights: list[Floats] = []
        self._value = np.full(len(points), -np.inf)
        self._rule, self._left = (
            Adam(len(points), points.shape[1], recipe.rate, STEEPEST),
            np.linspace(1.0, 0.0, recipe.steps + 1),
        )

    def keep(self, rows: Bools, values: Floats) -> None:
        """Take in how good some points are where they are."""
        now = np.full(len(self.points), -np.inf)
        now[rows] = values
        better = now > self._value
        self.best[better], self._value[better] = self.points[better], now[better]
        self.heights.append(self._value.copy())

    def go(self, number: int, slopes: Floats, free: Bools | None = None) -> None:
        """Make the step of this number along slopes, shape (R, D); those not ``free``, if given, stay."""
        held = (self.points <= 0) & (slopes < 0) | (self.points >= 1) & (slopes > 0)
        moving = ~held if free is None else ~held & free
        steps = self._rule.steps(np.ones(len(slopes), bool), slopes, moving)
        self.points = np.clip(self.points + self._left[number] * steps, 0.0, 1.0)


def train(task: Task, first: Floats, recipe: Recipe) -> Arrays:
    """Learn A, then B, then A again, from N points, shape (N, D), in every way of ``METHODS``.

    All have as many gradients in A and B. What was learned is the best point that was looked at on the way: in the
    environment that is learned, with elastic weights less what their pull costs, with replay and the last look at A,
    or in both. The return to A is plain, whatever the way in B was.

    Returns:
        How good controllers are in A and B: ``start`` and ``learned``, which is after A, where they learn one after
        the other, shape (N, 2); ``final`` in the order of ``METHODS``, shape (M, N, 2). Shares of the steps that they
        need to be good in A: ``first``, shape (N,), and ``again``, shape (M - 1, N), in the order of ``SEQUENTIAL``.
    """
    learned, importance, climbed = learn_first(task, first, recipe)
    after = learn_second(task, learned, importance, recipe)
    final = task.values(np.concatenate([after, learn_both(task, first, recipe)]))
    enough = climbed[0] + ENOUGH * (climbed[-1] - climbed[0])
    again = share_needed(climb_in_a(task, after, recipe).heights, np.tile(enough, len(SEQUENTIAL)))
    return {
        "start": task.values(first),
        "learned": task.values(learned),
        "final": final.reshape(len(METHODS), len(first), 2),
        "first": share_needed(climbed, enough),
        "again": again.reshape(len(SEQUENTIAL), len(first)),
    }


def climb_in_a(task: Task, points: Floats, recipe: Recipe, importance: Floats | None = None) -> Climb:
    """Climb in A from points, shape (N, D); mean squared gradients are added to ``importance``, if given."""
    climb = Climb(points, recipe)
    for step in range(recipe.steps):
        values, slopes = task.look(climb.points, 0)
        climb.keep(np.ones(len(points), bool), values)
        slopes = shortened(slopes)
        if importance is not None:
            importance += slopes**2 / recipe.steps
        climb.go(step, slopes)
    return climb


def share_needed(heights: Sequence[Floats], enough: Floats) -> Floats:
    """Share of the looks, whose heights have shape (N,), after which they are high enough; 1 if they never are."""
    reached = np.asarray(heights) >= enough
    looks = np.where(reached.any(axis=0), reached.argmax(axis=0) + 1, len(heights))
    return np.asarray(looks / len(heights))


def learn_first(task: Task, first: Floats, recipe: Recipe) -> tuple[Floats, Floats, list[Floats]]:
    """Learn A: points, how much every weight mattered, both of shape (N, D), and how good the best was at each look.

    What matters is the mean squared gradient on the way.
    """
    importance = np.zeros(first.shape)
    climb = climb_in_a(task, first, recipe, importance)
    return climb.best, importance, climb.heights


def learn_second(task: Task, learned: Floats, importance: Floats, recipe: Recipe) -> Floats:
    """Learn B from where A was learned, in every way of ``SEQUENTIAL``, one after the other: shape (4 N, D)."""
    way = np.repeat(list(SEQUENTIAL), len(learned))
    anchor = np.tile(learned, (len(SEQUENTIAL), 1))
    mean = np.maximum(importance.mean(axis=1, keepdims=True), np.finfo(float).tiny)
    matters = np.tile(importance / mean, (len(SEQUENTIAL), 1))
    order = np.argsort(np.argsort(matters, axis=1), axis=1)
    free = (way != "frozen")[:, None] | (order < matters.shape[1] // 2)
    elastic = recipe.strength * matters * (way == "elastic")[:, None]
    climb, in_a = Climb(anchor, recipe), np.zeros(len(anchor))  # of replay at its last look
    for step in range(recipe.steps):
        again = (way == "replay") & (step % recipe.replay == 0)
        slopes, away = np.zeros(anchor.shape), climb.points - anchor
        values, slopes[~again] = task.look(climb.points[~again], 1)
        climb.keep(~again, values + in_a[~again] - 0.5 * (elastic * away**2)[~again].sum(axis=1))
        if again.any():
            in_a[again], slopes[again] = task.look(climb.points[again], 0)
        climb.go(step, shortened(slopes) - elastic * away, free)
    return climb.best


def learn_both(task: Task, first: Floats, recipe: Recipe) -> Floats:
    """Learn A and B at once, along the mean of both gradients: points, shape (N, D)."""
    climb = Climb(first, recipe)
    for step in range(recipe.steps):
        (in_a, by_a), (in_b, by_b) = (task.look(climb.points, environment) for environment in (0, 1))
        climb.keep(np.ones(len(first), bool), in_a + in_b)
        climb.go(step, (shortened(by_a) + shortened(by_b)) / 2)
    return climb.best


def shortened(slopes: Floats) -> Floats:
    """Gradients, shape (N, D), none of them longer than ``STEEPEST``."""
    longest = np.maximum(np.abs(slopes).max(axis=1, keepdims=True), STEEPEST)  # so that no square overflows
    length = longest * np.linalg.norm(slopes / longest, axis=1, keepdims=True)
    return np.asarray(slopes * (STEEPEST / np.maximum(length, STEEPEST)))
