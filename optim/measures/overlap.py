"""Measures of a body by a sweep over controllers: how easily one that solves every environment is found.

Source: Powers, Grindle, Kriegman, Frati, Cheney & Bongard, Morphology dictates learnability in neural controllers,
Artificial Life Conference 2020 (M_L and M_CF); Powers, Grindle, Frati & Bongard, A good body is all you need, arXiv
2021 (the same, called M_L and M_CI).
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from taichi_sim.base.arrays import Floats


def learnability(overlap: ArrayLike, environments: int = 4) -> Floats:
    """M_L: the share of all controllers that solve every environment, from 0 to 1.

    Args:
        overlap: number of environments that each controller solves, whole numbers of shape (..., W, W): one matrix
            over the two weights for each body.
        environments: how many there are, E.

    Returns:
        Shares, shape (...).

    Raises:
        ValueError: if the overlaps are no matrices of whole numbers from 0 to E, or E is below 1.
    """
    counts = _checked(overlap, environments)
    return learnability_of((counts == environments).sum(axis=(-2, -1)), counts.shape[-2] * counts.shape[-1])


def resistance(overlap: ArrayLike, environments: int = 4) -> Floats:
    """M_CI: the share of controllers solving every environment among those that solve any, from 0 to 1.

    It is the resistance to catastrophic interference: at 1, whoever learns one environment has learned all; 0 if
    no controller solves anything.

    Args:
        overlap: as in :func:`learnability`.
        environments: how many there are, E.

    Returns:
        Shares, shape (...).

    Raises:
        ValueError: as in :func:`learnability`.
    """
    counts = _checked(overlap, environments)
    solving_all, solving_any = ((counts >= least).sum(axis=(-2, -1)) for least in (environments, 1))
    return resistance_of(solving_all, solving_any)


def learnability_of(solving_all: ArrayLike, controllers: int) -> Floats:
    """M_L from how many of all controllers solve every environment, shape (...)."""
    return np.asarray(np.asarray(solving_all) / controllers)


def resistance_of(solving_all: ArrayLike, solving_any: ArrayLike) -> Floats:
    """M_CI from how many controllers solve every environment, and how many any, shape (...); 0 if none does."""
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
