"""What commands make of ``--robot FILE``: problems of the user's own robot."""

import argparse
import dataclasses
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from optim.problem import GAIT, ROBOT
from optim.wording import counted

if TYPE_CHECKING:
    from optim.problems.lattice_robot import LatticeRobotProblem

# Options about gaits of the inflatable robot.
_GAITS = (
    "free",
    "encoding",
    "steps",
    "warm_up",
    "stages",
    "ladder",
    "ahead",
    "hard",
    "effort",
    "gait",
    "orientation",
    "pressure",
    "objective",
    "start",
    "start_orientation",
    "start_pressure",
    "geometry",
    "columns",
    "repeats",
    "weight",
    "calibration",
)
CYCLES = (1, 2, 4)  # horizons of ``gradient-check``


def is_robot(args: argparse.Namespace, known: Mapping[str, Any] | None) -> bool:
    """Whether the user's own robot is designed; ``known`` are the settings of a run that continues.

    Raises:
        ValueError: in one line, where a robot is given to a run of something else.
    """
    kind = known["problem"].get("kind", GAIT) if known else None
    if kind not in (None, ROBOT) and args.robot is not None:
        raise ValueError(f"robot: the run in {args.out} is one of a {kind}; leave --robot out")
    return args.robot is not None or kind == ROBOT


def robot_problem(args: argparse.Namespace, known: Mapping[str, Any] | None) -> "LatticeRobotProblem":
    """The problem of ``--robot``, or of the run that continues; ``known`` are its settings.

    Raises:
        ValueError: in one line, for what does not go with it, or contradicts the run.
    """
    from optim.problems.lattice_robot import LatticeRobotProblem
    from optim.runs.config import problem_of

    refuse_gait_options(args)
    terrains = list(args.terrain or ())
    if len(terrains) > 1:
        raise ValueError(f"terrain: {len(terrains)} are not allowed with --robot; give one")
    given = {
        name: getattr(args, name) for name in ("precision", "device", "threads") if getattr(args, name) is not None
    }
    if terrains:
        given["terrain"] = terrains[0]
    if known is None:
        return LatticeRobotProblem(_loaded(args), **given)
    problem = problem_of(args.out, known, LatticeRobotProblem.from_description)
    if args.robot is not None and LatticeRobotProblem(_loaded(args)).describe()["robot"] != known["problem"]["robot"]:
        raise ValueError(f"robot: {args.robot} is not the robot of the run in {args.out}; leave it out")
    return dataclasses.replace(problem, **given)


def horizons_of_robot(args: argparse.Namespace) -> dict[str, tuple["LatticeRobotProblem", np.ndarray]]:
    """The robot for more and more cycles, at the point where it starts, kept away from the bounds."""
    from optim.problems.lattice_robot import LatticeRobotProblem

    refuse_gait_options(args)
    robot, problems = _loaded(args), {}
    for cycles in _cycles(args.horizons):
        problem = LatticeRobotProblem(
            dataclasses.replace(robot, cycles=cycles),
            args.terrain,
            args.precision or "f64",
            args.device or "cpu",
            args.threads,
        )
        problems[counted(cycles, "cycle")] = problem, robot.start
    return problems


def refuse_gait_options(args: argparse.Namespace) -> None:
    """Raise a one-line ValueError for options that say nothing of a robot of the user's own."""
    for name in _GAITS:
        if getattr(args, name, None) is not None:
            raise ValueError(
                f"{name.replace('_', '-')}: it is of the inflatable robot's gaits; leave it out with --robot"
            )


def refuse_design_options(args: argparse.Namespace) -> None:
    """Raise a one-line ValueError for options that say what a problem's own file says."""
    for name in (*_GAITS, "robot", "terrain", "precision", "device"):
        if getattr(args, name, None) is not None:
            option = name.replace("_", "-")
            raise ValueError(
                f"{option}: it is of robots; leave it out with --problem, whose file says what is designed"
            )


def _loaded(args: argparse.Namespace) -> Any:
    from robots.lattice_robot import load_robot

    return load_robot(args.robot)


def _cycles(text: str | None) -> list[int]:
    if text is None:
        return list(CYCLES)
    try:
        wanted = sorted({int(part) for part in text.split(",")})
    except ValueError:
        wanted = [0]
    if wanted[0] < 1:
        raise ValueError(f"horizons: {text!r} is not allowed; give numbers of cycles such as 1,2,4")
    return wanted
