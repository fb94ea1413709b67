"""What is searched: bodies by what drawn controllers do in them, and bodies together with their controllers."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from optim.experiments.results import Progress
from optim.experiments.side_by_side import BudgetedSearch, run_side_by_side, run_with_budget
from optim.problem import Evaluation, Problem, Request, evaluate_request
from optim.search import build_method
from optim.space import Space
from optim.studies.beyond.evolving_vehicles.bodies import BODY, drawn_body, problem_of, tried
from taichi_sim.base.arrays import Arrays, Floats

OBJECTIVES = MappingProxyType(
    {
        "performance": ("performance",),
        "resistance": ("performance", "M_CI"),
        "learnability": ("performance", "M_L"),
    }
)
MARKS = 20  # costs at which loops are compared
LOOPS = MappingProxyType(
    {
        "lamarckian": "two loops, inherited",
        "baldwinian": "two loops, not inherited",
        "flat": "one loop",
        "fixed": "gradients, drawn body",
    }
)


@dataclass(frozen=True, eq=False)
class BodyProblem(Problem):
    """Designing a body by what the same drawn controllers do in each.

    Attributes:
        objectives: of ``"performance"``, minus the smallest mean distance left of any controller [m], ``"M_CI"``,
            as the lower end of its 95 % interval, because one success among one would be a share of 1, and ``"M_L"``.
        controllers: drawn.
        seed: of the controllers.
    """

    objectives: tuple[str, ...]
    controllers: int
    seed: int

    @property
    def space(self) -> Space:
        """Whole numbers that make a body."""
        return BODY

    @property
    def objective_names(self) -> tuple[str, ...]:
        """Names of the objectives."""
        return self.objectives

    def evaluate(self, points: ArrayLike) -> Evaluation:
        """Try the controllers in each body, shape (N, B)."""
        rows = []
        for body in self.space.validate(np.atleast_2d(points)):
            metrics, performance = tried(body, self.controllers, self.seed)
            values = {"performance": performance, "M_CI": metrics.resistance.low, "M_L": metrics.learnability.value}
            rows.append([values[name] for name in self.objective_names])
        return Evaluation(np.array(rows))


@dataclass(frozen=True, eq=False)
class PairProblem(Problem):
    """Designing body and controller together: how near the controller comes to the light in its worst environment."""

    @cached_property
    def space(self) -> Space:
        """Whole numbers of the body, then the controller, the same in all bodies."""
        return Space((*BODY.variables, *problem_of(BODY.low).space.variables))

    def evaluate(self, points: ArrayLike) -> Evaluation:
        """Score points, shape (N, B + P)."""
        return self._scored(self.space.validate(np.atleast_2d(points)), False)

    def evaluate_relaxed(self, points: ArrayLike, sharpness: float, gradients: bool) -> Evaluation:
        """Score points, with gradients by the controllers if wanted; by bodies these are zero."""
        del sharpness  # whole numbers stay whole
        return self._scored(self.space.relaxed().validate(np.atleast_2d(points)), gradients)

    def _scored(self, points: Floats, gradients: bool) -> Evaluation:
        """Points of one body together."""
        size = BODY.size
        bodies, of = np.unique(points[:, :size], axis=0, return_inverse=True)
        scores, slopes = np.full((len(points), 1), np.nan), np.zeros(points.shape)
        for number, body in enumerate(bodies):
            rows = np.flatnonzero(np.ravel(of) == number)
            request = Request(points[rows, size:], "gradients" if gradients else "points", np.inf)
            found = evaluate_request(problem_of(body), request)
            scores[rows] = found.objectives
            if found.gradients is not None:
                slopes[rows, size:] = found.gradients
        return Evaluation(scores, gradients=slopes if gradients else None)


def evolve(problem: BodyProblem, population: int, generations: int, progress: Progress = None) -> Arrays:
    """The body that NSGA-II ends with, ``body``, and what the search thought of it, ``objectives``.

    Of a front it is the point nearest to the best values of all objectives, in ranges of the front. If every evaluation
    fails it is the drawn body of the seed, as nothing was learnt about any.
    """
    total = population * (generations + 1)
    method = build_method("nsga2", problem.space, {"population": population, "seed": problem.seed})

    def observe(_: int, points: Floats, evaluation: Evaluation) -> bool:
        del points, evaluation
        if progress:
            progress(min(1.0, (search.spent + population) / total))
        return False

    search = BudgetedSearch(0, method, total, observe)
    run_side_by_side([search], lambda _, requests: [evaluate_request(problem, request) for request in requests])
    front = method.result()
    if not len(front.points):  # every evaluation has failed
        return {"body": drawn_body(problem.seed), "objectives": np.full(len(problem.objective_names), np.nan)}
    highest, span = front.objectives.max(axis=0), np.ptp(front.objectives, axis=0)
    away = (highest - front.objectives) / np.where(span > 0, span, 1.0)
    knee = int(np.argmin(np.linalg.norm(away, axis=1)))
    return {"body": front.points[knee], "objectives": front.objectives[knee]}


def loop(
    arm: str, population: int, life: int, budget: float, price: float, seed: int, progress: Progress = None
) -> Arrays:
    """Best score of one arm of ``LOOPS``, ``best``, at ``MARKS`` even costs, ``costs`` [evaluations].

    Args:
        arm: which.
        population: of bodies with their controllers.
        life: steps along gradients in each.
        budget: evaluations.
        price: what an evaluation with its gradient counts.
        seed: of all that is drawn.
        progress: is told the share that is done.
    """
    designed: Problem = problem_of(drawn_body(seed)) if arm == "fixed" else PairProblem()
    method, settings = {
        "lamarckian": ("lamarckian", {"population": population, "learning": life}),
        "baldwinian": ("lamarckian", {"population": population, "learning": life, "inherit": False}),
        "flat": ("genetic", {"population": population, "elites": population}),
        "fixed": ("gradient", {"climbers": 2, "candidates": max(2, population // 2), "patience": 20}),
    }[arm]
    course: list[tuple[float, float]] = []

    def evaluate(_: Sequence[Any], request: Request) -> Evaluation:
        return evaluate_request(designed, request)

    def observe(_: int, points: Floats, evaluation: Evaluation) -> bool:
        each = price if evaluation.gradients is not None else 1.0
        spent, best = course[-1] if course else (0.0, -np.inf)
        found = np.nan_to_num(evaluation.objectives[:, 0], nan=-np.inf)
        course.append((spent + each * len(points), max(best, float(found.max(initial=-np.inf)))))
        if progress:
            progress(min(1.0, course[-1][0] / budget))
        return False

    built = build_method(method, designed.space, {**settings, "seed": seed})
    run_with_budget([built], budget, evaluate, observe, None, price)
    costs = np.linspace(0, budget, MARKS + 1)[1:]
    spent, best = np.array(course).T
    known = np.searchsorted(spent, costs, side="right") - 1
    return {"costs": costs, "best": np.where(known >= 0, best[np.maximum(known, 0)], -np.inf)}
