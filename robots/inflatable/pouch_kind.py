"""Inflatable robots that feel, as a kind of robot: waves in their bladders, changed by reflexes."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from robots.kind import choices
from robots.lattice_robot.ground import LatticeGroundKind
from robots.robot import Option, Robot
from taichi_sim.base.checks import choice
from taichi_sim.base.options import number, whole

GEOMETRIES = ("small-closed", "closed")  # of one core, whose pressure drives nothing by itself
DRIVEN = ("pressure", "frequency", "cycles", "settling")


class PouchKind(LatticeGroundKind):
    """The body of the inflatable robot, whose waves and reflexes are searched; its designs are lattice robots."""

    name = "pouch"
    title = "pouch that feels"
    fading_gradients = True
    explored = choices(geometry=list(GEOMETRIES), pressure=(0, 12000), frequency=(0.5, 4), slope=(-15, 15))
    options = (
        Option("geometry", "the robot's body (default: small-closed)", choices=GEOMETRIES),
        Option("pressure", "of the core (default: 0)", number(0.0, unit="Pa"), "PA"),
        Option("frequency", "of the bladders' waves (default: 2)", number(0.1, 100, "Hz"), "HZ"),
        Option("cycles", "that count (default: 3)", whole(1), "N"),
        Option("settling", "before anything moves, in seconds (default: 0.1)", number(0), "S"),
    )

    def build(self, source: str | None, options: Mapping[str, Any]) -> Robot:
        """The robot of a geometry."""
        from robots.inflatable.body import NAMED_GEOMETRIES
        from robots.inflatable.pouch import feeling_pouch

        if source is not None:
            raise ValueError(f"robot: {source} is no pouch; a design of one is a lattice robot")
        geometry = NAMED_GEOMETRIES[choice("geometry", options.get("geometry", GEOMETRIES[0]), GEOMETRIES)]
        return feeling_pouch(geometry, **{name: options[name] for name in DRIVEN if name in options})

    def recognises(self, path: Path, form: str | None) -> bool:
        """No file: designs are lattice robots."""
        return False
