"""Exports of an articulated robot: its file with bodies and hinges of a design, and the commands of its drives."""

import csv
import io
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from robots.articulated.simulation import rhythm
from taichi_sim.base.arrays import Floats
from taichi_sim.base.files import write_text
from taichi_sim.base.plain_xml import parse_xml
from taichi_sim.rigid import Motor, Tree
from taichi_sim.rigid.model.files import Reading, read_model
from taichi_sim.rigid.model.mjcf_writing import TAKEN, WITHOUT_CONE, drive_commands, mjcf_text
from taichi_sim.rigid.model.resizing import height_of, resized_text, starts_of

if TYPE_CHECKING:
    from robots.articulated.robot import ArticulatedRobot

SUFFIXES = {"mujoco": (".xml", ".mjcf"), "robot": (".urdf", ".xml", ".mjcf")}
REWRITTEN = ".mjcf"  # of URDF robots: a file with all that URDF does not tell


def save_model(robot: "ArticulatedRobot", point: ArrayLike, path: Path) -> list[str]:
    """Write the file of a robot with bodies and hinges of a design; return what it does not tell of it.

    A URDF robot's is URDF, or MJCF that says all, by the path's suffix.

    Raises:
        ValueError: for another kind of file than the robot's, or bodies that such a file cannot hold.
    """
    root = parse_xml(robot.text).tag
    if path.suffix.lower() not in SUFFIXES[root]:
        raise ValueError(f"model: {path} is not allowed; give a file that ends in {' or '.join(SUFFIXES[root])}")
    _, (factors,) = robot.split(robot.points(point))
    tree = robot.variants.tree_of(factors)
    if root == "robot" and path.suffix.lower() == REWRITTEN:
        write_text(path, mjcf_text(tree, robot.physics, robot.drives, robot.name))
        return list(_approximated(tree, robot))
    write_text(path, resized_text(robot.text, *robot.variants.of_parts(factors), **robot.reading))
    untold = list(_not_in_the_file(robot))
    if root == "robot":
        base = tree.ordered[0][0].name
        untold.append(f"the origin of {base} starts {height_of(tree):.4g} m above the ground, which URDF does not tell")
        untold.append("MuJoCo finds no free base, ground or drives in URDF; a file that ends in .mjcf has them")
    return untold


def _approximated(tree: Tree, robot: "ArticulatedRobot") -> Iterator[str]:
    """What MJCF does not say of a robot as it is here."""
    holding = [hinge.motor for hinge in tree.hinges if isinstance(hinge.motor, Motor)]
    if holding:
        yield "drives hold rates here; those of the file are servos, which bend under a load"
    if any(motor.fastest for motor in holding if motor.by_angle):
        yield "drives by angle have a largest rate here, which those of the file have not"
    if any(body.immersed for body in tree.bodies):
        yield "solids on which water alone acts are left out"
    if any(body.name == TAKEN for body in tree.bodies):
        yield f"the body {TAKEN} is called otherwise, as MuJoCo calls what is fixed so"
    if not np.isfinite(robot.physics.friction):
        yield f"friction has a cone there, of coefficient {WITHOUT_CONE:g}, and none here"
    if robot.slip is not None:
        yield "points on the ground slip by a law of MuJoCo's own, whatever slip was given here"


def _not_in_the_file(robot: "ArticulatedRobot") -> Iterator[str]:
    """What other simulators do not learn from the file of a robot: how it starts, and settings that were given here."""
    if starts := starts_of(robot.text, **robot.reading):
        angles = ", ".join(f"{name}={angle:.6g}" for name, angle in starts.items())
        yield f"hinges start at {angles} rad, which the file does not tell"
    as_it_is: Reading = {**robot.reading, "fixed": False, "time_step": None}
    plain = read_model(robot.text, **as_it_is)
    if robot.tree.fixed and not plain.tree.fixed:
        yield "the base is fixed to the world, which the file does not tell"
    if robot.servos:
        yield "drives are servos with gains, which URDF does not tell"
    if robot.physics.friction != plain.world.friction:
        yield f"the coefficient of friction is {robot.physics.friction:g}, which the file does not tell"
    if robot.physics.time_step != plain.world.time_step:
        yield f"time steps are {robot.physics.time_step:g} s, which the file does not tell"


def command_table(robot: "ArticulatedRobot", point: ArrayLike) -> tuple[list[str], Floats]:
    """What the drives of a design are told in a trial: names of columns, and a row for each command, (K, 1 + M).

    The first column is the time from which a row holds [s]; the others are angles as the file counts them [rad], or
    rates of drives that have no target angle [rad/s], or torques of those that have neither [N m].

    Raises:
        ValueError: for robots whose commands depend on what they feel.
    """
    if robot.controller != "rhythm" or robot.feels:
        what = "reflexes" if robot.controller == "rhythm" else "a network"
        raise ValueError(f"commands: a robot with {what} decides them as it moves; give a robot with a rhythm alone")
    points = robot.points(point)
    commands = rhythm(robot, points)[0]
    names, columns = ["time [s]"], [np.arange(len(commands)) * robot.hold * robot.physics.time_step]
    for number, name in enumerate(robot.drives):
        (hinge,) = (each for each in robot.tree.hinges if each.motor is not None and each.command == number)
        told, unit = drive_commands(hinge, commands[:, number])
        names.append(f"{name} [{unit}]")
        columns.append(told)
    return names, np.column_stack(columns)


def save_commands(robot: "ArticulatedRobot", point: ArrayLike, path: Path) -> None:
    """Write the table of :func:`command_table` as CSV."""
    names, rows = command_table(robot, point)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(names)
    writer.writerows([f"{value:.10g}" for value in row] for row in rows.tolist())
    write_text(path, text.getvalue())
