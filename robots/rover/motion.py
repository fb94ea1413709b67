"""Build motions of the two-wheel vehicle, with sensors that show what they read."""

import numpy as np
from numpy.typing import ArrayLike

from robots.rover.body import LIGHT_RADIUS, Rover
from robots.rover.simulation import RoverResult
from robots.view.motion import Motion
from robots.view.rigid_motion import LIGHT, VALUE, frame_channels, rigid_motion, rollout_number
from robots.view.scene import HUES


def rover_motion(
    rover: Rover,
    result: RoverResult,
    lights: ArrayLike,
    controller: int = 0,
    environment: int = 0,
    *,
    name: str = "two-wheel vehicle",
) -> Motion:
    """Build the motion of a simulated two-wheel vehicle; its sensors show what they read.

    Channels: sensors, motor neurons, distance and speed.

    Args:
        rover: the robot.
        result: result of ``simulate``, with frames.
        lights: places of the light in the environments, as given to ``simulate``, (E, 2) [m].
        controller: number of the controller.
        environment: number of the environment.
        name: name of the motion.

    Raises:
        ValueError: for results without frames, and frames of other robots.
    """
    robot = rollout_number(result.closest.shape, controller, environment)
    tree, frames, (right, *_, left) = rover.tree(), result.rollouts.frames, HUES
    rows = [
        ("sensor 1", right, LIGHT),
        ("sensor 2", left, LIGHT),
        ("left motor", left, VALUE),
        ("right motor", right, VALUE),
    ]
    return rigid_motion(
        tree,
        frames,
        robot,
        name=name,
        channels=frame_channels(tree, frames, robot, rows),
        shown={"sensor 1": 0, "sensor 2": 1},
        balls=dict.fromkeys(("sensor 1", "sensor 2"), rover.sensor_radius),
        lights=[[*np.asarray(lights, float)[environment], LIGHT_RADIUS]],
        light_radius=LIGHT_RADIUS,
    )
