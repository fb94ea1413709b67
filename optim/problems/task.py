"""Convert tasks to problems, for searches in Python."""

from pathlib import Path
from typing import Any, Unpack

from optim.problem import Problem
from optim.problems.designer import COMPUTE, Designer, DesignRequest, designer_of
from optim.problems.robot import RobotProblem
from optim.problems.robot_designing import RobotDesigning
from optim.search import METHOD
from robots.robot import find_robot_doing
from robots.tasks import Task, check_success
from taichi_sim.base.checks import nearest
from taichi_sim.base.compute import ComputeOptions

# Options of ``codesign`` that say how and where it searches; a task may name them, and the problem is the same.
HOW = (
    *("method", "climbers", "population", "seed", "seeds", "generations", "set"),
    *("rule", "learning_rate", "gradient", "samples", "smoothing"),
    *("workers", "ray", "workers_dir", "silent_after", "slurm", "slurm_option"),
)


def problem_of_task(task: Task, **compute: Unpack[ComputeOptions]) -> RobotDesigning:
    """Make the problem of a task, as ``codesign --task`` searches it by a method for one objective: goals add up.

    Args:
        task: see ``robots.tasks.find_task``.
        **compute: precision, device and threads, which count more than those of the task.

    Raises:
        ValueError: for a key that ``codesign`` does not know of the robot, and values that are not allowed.
    """
    kind, source = find_robot_doing(task.source)
    designer = designer_of(kind)
    given = {**_given(task, designer), **compute}
    asked = DesignRequest(source, given, task.options.get("method", METHOD), False, None, Path())
    problem = designer.design(asked).problem
    assert isinstance(problem, RobotDesigning)
    check_task(task, problem)
    return problem


def check_task(task: Task, problem: Problem) -> None:
    """Refuse a task whose success depends on a measure that the robot, which may not be the task's, lacks.

    Raises:
        ValueError: that names the measures there are.
    """
    if isinstance(problem, RobotProblem):
        check_success(task.success, problem.offered, problem.tried_in)


def _given(task: Task, designer: Designer) -> dict[str, Any]:
    """Values of the options of a problem that a task gives, by name, as the command line would make them."""
    known = ["robot", *(option.name for option in designer.options), *COMPUTE, *HOW]
    for key in task.options:
        if key not in known:
            raise ValueError(
                f"task: {task.name} has the key {key!r}, which no {designer.kind.title} knows{nearest(key, known)}"
            )
    values = {name: task.options[name] for name in COMPUTE if name in task.options}
    values |= task.values_of(designer.options)
    return {name: value for name, value in values.items() if value is not False}  # which is a flag that is not given
