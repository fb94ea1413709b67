"""The record of one generation of a search."""

import json
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from optim.problem import Evaluation, Problem, Request
from optim.search.method import SearchResult
from taichi_sim.base.arrays import mean_of, median_of
from taichi_sim.base.records import Count


@dataclass(frozen=True)
class Generation:
    """One generation of a run, which is one line of ``log.jsonl``. Scores are None while all evaluations have failed.

    Attributes:
        generation: its number; generation 0 is the starting points.
        evaluations: evaluations since the run began.
        failed: failed evaluations of this generation.
        best: best score so far.
        mean: mean score of what the search keeps: the climbers' best points, a population, or a front.
        median: median score of what the search keeps.
        scores: scores of independent climbers, shape (C,), for statistics; None for other methods.
        best_point: values of the best point by name.
        best_details: the problem's details of the best point by name; None for what is not finite.
        numbers: other numbers that the method reports.
    """

    generation: Count
    evaluations: Count
    failed: Count
    best: float | None
    mean: float | None
    median: float | None
    scores: list[float | None] | None
    best_point: dict[str, float | int] | None
    best_details: dict[str, Any] | None
    numbers: dict[str, float | int | None]

    def to_json(self) -> str:
        """Format the generation as one line of JSON; equal numbers give equal bytes."""
        return json.dumps(asdict(self), allow_nan=False)


def record(
    last: Generation | None,
    problem: Problem,
    result: SearchResult,
    request: Request,
    evaluation: Evaluation,
) -> Generation:
    """Make the record of the generation whose evaluation the method has just received.

    Details of the best point are not updated from a minibatch, which covers only some of the draws or worlds.
    """
    valid = result.scores[~np.isnan(result.scores)]
    best_details = last.best_details if last else None
    scores = mean_of(evaluation.objectives, axis=1)
    here = np.flatnonzero((request.points == result.point).all(axis=1) & (scores == result.score))
    if here.size and request.minibatch is None:
        best_details = {name: _plain(values[here[0]]) for name, values in evaluation.details.items()}
    return Generation(
        generation=last.generation + 1 if last else 0,
        evaluations=(last.evaluations if last else 0) + len(request.points),
        failed=int(evaluation.failed.sum()),
        best=None if np.isnan(result.score) else result.score,
        mean=float(mean_of(valid)) if valid.size else None,
        median=median_of(valid) if valid.size else None,
        scores=[None if np.isnan(s) else s for s in result.scores.tolist()] if result.kind == "climbers" else None,
        best_point=None if np.isnan(result.score) else problem.space.to_dict(result.point),
        best_details=best_details,
        numbers=dict(result.numbers),
    )


def _plain(values: ArrayLike) -> Any:
    """A detail of one point as JSON has it, with None for what is not finite."""
    found = np.asarray(values)
    if found.dtype.kind == "f":
        found = np.where(np.isfinite(found), found.astype(object), np.array(None, object))
    return found.tolist()
