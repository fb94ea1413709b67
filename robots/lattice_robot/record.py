"""Lattice robots as files: JSON, with the body as Voxelyze has it."""

import json
from collections.abc import Mapping
from os import PathLike
from typing import Any

from robots.lattice_robot.description import LATER, SETTINGS
from robots.lattice_robot.drive import FIELDS, Drive, Free
from robots.lattice_robot.formats import ROBOT_FORMAT
from robots.lattice_robot.reflexes import Reflexes
from robots.lattice_robot.robot import LatticeRobot
from taichi_sim.base.checks import built, known_names
from taichi_sim.base.files import read_record, write_record
from taichi_sim.lattice.files import read_vxl_json


def save_robot(robot: LatticeRobot, path: str | PathLike[str]) -> None:
    """Write a robot, with its free parameters, as JSON."""
    write_record(path, ROBOT_FORMAT, robot.describe())


def load_saved_robot(path: str | PathLike[str]) -> LatticeRobot:
    """Read a robot written by :func:`save_robot`.

    Raises:
        ValueError: one line that names the file and what is wrong with it.
    """

    return read_record(path, ROBOT_FORMAT, robot_of_record)


def robot_of_record(record: Mapping[str, Any]) -> LatticeRobot:
    """The robot that ``LatticeRobot.describe`` described.

    Raises:
        ValueError, KeyError, TypeError: for a damaged one.
    """
    known_names(record, "format", "body", "drives", "moduli", *SETTINGS, *LATER, "reflexes", "own_measures")
    file = read_vxl_json(json.dumps(record["body"]))
    if file.ignored:
        raise ValueError(f"body: {file.ignored[0]}: it is unknown; leave it out")
    return LatticeRobot(
        file.body,
        tuple(_drive(drive) for drive in record["drives"]),
        {int(number): built(Free, free) for number, free in record["moduli"]},
        **{name: record[name] for name in SETTINGS},
        **{name: record[name] for name in LATER if name in record},
        reflexes=_reflexes(record["reflexes"]) if "reflexes" in record else None,
        own_measures=tuple(record.get("own_measures", ())),
    )


def _reflexes(record: Mapping[str, Any]) -> Reflexes:
    given: dict[str, Any] = {name: tuple(v) if isinstance(v, list) else v for name, v in record.items()}
    return built(Reflexes, given)


def _drive(record: Mapping[str, Any]) -> Drive:
    known_names(record, "name", "regions", "quantity", "axes", *FIELDS, "proportions")
    given = {field: _value(record[field]) for field in (*FIELDS, "proportions") if field in record}
    return Drive(record["name"], tuple(record["regions"]), record["quantity"], axes=record["axes"], **given)


def _value(plain: Any) -> Any:
    if isinstance(plain, list):
        return tuple(_value(v) for v in plain)
    return built(Free, plain) if isinstance(plain, dict) else plain
