"""Articulated robots as a kind of robot: made of an MJCF or URDF file, judged by how far they come."""

import math
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from robots.kind import OWN_MEASURES_OPTION
from robots.robot import Option, Robot, RobotKind, World
from robots.world import Terrain
from taichi_sim.base.names import joined
from taichi_sim.base.options import checked, flag, number, numbers

SEVERAL = ("angles", "servos", "body_sizes", "hinge_stiffness", "drive_torque")  # options that are given one by one
SUFFIXES = (".xml", ".mjcf", ".urdf")
REFLEXES = (
    "what it feels and changes its rhythm by: touch, angles, tilt, velocity, light, clock, acceleration, "
    "then how it answers, such as tilt,clock+hidden:8+gain:0.3 or touch+oscillators (default: nothing)"
)


def _friction(text: str) -> float:
    if text.strip().lower() in ("inf", "+inf", "infinity", "+infinity"):
        return math.inf
    return number(0.0)(text)


def _reflexes(text: str) -> Any:
    from robots.articulated.reflexes import DriveReflexes

    return DriveReflexes.parse(text)


def _factors(field: str, text: str) -> Any:
    from robots.articulated.variants import SCALES

    (scale,) = (each for each in SCALES if each.field == field)
    return scale.parse(text)


def _servo(text: str) -> dict[str, tuple[float, ...]]:
    """Parse the gains of servos, such as ``knee*=40,1`` or ``40`` of all."""
    name, given, gains = text.rpartition("=")
    try:
        values = tuple(float(part) for part in gains.split(","))
    except ValueError:
        values = ()
    if (given and not name) or len(values) not in (1, 2):
        told = "give NAME=STIFFNESS,DAMPING or NAME=STIFFNESS, as knee*=40,1, or these without a name for all"
        raise ValueError(f"servos: {text!r} is not allowed; {told}")
    return {name or "*": values}


def _angle(text: str) -> dict[str, float]:
    """Parse the angle of a hinge, such as ``knee=0.6``."""
    name, _, angle = text.rpartition("=")
    try:
        value = float(angle)
    except ValueError:
        value = math.nan
    if not name or not math.isfinite(value):
        raise ValueError(f"angles: {text!r} is not allowed; give JOINT=RADIANS, as knee=0.6")
    return {name: value}


class ArticulatedKind(RobotKind):
    """The kind of articulated robots, which are made from MJCF and URDF files."""

    name = "articulated"
    title = "articulated robot"
    suffixes = SUFFIXES
    trial_fields = ("duration", "heading", "friction", "slip", "time_step")
    options = (
        Option("controller", "what commands the drives (default: rhythm)", choices=("rhythm", "network")),
        Option("duration", "of a trial, in seconds (default: 5)", number(1e-3), "S"),
        Option("heading", "direction in which distance counts, degrees from x (default: 0)", number(), "DEG"),
        Option("slowest", "lowest frequency of a rhythm, in Hz (default: 0.5)", number(1e-3), "HZ"),
        Option("quickest", "highest frequency of a rhythm, in Hz (default: 2)", number(1e-3), "HZ"),
        Option("light", "place of a light that a network or reflexes see, in metres", numbers(3), "X,Y,Z"),
        Option(
            "friction",
            "coefficient of friction; inf, without a limit, has gradients (default: the file's, or 1)",
            checked(_friction),
            "N",
        ),
        Option(
            "slip",
            "speed of a point that holds for each newton of friction, m/(N s) (default: so little that robots of any "
            "weight hold)",
            number(1e-12),
            "N",
        ),
        Option(
            "speed",
            "of position drives that hold rates, 1/s (default: 10 of URDF; drives of MJCF are servos)",
            number(1e-6),
            "N",
        ),
        Option(
            "servos",
            "gains of drives of URDF that are servos, by a joint's name or a pattern, in N m/rad and N m s/rad: "
            "knee*=40,1, or knee*=40 with critical damping, or 40,1 for all; repeatable (default: ideal drives, which "
            "hold rates)",
            checked(_servo),
            "NAME=STIFFNESS,DAMPING",
            several=True,
        ),
        Option("reflexes", REFLEXES, checked(_reflexes), "SENSES"),
        flag("fixed", "fix the base of a URDF robot to the world, as a root link named world does"),
        Option(
            "fastest",
            "rate of drives without one, rad/s (default: 10 of URDF; drives of MJCF have their torques)",
            number(1e-6),
            "N",
        ),
        Option(
            "command_rate",
            "how often commands of a rhythm change, in Hz (default: 50, or once a time step)",
            number(1e-3),
            "HZ",
        ),
        Option("time_step", "of the simulation, in seconds (default: the file's, or 0.002)", number(1e-6), "S"),
        Option(
            "angles",
            "angle of a hinge at the start, in radians, by the name of its joint: knee=0.6; repeatable (default: the "
            "file's)",
            checked(_angle),
            "JOINT=RAD",
            several=True,
        ),
        Option(
            "body_sizes",
            "size of bodies, in that of the file, by a name or a pattern of names: thigh*=0.5:2 is free between these, "
            "torso=1.2 fixed, thigh* alone free from 0.5 to 2; repeatable (default: 1)",
            checked(partial(_factors, "body_sizes")),
            "NAME=LOW:HIGH",
            several=True,
        ),
        Option(
            "hinge_stiffness",
            "stiffness of servos and springs, in that of the file, by the body that a hinge carries or a pattern: "
            "shank*=0.5:2 is free between these, thigh=1.2 fixed; servos keep their damping ratio; repeatable "
            "(default: 1)",
            checked(partial(_factors, "hinge_stiffness")),
            "NAME=LOW:HIGH",
            several=True,
        ),
        Option(
            "drive_torque",
            "largest torque of drives, in that of the file, by the body that a hinge carries or a pattern: "
            "shank*=0.5:2 is free between these, thigh=1.2 fixed; of torque motors all of their torque; repeatable "
            "(default: 1)",
            checked(partial(_factors, "drive_torque")),
            "NAME=LOW:HIGH",
            several=True,
        ),
        OWN_MEASURES_OPTION,
    )

    def build(self, source: str | None, options: Mapping[str, Any]) -> Robot:
        """The robot of a file."""
        from robots.articulated.loading import load_robot

        if source is None:
            raise ValueError("robot: an articulated robot is made of a file; give it, such as ant.xml or arm.urdf")
        several = (name for name in SEVERAL if isinstance(options.get(name), list | tuple))
        given = {**options, **{name: joined(name, options[name]) for name in several}}
        robot = load_robot(source, **given)
        if robot.light is not None and not robot.sees:  # policies of environments may, with robots that Python loads
            place = ",".join(f"{each:g}" for each in robot.light)
            why = "is not allowed, as nothing sees it; give reflexes with the sense light, or controller network"
            raise ValueError(f"light: {place} {why}")
        return robot

    @property
    def world_options(self) -> tuple[Option, ...]:
        """A world by its name; terrains by the option that other kinds have, too."""
        told = (
            "a slope, uneven ground or water, such as hill:5, rough:0.01 or ramp:-5+water:0; the same as --world "
            "(default: level)"
        )
        return (*super().world_options, Option("terrain", told, checked(Terrain.parse), "TERRAIN"))

    def chosen_world(self, options: Mapping[str, Any]) -> World | None:
        """The world of either option.

        Raises:
            ValueError: for both of them.
        """
        terrain = options.get("terrain")
        if terrain is None:
            return super().chosen_world(options)
        if options.get("world") is not None:
            raise ValueError(f"terrain: {terrain.name} is not allowed beside --world; give one of them")
        return self.world(terrain)

    def world(self, text: Any) -> World:
        """Ground by its name."""
        from robots.articulated.worlds import FORMER, GROUND, on_ground

        if text == FORMER.name:
            return GROUND
        return on_ground(Terrain.parse(text) if isinstance(text, str) else text)

    def present_world(self, world: World) -> World:
        """The same ground, level ground by its present name."""
        from robots.articulated.worlds import FORMER, GROUND

        return GROUND if world == FORMER else world

    def world_of(self, record: Any) -> World:
        """Ground by its name, which stays as it is in results of earlier versions; runs may keep its file."""
        from robots.articulated.worlds import FORMER, on_ground

        return FORMER if record == FORMER.name else on_ground(Terrain.named(record))

    def recognises(self, path: Path, form: str | None) -> bool:
        """Files of MuJoCo and of ROS."""
        return path.suffix.lower() in SUFFIXES

    def from_description(self, description: Mapping[str, Any]) -> Robot:
        """The robot of a record."""
        from robots.articulated.loading import robot_of_record

        return robot_of_record(description)
