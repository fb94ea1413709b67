"""The problems that ship with the lab: of any kind of robot, and of kinds that search in ways of their own."""

from collections.abc import Mapping
from importlib import import_module
from typing import Any

from optim.problem import FILE, GAIT, ROBOT, VEHICLE, WALKER, Problem

# Where the problem of a run folder is built, by the kind that its description names; else it is of a kind of robot.
DESCRIBED = {
    GAIT: "optim.problems.inflatable.problem:GaitProblem.from_description",
    WALKER: "optim.problems.walker:WalkerProblem.from_description",
    VEHICLE: "optim.problems.braitenberg:VehicleProblem.from_description",
    ROBOT: "optim.problems.lattice_robot:LatticeRobotProblem.from_description",
    FILE: "optim.problems.user_file:RecordedProblem",
}


def problem_of_description(description: Mapping[str, Any]) -> Problem:
    """The problem that a run folder describes. No code of the folder is run.

    Raises:
        ValueError: if its kind is unknown, or the description is damaged.
    """
    kind = description.get("kind", GAIT)
    general = "optim.problems.robot:RobotProblem.from_description"
    place = general if "worlds" in description else DESCRIBED.get(kind, general)
    module, _, names = place.partition(":")
    build: Any = import_module(module)
    for name in names.split("."):
        build = getattr(build, name)
    problem: Problem = build(description)
    return problem
