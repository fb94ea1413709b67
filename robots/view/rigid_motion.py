"""Build motions of articulated robots: any tree, quadrupeds, the two-wheel vehicle."""

from collections.abc import Callable, Collection, Mapping, Sequence
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from robots.quadruped import LEGS, LIGHT_HEIGHT, Quadruped, QuadrupedResult
from robots.rover import LIGHT_RADIUS, Rover, RoverResult
from robots.view.motion import (
    BALL,
    Channel,
    Colour,
    Ground,
    Motion,
    Node,
    product,
    speed_channels,
    unit_quaternion,
    whole_frames,
)
from robots.view.scene import INK, PAIRS
from taichi_sim.base.arrays import Floats
from taichi_sim.lattice.faces import rotate
from taichi_sim.rigid import Box, Capsule, Frames, Sphere, Tree
from taichi_sim.rigid.model.shapes import Solid
from taichi_sim.rigid.pose import poses

STEEL, SLATE = (0.72, 0.73, 0.75), (0.36, 0.41, 0.47)
SUN = (0.95, 0.69, 0.12)
HUES: tuple[Colour, ...] = tuple((float(r), float(g), float(b)) for r, g, b in PAIRS)
DARK: Colour = (float(INK[0]), float(INK[1]), float(INK[2]))

Style = Callable[[str], tuple[Colour, int | None]]


def rigid_motion(
    tree: Tree,
    frames: Frames | None,
    robot: int = 0,
    *,
    name: str = "rigid robot",
    style: Style | None = None,
    channels: Sequence[Channel] = (),
    balls: Mapping[str, float] = MappingProxyType({}),
    hidden: Collection[str] = (),
    lights: ArrayLike = (),
    light_radius: float = 0.1,
) -> Motion:
    """Build the motion of a simulated articulated robot, with a node for each solid.

    Channels: those given, then distance from the start and speed of the base, seen from above.

    Args:
        tree: the robot.
        frames: frames of the engine's result.
        robot: number of the robot in the batch.
        name: name of the motion.
        style: colour of a body of a name, and the number of the channel that it shows.
        channels: rows of the timeline before distance and speed.
        balls: bodies without solids that are to be seen, with radii [m].
        hidden: bodies that are not to be seen.
        lights: their places [m], shape (L, 3).
        light_radius: radius of the balls that mark lights [m].

    Raises:
        ValueError: for results without frames, and frames of other robots.
    """
    _check(tree, frames, robot)
    assert frames is not None
    base = [a[:, robot] for a in (frames.position, frames.orientation, frames.angles)]
    last = whole_frames(*base)
    times = frames.times[:last]
    places, turns = poses(tree, *(a[:last].astype(float) for a in base))
    nodes, centres, quaternions, scales = list[Node](), list[Floats](), list[Floats](), list[float]()
    for n, (body, _) in enumerate(tree.ordered):
        if body.name in hidden:
            continue
        colour, channel = style(body.name) if style else (SLATE if n == 0 else STEEL, None)
        solids: list[Solid] = [*body.shapes, *([Sphere(balls[body.name])] if body.name in balls else ())]
        for k, solid in enumerate(solids):
            still, turn, scale = _canonical(solid)
            nodes.append(Node(f"{body.name} {k + 1}" if len(solids) > 1 else body.name, still, colour, channel))
            centres.append(places[:, n] + rotate(turns[:, n], np.broadcast_to(solid.centre, (last, 3))))
            quaternions.append(product(turns[:, n], np.broadcast_to(turn, (last, 4))))
            scales.append(scale)
    if not nodes:
        raise ValueError("tree: none of its bodies has a solid; give one, or balls")
    size = np.broadcast_to(np.array(scales)[:, None], (last, len(nodes), 3))
    path = places[:, 0]
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path[:, :2], axis=0).T))])
    rows = (*channels, *speed_channels(times, way, DARK))
    return Motion(
        name,
        times,
        tuple(nodes),
        np.stack(centres, 1),
        np.stack(quaternions, 1),
        size,
        path,
        rows,
        np.asarray(lights, float).reshape(-1, 3),
        light_radius,
        Ground(),
    )


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
    _check(tree, frames, robot)
    assert frames is not None
    rows = []
    for n, (sensor, values) in enumerate(zip(sensors, frames.readings[:, robot].T, strict=True)):
        lit = sensor == "light"
        colour = SUN if lit else HUES[n % len(HUES)]
        rows.append(_row(sensor, "1/m²" if lit else "", frames, values, colour, switch=not lit, logarithmic=lit))
    for n, (drive, values) in enumerate(zip(drives, frames.neurons[:, robot].T, strict=True)):
        rows.append(_row(drive, "", frames, values, HUES[n % len(HUES)]))
    return rigid_motion(tree, frames, robot, name=name, channels=rows, lights=lights)


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
    robot = _place(result.light.shape, controller, environment)
    tree, frames = quadruped.tree(), result.rollouts.frames
    _check(tree, frames, robot)
    assert frames is not None
    legs = len(LEGS)
    readings, neurons = frames.readings[:, robot].T, frames.neurons[:, robot].T
    rows = [
        _row(f"foot {leg + 1} on ground", "", frames, readings[leg] > 0.5, HUES[leg], switch=True)
        for leg in range(legs)
    ]
    rows.append(_row("light", "1/m²", frames, readings[legs], SUN, logarithmic=True))
    joints = {"legged": ("hip", "knee"), "wheeled": ("steer", "wheel"), "whegged": ("hip", "wheel")}[quadruped.kind]
    for number, values in enumerate(neurons):
        group, leg = divmod(number, legs)
        rows.append(_row(f"{joints[group]} {leg + 1}", "", frames, values, HUES[leg]))
    feet = "shin" if quadruped.kind == "legged" else "wheel"

    def style(body: str) -> tuple[Colour, int | None]:
        part, _, leg = body.partition(" ")
        return (HUES[int(leg)], int(leg)) if part == feet else (STEEL if leg else SLATE, None)

    place = [*np.asarray(lights, float)[environment], LIGHT_HEIGHT]
    hidden = [f"swivel {leg}" for leg in range(legs)]  # inside their wheels
    return rigid_motion(
        tree,
        frames,
        robot,
        name=name or f"{quadruped.kind} quadruped",
        style=style,
        channels=rows,
        hidden=hidden,
        lights=[place],
        light_radius=0.12,
    )


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

    Channels: sensors, motor neurons, distance and speed. Arguments and errors are those of :func:`quadruped_motion`.
    """
    robot = _place(result.closest.shape, controller, environment)
    tree, frames = rover.tree(), result.rollouts.frames
    _check(tree, frames, robot)
    assert frames is not None
    hues = (HUES[0], HUES[3])
    rows = [
        _row(f"sensor {n + 1}", "1/m²", frames, values, hues[n], logarithmic=True)
        for n, values in enumerate(frames.readings[:, robot].T)
    ]
    rows += [
        _row(f"{side} motor", "", frames, values, hue)
        for side, values, hue in zip(("left", "right"), frames.neurons[:, robot].T, hues[::-1], strict=True)
    ]

    def style(body: str) -> tuple[Colour, int | None]:
        sensor = {"sensor 1": 0, "sensor 2": 1}.get(body)
        return (SLATE if body == "body" else STEEL, None) if sensor is None else (hues[sensor], sensor)

    balls = dict.fromkeys(("sensor 1", "sensor 2"), rover.sensor_radius)
    place = [*np.asarray(lights, float)[environment], LIGHT_RADIUS]
    return rigid_motion(
        tree,
        frames,
        robot,
        name=name,
        style=style,
        channels=rows,
        balls=balls,
        lights=[place],
        light_radius=LIGHT_RADIUS,
    )


def _check(tree: Tree, frames: Frames | None, robot: int) -> None:
    """Return the frames if they were recorded and belong to this robot."""
    if frames is None or not len(frames.times):
        raise ValueError("frames: nothing was recorded; simulate with record_every")
    _, batch, hinges = frames.angles.shape
    if hinges != len(tree.hinges):
        raise ValueError(f"frames: they have {hinges} hinges, the robot {len(tree.hinges)}; give its own")
    if not 0 <= robot < batch:
        raise ValueError(f"robot: {robot} is not allowed; the batch has {batch}")


def _place(shape: tuple[int, ...], controller: int, environment: int) -> int:
    """Number of the rollout of a controller in an environment; environments change fastest."""
    for name, given, count in zip(("controller", "environment"), (controller, environment), shape, strict=True):
        if not 0 <= given < count:
            raise ValueError(f"{name}: {given} is not allowed; the result has {count}")
    return controller * shape[1] + environment


def _row(
    name: str,
    unit: str,
    frames: Frames,
    values: Floats,
    colour: Colour,
    switch: bool = False,
    logarithmic: bool = False,
) -> Channel:
    """Timeline row of values, cut off where the robot diverged."""
    last = whole_frames(np.asarray(values, float)[:, None])
    return Channel(name, unit, frames.times[:last], np.asarray(values[:last], float), colour, switch, logarithmic)


def _canonical(solid: Solid) -> tuple[Solid, Floats, float]:
    """Split a solid into a centred one along z, the rotation that gives it its direction, and a scale.

    Balls become the unit ball, so that all of them share one mesh.
    """
    upright = np.array([1.0, 0.0, 0.0, 0.0])
    if isinstance(solid, Sphere):
        return BALL, upright, 2 * solid.radius
    if isinstance(solid, Capsule):
        return Capsule(solid.radius, solid.length), unit_quaternion(solid.axis), 1.0
    x, y, z = (float(edge) for edge in solid.size)
    return Box((x, y, z)), upright, 1.0
