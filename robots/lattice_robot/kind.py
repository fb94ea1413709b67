"""Robots of the user's own as a kind of robot: made of a file, judged by their speed."""

import argparse
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from robots.kind import OWN_MEASURES_OPTION, choices
from robots.lattice_robot.formats import MESH_SUFFIXES, ROBOT_FORMAT, VOXEL_SUFFIXES
from robots.lattice_robot.ground import LatticeGroundKind
from robots.lattice_robot.links import LINKS_OPTION
from robots.robot import Option, Robot
from taichi_sim.base.checks import MOST_FRICTION
from taichi_sim.base.options import checked, file_path, file_text, number, whole

BY_CHANNELS = (
    "export --rig RIG --csv FILE writes a table of its channels for a rig; simulate that by --robot BEST.json "
    "--channels FILE, with --rig RIG as the rig plays it, without --table"
)


def _region(text: str) -> Any:
    from robots.lattice_robot.mesh_robot import MarkedRegion

    return MarkedRegion.from_text(text)


def _friction(text: str) -> float:
    """The type of the option of a mesh; two numbers are of the ground, as other kinds have them in one option."""
    if "," in text:
        told = "give one number, of the body of a mesh, or friction of the ground as --ground-friction STATIC,KINETIC"
        raise argparse.ArgumentTypeError(f"{text!r} is not allowed; {told}")
    return number(0.0, MOST_FRICTION)(text)


class LatticeRobotKind(LatticeGroundKind):
    """Lattice robots: Python that sets ``robot``, JSON of ``save_robot``, files of VoxCAD and voxcraft, and meshes.

    Some come with the lab, see ``robots.lattice_robot.presets``.
    """

    name = "lattice"
    title = "lattice robot"
    trial_fields = ("cycles", "heading", "reference_length", "target")
    options = (
        Option("pitch", "of a mesh, edge of the voxels, in the unit of its file", number(0.0), "P"),
        Option("scale", "of a mesh, metres per unit of its file (default: 0.001, millimetres)", number(0.0), "S"),
        Option(
            "region",
            "of a mesh, another one that marks a muscle or a material: legs=legs.stl, also "
            "legs=legs.stl,amplitude=0:0.3,phase=0.25 or feet=feet.stl,modulus=1e6,density=900,friction=1.2; "
            "LOW:HIGH is free",
            checked(_region),
            "NAME=FILE",
            several=True,
        ),
        Option("modulus", "of a mesh, Young's modulus of its body (default: 1e5)", number(0.0, unit="Pa"), "PA"),
        Option("density", "of a mesh, of its body (default: 1000)", number(0.0, unit="kg/m^3"), "RHO"),
        Option(
            "friction",
            "of a mesh, static, of its body; 0.8 of it is kinetic (default: 1)",
            _friction,
            "MU",
        ),
        Option("frequency", "of a mesh, of its muscles (default: 4)", number(0.1, 100, "Hz"), "HZ"),
        Option("cycles", "of a mesh, that count (default: 4)", whole(1), "N"),
        Option("settling", "of a mesh, before its muscles move, in seconds (default: 0.25)", number(0), "S"),
        LINKS_OPTION,
        Option(
            "channels",
            "a table of its channels, as export --csv writes it: its rows drive the robot instead",
            file_path,
            "FILE",
            commands=("simulate", "view"),
        ),
        Option(
            "rig",
            "with --channels: the rig that plays it, whose delays, regulators, limits of rate and lag act (default: "
            "ideal, which has none)",
            file_text,
            "RIG",
            commands=("simulate", "view"),
        ),
        Option("heading", "of a mesh, in which it shall travel, from x towards y (default: 0)", number(), "DEGREES"),
        OWN_MEASURES_OPTION,
    )

    fading_gradients = True
    designs = ("soft-quadruped", "feeling-quadruped", "light-seeker", "soft-swimmer")
    suffixes = (".py", *VOXEL_SUFFIXES, *MESH_SUFFIXES)
    explored = choices(slope=(-15, 15))
    instead = MappingProxyType(
        {
            "target": "give --terrain flat+light:X,Y, or set target of a LatticeRobot in Python; both add the measure "
            "remaining, so search with --objective minimise:remaining",
            "table": BY_CHANNELS,
        }
    )

    def build(self, source: str | None, options: Mapping[str, Any]) -> Robot:
        """The robot of a file, where one of Python may set a robot of any kind; or one that comes with the lab."""
        from robots.lattice_robot.sources import load_robot, robot_of_python

        if source is None:
            raise ValueError("robot: a lattice robot is made of a file; give it, such as my_robot.py")
        if source in self.designs:
            from robots.lattice_robot.presets import OFFERED

            return OFFERED[source]().changed(options)
        if source.lower().endswith(MESH_SUFFIXES):
            return _of_mesh(source, options)
        if source.lower().endswith(".py") and Path(source).is_file():
            return robot_of_python(Path(source), Robot).changed(options)
        return load_robot(source).changed(options)

    def recognises(self, path: Path, form: str | None) -> bool:
        """Files of Python, of voxels and of meshes, and saved robots."""
        return form == ROBOT_FORMAT or path.name.lower().endswith(self.suffixes)

    def from_description(self, description: Mapping[str, Any]) -> Robot:
        """The robot of a record."""
        from robots.lattice_robot.record import robot_of_record

        return robot_of_record(description)


def _of_mesh(source: str, options: Mapping[str, Any]) -> Robot:
    """The robot of a mesh and options."""
    from robots.lattice_robot.mesh_robot import robot_of_mesh

    given = dict(options)
    if "pitch" not in given:
        raise ValueError(f"pitch: {source} is a mesh; give the edge of its voxels, in the unit of the file")
    played: dict[str, Any] = {
        name: given.pop(name) for name in ("channels", "rig", "links", "own_measures") if name in given
    }
    return robot_of_mesh(source, given.pop("pitch"), given.pop("region", ()), **given).changed(played)
