"""Tasks as problems in Python: what ``codesign --task`` searches, and nothing of a file is lost."""

from types import SimpleNamespace

import numpy as np
import pytest

from optim.cli import build_parser
from optim.commands.task_file import OWN as OF_COMMANDS
from optim.problem import Evaluation
from optim.problems.designer import COMPUTE, designer_of
from optim.problems.goals import named
from optim.problems.robot import RobotProblem
from optim.problems.task import HOW, problem_of_task
from optim.runs.config import read_config
from robots.robot import KINDS
from robots.tasks import builtin_tasks, find_task

UNCERTAIN = """
robot = "soft-quadruped"
terrain = ["flat", "hill:5"]
ground-friction = "0.3,0.2"
objective = ["worst", "speed"]
uncertain = ["slope=1"]
risk = "worst"
draws = 4
precision = "f32"
method = "random"
[set]
climbers = 3
"""


@pytest.fixture
def problem(tmp_path):
    """Makes the problem of the text of a file."""

    def made(text, **compute):
        (tmp_path / "task.toml").write_text(text)
        return problem_of_task(find_task(tmp_path / "task.toml"), **compute)

    return made


@pytest.mark.parametrize("name", builtin_tasks())
def test_tasks_of_the_lab_are_judged_by_their_objectives_added_up(name):
    task = find_task(name)
    plain = RobotProblem(task.robot, task.worlds, objective=named(task.options["objective"]), summed=True)
    assert problem_of_task(task).describe() == plain.describe()


def test_all_that_a_file_says_counts(problem):
    found = problem(UNCERTAIN)
    assert (found.uncertain, found.risk, found.draws, found.precision) == ("slope=1.0", "worst", 4, "f32")
    assert [(each.name, each.static_friction, each.kinetic_friction) for each in found.tried_in] == [
        ("flat", 0.3, 0.2),
        ("hill:5", 0.3, 0.2),
    ]
    assert problem(UNCERTAIN, precision="f64", threads=1).compute.precision == "f64"
    assert problem(UNCERTAIN.replace('"0.3,0.2"', "[0.3, 0.2]")).describe() == found.describe()


def test_it_is_the_problem_of_the_command(problem, morpholab, tmp_path, monkeypatch):
    """Whatever its robots do."""
    monkeypatch.setattr(RobotProblem, "evaluate", lambda _, points: Evaluation(np.zeros(len(points))))
    judged = SimpleNamespace(document={})
    monkeypatch.setattr("optim.problems.uncertain.judge_uncertain", lambda *_, **__: judged)
    found = problem(UNCERTAIN.replace("draws = 4", "draws = 2").replace("climbers = 3", "climbers = 1"))
    assert morpholab("codesign --task task.toml --generations 0 --threads 1 --quiet --out a")[0] == 0
    assert read_config(tmp_path / "a")["problem"] == found.describe()


def test_kinds_that_are_designed_in_a_way_of_their_own_are_so_in_python(problem):
    gaits = problem('terrain = ["flat"]\nencoding = "graded"\ncolumns = 2\nladder = false\ngeometry = "small"\n')
    assert gaits.describe()["encoding"] == "graded" and gaits.robot_kind == "inflatable" and gaits.precision == "f32"
    assert problem('robot = "vehicle"\nobjective = "environments"\n').objective_names[0] != "total"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            'terrian = ["hill:5"]',
            "task: task has the key 'terrian', which no lattice robot knows; did you mean terrain?",
        ),
        ("columns = 3", "task: task has the key 'columns', which no lattice robot knows"),
        ("problem = 'hill.py'", "task: task has the key 'problem', which no lattice robot knows"),
        ('precision = "f16"', "precision: 'f16' is unknown; choose one of f32, f64"),
        ('terrain = ["lava"]', "terrain: 'lava' is unknown"),
        ('ground_friction = "0.3"', "ground_friction: '0.3' is not allowed; give 2 numbers"),
        ('uncertain = ["slope=1"]\ndraws = 1', "draws: 1 is not allowed; give a whole number, at least 2"),
        ('success = ["speedy >= 1"]', "success: 'speedy' is unknown; choose one of speed, "),
    ],
)
def test_what_is_wrong_is_told_in_one_line(problem, text, message):
    with pytest.raises(ValueError, match="^" + message) as refused:
        problem(f'robot = "soft-quadruped"\n{text}\n')
    assert "\n" not in str(refused.value)


def test_every_option_of_the_command_is_of_the_problem_or_of_the_search():
    (commands,) = (each.choices for each in build_parser()._actions if isinstance(each.choices, dict))
    parser = commands["codesign"]
    parser._add_kinds(())
    every = {action.dest for action in parser._actions}
    of_kinds = {option.name for kind in KINDS.builtin for option in designer_of(KINDS[kind]).options}
    assert every - of_kinds - {*OF_COMMANDS, *COMPUTE, "robot", "problem"} == {*HOW} - of_kinds
    assert {*HOW} <= every
