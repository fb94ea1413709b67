"""Arrays that describe trees to kernels: the plan, which all robots of a batch share, and the parameters of each."""

import math
from collections.abc import Sequence
from dataclasses import astuple, dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from taichi_sim.base.arrays import Floats
from taichi_sim.ground.laws import FIRM
from taichi_sim.ground.relief import Relief
from taichi_sim.rigid import slots
from taichi_sim.rigid.model.shapes import Vector, vector
from taichi_sim.rigid.model.tree import Hinge, Motor, Servo, Tree

Ints = NDArray[np.int32]


@dataclass(frozen=True)
class Senses:
    """Touch and light sensors of a robot, in the order of its controller's inputs.

    Attributes:
        touch: names of bodies that feel whether they touch the ground.
        light: light sensors, as names of bodies and places from their centres at rest [m].
    """

    touch: Sequence[str] = ()
    light: Sequence[tuple[str, Vector]] = ()

    @property
    def count(self) -> int:
        """Number of sensors."""
        return len(self.touch) + len(self.light)


def plan_of(tree: Tree, senses: Senses, commands: int = 0, *, wet: bool = False, granular: bool = False) -> Ints:
    """The plan of a tree's memory (see ``slots``), but for the numbers of a run; trees of one structure have the same.

    Args:
        tree: the robot.
        senses: what it senses.
        commands: how many commands it is given over time, 0 for neurons.
        wet: whether there is water, in which its bodies are portions.
        granular: whether there is sand, which finds the surface of its points.

    Raises:
        ValueError: for senses of bodies that do not exist or cannot touch.
    """
    points = [n for n, _, _ in tree.points()]
    eyes = [tree.place_of(name) for name, _ in senses.light]
    portions = [n for n, _ in tree.portions()] if wet else []
    rows, paths = _structure(tree, senses)
    bodies, depth, sensors, motors, pairs = (
        *paths.shape,
        senses.count,
        tree.motors,
        len(points) * (len(points) + 1) // 2,
    )
    point_width = slots.HINGES + depth
    plan: Ints = np.zeros(slots.PLACES, np.int32)
    touches, parts = len(senses.touch), len(portions)
    plan[: slots.HOLD] = bodies, len(points), touches, len(eyes), sensors, motors, depth, commands, parts
    widths = (  # from BODY to FACTOR
        *(slots.BODY_WIDTH * bodies, slots.PARAMETER_WIDTH * bodies, point_width * len(points)),
        *(slots.POINT_PARAMETER_WIDTH * len(points), slots.LIGHT_PARAMETER_WIDTH * len(eyes)),
        *(slots.WATER_WIDTH * wet, slots.PORTION_WIDTH * parts, slots.WET_BODY_WIDTH * bodies * wet),
        *(width * granular for width in (slots.SAND_WIDTH, slots.PATCH_WIDTH * len(points))),
        slots.SANDY_POINT_WIDTH * len(points) * granular,
        *(sensors, motors, sensors * motors, commands * motors, pairs, pairs),
    )
    plan[slots.BODY : slots.SLOTS + 1] = slots.HEAD + np.cumsum([0, *widths])
    body_slots = plan[slots.BODY] + slots.BODY_WIDTH * np.arange(bodies)[:, None]
    impulses = plan[slots.POINT] + slots.IMPULSES + point_width * np.arange(len(points))[:, None]
    pose, neurons = np.arange(slots.POSE_WIDTH), plan[slots.NEURON] + np.arange(motors)
    readings = plan[slots.READING] + np.arange(sensors)
    state = _listed(pose, body_slots + np.arange(slots.STATE_WIDTH), neurons, impulses + np.arange(2))
    frame = _listed(pose, body_slots[tree.hinged] + slots.ANGLE, readings, neurons)
    # All but the first from POINT_BODIES on.
    lists = rows.ravel(), _listed(points), paths.ravel(), _listed(eyes), _listed(portions), state, frame
    plan[[slots.KEPT, slots.FRAME_WIDTH]] = len(state), len(frame)
    plan[slots.POINT_BODIES :] = slots.PLACES + np.cumsum([len(each) for each in lists[:-1]])
    return np.concatenate([plan, *lists])


def _listed(*parts: ArrayLike) -> Ints:
    return np.concatenate([np.ravel(part) for part in parts]).astype(np.int32)


def _structure(tree: Tree, senses: Senses) -> tuple[Ints, Ints]:
    """Integers of bodies, (bodies, columns), and the hinged bodies between the base and each of them."""
    touchable = {n for n, _, _ in tree.points()}
    feeling = {tree.place_of(name): s for s, name in enumerate(senses.touch)}
    for n, s in feeling.items():
        if n not in touchable:
            raise ValueError(f"touch: {senses.touch[s]!r} has no shape that could touch; give a body with one")
    if len(feeling) < len(senses.touch):
        raise ValueError(f"touch: {list(senses.touch)!r} is not allowed; give each body once")
    chains: list[list[int]] = []
    rows = np.full((len(tree.bodies), slots.BODY_COLUMNS), -1, np.int32)
    for n, (_, joint) in enumerate(tree.ordered):
        hinged = isinstance(joint, Hinge)
        chains.append([] if n == 0 else chains[tree.parents[n]] + [n] * hinged)
        motor = joint.command if isinstance(joint, Hinge) and joint.motor is not None else -1
        rows[n] = tree.parents[n], hinged, motor, len(chains[n]), feeling.get(n, -1)
    paths = np.zeros((len(chains), max(1, *map(len, chains))), np.int32)
    for n, chain in enumerate(chains):
        paths[n, : len(chain)] = chain
    return rows, paths


def parameters_of(tree: Tree) -> Floats:
    """Parameters of all bodies, (bodies, PARAMETER_WIDTH)."""
    found = np.zeros((len(tree.bodies), slots.PARAMETER_WIDTH))
    for n, (body, joint) in enumerate(tree.ordered):
        each, position = found[n], np.array(body.position, float)
        each[slots.MASS] = body.mass or 1.0  # of a fixed base, which no mass moves; laws divide by it
        inertia = np.asarray(body.inertia)
        each[slots.REST_INERTIA : slots.REST_INERTIA + 6] = inertia[np.tril_indices(3)]
        each[[slots.LOWER, slots.UPPER]] = -slots.NO_STOP, slots.NO_STOP
        if joint is None:
            continue
        of_parent = np.array(tree.ordered[tree.parents[n]][0].position, float)
        anchor = np.array(joint.anchor, float) if isinstance(joint, Hinge) else position
        each[slots.CENTRE : slots.CENTRE + 3] = position - anchor
        each[slots.ANCHOR : slots.ANCHOR + 3] = anchor - of_parent
        if isinstance(joint, Hinge):
            each[slots.AXIS : slots.AXIS + 3] = np.array(joint.axis) / np.linalg.norm(joint.axis)
            if (motor := joint.motor) is not None:
                torque = slots.NO_LIMIT if motor.torque is None else motor.torque
                each[slots.TORQUE : slots.OFFSET + 1] = torque, motor.by_command, motor.by_angle, motor.offset
                fastest = motor.fastest if isinstance(motor, Motor) else None
                each[slots.FASTEST] = slots.NO_STOP if fastest is None else fastest
            if joint.stops is not None:
                each[[slots.LOWER, slots.UPPER]] = joint.stops
            *spring, each[slots.DRY_FRICTION] = astuple(joint.passive)
            each[slots.ROTOR : slots.SPRING_REST + 1] = spring
            each[slots.BY_RATE] = _drag(tree, joint, motor) if isinstance(motor, Servo) else -1.0
    return found


def _drag(tree: Tree, hinge: Hinge, servo: Servo) -> float:
    """Torque of a servo against its rate [N m s/rad]; a damper is critical at 2 sqrt(stiffness inertia)."""
    if servo.damping_ratio == 0:
        return servo.by_rate
    return servo.by_rate + 2 * servo.damping_ratio * math.sqrt(-servo.by_angle * tree.inertia_about(hinge))


def points_of(tree: Tree) -> Floats:
    """Centres and radii of all points, (points, 4)."""
    return np.array([(*centre, radius) for _, centre, radius in tree.points()]).reshape(-1, 4)


def portions_of(tree: Tree, pressure_drag: float, friction_drag: float) -> Floats:
    """What water knows of the portions of a tree, (portions, PORTION_WIDTH), see ``slots``."""
    lower, found = np.tril_indices(3), []
    for _, each in tree.portions():
        drag = pressure_drag * each.faces.pressure + friction_drag * each.faces.friction
        found.append((*each.centre, *each.spread[lower], each.volume, each.is_ball, *drag[lower]))
    return np.array(found).reshape(-1, slots.PORTION_WIDTH)


def water_of(relief: Relief, gravity: float) -> Floats:
    """The water on a ground, (WATER_WIDTH,), see ``slots``; its weight is that by the world's gravity [m/s^2]."""
    water = relief.water
    assert water is not None
    per_volume = max(0.0, -gravity), water.added_mass, 0.5
    return np.array([water.level, *(water.density * factor for factor in per_volume)])


def patches_of(tree: Tree) -> Floats:
    """What sand knows of the surface of the points of a tree, (points, PATCH_WIDTH), see ``slots``."""
    found = [(*each.ball, each.length, *each.axis, *each.edges) for each in tree.patches()]
    return np.array(found).reshape(-1, slots.PATCH_WIDTH)


def sand_of(relief: Relief) -> Floats:
    """The sand of a ground, (SAND_WIDTH,), see ``slots``."""
    return np.array([FIRM if relief.yield_per_depth is None else relief.yield_per_depth])


def eyes_of(senses: Senses) -> Floats:
    """Places of light sensors on their bodies, (sensors, 3)."""
    return np.array([vector("light", place) for _, place in senses.light]).reshape(-1, 3)
