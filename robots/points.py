"""Points of a robot's parameters: what may be simulated, and what may be a design."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from taichi_sim.base.arrays import Floats, copied
from taichi_sim.base.variables import Variable

ROUNDING = 1e-9  # of the range of a parameter, by which a value of a design may lie beyond it


def checked_points(parameters: Sequence[Variable], given: ArrayLike) -> Floats:
    """Points as an array of their own, shape (N, P), of which values may lie beyond the bounds of their parameters.

    Raises:
        ValueError: for another shape, or numbers that are not finite.
    """
    try:
        points = np.atleast_2d(copied(given))
    except (TypeError, ValueError):
        points = np.empty((0, 0))
    if points.shape[1:] != (len(parameters),) or not len(points):
        raise ValueError(f"points: shape {points.shape} is not allowed; give finite numbers of (N, {len(parameters)})")
    if wrong := np.argwhere(~np.isfinite(points)).tolist():
        row, column = wrong[0]
        name = parameters[column].name
        raise ValueError(f"points: {points[row, column]} of {name} is not allowed; give finite numbers")
    return points


def checked_design(parameters: Sequence[Variable], point: Floats) -> Floats:
    """A point, shape (P,), of which each value is one that its parameter takes, but for rounding; angles are free.

    Raises:
        ValueError: for a value beyond the bounds, or part of a whole number.
    """
    for parameter, value in zip(parameters, point.tolist(), strict=True):
        if not takes(parameter, value):
            raise ValueError(f"{parameter.name}: {value:g} is not allowed; give {parameter.allowed}")
    return point


def takes(parameter: Variable, value: float) -> bool:
    """Whether a parameter may have a value in a design, but for rounding; angles are free."""
    margin = ROUNDING * (parameter.high - parameter.low)
    beyond = parameter.kind != "angle" and not parameter.low - margin <= value <= parameter.high + margin
    return not beyond and not (parameter.is_integer and value != round(value))
