"""Packages of users that a run needs because they add its kind of robot, its objectives or its method."""

from collections.abc import Mapping
from typing import Any

from optim.problems.goals import Goal, goals_in
from optim.problems.objectives import OBJECTIVES
from optim.search import METHODS
from robots.robot import KINDS


def packages_of(problem: Mapping[str, Any], method: str | None = None) -> list[str]:
    """Names of the users' packages that a problem with this description, and a search method, need.

    A problem from a user's file needs none, as run folders keep the checksum of the file.
    """
    named = problem.get("objective", ()) if "robot" in problem else ()  # runs of version 1.0 name none
    goals = [Goal.of(text).name for text in goals_in([named] if isinstance(named, str) else named)]
    found = [KINDS.package_of(problem.get("kind")), *map(OBJECTIVES.package_of, goals), METHODS.package_of(method)]
    return sorted({package for package in found if package is not None})
