"""Lattice robots as files: JSON, with the body as Voxelyze has it."""

import dataclasses
import json
from collections.abc import Mapping
from os import PathLike
from typing import Any

from robots.lattice_robot.drive import FIELDS, Drive, Free
from robots.lattice_robot.formats import ROBOT_FORMAT
from robots.lattice_robot.robot import LatticeRobot
from taichi_sim.base.files import read_record, write_record
from taichi_sim.lattice.files import VoxelFile, read_vxl_json, write_vxl_json

_SETTINGS = ("frequency", "cycles", "settling", "heading", "time_step_safety", "name")


def save_robot(robot: LatticeRobot, path: str | PathLike[str]) -> None:
    """Write a robot, with what is free of it."""
    write_record(path, ROBOT_FORMAT, robot_record(robot))


def load_saved_robot(path: str | PathLike[str]) -> LatticeRobot:
    """Read a robot written by :func:`save_robot`.

    Raises:
        ValueError: in one line, that names the file and what is wrong with it.
    """
    return read_record(path, ROBOT_FORMAT, robot_of_record)


def robot_record(robot: LatticeRobot) -> dict[str, Any]:
    """All of a robot, fit for JSON; :func:`robot_of_record` gives it back to the bit."""
    return {
        **{name: getattr(robot, name) for name in _SETTINGS},
        "drives": [_drive_record(drive) for drive in robot.drives],
        "moduli": [[number, dataclasses.asdict(free)] for number, free in robot.free_moduli.items()],
        "body": json.loads(write_vxl_json(VoxelFile.of_body(robot.body))),
    }


def robot_of_record(record: Mapping[str, Any]) -> LatticeRobot:
    """The robot of a record.

    Raises:
        ValueError, KeyError, TypeError: for a damaged one.
    """
    return LatticeRobot(
        read_vxl_json(json.dumps(record["body"])).body,
        tuple(_drive(drive) for drive in record["drives"]),
        {int(number): Free(**free) for number, free in record["moduli"]},
        **{name: record[name] for name in _SETTINGS},
    )


def _drive_record(drive: Drive) -> dict[str, Any]:
    values = {field: _plain(getattr(drive, field)) for field in FIELDS}
    told = {"name": drive.name, "regions": list(drive.regions), "quantity": drive.quantity, "axes": drive.axes}
    return told | {field: value for field, value in values.items() if value is not None}


def _drive(record: Mapping[str, Any]) -> Drive:
    given = {field: _value(record[field]) for field in FIELDS if field in record}
    return Drive(record["name"], tuple(record["regions"]), record["quantity"], axes=record["axes"], **given)


def _plain(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_plain(v) for v in value]
    return dataclasses.asdict(value) if isinstance(value, Free) else value


def _value(plain: Any) -> Any:
    if isinstance(plain, list):
        return tuple(_value(v) for v in plain)
    return Free(**plain) if isinstance(plain, dict) else plain
