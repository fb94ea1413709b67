"""All evaluations of searches with several seeds, in order, and when they found solutions."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from optim.experiments.results import Progress, computed
from optim.experiments.side_by_side import BudgetedSearch, run_with_budget
from optim.problem import Evaluation, Evaluator, Request, evaluate_request
from optim.search import build_method
from optim.search.epsilon_archive import EpsilonArchive
from optim.search.method import check_fit
from taichi_sim.base.arrays import Arrays, Bools, Floats, Ints
from taichi_sim.base.checks import within
from taichi_sim.base.results_folder import ResultsFolder

MOST_ENVIRONMENTS = 4  # that points of a search can solve
NOTHING = -1  # where a search has ended, or has found nothing yet


@dataclass(frozen=True, eq=False)
class SearchEvaluations:
    """Evaluations of R searches, at most B each; -1 or NaN beyond the last."""

    points: Floats  # shape (R, B, D)
    objectives: Floats  # maximised, shape (R, B, K); NaN for failures, too
    solved: NDArray[np.int8]  # environments that each point solves, shape (R, B)
    with_gradient: Bools  # whether the gradient was asked for, shape (R, B)

    @property
    def arrays(self) -> Arrays:
        """Arrays of the searches by name, to be saved in a file; ``SearchEvaluations(**arrays)`` are the same again."""
        return dict(vars(self))

    @property
    def evaluations(self) -> Ints:
        """Number of evaluations of each search, shape (R,)."""
        return np.count_nonzero(self.solved != NOTHING, axis=1)

    def first(self, environments: int = 4) -> Ints:
        """Evaluations until a point solved all environments, -1 if none did, shape (R,)."""
        return first_time(self.solved >= environments)

    def cost(self, environments: int = 4) -> Ints:
        """Cost until a point solves all environments, shape (R,); a gradient costs 1 + D evaluations (forward mode)."""
        each = np.where(self.with_gradient, 1 + self.points.shape[2], 1)
        first = self.first(environments)
        return np.where(first > 0, np.cumsum(each, axis=1)[np.arange(len(first)), first - 1], NOTHING)

    def reported(self, epsilons: ArrayLike) -> Ints:
        """Number of the point that each search would report after each evaluation, shape (R, B).

        It is -1 while all have failed, and after the end of a search.

        Source: dissertation, chapter 4: the member of the archive with the largest sum of objectives; the archive is
        that of boxes with these sides.
        """
        count, budget, size = self.points.shape
        sides = np.broadcast_to(np.asarray(epsilons, float), self.objectives.shape[2]).copy()
        found = np.full((count, budget), NOTHING)
        for search in range(count):
            archive = EpsilonArchive.empty(sides, size)
            for n in range(int(self.evaluations[search])):
                if not np.isnan(self.objectives[search, n]).any():
                    archive, _ = archive.with_point(self.points[search, n], self.objectives[search, n], n)
                if len(archive.labels):
                    found[search, n] = archive.labels[np.argmax(archive.objectives.sum(axis=1))]
        return found

    def of_points(self, values: NDArray[Any], chosen: Ints, missing: float) -> NDArray[Any]:
        """Take the values of chosen points from ``values``, shape (R, B); ``missing`` where none is chosen."""
        taken = np.take_along_axis(values, np.maximum(chosen, 0), axis=1)
        return np.where(chosen == NOTHING, missing, taken)


def first_time(happens: Bools) -> Ints:
    """Number, counted from 1, of the first true value in each row; -1 if there is none."""
    return np.where(happens.any(axis=1), happens.argmax(axis=1) + 1, NOTHING)


def record_searches(
    problem: Evaluator,
    method: str,
    settings: Mapping[str, Any],
    seeds: Sequence[int],
    budget: int,
    *,
    environments: int = 4,
    until_solved: bool = False,
    progress: Progress = None,
) -> SearchEvaluations:
    """Run a search with each seed, side by side; details of the problem say how many environments points ``solved``."""
    size = len(seeds), budget
    points, solved = np.full((*size, problem.space.size), np.nan), np.full(size, NOTHING, np.int8)
    with_gradient, objectives = np.zeros(size, bool), list[Floats]()

    def evaluate(_: Sequence[BudgetedSearch], request: Request) -> Evaluation:
        return evaluate_request(problem, request)

    def observe(search: int, asked: Floats, evaluation: Evaluation) -> bool:
        if not objectives:
            objectives.append(np.full((*size, evaluation.objectives.shape[1]), np.nan))
        first = np.count_nonzero(solved[search] != NOTHING)
        part = slice(first, first + len(asked))
        points[search, part], objectives[0][search, part] = asked, evaluation.objectives
        solved[search, part] = np.where(evaluation.failed, 0, evaluation.details["solved"])
        with_gradient[search, part] = evaluation.gradients is not None
        return until_solved and bool((solved[search, part] == environments).any())

    methods = [build_method(method, problem.space, {**settings, "seed": seed}) for seed in seeds]
    check_fit(methods[0], problem)
    run_with_budget(methods, budget, evaluate, observe, progress)
    return SearchEvaluations(points, objectives[0], solved, with_gradient)


def _check(arrays: Arrays) -> None:
    """Refuse evaluations of a file that no search can have made."""
    for name, axes in {"points": 3, "objectives": 3, "solved": 2, "with_gradient": 2}.items():
        if arrays[name].ndim != axes or arrays[name].shape[:2] != arrays["solved"].shape:
            raise ValueError(f"{name}: shape {arrays[name].shape} does not fit {arrays['solved'].shape} of solved")
    within("solved", arrays["solved"], NOTHING, MOST_ENVIRONMENTS)


def computed_searches(
    folder: ResultsFolder | None, arms: Mapping[str, Callable[..., SearchEvaluations]], progress: Progress
) -> dict[str, SearchEvaluations]:
    """Load or run the searches of every arm of a study, each a :func:`record_searches` with all but ``progress``."""

    def arrays(run: Callable[..., SearchEvaluations], progress: Progress) -> Arrays:
        return run(progress=progress).arrays

    parts = {name: partial(arrays, run) for name, run in arms.items()}
    found = computed(folder, parts, progress, "trials_{}", _check)
    return {name: SearchEvaluations(**arrays) for name, arrays in found.items()}
