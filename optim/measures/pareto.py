"""Pareto dominance and hypervolume; objectives are maximised.

Source: While, Hingston, Barone & Huband, A faster algorithm for calculating hypervolume, IEEE Transactions on
Evolutionary Computation 10(1), 2006 (hypervolume by slicing objectives).
"""

import numpy as np
from numpy.typing import ArrayLike

from taichi_sim.base.arrays import Bools, Floats


def dominates(ours: ArrayLike, theirs: ArrayLike) -> Bools:
    """Whether ``ours`` dominates ``theirs``: no objective is worse and at least one is better.

    Both have shape (..., K) and are broadcast; the result has shape (...). NaN neither dominates nor is dominated.
    """
    ours, theirs = np.asarray(ours, float), np.asarray(theirs, float)
    return np.asarray((ours >= theirs).all(axis=-1) & (ours > theirs).any(axis=-1))


def non_dominated(objectives: ArrayLike) -> Bools:
    """Whether each of N points, shape (N, K), is not dominated by any other, shape (N,); False for failures (NaN)."""
    objectives = np.asarray(objectives, float)
    mask = ~np.isnan(objectives).any(axis=1)
    for i in np.flatnonzero(mask):
        if mask[i]:  # dominance is transitive, so dominated points need no comparison of their own
            mask &= ~dominates(objectives[i], objectives)
    return mask


def hypervolume(objectives: ArrayLike, reference: ArrayLike) -> float:
    """Volume between a reference point and the points that lie above it in every objective.

    Exact for any number of objectives; with four of them, fronts of a few hundred points take seconds.

    Args:
        objectives: objectives of N points, shape (N, K). Rows that are not finite or not above the reference are
            ignored.
        reference: a point that is worse in every objective than the points of interest, shape (K,).

    Raises:
        ValueError: if the shapes do not fit together.
    """
    objectives, reference = np.asarray(objectives, float), np.asarray(reference, float)
    if objectives.ndim != 2 or reference.shape != objectives.shape[1:]:
        raise ValueError(
            f"reference: shape {reference.shape} is not allowed for objectives of shape {objectives.shape}; "
            "give one number for each objective"
        )
    heights = objectives - reference
    return _volume(heights[np.isfinite(heights).all(axis=1) & (heights > 0).all(axis=1)])


def _volume(heights: Floats) -> float:
    """Volume of the union of the boxes from the origin to each point, shape (N, K), all above 0."""
    if heights.shape[0] == 0:
        return 0.0
    if heights.shape[1] == 1:
        return float(heights.max())
    if heights.shape[1] > 2:
        heights = heights[non_dominated(heights)]
    heights = heights[np.argsort(-heights[:, -1], kind="stable")]
    depths = heights[:, -1] - np.append(heights[1:, -1], 0.0)  # of the slices, from the top down
    if heights.shape[1] == 2:
        return float(np.sum(depths * np.maximum.accumulate(heights[:, 0])))
    return sum(depth * _volume(heights[: i + 1, :-1]) for i, depth in enumerate(depths.tolist()) if depth > 0)
