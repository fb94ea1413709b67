"""Soft walkers as a kind of robot: bodies of passive and active voxels, judged by their speed."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from robots.kind import choices
from robots.lattice_robot.formats import WALKER_FORMAT
from robots.lattice_robot.ground import LatticeGroundKind
from robots.lattice_robot.links import LINKS_OPTION, USUAL
from robots.robot import Option, Robot
from taichi_sim.base.checks import built, known_names, whole_number
from taichi_sim.base.options import checked, number, whole

ENCODINGS = ("direct", "pattern")


def shape_of(text: str) -> tuple[int, ...]:
    """Cells along x, y and z, of a text such as ``4,4,3``."""
    parts = text.split(",")
    if len(parts) != 3 or not all(part.strip().isdecimal() and int(part) for part in parts):
        raise ValueError(f"shape: {text!r} is not allowed; give three whole numbers such as 4,4,3")
    return tuple(whole_number("shape", int(part), 1) for part in parts)


class WalkerKind(LatticeGroundKind):
    """Soft walkers: lattice robots whose bodies are searched voxel by voxel."""

    name = "walker"
    title = "soft walker"
    explored = choices(frequency=(1, 8), amplitude=(0.02, 0.25), slope=(-15, 15))
    trial_fields = ("actuation.cycles",)
    options = (
        Option("shape", "places of the lattice along each axis (default: 4,4,3)", checked(shape_of), "X,Y,Z"),
        Option("encoding", "of the body: each voxel, or a pattern in space (default: direct)", choices=ENCODINGS),
        Option("amplitude", "of the edges of active voxels, part of their length (default: 0.14)", number(0, 0.5), "A"),
        Option("frequency", "of the actuation (default: 4)", number(0.1, 100, "Hz"), "HZ"),
        Option("cycles", "that count (default: 6)", whole(1), "N"),
        Option("settling", "before anything moves, in seconds (default: 0.25)", number(0), "S"),
        LINKS_OPTION,
    )

    def build(self, source: str | None, options: Mapping[str, Any]) -> Robot:
        """A lattice in which bodies are searched; or the walker of a file, of which nothing is free."""
        from robots.lattice_robot.walker import WalkerActuation, load_walker
        from robots.lattice_robot.walker_robot import WalkerRobot

        drive = {name: options[name] for name in ("amplitude", "frequency", "cycles", "settling") if name in options}
        links = options.get("links", USUAL)
        if source is None:
            body = {name: options[name] for name in ("shape", "encoding") if name in options}
            return WalkerRobot(actuation=WalkerActuation(**drive), links=links, **body)
        for name in ("shape", "encoding"):
            if name in options:
                raise ValueError(f"{name}: the walker in {source} has its own; leave it out")
        walker = load_walker(source)
        own = walker.materials.shape, ENCODINGS[0], WalkerActuation(**drive), walker, Path(source).stem
        return WalkerRobot(*own, links)

    def recognises(self, path: Path, form: str | None) -> bool:
        """Designs of ``save_walker``."""
        return form == WALKER_FORMAT

    def from_description(self, description: Mapping[str, Any]) -> Robot:
        """The lattice that was described."""
        from robots.lattice_robot.walker import WalkerActuation
        from robots.lattice_robot.walker_robot import WalkerRobot

        known_names(description, "shape", "encoding", "actuation", "links")
        shape, actuation = tuple(description["shape"]), built(WalkerActuation, description["actuation"])
        links = description.get("links", USUAL)
        return WalkerRobot(shape, description["encoding"], actuation, links=links)
