"""Requests of a search to evaluate points, and how they are cut into parts and joined."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from optim.problem import Evaluation
from optim.search.method import Wants
from optim.space import Space
from taichi_sim.base.arrays import Floats


@dataclass(frozen=True, eq=False)
class Request:
    """Points to evaluate, shape (N, D); ``wants`` is that of ``Method``, ``sharpness`` that of a relaxation."""

    points: Floats
    wants: Wants = "points"
    sharpness: float = 0.0

    def part(self, begin: int, end: int) -> "Request":
        """Request for the points from ``begin`` up to ``end``."""
        return Request(self.points[begin:end], self.wants, self.sharpness)


Evaluate = Callable[[Request], Evaluation]


class Judging(Protocol):
    """The part of a ``Problem`` that judges points; it may have ``evaluate_relaxed``, too."""

    @property
    def space(self) -> Space:
        """The variables that may change."""

    def evaluate(self, points: ArrayLike) -> Evaluation:
        """Judge points, shape (N, D)."""


def judge(problem: Judging, request: Request) -> Evaluation:
    """Evaluate a request in this process.

    Raises:
        ValueError: if the problem has no relaxation, but one is wanted.
    """
    if request.wants == "points":
        return problem.evaluate(request.points)
    evaluate_relaxed = getattr(problem, "evaluate_relaxed", None)
    if evaluate_relaxed is None:
        raise ValueError(
            f"method: it wants {request.wants}, but {type(problem).__name__} has no relaxation; choose another method"
        )
    return evaluate_relaxed(request.points, request.sharpness, request.wants == "gradients")


def join_requests(requests: Sequence[Request]) -> Request:
    """Join requests that want the same with the same sharpness into one."""
    return replace(requests[0], points=np.concatenate([request.points for request in requests]))


def part_of(evaluation: Evaluation, rows: slice) -> Evaluation:
    """Part of an evaluation: that of some of its points."""
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
    """Evaluation of ``count`` points that all failed, to be joined with that of other points.

    Details have the names, types and shapes of those in ``like``: NaN, or zero if a type has no NaN.
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
