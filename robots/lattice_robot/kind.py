"""Robots of the user's own as a kind of robot: made of a file, judged by their speed."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from robots.lattice_robot.formats import ROBOT_FORMAT, VOXEL_SUFFIXES
from robots.robot import Option, Robot
from robots.world import TerrainKind


class LatticeRobotKind(TerrainKind):
    """Lattice robots: Python that sets ``robot``, JSON of ``save_robot``, or files of VoxCAD and voxcraft."""

    name = "lattice"
    title = "lattice robot"
    options: tuple[Option, ...] = ()

    def build(self, source: str | None, options: Mapping[str, Any]) -> Robot:
        """The robot of a file."""
        from robots.lattice_robot.sources import load_robot

        if source is None:
            raise ValueError("robot: a lattice robot is made of a file; give it, such as my_robot.py")
        return load_robot(source)

    def recognises(self, path: Path, form: str | None) -> bool:
        """Files of Python and of voxels, and saved robots."""
        return form == ROBOT_FORMAT or path.name.lower().endswith((".py", *VOXEL_SUFFIXES))

    def from_description(self, description: Mapping[str, Any]) -> Robot:
        """The robot of a record."""
        from robots.lattice_robot.record import robot_of_record

        return robot_of_record(description)
