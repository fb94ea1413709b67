"""Build motions of quadrupeds, with feet that show when they touch the ground."""

import numpy as np
from numpy.typing import ArrayLike

from robots.quadruped.body import LEGS, LIGHT_HEIGHT, Quadruped
from robots.quadruped.simulation import QuadrupedResult
from robots.view.motion import Motion
from robots.view.rigid_motion import LIGHT, SWITCH, VALUE, frame_channels, rigid_motion, rollout_number
from robots.view.scene import HUES, SUN
from taichi_sim.rigid import Frames


def quadruped_motion(
    quadruped: Quadruped,
    result: QuadrupedResult,
    lights: ArrayLike,
    controller: int = 0,
    environment: int = 0,
    *,
    name: str | None = None,
) -> Motion:
    """Build the motion of a simulated quadruped; its feet show when they touch the ground.

    Channels: feet on the ground, the light, motor neurons, distance and speed.

    Args:
        quadruped: the robot.
        result: result of ``simulate``, with frames.
        lights: places of the light in the environments, as given to ``simulate``, (E, 2) [m].
        controller: number of the controller.
        environment: number of the environment.
        name: name of the motion; by default that of the kind of robot.

    Raises:
        ValueError: for results without frames, and frames of other robots.
    """
    robot = rollout_number(result.light.shape, controller, environment)
    light = np.asarray(lights, float)[environment]
    return quadruped_frames(quadruped, result.rollouts.frames, robot, light, name=name)


def quadruped_frames(
    quadruped: Quadruped, frames: Frames | None, robot: int, light: ArrayLike, *, name: str | None = None
) -> Motion:
    """Build the motion of a quadruped of a batch from its frames, with its light at a place (x, y) [m].

    Raises:
        ValueError: as :func:`quadruped_motion`.
    """
    tree = quadruped.tree()
    legs, feet = range(len(LEGS)), "shin" if quadruped.kind == "legged" else "wheel"
    joints = {"legged": ("hip", "knee"), "wheeled": ("steer", "wheel"), "whegged": ("hip", "wheel")}[quadruped.kind]
    rows = [
        *((f"foot {leg + 1} on ground", HUES[leg], SWITCH) for leg in legs),
        ("light", SUN, LIGHT),
        *((f"{joint} {leg + 1}", HUES[leg], VALUE) for joint in joints for leg in legs),
    ]
    return rigid_motion(
        tree,
        frames,
        robot,
        name=name or f"{quadruped.kind} quadruped",
        channels=frame_channels(tree, frames, robot, rows),
        shown={f"{feet} {leg}": leg for leg in legs},
        hidden=[f"swivel {leg}" for leg in legs],  # inside their wheels
        lights=[[*np.asarray(light, float), LIGHT_HEIGHT]],
        light_radius=0.12,
    )
