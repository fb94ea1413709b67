"""Load articulated robots: from MJCF and URDF files, and from the records of saved designs and runs."""

import math
import warnings
from collections.abc import Mapping
from dataclasses import fields
from os import PathLike
from pathlib import Path
from typing import Any

from robots.articulated.records import FORMER_SLIP, updated
from robots.articulated.reflexes import DriveReflexes
from robots.articulated.robot import READING, ArticulatedRobot
from taichi_sim.base import checks
from taichi_sim.base.files import read_text
from taichi_sim.rigid.model.assembly import check_start
from taichi_sim.rigid.model.files import read_model

OF_RHYTHMS = ("slowest", "quickest", "command_rate")  # settings of which a network has no use


def robot_of_record(record: Mapping[str, Any]) -> ArticulatedRobot:
    """The robot that ``ArticulatedRobot.describe`` described.

    Raises:
        ValueError: for values that are not allowed.
        TypeError: for a damaged record.
    """
    friction = math.inf if record.get("friction") == "inf" else record.get("friction")
    felt = record.get("reflexes")
    reflexes = None if felt is None else checks.built(DriveReflexes, felt)
    with warnings.catch_warnings():  # what of the file is ignored was told when it was first read
        warnings.simplefilter("ignore")
        given = {"slip": FORMER_SLIP, **updated(record), "friction": friction, "reflexes": reflexes}
        return checks.built(ArticulatedRobot, given)


def load_robot(path: str | PathLike[str], **settings: Any) -> ArticulatedRobot:
    """Load a robot from an MJCF or URDF file, and name it after the file.

    Args:
        path: path of the file.
        **settings: fields of :class:`ArticulatedRobot`.

    Raises:
        ValueError: for a file that cannot be read, is no such model, or starts deep in the ground, and for settings
            that would have no effect; it names the file.
    """
    text = read_text(path)
    try:
        _check_effect(settings)
        reading = {name: value for name, value in settings.items() if name in READING}
        check_start(read_model(text, **reading).tree)  # before anything is told of a robot that is refused
        return ArticulatedRobot(text, **{"name": Path(path).stem, **settings})
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _check_effect(settings: Mapping[str, Any]) -> None:
    """Refuse settings of rhythms beside a network, where they do nothing; records may have them."""
    usual = {each.name: each.default for each in fields(ArticulatedRobot) if each.name in OF_RHYTHMS}
    for name, kept in usual.items() if settings.get("controller") == "network" else ():
        if (value := settings.get(name, kept)) != kept:
            out = "leave it out" if kept is None else f"leave it at {kept:g}"
            raise ValueError(f"{name}: {value!r} is not allowed with a network, which has no rhythm; {out}")
