"""Packages of users that a run needs: those that add its kind of robot, its objectives and its method."""

from collections.abc import Mapping
from typing import Any

from optim.problems.goals import Goal, goals_in
from optim.problems.objectives import OBJECTIVES
from optim.search import METHODS
from robots.robot import KINDS


def packages_of(problem: Mapping[str, Any], method: str | None = None) -> list[str]:
    """Names of the packages that add what a problem of this description needs, and a search method.

    A problem of a user's file needs none: run folders keep its checksum.
    """
    named = problem.get("objective", ()) if "robot" in problem else ()  # runs of version 1.0 name none
    goals = [Goal.of(text).name for text in goals_in([named] if isinstance(named, str) else named)]
    found = [KINDS.package_of(problem.get("kind")), *map(OBJECTIVES.package_of, goals), METHODS.package_of(method)]
    return sorted({package for package in found if package is not None})
