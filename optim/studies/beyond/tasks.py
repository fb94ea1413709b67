"""Tasks of the lab, each searched by a gradient method and by an evolutionary one, at equal CPU time.

All searches begin at random, with settings that are the same for every task. The best design of a run moves again in
double precision: whether it succeeds, and its objective, are those of that trial.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from optim.experiments.data import Data, Kind
from optim.experiments.equal_cost import Arm, Contest, Entry, of_kind
from optim.experiments.judged_runs import JudgedRuns, Run, best_of_search, save_best
from optim.experiments.results import Progress, check_folder, write_json
from optim.experiments.study import Count, Settings, Study, some_of
from optim.experiments.tables import MISSING, Record, cell, column, distinct, markdown, page, select
from optim.measures.statistics import known_mean
from optim.problems.robot import RobotProblem
from optim.problems.task import problem_of_task
from robots.tasks import builtin_tasks, find_task
from taichi_sim.base.checks import positive
from taichi_sim.base.compute import Compute
from taichi_sim.base.files import write_text

NAME = "tasks"
TABLE = "runs.csv"
FILES = ("table.md", TABLE, "summary.json", "runs", "designs")
EXACT = Compute(precision="f64", threads=1)
ARMS = {
    "race": Arm("gradient race", "race", {"climbers": 8, "halving": 4, "moves": 60}),
    "horizon": Arm(
        "short gradients",
        "stochastic",
        {"candidates": 8, "moves": 60, "judging": 10, "learning_rate": 0.03},
        horizon=0.03,  # an eighth of a cycle
    ),
    "nes": Arm("NES", "nes", {"population": 16, "random_mean": True, "sigma": 0.1}),
}
FEELING = ("rough", "stairs", "gap", "shoreline", "sand")  # tasks of a robot that feels; that with a light has a study
COLUMNS: dict[str, Kind] = {
    "task": tuple(builtin_tasks()),
    "search": tuple(ARMS),
    "seed": int,
    "evaluations": int,
    "objective": float | None,
    "succeeded": int,
}


@dataclass(frozen=True)
class Solving(Settings):
    """How tasks are searched.

    Attributes:
        seconds: of CPU time of a run.
        seeds: runs of every search.
        tasks: by name.
    """

    seconds: Annotated[float, positive] = 60.0
    seeds: Count = 3
    tasks: Annotated[tuple[str, ...], partial(some_of, names=builtin_tasks())] = tuple(builtin_tasks())

    @property
    def runs(self) -> list[Run]:
        """Task, search and seed of every run, seed by seed."""
        return [
            (task, name, seed)
            for seed in range(self.seeds)
            for task in self.tasks
            for name, arm in ARMS.items()
            if arm.horizon is None or task in FEELING
        ]

    def contest(self, task: str, folder: Path) -> Contest:
        """The searches of a task."""
        entries = {
            name: Entry(partial(designed, task, arm.horizon), arm.method, arm.settings) for name, arm in ARMS.items()
        }
        return Contest(entries, "cpu", self.seconds, folder / "runs" / task, lambda line: None)


def designed(name: str, horizon: float | None = None, precision: str = "f32") -> RobotProblem:
    """The problem of a task, for one thread, with a horizon of its gradients [s]."""
    problem = problem_of_task(find_task(name), precision=precision, threads=1)
    assert isinstance(problem, RobotProblem)
    return replace(problem, gradient_horizon=horizon)


def study(folder: Path, settings: Solving, progress: Progress = None, jobs: int = 1) -> None:
    """Write what runs have found, and a table; runs that are whole in the folder are not run again."""
    check_folder(folder, FILES, NAME)
    runs = JudgedRuns(folder, TABLE, "task", settings.seconds, partial(_judged, folder, settings))
    _report(folder, settings.seconds, runs.complete(settings.runs, progress, jobs))


def rewrite(data: Data, folder: Path) -> None:
    """Write the table and ``summary.json`` from the table of runs."""
    seconds = data.from_summary(lambda summary: positive("seconds", summary["seconds"]))
    _report(folder, seconds, data.records(TABLE, COLUMNS))


def _judged(folder: Path, settings: Solving, run: Run) -> Record:
    """What a search finds, in double precision; its design is saved."""
    name, arm, seed = run
    contest = settings.contest(name, folder)
    best, evaluations = best_of_search(contest, arm, seed, settings.seconds, ARMS[arm].gradients)
    if best is None:
        return {"evaluations": evaluations, "objective": None, "succeeded": 0}
    made = designed(name, precision=EXACT.precision)
    point = save_best(made, best, folder / "designs" / f"{name}-{arm}-{seed}.json")
    objective = float(made.evaluate(point[None]).objectives[0, 0])
    succeeded = bool(find_task(name).succeeded(made.robot_of(point), made.tried_in, EXACT))
    return {"evaluations": evaluations, "objective": objective, "succeeded": int(succeeded)}


def _report(folder: Path, seconds: float, rows: Sequence[Record]) -> None:
    """Write ``summary.json`` and ``table.md``, which follow from the table of runs."""
    found = {task: _summary(select(rows, task=task)) for task in distinct(rows, "task")}
    write_json(folder / "summary.json", {"seconds": seconds, "tasks": found})
    write_text(folder / "table.md", page(_table(found)))


def _summary(rows: Sequence[Record]) -> dict[str, Any]:
    """What each search of a task has found."""
    task = find_task(rows[0]["task"])
    problem = problem_of_task(task)
    searches = {}
    for arm in distinct(rows, "search"):
        own = [row for row in select(rows, search=arm) if row["objective"] is not None]
        searches[arm] = {
            "label": ARMS[arm].label,
            "seeds": len(select(rows, search=arm)),
            **known_mean(column(own, "objective")),
            "succeeded": int(column(select(rows, search=arm), "succeeded").sum()),
            "evaluations": float(np.median(column(select(rows, search=arm), "evaluations"))),
        }
    (objective,) = problem.objective_names
    about = {"title": task.title, "robot": task.source, "variables": len(problem.space.names)}
    asked = " and ".join(one.text for one in task.success)
    return {**about, "objective": objective, "unit": problem.objective_units[0], "asked": asked, "searches": searches}


def _table(found: Mapping[str, Any]) -> list[str]:
    """Tasks with what each search made of them: the mean, its interval, and how many runs succeed."""
    arms = [*of_kind(ARMS, ARMS, True), *of_kind(ARMS, ARMS, False)]
    lines = []
    for name, each in found.items():
        told = []
        for arm in arms:
            one = each["searches"].get(arm)
            if one is None:
                told.append(MISSING)
                continue
            interval = f" ({cell(one['low'], '.3g')} to {cell(one['high'], '.3g')})" if one["low"] is not None else ""
            told.append(f"{cell(one['mean'], '.3g')}{interval}; {one['succeeded']} of {one['seeds']}")
        objective = f"{each['objective']} [{each['unit']}]"
        lines.append((f"`{name}`", each["robot"], str(each["variables"]), objective, each["asked"], *told))
    heads = [ARMS[arm].label for arm in arms]
    return markdown(("task", "robot", "variables", "objective", "success", *heads), "llrll" + "r" * len(arms), lines)


STUDY = Study(
    title="tasks of the lab, each searched along gradients and by evolution",
    source="beyond chapter 5",
    scales={
        "small": Solving(seconds=10.0, seeds=1, tasks=("walk", "jump")),
        "medium": Solving(),
        "full": Solving(seconds=300.0, seeds=5),
    },
    run=study,
    rewrite=rewrite,
    writes=FILES,
    cost="ten hours of one core; medium takes an hour",
)
