"""Records of articulated robots, and what those of earlier versions mean today."""

from collections.abc import Mapping
from dataclasses import asdict, fields
from math import inf
from typing import TYPE_CHECKING, Any

from robots.articulated.factors import record_of as record_of_factors
from robots.articulated.variants import SCALES
from robots.own_measures import records_of
from taichi_sim.base.plain_xml import parse_xml

if TYPE_CHECKING:
    from robots.articulated.robot import ArticulatedRobot

USUAL_RATE = 50.0  # of commands [Hz]
_LEFT_OUT_IF_NONE = ("speed", "fastest")  # numbers once, with which all drives held rates
FORMER_SLIP = 0.01  # m/(N s), of earlier versions, whose records do not tell it


def record_of(robot: "ArticulatedRobot") -> dict[str, Any]:
    """Describe a robot as JSON values."""
    found = {each.name: getattr(robot, each.name) for each in fields(robot) if each.init}
    light = None if robot.light is None else list(robot.light)
    friction = "inf" if robot.friction == inf else robot.friction
    reflexes = None if robot.reflexes is None else asdict(robot.reflexes)
    found |= {"light": light, "friction": friction, "angles": dict(robot.angles), "reflexes": reflexes}
    if robot.reflexes is None:  # a record is as before there were any
        del found["reflexes"]
    found["own_measures"] = records_of(robot.own_measures)
    if not robot.own_measures:  # as before there were any
        del found["own_measures"]
    for scale in SCALES:
        found[scale.field] = record_of_factors(getattr(robot, scale.field))
        if not found[scale.field]:  # as before there were any
            del found[scale.field]
    found["servos"] = {name: list(gains) for name, gains in robot.servos.items()}
    if not robot.servos:  # as before there were any
        del found["servos"]
    found = {name: value for name, value in found.items() if value is not None or name not in _LEFT_OUT_IF_NONE}
    if robot.seed == 0:  # as before there was any
        del found["seed"]
    if robot.slip == FORMER_SLIP:  # as a record of those versions is
        del found["slip"]
    return found


def updated(record: Mapping[str, Any]) -> Mapping[str, Any]:
    """A record with what today's fields mean, if it is of a version that had no time step among them.

    Raises:
        ValueError: for a URDF robot of such a version, which moved otherwise: it began elsewhere, without limits of
            velocity.
    """
    if "time_step" in record:
        return record
    if parse_xml(str(record.get("text"))).tag == "robot":
        raise ValueError(
            "robot: it is of a URDF file and of an earlier version, in which such robots moved otherwise; begin anew "
            "with the file"
        )
    usual = record.get("command_rate") == USUAL_RATE  # which was lowered to once a time step
    return {**record, "fixed": False, **({"command_rate": None} if usual else {})}
