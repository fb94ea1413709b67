"""A space as operators on arrays want it: every variable from 0 to 1."""

from collections.abc import Callable

import numpy as np

from optim.space import Space
from taichi_sim.base.arrays import Floats


def into_cube(space: Space, points: Floats, origin: Floats) -> Floats:
    """Points, shape (..., D), as shares of the ranges; angles turned so that ``origin`` is at 0.5.

    So the seam of an angle lies opposite the origin, where nothing is near it. Whole numbers lie in the middle of
    equal shares: a binary at 0.25 and 0.75.
    """
    low, span = _ends(space)
    return np.where(space.angles, 0.5 + space.offset(points, origin), (points - low) / span)


def out_of_cube(space: Space, unit: Floats, origin: Floats) -> Floats:
    """The points of the space that :func:`into_cube` brings to ``unit``: rounded, set to bounds, angles wrapped."""
    low, span = _ends(space)
    turned = origin + (unit - 0.5) * space.span
    return space.bound(space.round(np.where(space.angles, turned, low + unit * span)))


def mutate_in_cube(space: Space, points: Floats, mutate: Callable[[Floats], Floats]) -> Floats:
    """Points, shape (N, D), after a mutation of the cube.

    A whole number that the mutation touched changes by at least one, towards where it was pushed, or away from a
    bound: small pushes would be rounded away, and binaries would never flip.
    """
    unit = into_cube(space, points, points)
    pushed = mutate(unit)
    mutants = np.where(pushed == unit, points, out_of_cube(space, pushed, points))
    still = space.integers & (mutants == points)
    return np.where(still, space.reflect(points + np.sign(pushed - unit)), mutants)


def _ends(space: Space) -> tuple[Floats, Floats]:
    """Where the cube begins, and how long it is, in each variable, shape (D,): half a whole number beyond bounds."""
    margin = np.where(space.integers, 0.5, 0.0)
    return space.low - margin, space.span + 2 * margin
