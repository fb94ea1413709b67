"""A search in one call, without a folder."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import Any, cast

import numpy as np

from optim.interrupts import CTRL_C, EndedBySignals
from optim.problem import Objective, Problem, evaluate_request, objectives_of, score_of
from optim.problems.function import Bounds, Function, problem_of
from optim.runs.generation import Generation, record
from optim.search import MethodName, build_method, check_objectives
from optim.search.method import SearchResult, check_fit, next_request
from optim.space import Space
from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import whole_number
from taichi_sim.base.short_text import counted

Progress = Callable[[Generation], object]
MOST_SHOWN = 8  # values of the best point


@dataclass(frozen=True, eq=False, repr=False)
class Maximum:
    """Result of :func:`maximise`: the best point found, and the history of the search.

    Attributes:
        best: values of the best point by name; None if every evaluation failed.
        point: the best point, shape (D,); one of the first points if every evaluation failed.
        score: objective of the best point, or the mean of several; NaN if every evaluation failed.
        objectives: names and units of the objectives.
        generations: a record for each generation, as in the log of a run folder.
        result: points that the method keeps (climbers, a population, a front or elites), with their objectives.
    """

    best: dict[str, float | int] | None
    point: Floats
    score: float
    objectives: tuple[Objective, ...]
    generations: tuple[Generation, ...]
    result: SearchResult

    @cached_property
    def history(self) -> dict[str, Floats]:
        """Progress of the search over its generations: arrays of shape (generations + 1,), NaN before any success.

        ``evaluations`` counts those made so far, ``failed`` those of the generation that failed; ``best`` is the best
        score so far; ``mean`` and ``median`` are of the scores of what the method keeps.
        """
        names = ("evaluations", "failed", "best", "mean", "median")
        return {name: np.array([getattr(each, name) for each in self.generations], float) for name in names}

    def __repr__(self) -> str:
        score, spent = score_of(self.objectives), counted(self.generations[-1].evaluations, "evaluation")
        if self.best is None:
            return f"nothing succeeded in {spent}"
        shown = [f"{name} {value:.4g}" for name, value in list(self.best.items())[:MOST_SHOWN]]
        more = ", ..." if len(self.best) > MOST_SHOWN else ""
        return f"best {score.name} {score.value(self.score)} after {spent}: {', '.join(shown)}{more}"


def maximise(
    problem: Problem | Function,
    method: MethodName = "cma",
    *,
    bounds: Bounds | Space | None = None,
    generations: int = 100,
    seed: int = 0,
    progress: bool | Progress = True,
    **settings: Any,
) -> Maximum:
    """Search for the point with the highest score of a problem or function, in one call and without a run folder.

    The same arguments give exactly the same result, bit for bit, on the same machine.

    Args:
        problem: a problem, or a function of points, shape (N, D), which then needs ``bounds``. A function with several
            objectives or a gradient becomes a problem by :func:`optim.problem_of`.
        method: a name in ``optim.search.METHODS``, or a class of your own, such as one of ``PopulationSearch``.
        bounds: (low, high) of each variable of the function by name, as in :func:`optim.problem_of`.
        generations: number of the last generation; the starts are generation 0.
        seed: seed of all random numbers.
        progress: True for a bar on a terminal, False for silence, or a function that is called with the record of
            every generation.
        settings: settings of the method, such as ``population`` or ``start``; a wrong name raises an error that lists
            them.

    Raises:
        ValueError: if an argument is not allowed; nothing has been evaluated then.

    Example:
        >>> found = maximise(lambda points: -((points - 0.3) ** 2).sum(axis=1), bounds={"x": (0, 1), "y": (0, 1)})
        >>> round(found.best["x"], 3)
        0.3
    """
    designed = _problem(problem, bounds)
    if robot := getattr(designed, "offered", None):
        from robots.robot import warn_of_doubts

        warn_of_doubts(robot)
    objectives = objectives_of(designed)
    generations = whole_number("generations", generations, 0)
    check_objectives(method, [objective.name for objective in objectives])
    search = build_method(method, designed.space, {"seed": seed, **settings})
    check_fit(search, designed)
    records: list[Generation] = []
    with EndedBySignals(CTRL_C), _shown(progress, generations, score_of(objectives)) as show:
        while len(records) <= generations:
            request = next_request(search)
            evaluation = evaluate_request(designed, request)
            search.tell(request.points, evaluation)
            result = search.result()
            last = record(records[-1] if records else None, designed, result, request, evaluation)
            records.append(last)
            show(last)
    return Maximum(last.best_point, result.point, result.score, objectives, tuple(records), result)


def _problem(problem: Problem | Function, bounds: Bounds | Space | None) -> Problem:
    """The problem itself, or that of a function."""
    if hasattr(problem, "evaluate"):
        if bounds is not None:
            raise ValueError("bounds: they are of a function; this problem has its own space")
        return cast(Problem, problem)
    if bounds is None:
        from robots.robot import Robot

        if isinstance(problem, Robot):
            told = "give RobotProblem(robot, objective=...), which judges it"
            raise ValueError(f"problem: {problem.name} is a robot; {told}")
        raise ValueError("bounds: missing; give (low, high) of each variable of the function by name")
    return problem_of(problem, bounds)


@contextmanager
def _shown(progress: bool | Progress, generations: int, score: Objective) -> Iterator[Progress]:
    """Yield what is called after every generation."""
    if callable(progress):
        yield progress
        return
    if not progress or not (sys.stderr.isatty() or "ipykernel" in sys.modules):
        yield lambda generation: None
        return
    from optim.progress import shown_progress

    with shown_progress("starts", generations + 1) as update:

        def show(last: Generation) -> None:
            best = f"best {score.name} {score.value(last.best)}"
            update(last.generation + 1, f"generation {last.generation}/{generations}: {best}")

        yield show
