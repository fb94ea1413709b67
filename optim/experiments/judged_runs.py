"""Runs of a study that are searched up to a budget and then judged: one row of a table each, resumable."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.equal_cost import Contest
from optim.experiments.jobs import run_parallel
from optim.experiments.results import Progress
from optim.experiments.tables import Record, read_records, select, write_records
from optim.problem import Minibatch, Problem, Request, Wants, evaluate_request
from optim.problems.robot import RobotProblem
from optim.runs.history import read_history
from robots.robot import part_of
from taichi_sim.base.arrays import Floats

WARM_UP, MOST_POINTS = 3, 100  # seed of the points that have the kernels compiled, and how many are tried

Run = tuple[str, str, int]  # problem, search, seed


@dataclass(frozen=True)
class JudgedRuns:
    """Runs in a folder, told by a table there.

    Attributes:
        folder: of the study.
        table: name of its file of rows.
        subject: what the first column is called, such as ``"task"``.
        seconds: of CPU time of each run.
        judge: searches and judges one run, and returns its row.
    """

    folder: Path
    table: str
    subject: str
    seconds: float
    judge: Callable[[Run], Record]

    def complete(self, runs: Sequence[Run], progress: Progress = None, jobs: int = 1) -> list[Record]:
        """Run what the table does not tell yet, so many at a time; the rows of all."""
        path = self.folder / self.table
        known: list[Record] = list(read_records(path)) if path.exists() else []
        missing = [run for run in runs if not self._holds(known, run)]
        parts = [("-".join(map(str, run)), partial(self.run_one, run)) for run in missing]
        run_parallel(parts, jobs, {}, progress and part_of(progress, 0, 10, 9))
        for number, (run, (_, part)) in enumerate(zip(missing, parts, strict=True)):
            part({}, None)
            known = [row for row in known if (row[self.subject], row["search"], row["seed"]) != run]
            known += read_records(self._kept(run))
            write_records(path, known)  # what there is so far is of use
            if progress:
                progress((number + 1) / len(parts))
        return known

    def run_one(self, run: Run, options: Mapping[str, Any], progress: Progress) -> None:
        """Search and judge, if that is not done."""
        kept = self._kept(run)
        if kept.exists() and self._holds(read_records(kept), run):
            return
        row = self.judge(run)
        kept.parent.mkdir(parents=True, exist_ok=True)
        subject, search, seed = run
        write_records(kept, [{self.subject: subject, "search": search, "seed": seed, "seconds": self.seconds, **row}])

    def _kept(self, run: Run) -> Path:
        return self.folder / "designs" / f"{'-'.join(map(str, run))}.csv"

    def _holds(self, rows: Sequence[Record], run: Run) -> bool:
        subject, search, seed = run
        about = {self.subject: subject, "search": search, "seed": seed}
        return bool(select(rows, **about, seconds=self.seconds))


def warm_up(problem: Problem, gradients: bool) -> None:
    """Have the kernels of this process ready before the clock of a search starts: a random point is judged.

    Points that are no robots compile nothing, so others are tried.
    """
    minibatch = Minibatch(1) if getattr(problem, "uncertain", "") else None  # a draw has the kernels of all
    sharpnesses = _sharpnesses(problem) if gradients else (np.inf,)
    for point in problem.space.sample(np.random.default_rng(WARM_UP), MOST_POINTS):
        for sharpness in sharpnesses:
            wants: Wants = "gradients" if gradients else "points"
            found = evaluate_request(problem, Request(point[None], wants, sharpness, minibatch))
        if not found.failed.any():
            return


def _sharpnesses(problem: Problem) -> tuple[float, ...]:
    """At which a problem has gradients: infinitely sharp ones are of true points; some relaxed ones compute more."""
    if isinstance(problem, RobotProblem):
        return (1.0, np.inf) if problem.robot.relaxable else (np.inf,)
    try:
        getattr(problem, "check_true_gradients", lambda: None)()
    except ValueError:  # gaits have relaxed ones alone
        return (0.0,)
    return (np.inf,)


def best_of_search(
    contest: Contest, name: str, seed: int, seconds: float, gradients: bool
) -> tuple[dict[str, Any] | None, int]:
    """Search; the best point when the CPU time was used up, None if nothing had succeeded, and its evaluations."""
    warm_up(contest.entries[name].problem(), gradients)
    contest.run_one(name, seed)
    last = contest.last_within(name, seed, seconds)
    if last is None:
        return None, 0
    generation = read_history(contest.folder(name, seed)).generations[last]
    return generation.best_point, int(contest.curve(name, seed)[last]["evaluations"])


def save_best(problem: RobotProblem, values: Mapping[str, Any], path: Path) -> Floats:
    """Save the design with these values as a file; its point."""
    point = problem.space.from_dict(values)
    path.parent.mkdir(parents=True, exist_ok=True)
    problem.save(point, path)
    return point
