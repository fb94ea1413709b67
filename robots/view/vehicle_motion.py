"""Build motions of Braitenberg vehicles, which are points with a heading, shown as bodies of their size."""

import numpy as np

from robots.braitenberg import PUBLISHED, Traces, VehicleBody, VehicleTask
from robots.braitenberg.body import HALF_SIDE
from robots.view.motion import BALL, CUBE, Channel, Colour, Motion, Node, speed_channels, whole_frames
from robots.view.rigid_motion import DARK, HUES, SLATE, STEEL, SUN
from taichi_sim.base.arrays import Floats
from taichi_sim.lattice.faces import rotate

HEIGHT, WHEEL = 0.1, 0.25  # m, of the body's box, and radius of its wheels
SENSOR = 0.06  # m, radius
LIGHT_HEIGHT = 0.3  # m
BOX_MIDDLE = WHEEL + HEIGHT / 2


def vehicle_motion(
    traces: Traces,
    body: VehicleBody,
    task: VehicleTask = PUBLISHED,
    *,
    which: int = 0,
    controller: int = 0,
    environment: int = 0,
    name: str = "Braitenberg vehicle",
) -> Motion:
    """Build the motion of a vehicle up to the light, or to the end; its sensors show what they read.

    The model is a point with a heading and sensors: box, bumper and wheels are there to be seen. Channels: sensors,
    distance from the light, way gone and speed, both ahead.

    Args:
        traces: traces of the vehicle.
        body: body of the vehicle.
        task: that it was given.
        which: place of the body among the traces.
        controller: number of the controller.
        environment: number of the environment.
        name: name of the motion.

    Raises:
        ValueError: for traces of other bodies and tasks, and places that are not there.
    """
    places = {"which": which, "controller": controller, "environment": environment}
    for (field, given), count in zip(places.items(), traces.poses.shape[:3], strict=True):
        if not 0 <= given < count:
            raise ValueError(f"{field}: {given} is not allowed; the traces have {count}")
    poses, readings = traces.poses[which, controller, environment], traces.readings[which, controller, environment]
    if len(readings) != len(body.sensors):
        raise ValueError(f"traces: they have {len(readings)} sensors, the body {len(body.sensors)}; give its own")
    if environment >= len(task.lights):
        raise ValueError(f"environment: {environment} is not allowed; the task has {len(task.lights)}")
    light = task.lights[environment]
    away = np.hypot(*(poses[:, :2] - light).T)
    last = whole_frames(poses, readings.T)
    reached = np.flatnonzero(away[:last] < task.radius)
    last = int(reached[0]) + 1 if len(reached) else last
    times, poses, away = traces.times[:last], poses[:last], away[:last]
    rows = [
        Channel(f"sensor {n + 1}", "1/m²", times, values[:last], _hue(n), logarithmic=True)
        for n, values in enumerate(readings)
    ]
    rows.append(Channel("from light", "m", times, away, SUN))
    moved = np.diff(poses[:, :2], axis=0)
    ahead = np.stack([np.cos(poses[:-1, 2]), np.sin(poses[:-1, 2])], axis=1)
    way = np.concatenate([[0.0], np.cumsum((moved * ahead).sum(axis=1))])
    nodes, offsets, sizes = _solids(body)
    zero = np.zeros(last)
    turn = np.stack([np.cos(poses[:, 2] / 2), zero, zero, np.sin(poses[:, 2] / 2)], axis=1)
    turns = np.repeat(turn[:, None], len(nodes), axis=1)
    centres = rotate(turns, np.broadcast_to(offsets, (last, *offsets.shape)))
    centres[..., :2] += poses[:, None, :2]
    scale = np.broadcast_to(sizes, (last, *sizes.shape))
    path = np.column_stack([poses[:, :2], np.full(last, BOX_MIDDLE)])
    return Motion(
        name,
        times,
        tuple(nodes),
        centres,
        turns,
        scale,
        path,
        (*rows, *speed_channels(times, way, DARK)),
        np.array([[*light, LIGHT_HEIGHT]]),
        0.15,
    )


def _solids(body: VehicleBody) -> tuple[list[Node], Floats, Floats]:
    """Nodes of a vehicle, their places in its frame (x ahead) and their sizes [m], shape (N, 3) each."""
    wide = 2 * HALF_SIDE
    parts = [
        (Node("body", CUBE, STEEL), (0.0, 0.0, BOX_MIDDLE), (wide, wide, HEIGHT)),
        (Node("bumper", CUBE, DARK), (HALF_SIDE, 0.0, BOX_MIDDLE), (0.06, 0.7 * wide, 0.6 * HEIGHT)),
        *(
            (Node(f"{side} wheel", BALL, SLATE), (0.0, y, WHEEL), (2 * WHEEL, 0.16, 2 * WHEEL))
            for side, y in (("left", HALF_SIDE + 0.08), ("right", -HALF_SIDE - 0.08))
        ),
        *(
            (Node(f"sensor {n + 1}", BALL, _hue(n), n), (x, y, WHEEL + HEIGHT + SENSOR), (2 * SENSOR,) * 3)
            for n, (x, y) in enumerate(body.sensors)
        ),
    ]
    nodes, offsets, sizes = zip(*parts, strict=True)
    return list(nodes), np.array(offsets), np.array(sizes)


def _hue(sensor: int) -> Colour:
    return (HUES[0], HUES[3], HUES[2], HUES[1])[sensor % len(HUES)]
