"""The inflatable robot as a kind of robot: its options on the command line, its worlds, and the files it recognises.

What is heavy is imported when it is used, as commands ask kinds for their options before they do any work.
"""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robots.inflatable.actuation import ACTUATION, WEIGHTS
from robots.inflatable.design import (
    BY_HAND,
    FORMATS,
    InflatableDesign,
    Pressure,
    load_design,
)
from robots.inflatable.layout import layout_of
from robots.inflatable.robot import InflatableRobot
from robots.kind import choices
from robots.robot import (
    Option,
    Robot,
    World,
)
from robots.terrain_kind import TerrainKind
from robots.world import FLOORS, FRICTION_OF_PARTS, Terrain, friction_of_parts, terrain_of
from taichi_sim.base import checks
from taichi_sim.base.options import checked, file_path, file_text, number, numbers, spelled, value_of, whole

if TYPE_CHECKING:
    pass

GAITS = tuple(BY_HAND)
GEOMETRIES = ("published", "small", "two-core", "closed", "small-closed")
RIG_OPTION = Option(
    "calibration",
    "properties of a rig, the calibration.json of morpholab calibrate; its geometry is the default",
    file_path,
    "FILE",
)
BLADDERS_OPTION = Option(
    "bladders",
    "places that have a bladder, such as 1,4,6, or none; 1 to 4 lie on top, 8 to 5 underneath, and the gait leaves the "
    "others empty (default: all, of a gait its own)",
    checked(layout_of),
    "PLACES",
)


def pressure(high: float = float("inf")) -> Any:
    """The type of an option with pressures from 0 to a bound [Pa]: one, or one for each core, with commas between."""

    def convert(text: str) -> Pressure:
        each = tuple(checks.number("", value_of(part), 0.0, high, "Pa") for part in text.split(","))
        return each[0] if len(each) == 1 else each

    return checked(convert)


class InflatableKind(TerrainKind):
    """The kind of the inflatable robot, whose designs are JSON files or gait tables."""

    name = "inflatable"
    title = "inflatable robot"
    designs = GAITS
    suffixes = (".csv",)
    explored = choices(geometry=["small", "published"], slope=(-15, 15), orientation=(0, 90))
    search_precision = "f32"
    ground_options = ("friction", "floor", *FRICTION_OF_PARTS)
    options = (
        Option("geometry", "the robot's body (default: published, of a run its own)", choices=GEOMETRIES),
        BLADDERS_OPTION,
        Option("columns", "columns of the gait that are played (default: all)", whole(1), "T"),
        Option("repeats", "how often the columns are played (default: the gait's own)", whole(1), "N"),
        Option(
            "weight",
            "of bladders: none while they move or stay inflated, or always (default: published, of a run its own)",
            choices=WEIGHTS,
        ),
        RIG_OPTION,
        Option(
            "pressure",
            "of the core, or such as 12000,0 of each of several (default: the gait's own)",
            pressure(),
            "PA",
        ),
        Option(
            "orientation",
            "0 rolls, 90 inches uphill (default: the gait's own)",
            number(0.0, 90.0, "degrees"),
            "DEGREES",
        ),
        Option(
            "from_rows",
            "of a gait table, what its rows play, by the inverse of its pressure map, not the design in its header",
            None,
            commands=("simulate",),
        ),
        Option(
            "rig",
            "with --table: the rig that plays it, a preset or a .toml file; ideal follows the simulator's strokes",
            file_text,
            "RIG",
            commands=("simulate",),
        ),
        Option(
            "perturbation",
            "standard deviation of noise on the start positions (default: 0)",
            number(0.0, unit="m"),
            "M",
            commands=("simulate",),
        ),
        Option("seed", "of the noise (default: 0)", whole(0), "N", commands=("simulate",)),
    )

    @property
    def world_options(self) -> tuple[Option, ...]:
        """A terrain, and the friction of feet on it, by two coefficients or by the name of a measured floor."""
        return (
            *super().world_options,
            Option("friction", "of sliding and of gripping feet (default: 0.0001,2)", numbers(2), "SLIDING,GRIPPING"),
            Option("floor", "whose measured friction feet have; instead of --friction", metavar="wood|acrylic"),
            Option(
                "bladder_friction",
                "of bladders (default: a third of that of gripping feet)",
                number(0.0, checks.MOST_FRICTION),
                "X",
            ),
            Option(
                "skin_friction",
                "of the skin beside seams and feet (default: that of gripping feet)",
                number(0.0, checks.MOST_FRICTION),
                "X",
            ),
            Option(
                "seam_friction",
                "of seams (default: that of gripping feet, but within feet that of sliding feet in the first column)",
                number(0.0, checks.MOST_FRICTION),
                "X",
            ),
        )

    def chosen_world(self, options: Mapping[str, Any]) -> World | None:
        """The terrain of a name or a slope, flat by default, with the friction that is given.

        Raises:
            ValueError: for a friction and a floor, an unknown floor, and friction that is not allowed.
        """
        world = super().chosen_world(options)
        if all(options.get(name) is None for name in self.ground_options):
            return world
        return self.on_ground(Terrain() if world is None else terrain_of(world), options)

    def on_ground(self, terrain: Terrain, options: Mapping[str, Any]) -> Terrain:
        """A terrain with the friction that values of :attr:`ground_options` give.

        Raises:
            ValueError: as :meth:`chosen_world` does.
        """
        own = {name: options[name] for name in FRICTION_OF_PARTS if options.get(name) is not None}
        friction = friction_of_feet(options)
        if friction is not None:
            own |= {"low_friction": friction[0], "high_friction": friction[1]}
        if terrain.is_fluid:
            name, told = ("friction", spelled(friction)) if friction else next(iter(own.items()))
            raise ValueError(f"{name}: {told} is not allowed in a fluid, which has no ground; leave it out")
        return dataclasses.replace(terrain, **own)

    def world_values(self, world: World) -> dict[str, Any]:
        """A terrain by its name, and the friction on it that is not the robot's own."""
        terrain, usual = terrain_of(world), ACTUATION
        found, feet = super().world_values(terrain), (terrain.low_friction, terrain.high_friction)
        if feet != (None, None):
            pairs = zip(feet, (usual.low_friction, usual.high_friction), strict=True)
            found["friction"] = tuple(own if given is None else given for given, own in pairs)
        return {**found, **friction_of_parts(terrain)}

    def build(self, source: str | None, options: Mapping[str, Any]) -> Robot:
        """The robot of a known gait, of a design file, or of a gait table; by default inching."""
        from robots.calibration import load_calibration

        named = source or GAITS[0]
        name = named if named in GAITS else Path(named).stem
        rig, table = None, None
        if "rig" in options:
            from robots.inflatable.on_rig import gait_of_table

            gait, rig, table = gait_of_table(named, options)
        else:
            gait = load_gait(named, bool(options.get("from_rows")))
        geometry = load_calibration(options["calibration"])[1] if "calibration" in options else GEOMETRIES[0]
        return InflatableRobot(gait, geometry, name=name, rig=rig, rig_table=table).changed(options)

    def recognises(self, path: Path, form: str | None) -> bool:
        """Designs and gait tables."""
        return form in FORMATS or path.suffix.lower() in self.suffixes


def friction_of_feet(options: Mapping[str, Any]) -> tuple[float, float] | None:
    """Friction of feet that slide and that grip, from ``friction`` or ``floor``; None if neither is given."""
    friction, floor = options.get("friction"), options.get("floor")
    if floor is not None:
        if friction is not None:
            raise ValueError(f"floor: {floor} is not allowed beside --friction; give one of them")
        if floor == "gravel":
            raise ValueError("floor: gravel is not allowed, as no friction on it was published; give --friction")
        friction = FLOORS[checks.choice("floor", floor, FLOORS)]
    if friction is None:
        return None
    if not isinstance(friction, (list, tuple)) or len(friction) != 2:
        raise ValueError(f"friction: {friction!r} is not allowed; give that of sliding and of gripping feet")
    sliding, gripping = (checks.number("friction", coefficient, 0.0, checks.MOST_FRICTION) for coefficient in friction)
    if sliding > gripping:
        raise ValueError(
            f"friction: {sliding:g} of sliding feet is not allowed; at most that of gripping feet, {gripping:g}"
        )
    return sliding, gripping


def load_gait(text: str, from_rows: bool = False) -> InflatableDesign:
    """The design of a known gait's name, or of a file; with ``from_rows`` what the rows of a gait table play.

    Raises:
        ValueError: for anything else.
    """
    path = Path(text)
    if text in BY_HAND and not from_rows:
        return BY_HAND[text]
    if text not in BY_HAND and not path.is_file():
        raise ValueError(f"gait: {text!r} is neither a known gait ({', '.join(BY_HAND)}) nor a file")
    if from_rows or path.suffix.lower() == ".csv":
        from robots.hardware import read_design

        return read_design(path, from_rows)
    return load_design(path)
