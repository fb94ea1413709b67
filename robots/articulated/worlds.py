"""Worlds of articulated robots: terrains, as the engine takes them."""

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from robots.articulated.centres import first_centre
from robots.robot import Place, World
from robots.terrain_fields import not_taken
from robots.world import FLUID_FIELDS, Terrain, terrain_of
from taichi_sim import rigid
from taichi_sim.base.arrays import Floats

if TYPE_CHECKING:
    from robots.articulated.robot import ArticulatedRobot
    from taichi_sim.ground import Relief

GROUND = Terrain()  # level
FORMER = Place("ground")  # the same in runs of earlier versions, whose results have its name
TERRAIN_FIELDS = ("slope", "ground", *FLUID_FIELDS)  # which articulated robots take
DEEP = 1e5  # m: how far a fluid all around reaches up, and down to the ground
FINENESS = 50  # nodes of uneven ground along a robot


def on_ground(world: World) -> World:
    """A world that robots of this kind can be in: level, tilted or uneven ground, maybe with sand or water, or a fluid.

    Raises:
        ValueError: for worlds of other kinds, and terrains that are more than ground.
    """
    if world == FORMER:
        return world
    terrain = terrain_of(world)
    if not_taken(terrain, TERRAIN_FIELDS):
        raise ValueError(
            f"terrain: {terrain.where!r} is not allowed for an articulated robot; give a slope, uneven ground or "
            "water, such as hill:5, rough:0.01+sand:2e5 or ramp:-5+water:0, and friction by the robot"
        )
    return terrain


def tilted(robot: "ArticulatedRobot", world: World) -> rigid.Physics:
    """The physics of a robot on ground that rises along its heading; the robot is turned with it."""
    slope = world.slope if isinstance(world, Terrain) else 0.0
    if slope == 0:
        return robot.physics
    angle, down = math.radians(slope), robot.physics.gravity
    x, y, _ = down * math.sin(angle) * robot.direction
    return replace(robot.physics, gravity=down * math.cos(angle), gravity_across=(float(x), float(y)))


def physics_in(robot: "ArticulatedRobot", world: World) -> rigid.Physics:
    """The physics of a robot in a world: in a fluid it neither sinks nor rises, and feels its drag."""
    physics = tilted(robot, world)
    if not isinstance(world, Terrain) or not world.is_wet:
        return physics
    pressure, friction = world.drag
    gravity = 0.0 if world.is_fluid else physics.gravity
    return replace(physics, gravity=gravity, pressure_drag=pressure, friction_drag=friction)


def relief_under(robot: "ArticulatedRobot", world: World) -> "Relief | None":
    """The uneven ground around a robot, whose x axis is its heading, with its water; None for the level floor."""
    from taichi_sim.ground.relief import Relief, Water

    terrain = on_ground(world)
    if not isinstance(terrain, Terrain):
        return None
    if terrain.fluid_density is not None:
        around = Water(DEEP, terrain.fluid_density) if terrain.fluid_density else None
        return Relief(np.full((2, 2), -DEEP), 1.0, water=around)
    if terrain.uneven is None:
        return None
    relief, (x, y, _) = terrain.uneven.relief(robot.heading, 2 * length_of(robot) / FINENESS), ground_place(robot)
    return replace(relief, origin=(relief.origin[0] + x, relief.origin[1] + y)) if x or y else relief


def ground_place(robot: "ArticulatedRobot") -> Floats:
    """Where uneven ground has its origin, (3,) [m]: the whole metre next to the start of a robot.

    Ground is made around its origin, so a robot that its file puts elsewhere would find it level.
    """
    x, y, _ = first_centre(robot.model.tree)[0]
    return np.round([x, y, 0.0])


def check_gradients(robot: "ArticulatedRobot", world: World) -> None:
    """Refuse a world in which a cone limits the friction of a robot, which has no derivatives then."""
    friction = physics_in(robot, world).friction
    if np.isfinite(friction):
        told = "give inf, as --friction inf, which has no limit beyond which feet slip"
        raise ValueError(f"friction: {friction:g} has no derivatives; {told}")


def length_of(robot: "ArticulatedRobot") -> float:
    """The longest side of the space that a robot takes as its file has it, whatever the sizes of its bodies [m]."""
    centres, radii = robot.model.tree.balls()
    reach = radii[:, None]
    return float(((centres + reach).max(axis=0) - (centres - reach).min(axis=0)).max())
