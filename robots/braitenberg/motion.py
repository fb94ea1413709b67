"""Build motions of Braitenberg vehicles, which are points with a heading, shown as bodies of their size."""

import numpy as np

from robots.braitenberg import PUBLISHED, Traces, VehicleBody, VehicleTask
from robots.braitenberg.body import HALF_SIDE
from robots.view.motion import BALL, CUBE, Channel, Motion, Node, check_place, speed_channels, way_ahead, whole_frames
from robots.view.scene import HUES, INK, SLATE, STEEL, SUN
from taichi_sim.base.arrays import Floats
from taichi_sim.lattice.faces import rotate

HEIGHT, WHEEL = 0.1, 0.25  # m, of the body's box, and radius of its wheels
SENSOR = 0.06  # m, radius
LIGHT_HEIGHT = 0.3  # m
BOX_MIDDLE = WHEEL + HEIGHT / 2
SENSOR_HUES = [HUES[n] for n in (0, 3, 2, 1)]


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
        check_place(field, given, count, "the traces have")
    poses, readings = traces.poses[which, controller, environment], traces.readings[which, controller, environment]
    if len(readings) != len(body.sensors):
        raise ValueError(f"traces: they have {len(readings)} sensors, the body {len(body.sensors)}; give its own")
    check_place("environment", environment, len(task.lights), "the task has")
    light = task.lights[environment]
    away = np.hypot(*(poses[:, :2] - light).T)
    last = whole_frames(poses, readings.T)
    reached = np.flatnonzero(away[:last] < task.radius)
    last = int(reached[0]) + 1 if len(reached) else last
    times, poses, away = traces.times[:last], poses[:last], away[:last]
    rows = [
        Channel(f"sensor {n + 1}", "1/m²", times, values[:last], SENSOR_HUES[n % len(SENSOR_HUES)], logarithmic=True)
        for n, values in enumerate(readings)
    ]
    rows.append(Channel("from light", "m", times, away, SUN))
    way = way_ahead(poses[:, :2], poses[:-1, 2])
    nodes, offsets, sizes = _solids(body)
    zero = np.zeros(last)
    turn = np.stack([np.cos(poses[:, 2] / 2), zero, zero, np.sin(poses[:, 2] / 2)], axis=1)
    turns = np.repeat(turn[:, None], len(nodes), axis=1)
    centres = rotate(turns, np.broadcast_to(offsets, (last, *offsets.shape)))
    centres[..., :2] += poses[:, None, :2]
    return Motion(
        name,
        times,
        nodes,
        centres,
        turns,
        np.broadcast_to(sizes, (last, *sizes.shape)),
        np.column_stack([poses[:, :2], np.full(last, BOX_MIDDLE)]),
        (*rows, *speed_channels(times, way)),
        np.array([[*light, LIGHT_HEIGHT]]),
        0.15,
    )


def _solids(body: VehicleBody) -> tuple[tuple[Node, ...], Floats, Floats]:
    """Nodes of a vehicle, their places in its frame (x ahead) and their sizes [m], shape (N, 3) each."""
    wide, aside, ball = 2 * HALF_SIDE, HALF_SIDE + 0.08, 2 * SENSOR
    wheel = (2 * WHEEL, 0.16, 2 * WHEEL)
    parts = [
        (Node("body", CUBE, STEEL), (0.0, 0.0, BOX_MIDDLE), (wide, wide, HEIGHT)),
        (Node("bumper", CUBE, INK), (HALF_SIDE, 0.0, BOX_MIDDLE), (0.06, 0.7 * wide, 0.6 * HEIGHT)),
        (Node("left wheel", BALL, SLATE), (0.0, aside, WHEEL), wheel),
        (Node("right wheel", BALL, SLATE), (0.0, -aside, WHEEL), wheel),
    ]
    for n, (x, y) in enumerate(body.sensors):
        node = Node(f"sensor {n + 1}", BALL, SENSOR_HUES[n % len(SENSOR_HUES)], n)
        parts.append((node, (x, y, WHEEL + HEIGHT + SENSOR), (ball, ball, ball)))
    nodes, offsets, sizes = zip(*parts, strict=True)
    return nodes, np.array(offsets), np.array(sizes)
