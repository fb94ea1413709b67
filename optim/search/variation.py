"""What evolutionary methods share: who is best, how far a variable mutates, and starts around given values."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from optim.search.method import with_values
from optim.search.population import below_all
from optim.space import Space, Vector

DEFAULT_STEP = 0.1  # of a range, for a variable that names no step


def mutation_steps(space: Space) -> Vector:
    """Standard deviations of a mutation, shape (D,): ``Variable.step``, or a tenth of the range where that is 0."""
    return np.where(space.step > 0, space.step, DEFAULT_STEP * space.span)


def around_start(space: Space, points: Vector, start: Mapping[str, float], rng: np.random.Generator) -> Vector:
    """The points, shape (N, D), with given values in the first, and in the others these values mutated.

    If all had the same value, recombining them could never change it. Neither rounded nor brought into the bounds.
    """
    away = mutation_steps(space) * rng.standard_normal(points.shape)
    away[0] = 0
    given = np.array([name in start for name in space.names])
    centre = with_values(space, space.low[None], start)
    return np.where(given, centre + away, points)


def ranking(scores: Vector) -> NDArray[np.intp]:
    """The order from the best to the failed, shape (N,); of equals the first goes first."""
    return np.argsort(-below_all(scores), kind="stable")
