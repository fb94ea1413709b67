"""Learnability and resistance to interference of a body, measured by a sweep over its controllers.

Source: Powers, Grindle, Kriegman, Frati, Cheney & Bongard, Morphology dictates learnability in neural controllers,
Artificial Life Conference 2020 (M_L and M_CF); Powers, Grindle, Frati & Bongard, A good body is all you need, arXiv
2021 (the same measures, called M_L and M_CI).
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from taichi_sim.base.arrays import Floats


def learnability(overlap: ArrayLike, environments: int = 4) -> Floats:
    """M_L: the share of all controllers that solve every environment, from 0 to 1.

    Args:
        overlap: number of environments that each controller solves, integers of shape (..., W, W): for each body one
            matrix over the two weights.
        environments: E, the number of environments.

    Returns:
        Shares, shape (...).

    Raises:
        ValueError: if ``overlap`` does not hold matrices of integers from 0 to E, or E is below 1.
    """
    counts = _checked(overlap, environments)
    return learnability_of((counts == environments).sum(axis=(-2, -1)), counts.shape[-2] * counts.shape[-1])


def resistance(overlap: ArrayLike, environments: int = 4) -> Floats:
    """M_CI: among the controllers that solve any environment, the share that solves every one, from 0 to 1.

    It is the resistance to catastrophic interference: at 1, a controller that has learned one environment has learned
    all. It is 0 if no controller solves any environment.

    Args:
        overlap: as in :func:`learnability`.
        environments: E, the number of environments.

    Returns:
        Shares, shape (...).

    Raises:
        ValueError: as in :func:`learnability`.
    """
    counts = _checked(overlap, environments)
    solving_all, solving_any = ((counts >= least).sum(axis=(-2, -1)) for least in (environments, 1))
    return resistance_of(solving_all, solving_any)


def learnability_of(solving_all: ArrayLike, controllers: int) -> Floats:
    """M_L, shape (...), from the number of controllers that solve every environment and the number of all."""
    return np.asarray(np.asarray(solving_all) / controllers)


def resistance_of(solving_all: ArrayLike, solving_any: ArrayLike) -> Floats:
    """M_CI, shape (...), from the numbers of controllers that solve every, and any, environment; 0 if none does."""
    return np.asarray(np.asarray(solving_all) / np.maximum(solving_any, 1))


def _checked(overlap: ArrayLike, environments: int) -> NDArray[np.integer]:
    if not isinstance(environments, int | np.integer) or isinstance(environments, bool) or environments < 1:
        raise ValueError(f"environments: {environments!r} is not allowed; give a whole number of at least 1")
    counts = np.asarray(overlap)
    if counts.ndim < 2 or 0 in counts.shape[-2:]:
        raise ValueError(f"overlap: shape {counts.shape} is not allowed; give matrices, shape (..., W, W)")
    whole = np.issubdtype(counts.dtype, np.integer)
    if not whole or (counts.size and not 0 <= counts.min() <= counts.max() <= environments):
        found = f"from {counts.min()} to {counts.max()}" if whole else f"of type {counts.dtype}"
        raise ValueError(f"overlap: values {found} are not allowed; give whole numbers from 0 to {environments}")
    return counts
