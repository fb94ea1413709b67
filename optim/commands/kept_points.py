"""Points that runs keep, for commands that make something of them."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from optim.wording import counted
from taichi_sim.base.arrays import Floats

if TYPE_CHECKING:
    from optim.runs.history import History

P = TypeVar("P")


def kept_point(source: Path, build: Callable[[Mapping[str, Any]], P], member: int | None) -> "tuple[P, Floats]":
    """The problem of a run, and its best point, as its checked log tells, or another that it keeps.

    Args:
        source: folder of the run.
        build: ``from_description`` of the kind of problem that is wanted.
        member: which of the points that the search keeps, counted from 1; None: the best one.

    Raises:
        ValueError: in one line, for folders without runs, runs of other problems, and points that are not there.
    """
    from optim.runs.history import read_history

    return kept_point_of(read_history(source), build, member)


def kept_point_of(
    history: "History", build: Callable[[Mapping[str, Any]], P], member: int | None
) -> "tuple[P, Floats]":
    """As :func:`kept_point`, for a run that has been read."""
    from optim.runs.config import problem_of

    source = history.path
    problem: Any = problem_of(source, history.config, build)
    if member is not None:
        return problem, _kept(history, problem, member)
    best = history.generations[-1].best_point if history.generations else None
    if best is None:
        raise ValueError(f"source: {source} has no best design yet")
    return problem, problem.space.from_dict(best)


def _kept(history: "History", problem: Any, member: int) -> "Floats":
    """The Nth point that the search keeps."""
    from optim.runs.history import read_result

    result = read_result(history, problem)
    count = 0 if result is None else len(result.points)
    if result is None or member > count:
        raise ValueError(f"member: {member} is not allowed; {history.path} keeps {counted(count, 'design')}")
    if np.isnan(result.points[member - 1]).any() or np.isnan(result.scores[member - 1]):
        raise ValueError(f"member: {member} of {history.path} has failed; choose another")
    return result.points[member - 1]
