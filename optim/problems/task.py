"""Tasks as problems, for searches in Python."""

from typing import Unpack

from optim.problems.goals import named
from optim.problems.robot import RobotProblem
from robots.tasks import Task
from taichi_sim.base.compute import ComputeOptions


def problem_of_task(task: Task, **compute: Unpack[ComputeOptions]) -> RobotProblem:
    """The problem that ``codesign --task`` searches with a method for one objective: several goals add up.

    Args:
        task: see ``robots.tasks.find_task``.
        **compute: precision, device and threads, as of ``RobotProblem``.
    """
    given = task.options.get("objective", "mean")
    objective = named([given] if isinstance(given, str) else list(given))
    return RobotProblem(task.robot, task.worlds, objective=objective, summed=True, **compute)
