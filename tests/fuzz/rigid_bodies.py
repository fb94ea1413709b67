"""Random articulated robots: bodies of all solids, joined by hinges and welds, with all kinds of drives."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from taichi_sim.rigid import Body, Box, Capsule, Hinge, Motor, Passive, Servo, Sphere, Tree, Weld
from taichi_sim.rigid.model.shapes import Solid
from taichi_sim.rigid.model.tree import Joint

HIGH = 0.35  # m: where the base is


def draw_tree(rng: np.random.Generator) -> tuple[Tree, list[str]]:
    """A robot of one to seven bodies, and words for what it has."""
    count = int(rng.integers(1, 8))
    bodies, joints, features = [draw_body(rng, "body-0", np.array([0.0, 0.0, HIGH]))], list[Joint](), []
    commands = int(rng.integers(1, 5))
    for n in range(1, count):
        parent = bodies[int(rng.integers(n))]
        place = np.add(parent.position, rng.uniform(-0.2, 0.2, 3))
        bodies.append(draw_body(rng, f"body-{n}", place))
        anchor = (place + parent.position) / 2 + rng.uniform(-0.05, 0.05, 3)
        joints.append(draw_joint(rng, parent.name, bodies[-1].name, anchor, commands))
    fixed = count > 1 and rng.random() < 0.15
    hinges = [joint for joint in joints if isinstance(joint, Hinge)]
    motors = [hinge for hinge in hinges if hinge.motor is not None]
    features += ["fixed base"] * fixed + ["hinges"] * bool(hinges) + ["welds"] * (len(hinges) < len(joints))
    features += ["motors"] * bool(motors) + ["free hinges"] * (len(motors) < len(hinges))
    features += ["stops"] * any(hinge.stops is not None for hinge in hinges)
    features += ["limited rates"] * any(
        isinstance(hinge.motor, Motor) and hinge.motor.fastest is not None for hinge in motors
    )
    features += ["solids that touch nothing"] * any(body.immersed for body in bodies)
    return Tree(bodies, joints, bool(fixed)), features


def draw_body(rng: np.random.Generator, name: str, place: np.ndarray) -> Body:
    """A body of up to two solids, not always where its mass is; one without any is a mass that touches nothing."""
    mass, edges = float(rng.uniform(0.2, 3)), rng.uniform(0.05, 0.3, 3) ** 2
    shapes = [draw_solid(rng) for _ in range(int(rng.choice([0, 1, 2], p=[0.15, 0.65, 0.2])))]
    immersed = [draw_solid(rng)] if rng.random() < 0.15 else []
    inertia = None
    if len(shapes) != 1 or rng.random() < 0.5:
        turned = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        inertia = turned @ np.diag(mass / 12 * (edges.sum() - edges)) @ turned.T
        shapes = [replace(shape, centre=tuple(rng.uniform(-0.05, 0.05, 3).tolist())) for shape in shapes]
    return Body(name, tuple(place.tolist()), mass, shapes, inertia, immersed)


def draw_solid(rng: np.random.Generator) -> Solid:
    """A ball, a capsule along any axis, or a box."""
    kind, radius = rng.integers(3), float(rng.uniform(0.02, 0.08))
    if kind == 0:
        return Sphere(radius)
    if kind == 1:
        return Capsule(radius, float(rng.uniform(0.05, 0.3)), tuple(draw_axis(rng).tolist()))
    return Box(tuple(rng.uniform(0.05, 0.3, 3).tolist()))


def draw_axis(rng: np.random.Generator) -> np.ndarray:
    """Any direction; often that of a coordinate."""
    axis: np.ndarray = np.eye(3)[rng.integers(3)] if rng.random() < 0.5 else rng.normal(size=3)
    return axis / np.linalg.norm(axis)


def draw_joint(rng: np.random.Generator, parent: str, child: str, anchor: np.ndarray, commands: int) -> Joint:
    """A weld, or a hinge with any motor or none, and with stops or without."""
    if rng.random() < 0.2:
        return Weld(parent, child)
    torque, fastest = float(10 ** rng.uniform(-1, 2)), float(rng.uniform(1, 8))
    motor: Motor | None = Motor.velocity(fastest, torque)
    if rng.random() < 0.5:
        low = float(rng.uniform(-1.5, 0))
        speed, slow = float(rng.uniform(1, 10)), fastest if rng.random() < 0.5 else None
        motor = Motor.position(low, low + float(rng.uniform(0.2, 2)), speed, torque, slow)
    if rng.random() < 0.25:
        motor = None
    stops = (float(rng.uniform(-1, -0.05)), float(rng.uniform(0.05, 1))) if rng.random() < 0.35 else None
    place, axis = tuple(anchor.tolist()), tuple(draw_axis(rng).tolist())
    return Hinge(parent, child, place, axis, motor, int(rng.integers(commands)), stops)


def with_dynamics(rng: np.random.Generator, tree: Tree) -> tuple[Tree, list[str]]:
    """The tree, half of whose robots have servos, rotors, dampers and springs at some hinges, and words for these."""
    if rng.random() < 0.5:
        return tree, []
    joints = [
        replace(joint, passive=draw_passive(rng)) if isinstance(joint, Hinge) and rng.random() < 0.5 else joint
        for joint in tree.joints
    ]
    joints = [
        replace(joint, motor=draw_servo(rng))
        if isinstance(joint, Hinge) and joint.motor and rng.random() < 0.5
        else joint
        for joint in joints
    ]
    hinges = [joint for joint in joints if isinstance(joint, Hinge)]
    found = [hinge.passive for hinge in hinges]
    given = {
        "servos": any(isinstance(hinge.motor, Servo) for hinge in hinges),
        "rotors": any(each.rotor_inertia for each in found),
        "dampers": any(each.damping for each in found),
        "springs": any(each.stiffness for each in found),
        "rubbing hinges": any(each.friction for each in found),
    }
    return Tree(tree.bodies, joints, tree.fixed), [word for word, has in given.items() if has]


def draw_passive(rng: np.random.Generator) -> Passive:
    """A rotor, damper, spring and friction, each in two of three hinges; from far less to far more than bodies have."""
    rotor, damping, stiffness, friction = (
        float(10 ** rng.uniform(*ends)) if rng.random() < 0.67 else 0.0 for ends in ((-5, 0), (-3, 1), (-2, 4), (-3, 1))
    )
    return Passive(rotor, damping, stiffness, float(rng.uniform(-0.6, 0.6)), friction)


def draw_servo(rng: np.random.Generator) -> Servo:
    """A servo by angle, by rate, or by torque alone, of any strength, with a largest torque or without."""
    kind, torque = rng.integers(3), float(10 ** rng.uniform(-1, 2)) if rng.random() < 0.6 else None
    if kind == 0:
        low, damping = float(rng.uniform(-1.5, 0)), float(10 ** rng.uniform(-2, 1)) if rng.random() < 0.8 else 0.0
        return Servo.position(low, low + float(rng.uniform(0.2, 2)), float(10 ** rng.uniform(-1, 3)), damping, torque)
    if kind == 1:
        by_rate = float(10 ** rng.uniform(-2, 1))
        return Servo(by_rate * float(rng.uniform(1, 8)), by_rate=by_rate, torque=torque)
    return Servo(float(10 ** rng.uniform(-1, 1)), offset=float(rng.uniform(-0.2, 0.2)), torque=torque)


def scaled(drive: Motor | Servo, **factors: float) -> dict[str, float]:
    """Numbers of a drive times factors; a torque without a limit has none."""
    return {name: getattr(drive, name) * factor for name, factor in factors.items() if getattr(drive, name) is not None}


def varied(rng: np.random.Generator, tree: Tree) -> Tree:
    """Like the tree, with other masses, places and torques; as another robot of the batch."""
    by = lambda: float(rng.uniform(0.8, 1.25))  # noqa: E731
    moved = lambda place: tuple((np.array(place) + rng.uniform(-0.02, 0.02, 3)).tolist())  # noqa: E731
    bodies = [
        replace(body, mass=body.mass * factor, position=moved(body.position), inertia=np.array(body.inertia) * factor)
        for body, factor in ((body, by()) for body in tree.bodies)
    ]
    return Tree(bodies, [_varied_joint(joint, by(), moved) for joint in tree.joints], tree.fixed)


def _varied_joint(joint: Joint, factor: float, moved) -> Joint:
    if not isinstance(joint, Hinge):
        return joint
    motor = joint.motor and replace(joint.motor, **scaled(joint.motor, torque=factor))
    return replace(joint, anchor=moved(joint.anchor), motor=motor)


def touchable(tree: Tree) -> Sequence[str]:
    """Names of bodies with shapes that touch the ground."""
    return [body.name for body in tree.bodies if body.shapes]
