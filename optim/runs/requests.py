"""Split requests and evaluations into parts and join them, for several workers or searches."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from optim.problem import Evaluation, Request


def join_requests(requests: Sequence[Request]) -> Request:
    """Join requests that differ only in their points."""
    return replace(requests[0], points=np.concatenate([request.points for request in requests]))


def part_of(evaluation: Evaluation, rows: slice) -> Evaluation:
    """Evaluation of some of the points of an evaluation."""
    return Evaluation(
        evaluation.objectives[rows],
        evaluation.status[rows],
        {name: values[rows] for name, values in evaluation.details.items()},
        None if evaluation.gradients is None else evaluation.gradients[rows],
    )


def join(parts: Sequence[Evaluation]) -> Evaluation:
    """Join the evaluations of a request's parts, in order."""
    gradients = [part.gradients for part in parts]
    return Evaluation(
        np.concatenate([part.objectives for part in parts]),
        np.concatenate([np.asarray(part.status) for part in parts]),
        {name: np.concatenate([part.details[name] for part in parts]) for name in parts[0].details},
        None if any(g is None for g in gradients) else np.concatenate([g for g in gradients if g is not None]),
    )


def failures(like: Evaluation, count: int, status: str) -> Evaluation:
    """Evaluation of ``count`` points that all failed, which can be joined with that of other points.

    Details have the names, types and shapes of those in ``like``; they are NaN, or zero if the type has no NaN.
    """
    return Evaluation(
        np.full((count, like.objectives.shape[1]), np.nan),
        [status] * count,
        {name: _blank(np.asarray(values), count) for name, values in like.details.items()},
        None if like.gradients is None else np.full((count, like.gradients.shape[1]), np.nan),
    )


def _blank(like: NDArray[Any], count: int) -> NDArray[Any]:
    """``count`` rows of NaN, or zero if the type has no NaN, that can be joined with the given array."""
    blank = np.zeros((count, *like.shape[1:]), like.dtype)
    if np.issubdtype(like.dtype, np.inexact):
        blank[...] = np.nan
    return blank
