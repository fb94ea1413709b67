"""What files and run folders say of a lattice robot, as JSON values; ``record`` reads it."""

import dataclasses
import json
from typing import TYPE_CHECKING, Any

from robots.own_measures import records_of
from taichi_sim.lattice.files import VoxelFile, write_vxl_json

if TYPE_CHECKING:
    from robots.lattice_robot.robot import LatticeRobot

SETTINGS = ("frequency", "cycles", "settling", "heading", "time_step_safety", "name")
# Settings that files have where they are not as usual.
LATER = (
    "target",
    "reference_length",
    "perturbation",
    "seed",
    "highest_moduli",
    "highest_size",
    "lowest_size",
    "largest_amplitude",
    "origin",
)


def description_of(robot: "LatticeRobot") -> dict[str, Any]:
    """Everything that results of a lattice robot depend on, what is free of it among it."""
    return {
        **{name: getattr(robot, name) for name in SETTINGS},
        **{
            f.name: getattr(robot, f.name)
            for f in dataclasses.fields(robot)
            if f.name in LATER and getattr(robot, f.name) != f.default
        },
        "drives": [drive.describe() for drive in robot.drives],
        **({"reflexes": dataclasses.asdict(robot.reflexes)} if robot.reflexes else {}),
        **({"own_measures": records_of(robot.own_measures)} if robot.own_measures else {}),
        "moduli": [[number, dataclasses.asdict(free)] for number, free in robot.free_moduli.items()],
        "body": json.loads(write_vxl_json(VoxelFile.of_body(robot.body))),
    }
