"""Read URDF: links and joints become a tree of hinges.

Source: http://wiki.ros.org/urdf/XML (link, joint). All angles are radians; a joint's frame is its child's.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from xml.etree.ElementTree import Element

import numpy as np
from scipy.spatial.transform import Rotation

from taichi_sim.base.arrays import Floats
from taichi_sim.rigid.model.assembly import (
    OUTSIDE,
    SHALLOW,
    USUAL,
    Frame,
    Lump,
    Model,
    Part,
    depth_of,
    placed,
    possible_inertia,
    raised,
    rest_within,
    solid_of,
    tree_of,
)
from taichi_sim.rigid.model.shapes import Solid
from taichi_sim.rigid.model.tree import Hinge, Joint, Passive, Weld
from taichi_sim.rigid.model.urdf_drives import Drives, Gains
from taichi_sim.rigid.model.urdf_schema import SIZES, strangers
from taichi_sim.rigid.model.xml_values import (
    direction,
    keyword,
    named,
    not_negative,
    number,
    numbers,
    single,
    with_names,
)
from taichi_sim.rigid.tables import Senses

_ENTRIES = ("ixx", "ixy", "ixz", "ixy", "iyy", "iyz", "ixz", "iyz", "izz")
_NO_TURN = 1e-12  # length of a quaternion that turns nowhere
_HINGED = ("revolute", "continuous")
_COMPILER = "mujoco/compiler"  # MuJoCo's extension of URDF


def read_urdf(
    root: Element,
    angles: dict[str, float],
    fixed: bool,
    speed: float | None,
    fastest: float | None,
    time_step: float | None,
    servos: Mapping[str, Gains],
) -> Model:
    """Read the robot of a URDF file.

    Revolute joints get position drives, continuous joints velocity drives; effort limits the torque. Those of
    ``servos`` have the torque of their gains, others hold rates. The time step and the friction, of which URDF says
    nothing, are MuJoCo's defaults. A robot is raised out of the ground, as far as the ground could move it.

    Raises:
        ValueError: for entries that are not allowed.
    """
    for kind in ("link", "joint"):
        _check_names(root.findall(kind), kind)
    links = {link.get("name", ""): link for link in root.findall("link")}
    joints = root.findall("joint")
    base = base_of(links, joints)
    world = USUAL if time_step is None else replace(USUAL, time_step=float(time_step))
    hinged = [joint for joint in joints if joint.get("type") in _HINGED]
    if unknown := set(angles) - {joint.get("name", "") for joint in hinged}:
        raise ValueError(f"angles: there is no hinge {sorted(unknown)[0]!r}")
    drives = Drives.of(hinged, speed, fastest, servos, world.time_step)
    fixed = fixed or (base == "world" and single(links["world"], "inertial") is None)  # so ROS fixes robots
    places = {base: Frame(np.zeros(3), np.eye(3))}
    balanced = any(keyword(each, "balanceinertia", "false", "true") == "true" for each in root.iterfind(_COMPILER))
    parts, commands = [_part(links[base], None, places[base], balanced, fixed)], list[str]()
    for joint in outwards(joints, base):
        child = link_of(joint, "child")
        places[child], hung = _hang(joint, places[link_of(joint, "parent")], angles, drives, len(commands))
        if isinstance(hung, Hinge) and hung.motor is not None:
            commands.append(joint.get("name", child))
        parts.append(_part(links[child], hung, places[child], balanced))
    tree, ignored = tree_of(parts, fixed), _ignored(root, angles)
    if fixed and (depth := depth_of(tree)) > SHALLOW:
        ignored += (f"the height of its base, which is fixed {depth:.3g} m higher, so that it starts above the ground",)
    if not fixed and not tree.points():
        ignored += ("that nothing of the robot touches the ground, as it has no <collision>: it falls without end",)
    tree = raised(tree)  # where the base is says nothing of the ground, which is often below its origin
    return Model(tree, Senses(), world, tuple(commands), ignored)


def _check_names(elements: Sequence[Element], kind: str) -> None:
    """Refuse elements of a kind without a name, and with the same one."""
    if len(list(with_names(elements, kind))) < len(elements):
        raise ValueError(f"{kind}: name is missing; give each {kind} a name of its own")


def base_of(links: Mapping[str, Element], joints: Sequence[Element]) -> str:
    """The name of the only link that no joint carries.

    Raises:
        ValueError: for joints of unknown links, links carried twice, and no or several bases.
    """
    for joint in joints:
        for end in ("parent", "child"):
            if link_of(joint, end) not in links:
                raise ValueError(
                    f"{named(joint)}: there is no link {link_of(joint, end)!r}; give one of {', '.join(links)}"
                )
    carried = {link_of(joint, "child") for joint in joints}
    if len(carried) < len(joints):
        raise ValueError("robot: a link that is carried twice is not allowed; give a tree without loops")
    bases = [name for name in links if name not in carried]
    if len(bases) != 1:
        raise ValueError(f"robot: {len(bases)} links without a parent are not allowed; give one base")
    return bases[0]


def outwards(joints: Sequence[Element], base: str) -> Iterator[Element]:
    """Joints from the base outwards, in rounds: each after the one that carries its parent.

    Raises:
        ValueError: for joints that hang on themselves.
    """
    reached, waiting = {base}, list(joints)
    while waiting:
        ready = [joint for joint in waiting if link_of(joint, "parent") in reached]
        if not ready:
            raise ValueError(f"{named(waiting[0])}: a loop is not allowed; give a tree without loops")
        yield from ready
        reached |= {link_of(joint, "child") for joint in ready}
        waiting = [joint for joint in waiting if joint not in ready]


def link_of(joint: Element, end: str) -> str:
    """Name of the link at an end of a joint, ``parent`` or ``child``; empty if it names none."""
    found = single(joint, end)
    return "" if found is None else found.get("link", "")


def _origin(element: Element) -> tuple[Floats, Floats]:
    """Read position and rotation matrix of an element's origin; roll, pitch and yaw turn about fixed axes."""
    origin = single(element, "origin")
    if origin is None:
        return np.zeros(3), np.eye(3)
    place = numbers(origin, "xyz", "0 0 0", 3)
    if "quat_xyzw" not in origin.attrib:
        return place, Rotation.from_euler("xyz", numbers(origin, "rpy", "0 0 0", 3)).as_matrix()
    if "rpy" in origin.attrib:
        raise ValueError(f"origin of {named(element)}: rpy and quat_xyzw are not allowed together; give one turn")
    turn = numbers(origin, "quat_xyzw", None, 4)
    if np.linalg.norm(turn) < _NO_TURN:
        raise ValueError(f"origin of {named(element)}: quat_xyzw of length 0 is not allowed; give a unit quaternion")
    return place, Rotation.from_quat(turn).as_matrix()


def _hang(
    joint: Element, carrier: Frame, angles: dict[str, float], drives: Drives, command: int
) -> tuple[Frame, Joint]:
    """Read a joint at the place of its parent: the place of its child, and the joint itself."""
    kind, place = joint.get("type", ""), carrier.then(*_origin(joint))
    parent, child = link_of(joint, "parent"), link_of(joint, "child")
    if kind == "fixed":
        return place, Weld(parent, child)
    if kind not in _HINGED:
        raise ValueError(f"{named(joint)}: type {kind!r} is not allowed; give revolute, continuous or fixed")
    axis = single(joint, "axis")
    along = np.array([1.0, 0, 0]) if axis is None else direction(axis, "xyz", "1 0 0")
    span = _range(joint) if kind == "revolute" else None
    start = angles.get(joint.get("name", ""), rest_within(span, 0.0)[0])
    if span is not None:
        _check_range(joint, span, start)
    turned = place.then(np.zeros(3), Rotation.from_rotvec(start * along).as_matrix())
    if single(joint, "mimic") is not None:
        raise ValueError(f"{named(joint)}: mimic is not allowed; give a joint of its own")
    stops = None if span is None else (span[0] - start, span[1] - start)
    motor = drives.drive(joint, stops)
    dynamics = single(joint, "dynamics")
    damping, friction = (
        0.0 if dynamics is None else not_negative(joint, name, number(dynamics, name, "0"))
        for name in ("damping", "friction")
    )
    passive = Passive(damping=damping, friction=friction)
    return turned, Hinge(parent, child, place.position, place.rotation @ along, motor, command, stops, start, passive)


def _check_range(joint: Element, span: tuple[float, float], start: float) -> None:
    low, high = span
    if low >= high:
        raise ValueError(
            f"{named(joint)}: limits {low:g} and {high:g} are not allowed; give a lower and a higher one, or type fixed"
        )
    if not low <= start <= high:
        raise ValueError(f"angles: {start:g} of {named(joint)} is not allowed; give a number from {low:g} to {high:g}")


def _range(joint: Element) -> tuple[float, float]:
    """Lowest and highest angle of a revolute joint [rad]."""
    limit = single(joint, "limit")
    if limit is None:
        raise ValueError(f"{named(joint)}: limit is missing; give it, or type continuous")
    return number(limit, "lower", "0"), number(limit, "upper", "0")


def _part(link: Element, joint: Joint | None, place: Frame, balanced: bool, still: bool = False) -> Part:
    """Read a link as a part at its place in the world; impossible inertias are balanced, or refused.

    Moments of inertia without a mass are refused, but of a base that stands still, where PyBullet's files have them.
    """
    lump, inertial = Lump(), single(link, "inertial")
    if inertial is not None:
        mass, inertia = single(inertial, "mass"), single(inertial, "inertia")
        if mass is None or inertia is None:
            raise ValueError(f"{named(link)}: an inertial without mass or inertia is not allowed; give both")
        matrix = np.array([number(inertia, entry, "0") for entry in _ENTRIES]).reshape(3, 3)
        matrix = possible_inertia(named(link), matrix, balanced)
        weight = not_negative(link, "mass", number(mass, "value"))
        if weight == 0 and matrix.any() and not still:
            raise ValueError(
                f"{named(link)}: moments of inertia without a mass are not allowed; give a mass, or moments of 0"
            )
        lump = Lump.of(weight, place.then(*_origin(inertial)), matrix)
    shapes = [_solid(each, link, place.then(*_origin(each))) for each in link.findall("collision")]
    return Part(link.get("name", ""), joint, lump, tuple(shapes), origin=place.position)


def _solid(collision: Element, link: Element, place: Frame) -> Solid:
    geometry = single(collision, "geometry")
    solids = list(geometry) if geometry is not None else []
    if len(solids) != 1 or solids[0].tag not in SIZES:
        found = solids[0].tag if solids else "nothing"
        raise ValueError(f"collision of {named(link)}: {found} is not allowed; give a box, sphere, cylinder or capsule")
    sizes = [numbers(solids[0], name, None, count) for name, count in SIZES[solids[0].tag].items()]
    name = f"collision of {named(link)}"
    return placed(solid_of(solids[0].tag, name, np.concatenate(sizes).tolist()), name, place)


def _ignored(root: Element, angles: dict[str, float]) -> tuple[str, ...]:
    """Entries of the file that the engine does not support, one for each kind."""
    found = [f"<{tag}>" for tag in sorted({child.tag for child in root} - {"link", "joint", "mujoco"})]
    if root.find("mujoco") is not None:
        found.append("<mujoco> but for balanceinertia")
    if root.find("link/visual") is not None:
        found.append("<visual>")
    if root.find("link/collision/geometry/cylinder") is not None:
        found.append("edges of cylinders, which touch the ground as capsules of their length")
    revolute = [joint for joint in root.findall("joint") if joint.get("type") == "revolute"]
    if any(rest_within(_range(joint), 0.0)[1] for joint in revolute if joint.get("name", "") not in angles):
        found.append(OUTSIDE)
    return *found, *strangers(root)
