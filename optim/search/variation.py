"""Operators that evolutionary methods share: ranking, mutation steps, starts around given values, and bounds."""

from collections.abc import Mapping
from typing import Literal

import numpy as np

from optim.search.method import below_all, with_values
from optim.space import USUAL_STEP, Space
from taichi_sim.base.arrays import Floats, Indices

Bounds = Literal["reflect", "random"]  # what becomes of values beyond a bound: Space.reflect, or draw_inside


def mutation_steps(space: Space) -> Floats:
    """Standard deviations of a mutation, shape (D,): ``Variable.step``, or a tenth of the range where that is 0."""
    return np.where(space.step > 0, space.step, USUAL_STEP * space.span)


def around_start(space: Space, points: Floats, start: Mapping[str, float], rng: np.random.Generator) -> Floats:
    """The points, shape (N, D), with given values in the first, and in the others these values mutated.

    If all had the same value, recombining them could never change it. Neither rounded nor brought into the bounds.
    """
    away = mutation_steps(space) * rng.standard_normal(points.shape)
    away[0] = 0
    given = np.array([name in start for name in space.names])
    centre = with_values(space, space.low[None], start)
    return np.where(given, centre + away, points)


def draw_inside(space: Space, points: Floats, origin: Floats, rng: np.random.Generator) -> Floats:
    """The points, shape (..., D), brought into the bounds, without rounding; angles wrap round.

    A value beyond a bound is drawn evenly between that of ``origin``, which lies inside, and the bound. Unlike
    :meth:`Space.clip` this leaves no points at the bounds themselves.
    """
    bound = space.clip(points)
    drawn = bound + rng.random(points.shape) * (origin - bound)
    return np.where(space.angles, space.reflect(points), np.where(points == bound, points, space.clip(drawn)))


def ranking(scores: Floats) -> Indices:
    """The order from the best to the failed, shape (N,); of equals the first goes first."""
    return np.argsort(-below_all(scores), kind="stable")
