"""What kinds of robots share whose worlds are terrains: how people name a terrain, and how it is kept."""

from collections.abc import Mapping
from typing import Any

from robots.ground_kinds import described
from robots.robot import Option, RobotKind, World
from robots.world import STEEPEST, Terrain
from taichi_sim.base.options import checked
from taichi_sim.base.options import number as number_type


class TerrainKind(RobotKind):
    """A kind of robot whose worlds are terrains."""

    world_option = "terrain"
    world_type = staticmethod(checked(Terrain.parse, "terrain"))
    world_hint = (
        "flat, hill:15, water or uneven ground, such as rough:0.01 (default: flat, of a run its own); with a light for "
        "robots that feel it, flat+light:X,Y, or a box, ball or wall, flat+box:LX,LY,LZ,X,Y[,Z]; uneven ground is "
        f"{described()}"
    )
    quick_precision = "f32"

    @property
    def world_options(self) -> tuple[Option, ...]:
        """A terrain by its name, or by its slope."""
        slope = number_type(-STEEPEST, STEEPEST, "degrees")
        told = "of the ground, uphill is positive; instead of --terrain"
        return (*super().world_options, Option("slope", told, slope, "DEGREES"))

    def chosen_world(self, options: Mapping[str, Any]) -> World | None:
        """The terrain of a name or a slope.

        Raises:
            ValueError: for both of them.
        """
        terrain, slope = options.get("terrain"), options.get("slope")
        if terrain is not None and slope is not None:
            raise ValueError(f"slope: {slope:g} is not allowed beside --terrain {terrain.name}; give one of them")
        return terrain if slope is None else Terrain(slope)

    def world(self, text: Any) -> Terrain:
        """The terrain of a name."""
        return text if isinstance(text, Terrain) else Terrain.parse(text)

    def world_record(self, world: World) -> dict[str, Any]:
        """A terrain's fields, without those that are None."""
        assert isinstance(world, Terrain)
        return {name: value for name, value in world.fields.items() if value is not None}

    def world_of(self, record: Any) -> Terrain:
        """The terrain of a record."""
        return Terrain(**record)
