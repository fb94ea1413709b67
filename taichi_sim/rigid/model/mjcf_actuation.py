"""Change the actuation within an MJCF file: gains and largest forces of actuators and springs of joints."""

import math
from collections.abc import Mapping
from xml.etree.ElementTree import Element

from taichi_sim.rigid.model.actuation import holds_angle
from taichi_sim.rigid.model.mjcf import MjcfReader
from taichi_sim.rigid.model.mjcf_drives import symmetric
from taichi_sim.rigid.model.tree import Motor, Tree
from taichi_sim.rigid.model.xml_values import number, numbers, with_numbers


def stiffen_mjcf(
    reader: MjcfReader, written: Mapping[Element, Element], tree: Tree, factors: Mapping[str, float]
) -> None:
    """Write what ``stiffened_tree`` makes of hinges into the elements of a file.

    Args:
        reader: that has read the file.
        written: the element to write for each element that was read.
        tree: the robot, some of whose drives may be ideal ones, of which nothing is written.
        factors: of the hinges by the names of the bodies that they carry; others stay.
    """
    servos = {hinge.child for hinge in tree.hinges if holds_angle(hinge)}
    actuators = [each for group in reader.root.iterfind("actuator") for each in group]
    for body, found in reader.bodies_read.items():
        factor = factors.get(found.name, 1.0)
        joint = next((each for each in body if each.tag == "joint"), None)
        if factor == 1 or joint is None:
            continue
        spring = number(reader.defaults.resolved(joint, found.childclass), "stiffness", "0")
        if spring > 0:
            written[joint].set("stiffness", with_numbers([factor * spring]))
        if found.name in servos:
            name = next(name for name, (child, _) in reader.hinges.items() if child == found.name)
            command, given = reader.drives[name]
            _write_gains(written[actuators[command]], given, factor)


def strengthen_mjcf(
    reader: MjcfReader, written: Mapping[Element, Element], tree: Tree, factors: Mapping[str, float]
) -> None:
    """Write what ``strengthened_tree`` makes of drives into the elements of a file.

    Args:
        reader: that has read the file.
        written: the element to write for each element that was read.
        tree: the robot.
        factors: of the drives of hinges by the names of the bodies that they carry; others stay.
    """
    drives = {hinge.child: hinge.motor for hinge in tree.hinges if hinge.motor is not None}
    actuators = [each for group in reader.root.iterfind("actuator") for each in group]
    names = {child: name for name, (child, _) in reader.hinges.items()}
    for body, found in reader.bodies_read.items():
        factor, drive = factors.get(found.name, 1.0), drives.get(found.name)
        if factor == 1 or drive is None:
            continue
        joint = next(each for each in body if each.tag == "joint")
        given = reader.defaults.resolved(joint, found.childclass)
        if reader.compiler.limits(given, "actuatorfrcrange", "actuatorfrclimited") is not None:
            _write_range(written[joint], "actuatorfrcrange", factor * symmetric(given, "actuatorfrcrange"))
        command, given = reader.drives[names[found.name]]
        gear, actuator = numbers(given, "gear", "1"), written[actuators[command]]
        if _pushes(given):
            actuator.set("gear", with_numbers([factor * gear[0], *gear[1:]]))
        elif reader.compiler.limits(given, "forcerange", "forcelimited") is not None:
            _write_range(actuator, "forcerange", factor * symmetric(given, "forcerange"))
        elif isinstance(drive, Motor):  # an ideal drive, whose largest torque is that of its range
            actuator.set("forcelimited", "true")
            _write_range(actuator, "forcerange", factor * drive.torque / abs(gear[0]))


def _write_range(written: Element, name: str, largest: float) -> None:
    written.set(name, with_numbers([-largest, largest]))


def _pushes(given: Element) -> bool:
    """Whether an actuator has the force of its control, whatever the joint does."""
    biased = given.get("biastype", "none") == "affine" and any(number(given, e, "0") for e in ("by_length", "kv"))
    return given.tag == "motor" or (given.tag == "general" and not biased)


def _write_gains(written: Element, given: Element, factor: float) -> None:
    """Write the gains of a position or general actuator; ``given`` has those that it acts with."""
    damping, ratio = math.sqrt(factor) * number(given, "kv", "0"), number(given, "dampratio", "0")
    if given.tag == "position":
        written.set("kp", with_numbers([factor * number(given, "kp", "1")]))
        if damping:
            written.set("kv", with_numbers([damping]))
    else:
        gain = [factor * number(given, "kp", "1"), *numbers(given, "gainprm", "0")[1:]]
        bias = [factor * number(given, name, "0") for name in ("constant", "by_length")]
        written.set("gainprm", with_numbers(gain))
        written.set("biasprm", with_numbers([*bias, ratio if ratio > 0 else -damping]))
