"""At most so many full bladders at a time: levels of a column whose sum is more are scaled down to it."""

import numpy as np

from taichi_sim.base.arrays import Floats


def limited(levels: Floats, most_full: float | None) -> Floats:
    """Levels from 0 to 1, shape (8, T), of which the sum of no column is more than ``most_full``; None limits none."""
    return levels if most_full is None else levels * _shares(levels, most_full)


def slopes_before(levels: Floats, slopes: Floats, most_full: float | None) -> Floats:
    """Derivatives by levels before :func:`limited`, shape (8, T), from those by the levels that it returns."""
    if most_full is None:
        return slopes
    shares = _shares(levels, most_full)
    along = np.where(shares < 1.0, (slopes * levels).sum(axis=0) * shares / most_full, 0.0)
    return shares * (slopes - along)


def _shares(levels: Floats, most_full: float) -> Floats:
    """By what the levels of each column are multiplied, shape (T,)."""
    # Sorted, for sums of the same levels in another order round otherwise: a wave would be none any more.
    return most_full / np.maximum(np.sort(levels, axis=0).sum(axis=0), most_full)
