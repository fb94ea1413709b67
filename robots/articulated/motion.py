"""Build motions of articulated robots of files, with what they sense and are told."""

from collections.abc import Sequence

from numpy.typing import ArrayLike

from robots.view.motion import Motion
from robots.view.rigid_motion import LIGHT, SWITCH, VALUE, frame_channels, rigid_motion
from robots.view.scene import HUES, SUN
from taichi_sim.rigid import Frames, Tree


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
