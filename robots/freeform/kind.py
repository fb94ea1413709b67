"""Freeform robots as a kind of robot: grids whose cells, tissues and muscles are free."""

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from robots.kind import OWN_MEASURES_OPTION, choices
from robots.lattice_robot.ground import LatticeGroundKind
from robots.lattice_robot.kind import BY_CHANNELS
from robots.lattice_robot.links import LINKS_OPTION
from robots.lattice_robot.walker_kind import shape_of
from robots.robot import Option, Robot
from taichi_sim.base.files import read_text
from taichi_sim.base.options import checked, file_text, number, numbers, whole
from taichi_sim.base.parsing import RepeatedNameError, parse_json
from taichi_sim.base.short_text import counted

FIELDS = ("cells", "filtered", "blobs", "network", "pattern")
GRID = ("shape", "voxel_size", "symmetry")
ACTUATION = ("amplitude", "frequency", "cycles", "settling", "channels")
OWN = ("fields", "detail", "full", "feature", "target", "perturbation", "seed", "links", "own_measures")


class FreeformKind(LatticeGroundKind):
    """The kind of freeform robots, in which a search chooses the content of each cell of a grid."""

    name = "freeform"
    title = "freeform robot"
    explored = choices(frequency=(1, 8), amplitude=(0.02, 0.25), slope=(-15, 15))
    trial_fields = ("actuation.cycles",)
    instead = MappingProxyType({"rig": BY_CHANNELS, "table": BY_CHANNELS})
    options = (
        Option("shape", "cells of the grid along each axis (default: 12,4,3)", checked(shape_of), "X,Y,Z"),
        Option("voxel_size", "edge of a cell in metres (default: 0.01)", number(1e-6, 1e3), "M"),
        Option("symmetry", "axes along which both halves are alike, such as y (default: none)", metavar="AXES"),
        Option("palette", "JSON file of the tissues, a list of materials (default: silicone)", file_text, "FILE"),
        Option("fields", "how a search writes what cells are (default: cells)", choices=FIELDS),
        Option("detail", "radius of filtered fields, balls of blobs, nodes of networks", number(0, 1e4), "N"),
        Option("full", "all cells are there; muscles and tissues alone are free", None),
        Option("feature", "least thickness of a robot in cells (default: 1)", whole(1), "N"),
        Option("amplitude", "largest of the muscles, part of an edge (default: 0.2)", number(1e-6, 0.5), "A"),
        Option("channels", "different waves that a robot may have (default: one for each muscle)", whole(1), "K"),
        Option("frequency", "of the muscles (default: 4)", number(0.1, 100, "Hz"), "HZ"),
        Option("cycles", "that count (default: 2)", whole(1), "N"),
        Option("settling", "before anything moves, in seconds (default: 0.1)", number(0), "S"),
        Option("target", "point that it should come near, in metres from its start", numbers(2), "X,Y"),
        Option("perturbation", "noise on start positions, in metres (default: 1e-5)", number(0), "M"),
        Option("seed", "of that noise (default: 0)", whole(0), "N"),
        LINKS_OPTION,
        OWN_MEASURES_OPTION,
    )

    def build(self, source: str | None, options: Mapping[str, Any]) -> Robot:
        """A grid in which robots are searched."""
        from robots.freeform.grid import Grid
        from robots.freeform.palette import Palette, palette_of
        from robots.freeform.robot import FreeformActuation, FreeformRobot
        from robots.freeform.solid import LEAST_CELLS
        from robots.lattice_robot.sources import robot_of_python

        if source is not None and source.lower().endswith(".py"):
            return robot_of_python(Path(source), FreeformRobot).changed(options)
        if source is not None:
            raise ValueError(f"robot: {source} is no freeform robot; a design of one is a lattice robot")

        def given(names: tuple[str, ...]) -> dict[str, Any]:
            return {name: options[name] for name in names if name in options}

        grid = Grid(**given(GRID))
        if grid.count < LEAST_CELLS:  # not refused by the grid itself: runs of earlier versions may have one
            sides, cells = ",".join(map(str, grid.shape)), counted(grid.count, "cell")
            raise ValueError(f"shape: {sides} is not allowed, as it has {cells}; give at least {LEAST_CELLS}")
        palette = Palette()
        if path := options.get("palette"):
            palette = palette_of(_records(Path(path)))
        return FreeformRobot(grid, palette, FreeformActuation(**given(ACTUATION)), **given(OWN))

    def from_description(self, description: Mapping[str, Any]) -> Robot:
        """The grid that was described."""
        from robots.freeform.robot import freeform_of

        return freeform_of(description)


def _records(path: Path) -> list[dict[str, Any]]:
    """The tissues of a file."""
    text = read_text(path)
    try:
        records = parse_json(text)
    except RepeatedNameError as error:
        raise ValueError(f"palette: {path}: {error}") from None
    except ValueError as error:
        raise ValueError(f"palette: {path} is no JSON ({error})") from None
    if not isinstance(records, list) or not all(isinstance(record, dict) for record in records):
        raise ValueError(f"palette: {path} is not allowed; give a list of tissues, each a table of numbers")
    return records
