"""Build motions of articulated robots, from frames of any tree of rigid bodies."""

from collections.abc import Collection, Mapping, Sequence
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from robots.view import motion
from robots.view.motion import Channel, Motion, Node
from robots.view.scene import SLATE, STEEL, Colour
from taichi_sim.base.arrays import Floats
from taichi_sim.lattice.faces import rotate
from taichi_sim.rigid import Box, Capsule, Frames, Sphere, Tree
from taichi_sim.rigid.model.shapes import Solid
from taichi_sim.rigid.pose import poses

VALUE, SWITCH, LIGHT = "value", "switch", "light"  # what a reading or a neuron is
UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])


def rigid_motion(
    tree: Tree,
    frames: Frames | None,
    robot: int = 0,
    *,
    name: str = "rigid robot",
    channels: Sequence[Channel] = (),
    shown: Mapping[str, int] = MappingProxyType({}),
    balls: Mapping[str, float] = MappingProxyType({}),
    hidden: Collection[str] = (),
    lights: ArrayLike = (),
    light_radius: float = 0.1,
) -> Motion:
    """Build the motion of a simulated articulated robot, with a node for each solid.

    Channels: those given, then straight distance of the base from its start, seen from above, and how fast that grows.

    Args:
        tree: the robot.
        frames: frames of the engine's result.
        robot: number of the robot in the batch.
        name: name of the motion.
        channels: rows of the timeline before distance and speed.
        shown: numbers of the channels that bodies show, by names of bodies, which get the channels' colours.
        balls: radii of balls that show bodies without solids, by names of bodies [m].
        hidden: names of bodies that are not shown.
        lights: positions of the lights [m], shape (L, 3).
        light_radius: radius of the balls that mark lights [m].

    Raises:
        ValueError: if there are no frames, or they belong to another robot.
    """
    frames = _recorded(tree, frames, robot)
    base = [a[:, robot] for a in (frames.position, frames.orientation, frames.angles)]
    last = motion.whole_frames(*base)
    times = frames.times[:last]
    places, turns = poses(tree, *(a[:last].astype(float) for a in base))
    nodes, centres, quaternions, scales = list[Node](), list[Floats](), list[Floats](), list[float]()
    for n, (body, _) in enumerate(tree.ordered):
        if body.name in hidden:
            continue
        channel = shown.get(body.name)
        colour = channels[channel].colour if channel is not None else STEEL if n else SLATE
        solids: list[Solid] = [
            *body.shapes,
            *body.immersed,
            *([Sphere(balls[body.name])] if body.name in balls else ()),
        ]
        for k, solid in enumerate(solids):
            still, turn, scale = _canonical(solid)
            nodes.append(Node(f"{body.name} {k + 1}" if len(solids) > 1 else body.name, still, colour, channel))
            centres.append(places[:, n] + rotate(turns[:, n], np.broadcast_to(solid.centre, (last, 3))))
            quaternions.append(motion.product(turns[:, n], np.broadcast_to(turn, (last, 4))))
            scales.append(scale)
    if not nodes:
        raise ValueError("tree: none of its bodies has a solid; give one, or balls")
    path = places[:, 0]
    way = np.hypot(*(path - path[0])[:, :2].T)  # a sum of steps would grow with the frames, as bases swing
    return Motion(
        name,
        times,
        tuple(nodes),
        np.stack(centres, 1),
        np.stack(quaternions, 1),
        np.broadcast_to(np.array(scales)[:, None], (last, len(nodes), 3)),
        path,
        (*channels, *motion.speed_channels(times, way)),
        np.asarray(lights, float).reshape(-1, 3),
        light_radius,
        centre_of_mass=np.average(places, axis=1, weights=[body.mass for body, _ in tree.ordered]),
    )


def frame_channels(
    tree: Tree, frames: Frames | None, robot: int, rows: Sequence[tuple[str, Colour, str]]
) -> list[Channel]:
    """Timeline rows of all readings, then all neurons; each ends where it is no longer finite after a divergence.

    Args:
        tree: the robot.
        frames: frames of the engine's result.
        robot: number of the robot in the batch.
        rows: name, colour and kind of each: ``VALUE``, ``SWITCH`` or ``LIGHT``.

    Raises:
        ValueError: for results without frames, and frames of other robots.
    """
    frames, channels = _recorded(tree, frames, robot), list[Channel]()
    columns = np.concatenate([frames.readings[:, robot], frames.neurons[:, robot]], axis=1).astype(float).T
    for (name, colour, kind), values in zip(rows, columns, strict=True):
        last = motion.whole_frames(values)
        shown = values[:last] > 0.5 if kind == SWITCH else values[:last]
        unit = "1/m²" if kind == LIGHT else ""
        channels.append(Channel(name, unit, frames.times[:last], shown, colour, kind == SWITCH, kind == LIGHT))
    return channels


def rollout_number(shape: tuple[int, ...], controller: int, environment: int) -> int:
    """Number of the rollout of a controller in an environment; the environment index varies fastest."""
    controllers, environments = shape
    motion.check_place("controller", controller, controllers, "the result has")
    motion.check_place("environment", environment, environments, "the result has")
    return controller * environments + environment


def _recorded(tree: Tree, frames: Frames | None, robot: int) -> Frames:
    """Return the frames if they were recorded and belong to this robot."""
    frames = motion.recorded(frames)
    _, batch, hinges = frames.angles.shape
    if hinges != len(tree.hinges):
        raise ValueError(f"frames: they have {hinges} hinges, the robot {len(tree.hinges)}; give its own")
    motion.check_place("robot", robot, batch, "the batch has")
    return frames


def _canonical(solid: Solid) -> tuple[Solid, Floats, float]:
    """Split a solid into a centred one along z, the rotation that gives it its direction, and a scale.

    Balls become the unit ball, so that all of them share one mesh.
    """
    if isinstance(solid, Sphere):
        return motion.BALL, UPRIGHT, 2 * solid.radius
    if isinstance(solid, Capsule):
        return Capsule(solid.radius, solid.length), motion.unit_quaternion(solid.axis), 1.0
    x, y, z = (float(edge) for edge in solid.size)
    return Box((x, y, z)), UPRIGHT, 1.0
