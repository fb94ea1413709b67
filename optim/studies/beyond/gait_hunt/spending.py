"""Searches that end when they have spent what they may, in time steps of simulated robots."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.side_by_side import run_side_by_side
from optim.problem import Evaluation
from optim.problems.inflatable.problem import GaitProblem
from optim.runs import open_run
from optim.runs.folder import RunFolder
from optim.runs.history import History, read_history
from optim.runs.loop import FolderSearch
from optim.runs.requests import Request, judge
from optim.search import Method, build_method, default_settings
from taichi_sim.base.files import read_text, write_text

# A gradient takes as long as so many simulations without, for robots that fill vectors; see docs/performance.md.
GRADIENT_COST = 7.5
PUBLISHED_COST = 200_720  # robot-steps of a published evaluation at half of the largest pressure
ENDLESS = 1_000_000  # generations
SPENT = "spent.json"


class PaidSearch(FolderSearch):
    """A search in a run folder that ends when its next generation would cost more than is left.

    Attributes:
        spent: what each generation has cost [robot-steps].
    """

    def __init__(self, problem: GaitProblem, method: Method, run: RunFolder, budget: float, generations: int) -> None:
        """Restore the search and what it has spent.

        Args:
            problem: what to search.
            method: not yet used.
            run: open run folder; takes ``spent.json``, too.
            budget: [robot-steps].
            generations: number of the last generation, if the budget lasts.
        """
        super().__init__(problem, method, run)
        self.gaits, self.budget, self.generations, self.path = problem, budget, generations, run.path
        self.spent = read_spent(self.path)
        if (known := len(self.spent)) < self.turns:
            raise ValueError(f"{run.path / SPENT}: tells the cost of {known} of {self.turns} generations; restore it")
        del self.spent[self.turns :]  # of a generation that was cut off

    @property
    def done(self) -> bool:
        """Whether all generations are made, or the next one would cost too much; the first never does."""
        if self.turns > self.generations:
            return True
        return bool(self.spent) and sum(self.spent) + least_cost(self.gaits, self.ask()) > self.budget

    def tell(self, request: Request, evaluation: Evaluation) -> None:
        """Note what the generation has cost, then complete it."""
        self.spent.append(cost(self.gaits, request, evaluation))
        write_text(self.path / SPENT, json.dumps(self.spent) + "\n")
        super().tell(request, evaluation)


def search_within(
    problem: GaitProblem,
    method: str,
    settings: Mapping[str, Any],
    folder: Path,
    budget: float,
    progress: Callable[[float], None] | None = None,
    generations: int = ENDLESS,
) -> History:
    """Run a search, or go on with the one in the folder, until it has spent its budget, or made its generations.

    A generation of which it is clear before that the budget does not last is not begun, but the first always is. One
    that turns out to cost more is completed; :func:`paid` leaves it away.

    Args:
        problem: what to search.
        method: its name in ``METHODS``.
        settings: of the method, its seed among them.
        folder: of the run; beside its files ``spent.json``, what every generation has cost.
        budget: in robot-steps, see :func:`cost`.
        progress: called with the part of the budget that is spent.
        generations: number of the last one, if the budget lasts.

    Raises:
        ValueError: if budget or folder are not allowed, or the folder lacks what has been spent.
    """
    if not budget > 0:
        raise ValueError(f"budget: {budget:g} robot-steps are not allowed; give more than 0")
    known = default_settings(method) | dict(settings)
    config = {"problem": problem.describe(), "method": {"name": method, **known}, "generations": ENDLESS}
    with open_run(folder, config, resume=True) as run:
        search = PaidSearch(problem, build_method(method, problem.space, known), run, budget, generations)

        def evaluate(_: Sequence[PaidSearch], requests: Sequence[Request]) -> list[Evaluation]:
            return [judge(problem, request) for request in requests]

        def after_round() -> None:
            if progress:
                progress(min(sum(search.spent) / budget, 1.0))

        run_side_by_side([search], evaluate, after_round)
    return read_history(folder)


def paid(history: History, spent: Sequence[float], budget: float) -> History:
    """The generations of a run that ended within a budget; the first counts in any case."""
    count = max(1, int(np.searchsorted(np.cumsum(spent), budget, side="right")))
    return replace(history, generations=history.generations[:count], seconds=history.seconds[:count])


def read_spent(folder: Path) -> list[float]:
    """Read the cost of each generation of a run, perhaps with one that was cut off; empty for a new run.

    Raises:
        ValueError: for a damaged file.
    """
    path = folder / SPENT
    if not path.exists():
        return []
    try:
        spent = json.loads(read_text(path))
    except ValueError:
        spent = None
    if not isinstance(spent, list) or not all(isinstance(each, int | float) and each >= 0 for each in spent):
        raise ValueError(f"{path}: is damaged; it must be a list of robot-steps, one of each generation")
    return spent


def least_cost(problem: GaitProblem, request: Request) -> float:
    """The smallest cost of a request, see :func:`cost`: no gait gets ahead."""
    count = len(request.points)
    speeds = {condition.name: np.full(count, -np.inf) for condition in problem.conditions}
    return cost(problem, request, Evaluation(np.zeros(count), details=speeds))


def cost(problem: GaitProblem, request: Request, judged: Evaluation) -> float:
    """Time steps of all robots that judged a request; a gradient counts as ``GRADIENT_COST`` simulations."""
    relaxed = request.wants != "points"
    each = problem.robot_steps(request.points, judged, relaxed=relaxed, sharpness=request.sharpness)
    return float(each.sum()) * (GRADIENT_COST if request.wants == "gradients" else 1.0)
