"""The study of tasks: searched at equal cost, judged in double precision; its table is enough to go on."""

import dataclasses
import shutil

import pytest

from optim.experiments.tables import read_records
from optim.problems.task import problem_of_task
from optim.studies.beyond import tasks
from optim.studies.beyond.tasks import STUDY, Solving
from robots.tasks import find_task

QUICK = Solving(seconds=0.5, seeds=1, tasks=("jump",))


def test_a_task_is_a_problem():
    problem = problem_of_task(find_task("light"))
    assert problem.objective == ("worst", "minimise:remaining") and len(problem.tried_in) == 2
    assert problem.objective_names == ("minus worst remaining",) and problem.summed
    assert problem_of_task(find_task("walk")).objective == ("mean", "speed")


@pytest.mark.kernels
def test_runs_are_judged_and_the_table_is_enough_to_go_on(tmp_path, monkeypatch):
    # Taichi would start again for every run, and again for its judgement: that takes seconds.
    assert tasks.EXACT.precision == "f64"
    monkeypatch.setattr(tasks, "EXACT", dataclasses.replace(tasks.EXACT, precision="f32"))
    for name, few in (("race", {"climbers": 1, "moves": 2}), ("nes", {"population": 4})):
        monkeypatch.setitem(tasks.ARMS, name, dataclasses.replace(tasks.ARMS[name], settings=few))
    told = []
    tasks.study(tmp_path / "a", QUICK, told.append)
    assert told[-1] == 1.0
    rows = read_records(tmp_path / "a" / "runs.csv")
    assert [(row["task"], row["search"], row["seed"]) for row in rows] == QUICK.runs
    assert all((tmp_path / "a" / name).exists() for name in STUDY.writes)
    page = (tmp_path / "a" / "table.md").read_text()
    assert "`jump` | soft-quadruped | 40 | jump [m] | jump >= 0.005 |" in page

    (tmp_path / "b").mkdir()
    for name in ("tasks.json", "runs.csv"):
        shutil.copy(tmp_path / "a" / name, tmp_path / "b")
    tasks.study(tmp_path / "b", QUICK)
    assert not (tmp_path / "b" / "runs").exists()
    assert (tmp_path / "b" / "table.md").read_bytes() == (tmp_path / "a" / "table.md").read_bytes()
