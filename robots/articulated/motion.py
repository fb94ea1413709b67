"""Build motions of articulated robots of files, with what they sense, what they are told, and the ground below."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from robots.articulated.worlds import relief_under
from robots.outcome import World
from robots.view.motion import GroundPlane, Motion, speed_channels
from robots.view.rigid_motion import LIGHT, SWITCH, VALUE, frame_channels, rigid_motion
from robots.view.scene import HUES, SUN
from robots.world import Terrain
from taichi_sim.base.arrays import along
from taichi_sim.rigid import Frames, Tree

if TYPE_CHECKING:
    from robots.articulated.robot import ArticulatedRobot


def driven_motion(
    tree: Tree,
    frames: Frames | None,
    sensors: Sequence[str],
    drives: Sequence[str],
    robot: int = 0,
    *,
    name: str = "rigid robot",
    lights: ArrayLike = (),
) -> Motion:
    """Build the motion of an articulated robot, with timeline rows for its sensors and commands.

    Args:
        tree: the robot.
        frames: frames of the engine's result.
        sensors: names of the readings in the frames; one called ``light`` is that of a light.
        drives: names of the commands.
        robot: number of the robot in the batch.
        name: name of the motion.
        lights: their places [m], shape (L, 3).

    Raises:
        ValueError: for results without frames, and frames of other robots.
    """
    hues = [HUES[n % len(HUES)] for n in range(max(len(sensors), len(drives)))]
    read = [("light", SUN, LIGHT) if s == "light" else (s, hue, SWITCH) for s, hue in zip(sensors, hues, strict=False)]
    told = [(drive, hue, VALUE) for drive, hue in zip(drives, hues, strict=False)]
    channels = frame_channels(tree, frames, robot, [*read, *told])
    return rigid_motion(tree, frames, robot, name=name, channels=channels, lights=lights)


def motion_of(
    robot: "ArticulatedRobot",
    frames: Frames | None,
    world: World,
    number: int = 0,
    name: str = "",
    tree: Tree | None = None,
) -> Motion:
    """The motion of a robot of a file on its ground, with its sensors, commands and light.

    Its distance is that of its centre of mass along its heading, as its measures count it, and its speed that of this.

    Args:
        robot: the robot.
        frames: frames of the engine's result.
        world: where it moved.
        number: of the robot in the batch.
        name: of the motion; that of the robot by default.
        tree: of that robot; the robot's own by default.

    Raises:
        ValueError: for results without frames.
    """
    lights = [] if robot.light is None else [robot.light]
    sensors = [*(f"{body} on ground" for body in robot.senses.touch), *(["light"] if robot.light else [])]
    tree, told = tree or robot.tree, name or robot.name
    motion = driven_motion(tree, frames, sensors, robot.drives, number, name=told, lights=lights)
    own = speed_channels(motion.times, along(motion.centre_of_mass, robot.direction))
    counted = replace(motion, channels=(*motion.channels[: -len(own)], *own))
    return on_its_ground(counted, robot, world)


def on_its_ground(motion: Motion, robot: "ArticulatedRobot", world: World) -> Motion:
    """The motion with the ground of its world, tilted, uneven or below water; in a fluid below all that it reaches."""
    if not isinstance(world, Terrain):
        return motion
    if world.is_fluid:
        level = float(motion.translation[..., 2].min() - motion.scale.max())
        return replace(motion, ground=GroundPlane(level, solid=False))
    return replace(motion, ground=GroundPlane(0.0, world.slope, robot.heading, relief=relief_under(robot, world)))
