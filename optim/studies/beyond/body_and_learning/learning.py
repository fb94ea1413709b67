"""Learning of controllers in a body: which kinds there are, and how many evaluations a search needs."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np

from optim.experiments.data import Data, Kind
from optim.experiments.results import Progress, cached
from optim.experiments.side_by_side import run_with_budget
from optim.experiments.tables import Record, column
from optim.problem import Evaluation, Request, evaluate_request
from optim.problems.robot import RobotProblem
from optim.search import build_method
from taichi_sim.base.arrays import Arrays, Floats
from taichi_sim.base.checks import within
from taichi_sim.base.results_folder import ResultsFolder


@dataclass(frozen=True)
class Learner:
    """A kind of learning.

    Attributes:
        title: as tables say it.
        method, settings: of the search.
        share: of the budget of evaluations that it has; one with its gradient takes as long as several without.
    """

    title: str
    method: str
    settings: Mapping[str, Any]
    share: float = 1.0

    def evaluations(self, budget: int) -> int:
        """What it may take of a budget of evaluations without gradients."""
        return max(2, round(self.share * budget))


LEARNERS = MappingProxyType(
    {
        "evolution": Learner("evolution", "hill-climb", {"climbers": 8}),
        "nes": Learner("evolution strategies", "nes", {"population": 16, "random_mean": True, "sigma": 0.1}),
        "gradient": Learner("gradients", "gradient", {"climbers": 2, "candidates": 8, "patience": 20}, 0.25),
    }
)


def learn_until(
    problem: RobotProblem, score: float, learner: Learner, budget: int, seeds: Sequence[int], progress: Progress = None
) -> Arrays:
    """Evaluations until a search finds a score, or its budget, and whether it did, shape (R,) each; R seeds."""
    evaluations, solved = np.zeros(len(seeds), np.int64), np.zeros(len(seeds), bool)

    def evaluate(_: Sequence[Any], request: Request) -> Evaluation:
        return evaluate_request(problem, request)

    def observe(run: int, points: Floats, evaluation: Evaluation) -> bool:
        good = np.flatnonzero(np.nan_to_num(evaluation.objectives[:, 0], nan=-np.inf) >= score)
        solved[run] = good.size > 0
        evaluations[run] += good[0] + 1 if good.size else len(points)
        return bool(solved[run])

    methods = [build_method(learner.method, problem.space, {**learner.settings, "seed": seed}) for seed in seeds]
    run_with_budget(methods, budget, evaluate, observe, progress)
    return {"evaluations": evaluations, "solved": solved}


def learned_cells(
    kept: ResultsFolder, part: str, name: str, repetitions: int, budget: int, learn: Callable[[], Arrays]
) -> Record:
    """Cells of a kind of learning in the row of a body: mean evaluations, runs that succeeded, evaluations of each run.

    Args:
        kept: where outcomes are kept; if it has them, nothing is learned again.
        part: their name there.
        name: of the learner, one of :data:`LEARNERS`.
        repetitions: runs.
        budget: evaluations of a run, gradients not yet counted.
        learn: what :func:`learn_until` gives.
    """
    check = partial(check_learned, repetitions, LEARNERS[name].evaluations(budget))
    learned = cached(kept, part, learn, check)
    return {
        name: float(learned["evaluations"].mean()),
        f"{name}_solved": int(learned["solved"].sum()),
        f"{name}_runs": learned["evaluations"].tolist(),
    }


def run_columns(data: Data, table: str) -> dict[str, Kind]:
    """Columns of single runs that a table of bodies has, by name; older ones have none."""
    there = data.columns(table)
    return {column: list for name in LEARNERS if (column := f"{name}_runs") in there}


def single_runs(rows: Sequence[Record], name: str) -> Floats | None:
    """Evaluations of each run of a learner, shape (bodies, R); None for rows that have only means.

    Raises:
        ValueError: if bodies have unequal numbers of runs, or means that are not theirs.
    """
    if not all(f"{name}_runs" in row for row in rows):
        return None
    runs = [row[f"{name}_runs"] for row in rows]
    if len({len(each) for each in runs}) != 1:
        raise ValueError(
            f"{name}_runs: lists of {sorted({len(each) for each in runs})} runs are not allowed; give one length"
        )
    found = np.array(runs, float)
    if not np.allclose(found.mean(axis=1), column(rows, name)):
        raise ValueError(f"{name}_runs: the means of a row are not {name}; give the runs that it is the mean of")
    return found


def succeeded(rows: Sequence[Record], name: str, repetitions: int) -> str:
    """How many runs of a kind of learning succeeded in bodies, as tables say it."""
    return f"{int(column(rows, f'{name}_solved').sum())} of {repetitions * len(rows)}"


def check_learned(repetitions: int, budget: int, arrays: Arrays) -> None:
    """Refuse outcomes of a file that :func:`learn_until` cannot have found, by a ValueError."""
    for name in ("evaluations", "solved"):
        if (shape := arrays[name].shape) != (repetitions,):
            raise ValueError(f"{name}: shape {shape} is not allowed; give ({repetitions},)")
    within("evaluations", arrays["evaluations"], 1, budget)
    within("solved", arrays["solved"], 0, 1)
