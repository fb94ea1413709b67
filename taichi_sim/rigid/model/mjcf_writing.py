"""Writes MJCF of any tree, such as that of a URDF file, which other simulators can play as it stands."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from taichi_sim.base.arrays import Floats
from taichi_sim.rigid.model.settings import Physics
from taichi_sim.rigid.model.shapes import Capsule, Solid, Sphere, unit
from taichi_sim.rigid.model.tree import Body, Hinge, Motor, Servo, Tree

SHORTER = 8  # times as short are time steps of robots whose drives hold rates here
WITHOUT_CONE = 100.0  # coefficient of friction that stands for ground without a cone
TAKEN = "world"  # a name that MuJoCo gives to what is fixed
FLATTEST = 1 - 1e-12  # share of the sum of two principal moments that MuJoCo lets the third be, with its rounding
LEAST_MOMENT = 2e-15  # kg m^2 that MuJoCo takes


def mjcf_text(tree: Tree, physics: Physics, drives: Sequence[str] = (), name: str = "robot") -> str:
    """Write a tree on level ground as MJCF: bodies with their solids, hinges, drives, and a plane.

    Bodies have the axes of the world at rest, as here, and start standing on the ground; solids touch only that. A
    drive is told what :func:`drive_commands` makes of commands. Drives that hold rates become servos by rate,
    which come to it in a time step; for their sake time steps are ``SHORTER``.

    Args:
        tree: the robot.
        physics: time step, gravity and friction; the tilt of a slope is in its gravity.
        drives: names of the drives, in the order of commands; by default numbers.
        name: of the model.

    Raises:
        ValueError: for a body whose inertia MuJoCo does not take.
    """
    root = ElementTree.Element("mujoco", model=name)
    ElementTree.SubElement(root, "compiler", angle="radian", autolimits="true")
    gravity = (*physics.gravity_across, physics.gravity)
    step = written_step(tree, physics)
    settings = {"timestep": _number(step), "gravity": _row(gravity)}
    ElementTree.SubElement(root, "option", settings, integrator="implicitfast", cone="elliptic")
    world = ElementTree.SubElement(root, "worldbody")
    rubs = physics.friction if math.isfinite(physics.friction) else WITHOUT_CONE
    floor = {"friction": f"{_number(rubs)} 0.005 0.0001", "priority": "1", "contype": "1", "conaffinity": "0"}
    ElementTree.SubElement(world, "geom", floor, name="floor", type="plane", size="0 0 1")
    centres, radii = tree.balls()
    lift = np.array([0.0, 0.0, 0.0 if tree.fixed else -float((centres[:, 2] - radii).min())])
    called = _names(tree)
    made: dict[str, ElementTree.Element] = {}
    places = {body.name: np.array(body.position, float) + lift for body, _ in tree.ordered}
    for body, joint in tree.ordered:
        parent, origin = (world, np.zeros(3)) if joint is None else (made[joint.parent], places[joint.parent])
        made[body.name] = _body(parent, called[body.name], body, places[body.name] - origin)
        if joint is None and not tree.fixed:
            ElementTree.SubElement(made[body.name], "freejoint")
        if isinstance(joint, Hinge):
            _hinge(made[body.name], called[body.name], joint, np.subtract(joint.anchor, body.position))
        for solid in body.shapes:
            _geom(made[body.name], solid)
    _drives(root, tree, drives, step, called)
    ElementTree.indent(root, "  ")
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def _names(tree: Tree) -> dict[str, str]:
    """What bodies, and the joints that carry them, are called in the file: as here, but none is the world."""
    names = [body.name for body, _ in tree.ordered]
    free = next(name for n in range(len(names) + 1) if (name := f"{TAKEN}{'_' * (n + 1)}") not in names)
    return {name: free if name == TAKEN else name for name in names}


def _body(parent: ElementTree.Element, name: str, body: Body, place: Floats) -> ElementTree.Element:
    """A body whose frame is at its centre of mass, with its principal moments of inertia.

    Raises:
        ValueError: for moments that MuJoCo does not take.
    """
    made = ElementTree.SubElement(parent, "body", name=name, pos=_row(place))
    if body.mass > 0:
        moments, axes = np.linalg.eigh(np.asarray(body.inertia, float))
        if moments[0] < LEAST_MOMENT:
            raise ValueError(
                f"inertia of {body.name}: a moment of {moments[0]:.3g} kg m^2 is not allowed in MJCF; give at least "
                f"{LEAST_MOMENT:g}"
            )
        moments[2] = min(moments[2], FLATTEST * (moments[0] + moments[1]))  # rounding may leave a flat body more
        x, y, z, w = Rotation.from_matrix(axes * np.linalg.det(axes)).as_quat()
        given = {"mass": _number(body.mass), "diaginertia": _row(moments), "quat": _row([w, x, y, z])}
        ElementTree.SubElement(made, "inertial", given, pos="0 0 0")
    return made


def _hinge(body: ElementTree.Element, name: str, hinge: Hinge, anchor: Floats) -> None:
    """The joint of a body, whose angles are as the file of the robot counted them."""
    acts = hinge.passive
    told = {"name": name, "type": "hinge", "pos": _row(anchor), "axis": _row(unit("axis", hinge.axis))}
    if hinge.stops is not None:
        told["range"] = _row(np.add(hinge.stops, hinge.rest))
    told |= {
        key: _number(value)
        for key, value in {
            "ref": hinge.rest,
            "armature": acts.rotor_inertia,
            "damping": acts.damping,
            "stiffness": acts.stiffness,
            "springref": acts.spring_rest + hinge.rest if acts.stiffness else 0.0,
            "frictionloss": acts.friction,
        }.items()
        if value
    }
    ElementTree.SubElement(body, "joint", told)


def _geom(body: ElementTree.Element, solid: Solid) -> None:
    """A solid, which touches the plane and no other solid."""
    told = {"contype": "0", "conaffinity": "1", "pos": _row(solid.centre)}
    if isinstance(solid, Sphere):
        told |= {"type": "sphere", "size": _number(solid.radius)}
    elif isinstance(solid, Capsule):
        size = _row([solid.radius, solid.length / 2])
        told |= {"type": "capsule", "size": size, "zaxis": _row(unit("axis", solid.axis))}
    else:
        told |= {"type": "box", "size": _row(np.array(solid.size) / 2)}
    ElementTree.SubElement(body, "geom", told)


def _drives(
    root: ElementTree.Element, tree: Tree, names: Sequence[str], step: float, called: Mapping[str, str]
) -> None:
    """An actuator for each hinge with a drive, in the order of the robot's commands; ``called``: bodies in the file."""
    driven = sorted((hinge for hinge in tree.hinges if hinge.motor is not None), key=lambda each: each.command)
    if not driven:
        return
    drives = ElementTree.SubElement(root, "actuator")
    sharing = Counter(hinge.command for hinge in driven)
    for hinge in driven:
        motor = hinge.motor
        assert motor is not None
        by_angle, by_rate = law_of(tree, hinge, step)
        gain = -by_angle or by_rate or 1.0
        told = {"gainprm": _number(gain), "biastype": "affine", "biasprm": _row([0.0, by_angle, -by_rate])}
        told["ctrlrange"] = _row(np.sort(drive_commands(hinge, np.array([-1.0, 1.0]))[0]))
        if motor.torque is not None:
            told["forcerange"] = _row([-motor.torque, motor.torque])
        name = names[hinge.command] if names else f"drive {hinge.command}"
        if sharing[hinge.command] > 1:
            name = f"{name} of {called[hinge.child]}"
        ElementTree.SubElement(drives, "general", told, name=name, joint=called[hinge.child])


def drive_commands(hinge: Hinge, commands: Floats) -> tuple[Floats, str]:
    """Return what commands from -1 to 1, shape (N,), mean to the drive of a hinge, and its unit.

    It is an angle as the file counts it [rad], else a rate [rad/s], else a torque [N m].
    """
    motor = hinge.motor
    assert motor is not None
    told = motor.by_command * commands + motor.offset
    if motor.by_angle != 0:
        return told / -motor.by_angle + hinge.rest, "rad"
    if isinstance(motor, Servo):
        return (told / motor.by_rate, "rad/s") if motor.by_rate > 0 else (told, "N m")
    return told if motor.fastest is None else np.clip(told, -motor.fastest, motor.fastest), "rad/s"


def written_step(tree: Tree, physics: Physics) -> float:
    """Time step of the file [s]."""
    return physics.time_step / (SHORTER if any(isinstance(hinge.motor, Motor) for hinge in tree.hinges) else 1)


def law_of(tree: Tree, hinge: Hinge, step: float) -> tuple[float, float]:
    """Torques of a hinge's drive for a radian of its angle, at most 0, and against a rad/s of its rate, in the file.

    A drive that holds a rate gives what hangs on the hinge at rest that rate within a ``step`` [s], unless it is
    loaded. More would be worse: MuJoCo damps drives implicitly, also where their torque is at its limit.
    """
    motor = hinge.motor
    if isinstance(motor, Servo):
        critical = 2 * math.sqrt(-motor.by_angle * tree.inertia_about(hinge))
        return motor.by_angle, motor.by_rate + motor.damping_ratio * critical
    assert isinstance(motor, Motor)
    by_rate = tree.inertia_about(hinge) / step
    return by_rate * motor.by_angle, by_rate


def _number(value: float) -> str:
    return repr(float(value))


def _row(values: "Floats | tuple[float, ...] | list[float] | object") -> str:
    return " ".join(_number(value) for value in np.asarray(values, float))
