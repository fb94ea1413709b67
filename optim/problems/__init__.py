"""Problems that come with the lab, and readers of the problems and the designed robots of run folders."""

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from optim.problem import FILE, GAIT, ROBOT, VEHICLE, WALKER, Problem, design_in
from taichi_sim.base.arrays import Floats
from taichi_sim.base.compute import Precision
from taichi_sim.base.results_folder import BEST_DESIGN
from taichi_sim.base.short_text import counted

if TYPE_CHECKING:
    from pathlib import Path

    from optim.runs.history import History
    from robots.robot import Robot, RobotKind, World

# Where the problem of a run folder is built, by the kind that its description names; else it is of a kind of robot.
DESCRIBED = {
    GAIT: "optim.problems.inflatable.problem:GaitProblem.from_description",
    WALKER: "optim.problems.walker:WalkerProblem.from_description",
    VEHICLE: "optim.problems.braitenberg:VehicleProblem.from_description",
    ROBOT: "optim.problems.lattice_robot:LatticeRobotProblem.from_description",
    FILE: "optim.problems.user_file:RecordedProblem",
}

KINDS_OF_1_0 = {GAIT: "inflatable", ROBOT: "lattice"}  # of robots, where descriptions name them otherwise


def problem_of_description(description: Mapping[str, Any]) -> Problem:
    """Build the problem that a run folder describes, without running any code of the folder.

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


def problem_of_run(folder: "Path", config: Mapping[str, Any]) -> Problem:
    """Build the problem of a run folder from its settings, with the ground files that the folder keeps.

    Raises:
        ValueError: as :func:`problem_of_description`; names the folder.
    """
    from optim.problems.robot_designing import RobotDesigning
    from optim.runs.config import GROUND_FILES

    try:
        problem = problem_of_description(config["problem"])
    except ValueError as error:
        raise ValueError(f"{folder}: {error}") from None
    return problem.kept_in(folder) if isinstance(problem, RobotDesigning) and config.get(GROUND_FILES) else problem


def kind_of_description(description: Mapping[str, Any]) -> "RobotKind | None":
    """Return the kind of robot that the problem of a run folder designs; None for problems without robots."""
    from robots.robot import KINDS

    name = str(description.get("kind", GAIT))
    if name == FILE and (design := design_in(description)) is not None:
        return kind_of_description(design)
    return KINDS.get(KINDS_OF_1_0.get(name, name))


def kind_of_run(folder: "Path", config: Mapping[str, Any]) -> "RobotKind":
    """Return the kind of robot that the run in a folder designs.

    Raises:
        ValueError: if it designs no robot.
    """
    kind = kind_of_description(config["problem"])
    if kind is None:
        what, best = config["problem"].get("file", f"a {config['problem'].get('kind')}"), folder / BEST_DESIGN
        raise ValueError(
            f"source: {folder} is a run of {what}, which is no robot; `morpholab report {folder}` shows it, and {best} "
            "has its best point"
        )
    return kind


def robot_of_run(
    history: "History", member: int | None = None, elsewhere: bool = False
) -> "tuple[Robot, tuple[World, ...]]":
    """Load a robot that a run has designed, and the worlds in which the run evaluated it.

    Args:
        history: of the run.
        member: which of the designs that the search keeps, counted from 1; None for the best, as the checked log tells.
        elsewhere: whether it will be tried in other worlds, so that files of the run's ground may have changed.

    Raises:
        ValueError: if there is none, the run designs no robots, or a file of its ground is not as it was.
    """
    from optim.runs.config import check_ground_files

    problem = _problem_of_robots(history.path, history.config)
    if not elsewhere:
        check_ground_files(history.config, problem.ground_files, history.path)
    return problem.robot_of(kept_point(history, problem, member)), problem.tried_in


def offered_by_run(history: "History") -> "tuple[Robot, Floats, tuple[World, ...]]":
    """Return the robot of a run with its free parameters, the best point of these, shape (P,), and the run's worlds.

    Raises:
        ValueError: if there is no best point yet, or the run searches no parameters of one robot.
    """
    problem = _problem_of_robots(history.path, history.config)
    if problem.offered is None:
        raise ValueError(f"robot: the run in {history.path} searches no parameters of one robot; give the robot itself")
    return problem.offered, kept_point(history, problem, None), tuple(problem.tried_in)


def precision_of_run(path: Path, config: Mapping[str, Any]) -> Precision:
    """Return the precision in which a run has simulated its robots, ``"f32"`` or ``"f64"``.

    In another one, a robot whose motion is chaotic may end elsewhere than the run has scored it.

    Raises:
        ValueError: if the run designs no robots.
    """
    found: Precision = _problem_of_robots(path, config).precision
    return found


def _problem_of_robots(path: Path, config: Mapping[str, Any]) -> Any:
    """The problem of a run that designs robots."""
    kind_of_run(path, config)
    problem: Any = problem_of_run(path, config)
    return problem.designed if config["problem"].get("kind") == FILE else problem


def kept_point(history: "History", problem: Problem, member: int | None) -> Floats:
    """Return the best point of a run, or the point of one of the members that it kept, shape (D,)."""
    from optim.runs.history import read_result

    if member is None:
        best = history.generations[-1].best_point if history.generations else None
        if best is None:
            raise ValueError(f"source: {history.path} has no best design yet")
        return problem.space.from_dict(best)
    result = read_result(history, problem)
    count = 0 if result is None else len(result.points)
    if result is None or member > count:
        raise ValueError(f"member: {member} is not allowed; {history.path} keeps {counted(count, 'design')}")
    if np.isnan(result.points[member - 1]).any() or np.isnan(result.scores[member - 1]):
        raise ValueError(f"member: {member} of {history.path} has failed; choose another")
    return result.points[member - 1]
