"""The friction that a terrain gives to the materials of a lattice robot, and its options."""

import dataclasses
from collections.abc import Collection, Mapping
from typing import Any

from robots.robot import Option, World
from robots.terrain_fields import check_taken
from robots.terrain_kind import TerrainKind
from robots.world import FLUID_FIELDS, MATERIAL_FRICTION, Terrain, terrain_of
from taichi_sim.base import checks
from taichi_sim.base.options import numbers

WITHOUT_PROPS = ("slope", "high_friction", *FLUID_FIELDS, *MATERIAL_FRICTION, "ground", "light")
TERRAIN_FIELDS = (*WITHOUT_PROPS, "props")  # which lattice robots take


def material_friction(
    terrain: Terrain, instead: str = "drive the friction of a region", taken: Collection[str] = TERRAIN_FIELDS
) -> dict[str, float]:
    """The friction that replaces that of all materials, by the names of their fields; nothing where theirs stays.

    Args:
        terrain: its ``high_friction`` replaces both kinds.
        instead: what to do about feet that slide.
        taken: fields of the terrain that the robot takes.

    Raises:
        ValueError: if the terrain gives others, such as a friction for parts that a lattice robot does not have.
    """
    check_taken(terrain, taken, {"low_friction": f"; {instead}"})
    both = terrain.high_friction
    given = {name: getattr(terrain, name) if both is None else both for name in MATERIAL_FRICTION}
    return {name: value for name, value in given.items() if value is not None}


def without_friction(terrain: Terrain) -> Terrain:
    """A terrain on which materials keep their friction."""
    return dataclasses.replace(terrain, high_friction=None, static_friction=None, kinetic_friction=None)


class LatticeGroundKind(TerrainKind):
    """A kind of robot whose materials have friction, which the ground can replace."""

    ground_options = ("ground_friction",)

    @property
    def world_options(self) -> tuple[Option, ...]:
        """A terrain, and the friction of all materials on it."""
        told = "of all materials on the ground (default: their own)"
        return (*super().world_options, Option("ground_friction", told, numbers(2), "STATIC,KINETIC"))

    def chosen_world(self, options: Mapping[str, Any]) -> World | None:
        """The terrain of a name or a slope, flat by default, with the friction that is given.

        Raises:
            ValueError: for friction that is not allowed.
        """
        world, given = super().chosen_world(options), options.get("ground_friction")
        if given is None:
            return world
        static, kinetic = (checks.number("ground_friction", value, 0.0, checks.MOST_FRICTION) for value in given)
        told = f"ground_friction: {static:g},{kinetic:g} is not allowed"
        if kinetic > static:
            raise ValueError(f"{told}; kinetic friction is at most static friction")
        terrain = Terrain() if world is None else terrain_of(world)
        if terrain.is_fluid:
            raise ValueError(f"{told} in a fluid, which has no ground; leave it out")
        return dataclasses.replace(without_friction(terrain), static_friction=static, kinetic_friction=kinetic)

    def world_values(self, world: World) -> dict[str, Any]:
        """A terrain by its name, and the friction on it that is not that of the materials."""
        found, pair = super().world_values(world), tuple(material_friction(terrain_of(world)).values())
        return {**found, "ground_friction": pair} if pair else found
