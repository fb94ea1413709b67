"""Terrains, the worlds of most robots: ground or fluid, with friction, props and a light."""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Self, TypedDict

import numpy as np

from robots.ground import Ground, is_ground
from robots.ground import level as level_ground
from robots.ground_kinds import WATER_DENSITY as WATER_DENSITY
from robots.ground_kinds import check_single, ways
from robots.outcome import World
from robots.props import LIGHT, Prop, split_name
from robots.terrain_fields import about
from taichi_sim.base.checks import Friction, NotNegative, check_fields, number, shown
from taichi_sim.base.files import found_beside
from taichi_sim.base.options import value_of as number_of

if TYPE_CHECKING:
    from taichi_sim.lattice import Relief

STEEPEST = 45.0  # degrees, either way
PRESSURE_DRAG, FRICTION_DRAG = 1.2, 0.02  # of a flat plate broadside on (Hoerner 1965, ch. III), and along its side
STANDARD_GRAVITY = 9.80665  # m/s^2
NO_WEIGHT = (0.0, 0.0, 0.0)
# Sliding and gripping feet, static, of the robot dragged over it (Powers 2021, ch. 5); no pair is published of gravel.
FLOORS = {"wood": (0.56, 0.70), "acrylic": (0.38, 0.51)}
FRICTION_OF_PARTS = ("bladder_friction", "skin_friction", "seam_friction")
FRICTION_FIELDS = ("high_friction", "low_friction", *FRICTION_OF_PARTS)  # of the inflatable robot
MATERIAL_FRICTION = ("static_friction", "kinetic_friction")  # of lattice robots
FLUID_FIELDS = ("fluid_density", "pressure_drag", "friction_drag")
_OF_INFLATABLE = about("; it is of the inflatable robot", later=True)
_OF_LATTICE = about("; it is of lattice robots", later=True)
_OF_PROPS = about(", as only lattice robots meet any; leave it out", later=True, shown=lambda props: str(props[0].name))

Vector = tuple[Any, Any, Any]  # numbers, or traced arrays


class Medium(TypedDict):
    """What is around the robots of a batch, as arguments of a ``LatticeEngine``."""

    floor: "bool | list[Relief]"
    fluid: bool


@dataclass(frozen=True)
class Terrain:
    """A terrain that robots move on: level, tilted or uneven ground, with optional props and a light; or a fluid.

    In a fluid there is no ground, and the robot has its density: it neither sinks nor rises. The fluid resists outer
    faces as ``taichi_sim.lattice.laws.fluid`` says.

    Attributes:
        slope: slope of the ground [degrees], positive is uphill, -45 to 45.
        high_friction: Coulomb coefficient that replaces the robot's 2.0 (skin, gripping feet); None keeps it.
        low_friction: Coulomb coefficient that replaces the robot's 1e-4 (sliding feet); None keeps it.
        fluid_density: density of the fluid around the robot [kg/m^3]; None is no fluid.
        pressure_drag: drag coefficient of faces that move against the fluid; None is 1.2.
        friction_drag: drag coefficient of faces that the fluid flows along; None is 0.02.
        bladder_friction, skin_friction, seam_friction: Coulomb coefficients of these parts of the inflatable robot, see
            ``InflatableActuation``; None keeps what they follow from.
        static_friction, kinetic_friction: Coulomb coefficients that replace those of all materials of a lattice robot;
            None keeps them.
        ground: uneven ground, sand or water, see ``robots.ground``, such as ``"rough:0.01"``; tilted with the slope.
            None is a plane.
        light: place (x, y) of a light that robots may feel, ahead of where they start and to the left of it [m].
        props: bodies beside the robot, see ``robots.props``; None without any.
        folder: folder with a copy of the ground's file, such as a run folder; it does not change what the terrain is.

    Raises:
        ValueError: for a value that is not allowed, alone or beside the others.
    """

    slope: Annotated[float, partial(number, low=-STEEPEST, high=STEEPEST, unit="degrees")] = 0.0
    high_friction: Friction | None = None
    low_friction: Friction | None = None
    fluid_density: NotNegative | None = field(default=None, metadata=about("; give ground in place of a fluid"))
    pressure_drag: NotNegative | None = None
    friction_drag: NotNegative | None = None
    bladder_friction: Friction | None = field(default=None, metadata=_OF_INFLATABLE)
    skin_friction: Friction | None = field(default=None, metadata=_OF_INFLATABLE)
    seam_friction: Friction | None = field(default=None, metadata=_OF_INFLATABLE)
    static_friction: Friction | None = field(default=None, metadata=_OF_LATTICE)
    kinetic_friction: Friction | None = field(default=None, metadata=_OF_LATTICE)
    ground: str | None = field(default=None, metadata=about("; give a plane", later=True))
    light: tuple[float, float] | None = field(default=None, metadata=about(later=True))
    props: tuple[Prop, ...] | None = field(default=None, metadata=_OF_PROPS)
    folder: Path | None = field(default=None, compare=False, repr=False)

    def __post_init__(self) -> None:
        if not isinstance(self.ground, str | None):  # which may be an array of many lines
            raise ValueError(f"ground: {shown(self.ground)} is not allowed; give a text such as 'rough:0.01'")
        check_fields(self)
        if self.light is not None:
            object.__setattr__(self, "light", checked_place("light", self.light))
        object.__setattr__(self, "props", tuple(_prop(each) for each in self.props or ()) or None)
        if self.ground is not None and Ground(self.ground).is_wet and self.slope:
            raise ValueError(
                f"slope: {self.slope} is not allowed with water, whose surface is level; give 0, or a ramp in place of "
                f"the hill, such as ramp:{self.slope:g}+water:0"
            )
        low, high = self.low_friction, self.high_friction
        if low is not None and high is not None and low > high:
            raise ValueError(f"low_friction: {low} is not allowed; give at most high_friction, {high}")
        self._check_materials()
        if self.is_fluid:
            for name in ("slope", "ground", *FRICTION_FIELDS, *MATERIAL_FRICTION):
                if value := getattr(self, name):
                    raise ValueError(f"{name}: {value} is not allowed in a fluid, which has no ground; leave it out")
        for name in FLUID_FIELDS[1:]:
            if not self.is_wet and (value := getattr(self, name)) is not None:
                raise ValueError(f"{name}: {value} is not allowed without a fluid; give fluid_density")

    def _check_materials(self) -> None:
        """Refuse friction of materials by halves, the wrong way round, or beside that of the inflatable robot."""
        static, kinetic = self.static_friction, self.kinetic_friction
        if static is None and kinetic is None:
            return
        if static is None or kinetic is None:
            given, missing = MATERIAL_FRICTION if kinetic is None else MATERIAL_FRICTION[::-1]
            raise ValueError(f"{given}: {getattr(self, given)} is not allowed without {missing}; give both")
        if kinetic > static:
            raise ValueError(f"kinetic_friction: {kinetic} is not allowed; give at most static_friction, {static}")
        for name in FRICTION_FIELDS:
            if (value := getattr(self, name)) is not None:
                raise ValueError(f"{name}: {value} is not allowed beside static_friction; give one of them")

    @property
    def document(self) -> dict[str, Any]:
        """Convert all fields to a table for files, as earlier versions wrote it: later fields only where given."""
        later = {each.name for each in dataclasses.fields(self) if each.metadata.get("later")}
        return {name: value for name, value in self.fields.items() if name not in later or value is not None}

    @property
    def fields(self) -> dict[str, Any]:
        """Convert the fields to values that fit JSON: the light as a list, props by their names."""
        found = {each.name: getattr(self, each.name) for each in dataclasses.fields(self) if each.compare}
        light, props = self.light and list(self.light), self.props and [prop.name for prop in self.props]
        return {**found, "light": light, "props": props}

    @property
    def uneven(self) -> Ground | None:
        """Uneven ground, sand or water; None for a plane."""
        return Ground(self.ground, self.folder) if self.ground else None

    @property
    def is_fluid(self) -> bool:
        """Whether robots are in a fluid, instead of on ground."""
        return self.fluid_density is not None

    @property
    def is_level(self) -> bool:
        """Whether the ground is the same height everywhere, and not tilted; reads the file of heights, if it has one.

        Raises:
            ValueError: for files that are no heights.
        """
        return self.slope == 0 and (self.uneven is None or self.uneven.is_level)

    @property
    def is_wet(self) -> bool:
        """Whether a fluid is around robots, or water on the ground."""
        return self.is_fluid or (self.uneven is not None and self.uneven.is_wet)

    @property
    def name(self) -> str:
        """Name that :meth:`parse` reads, such as ``"hill:15"``, ``"hill:5+rough:0.01"``, ``"flat+light:0.5,0.1"``.

        Coefficients are not part of it.
        """
        hill = [f"hill:{self.slope!r}".removesuffix(".0")] if self.slope else []
        where = "water" if self.is_fluid else "+".join([*hill, *([self.ground] if self.ground else [])]) or "flat"
        light = [f"{LIGHT}:{self.light[0]!r},{self.light[1]!r}"] if self.light else []
        return "+".join([where, *light, *(prop.name for prop in self.props or ())])

    @property
    def friction(self) -> str:
        """The friction that replaces the robot's own, such as ``"friction 0.56,0.7 (wood)"``; empty if none does."""
        feet = self.low_friction, self.high_friction
        named = floor_of(feet)
        floor = f" ({named})" if named else ""
        given = [f"{value:g}" for value in feet if value is not None]
        told = [f"friction {','.join(given)}{floor}"] if given else []
        if self.static_friction is not None:
            told.append(f"friction {self.static_friction:g} static, {self.kinetic_friction:g} kinetic")
        told += [f"{name.replace('_', ' ')} {value:g}" for name, value in friction_of_parts(self).items()]
        return ", ".join(told)

    @property
    def where(self) -> str:
        """Place in words, such as ``"on flat"``, ``"on hill:15, friction 0.56,0.7 (wood)"`` or ``"in water"``."""
        return ", ".join(filter(None, [f"{'in' if self.is_fluid else 'on'} {self.name}", self.friction]))

    @property
    def spoken(self) -> str:
        """Text to follow a robot's name: ``"on flat ground"``, ``"up a slope of 15°, friction 0.5"``, ..."""
        light = "to a light at ({:g}, {:g}) m".format(*self.light) if self.light else ""
        props = f"with {' and '.join(f'a {prop.kind}' for prop in self.props)}" if self.props else ""
        if self.is_fluid:
            return ", ".join(filter(None, ["in water", props, light]))
        way = "up" if self.slope > 0 else "down"
        slope = f"{way} a slope of {abs(self.slope):g}°" if self.slope else ""
        ground = f"on {self.uneven.spoken}" if self.uneven else "" if slope else "on flat ground"
        return ", ".join(filter(None, [slope, ground, self.friction, props, light]))

    @property
    def resistance(self) -> tuple[float, float]:
        """Half the density of the fluid or water times the coefficients of pressure drag and friction [kg/m^3]."""
        water = self.uneven.water if self.uneven else None
        half = 0.5 * (water.density if water else self.fluid_density or 0.0)
        pressure, friction = self.drag
        return half * pressure, half * friction

    @property
    def drag(self) -> tuple[float, float]:
        """Coefficients of pressure drag and friction in the fluid or water."""
        pressure = PRESSURE_DRAG if self.pressure_drag is None else self.pressure_drag
        return pressure, FRICTION_DRAG if self.friction_drag is None else self.friction_drag

    def _with_its_file(self) -> Self:
        """Itself, if the file of its ground is there: who names a terrain means to use it."""
        if self.uneven is not None:
            self.uneven.check_file()
        return self

    @classmethod
    def water(cls) -> Self:
        """Make a terrain that is water all around the robot, which has its density and floats."""
        return cls(fluid_density=WATER_DENSITY)

    @classmethod
    def parse(cls, text: str) -> Self:
        """Parse the name of a terrain, such as ``"hill:15"``.

        It is ``"flat"``, ``"hill:DEGREES"`` such as ``"hill:15"``, ``"water"``, uneven ground such as ``"rough:0.01"``
        (see ``robots.ground``), or that on a slope, ``"hill:5+rough:0.01"``; any of them with a light and props at
        the end, ``"flat+light:0.5,0.1+ball:0.04,0.12,0"``.

        Raises:
            ValueError: for any other name or slope, and a file of heights that is not there.
        """
        return cls.named(text)._with_its_file()

    @classmethod
    def named(cls, text: str) -> Self:
        """Return the terrain of a name as :meth:`parse` does, whether or not the file of its heights is there.

        Raises:
            ValueError: for any other name or slope.
        """
        text, things = split_name(text)
        if things:
            given = [each for each in things if not each.startswith(f"{LIGHT}:")]
            lights = [each.partition(":")[2] for each in things if each.startswith(f"{LIGHT}:")]
            if len(lights) > 1:
                raise ValueError(f"light: {len(lights)} are not allowed; give one")
            places = [checked_place(LIGHT, [number_of(part) for part in each.split(",")]) for each in lights]
            props = tuple(map(Prop.parse, given))
            return dataclasses.replace(cls.named(text), light=places[0] if places else None, props=props)
        check_single(text)
        hill, ground = _hill_and_ground(text)
        if hill:
            return dataclasses.replace(cls.named(hill), ground=ground)
        kind, _, degrees = text.partition(":")
        if text == "flat":
            return cls()
        if text == "water":
            return cls.water()
        if is_ground(text):
            return cls(ground=text)
        try:
            slope = float(degrees if kind == "hill" else "")
        except ValueError:
            known = f'"flat", "hill:15" (degrees), "water" or uneven ground: {ways()}'
            raise ValueError(f"terrain: {text!r} is unknown; give {known}") from None
        return cls(slope)


def _hill_and_ground(text: str) -> tuple[str, str]:
    """What a name without things says before the ground, ``hill:5`` of ``hill:5+rough:0.01``, and that ground."""
    hill, plus, ground = text.partition("+")
    if plus and (hill in ("flat", "water") or hill.partition(":")[0] == "hill"):
        return hill, ground
    return "", text


def with_file_in(folder: Path, text: str) -> str:
    """The name of a terrain with the path of its file of heights, which is also looked for in a folder."""
    try:
        file = Ground(_hill_and_ground(split_name(text)[0])[1]).file
    except ValueError:  # another terrain, or one that is refused where it is made
        return text
    return text if file is None else text.replace(file, found_beside(folder, file), 1)


def checked_place(field: str, given: Any) -> tuple[float, float]:
    """A place (x, y) [m].

    Raises:
        ValueError: for anything else, naming the field.
    """
    if not isinstance(given, list | tuple) or len(given) != 2:
        raise ValueError(f"{field}: {given!r} is not allowed; give (x, y) in metres")
    x, y = (number(field, each, unit="m") for each in given)
    return x, y


def _prop(given: Any) -> Prop:
    """A prop, which may be given by its name."""
    if isinstance(given, str):
        return Prop.parse(given)
    if not isinstance(given, Prop):
        raise ValueError(f"props: {given!r} is not allowed; give a Prop, or its name")
    return given


def floor_of(friction: tuple[float | None, float | None]) -> str | None:
    """The name of the floor on which sliding and gripping feet have this friction; None if none of ``FLOORS`` does."""
    return next((name for name, pair in FLOORS.items() if pair == friction), None)


def friction_of_parts(described: Any, factor: float = 1.0) -> dict[str, Any]:
    """Friction that a terrain or an actuation gives to bladders, skin and seams, times a factor; nothing of others."""
    given = {name: getattr(described, name) for name in FRICTION_OF_PARTS}
    return {name: factor * value for name, value in given.items() if value is not None}


def terrain_of(world: World) -> Terrain:
    """A world that must be a terrain.

    Raises:
        ValueError: if it is another.
    """
    if not isinstance(world, Terrain):
        told = getattr(world, "name", world)
        raise ValueError(f"terrain: {told!r} is not allowed; give a Terrain, such as Terrain.parse('hill:15')")
    return world


def one_each(terrain: Terrain | Sequence[Terrain], count: int) -> list[Terrain]:
    """The terrain of each of ``count`` robots of a batch: one for all, or one each, with the same around all of them.

    Raises:
        ValueError: for another number of terrains, or dry ground for some and a fluid or water for others.
    """
    if isinstance(terrain, Terrain):
        return [terrain] * count
    terrains = [terrain_of(each) for each in ([terrain] if isinstance(terrain, str) else terrain)]
    if len(terrains) != count:
        raise ValueError(f"terrain: {len(terrains)} are not allowed for {count} designs; give one, or one each")
    if len({(each.is_fluid, each.is_wet) for each in terrains}) > 1:
        raise ValueError("terrain: ground and a fluid are not allowed in one batch; give a batch for either")
    return terrains


def medium_of(terrains: Sequence[Terrain], headings: Sequence[float], edge: float) -> Medium:
    """What is around robots of voxels of an edge [m], each on a terrain and heading somewhere [degrees]."""
    first = terrains[0]
    if not any(terrain.ground for terrain in terrains):
        return {"floor": not first.is_fluid, "fluid": first.is_fluid}
    level = level_ground(edge)
    pairs = [(terrain.uneven, heading) for terrain, heading in zip(terrains, headings, strict=True)]
    found = {pair: pair[0].relief(pair[1], edge) if pair[0] else level for pair in {*pairs}}
    return {"floor": [found[pair] for pair in pairs], "fluid": False}


def standing(centres: Any, medium: Medium, edge: float) -> Any:
    """Voxel centres at the start [m], shape (B, V, 3), raised so that every robot just stands on its ground."""
    if isinstance(medium["floor"], bool):
        return centres
    raised = np.array(centres)
    for robot, relief in zip(raised, medium["floor"], strict=True):
        robot[:, 2] += relief.rise(robot, edge)
    return raised


def gravity_vector(slope: float, orientation: Any) -> Vector:
    """Gravity [m/s^2] on a plane of a slope [degrees], as a robot of a heading [degrees] feels it."""
    from taichi_sim.autodiff.arrays import cosine, sine

    tilt, heading = math.radians(180 + slope), orientation * (math.pi / 180)
    direction = (math.sin(tilt) * cosine(heading), math.sin(tilt) * sine(heading), math.cos(tilt))
    x, y, z = (STANDARD_GRAVITY * part for part in direction)
    return x, y, z


def weights(terrain: Terrain, orientation: Any) -> tuple[Vector, Vector]:
    """Gravity [m/s^2] while a robot is put on level ground, and on the terrain; none in a fluid."""
    if terrain.is_fluid:
        return NO_WEIGHT, NO_WEIGHT
    return (0.0, 0.0, -STANDARD_GRAVITY), gravity_vector(terrain.slope, orientation)
