"""Change the actuation within an MJCF file: gains and largest forces of actuators and springs of joints."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from xml.etree.ElementTree import Element

from taichi_sim.rigid.model.actuation import holds_angle
from taichi_sim.rigid.model.mjcf import MjcfReader
from taichi_sim.rigid.model.mjcf_drives import symmetric
from taichi_sim.rigid.model.tree import Motor, Tree
from taichi_sim.rigid.model.xml_values import number, numbers, with_numbers


@dataclass(frozen=True, eq=False)
class _Hinge:
    """A hinge of a file whose actuation is changed, and its actuator, if it has one."""

    child: str  # the body that it carries
    factor: float
    joint: Element  # to write
    given: Element  # what it acts with
    actuator: Element | None  # to write
    drive: Element  # what that acts with


def _changed(reader: MjcfReader, written: Mapping[Element, Element], factors: Mapping[str, float]) -> Iterator[_Hinge]:
    """The hinges of a file whose factor, by the names of the bodies that they carry, is not 1."""
    actuators = [each for group in reader.root.iterfind("actuator") for each in group]
    names = {child: name for name, (child, _) in reader.hinges.items()}
    for body, found in reader.bodies_read.items():
        factor = factors.get(found.name, 1.0)
        joint = next((each for each in body if each.tag == "joint"), None)
        if factor == 1 or joint is None:
            continue
        given, name = reader.defaults.resolved(joint, found.childclass), names.get(found.name, "")
        command, drive = reader.drives.get(name, (0, given))
        actuator = written[actuators[command]] if name in reader.drives else None
        yield _Hinge(found.name, factor, written[joint], given, actuator, drive)


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
    for each in _changed(reader, written, factors):
        if (spring := number(each.given, "stiffness", "0")) > 0:
            each.joint.set("stiffness", with_numbers([each.factor * spring]))
        if each.child in servos and each.actuator is not None:
            _write_gains(each.actuator, each.drive, each.factor)


def strengthen_mjcf(
    reader: MjcfReader, written: Mapping[Element, Element], tree: Tree, factors: Mapping[str, float]
) -> None:
    """Write what ``strengthened_tree`` makes of drives into the elements of a file, as :func:`stiffen_mjcf`."""
    motors = {hinge.child: hinge.motor for hinge in tree.hinges}
    for each in _changed(reader, written, factors):
        motor, drive, actuator = motors.get(each.child), each.drive, each.actuator
        if actuator is None:
            continue
        if reader.compiler.limits(each.given, "actuatorfrcrange", "actuatorfrclimited") is not None:
            _write_range(each.joint, "actuatorfrcrange", each.factor * symmetric(each.given, "actuatorfrcrange"))
        gear = numbers(drive, "gear", "1")
        if _pushes(drive):
            actuator.set("gear", with_numbers([each.factor * gear[0], *gear[1:]]))
        elif reader.compiler.limits(drive, "forcerange", "forcelimited") is not None:
            _write_range(actuator, "forcerange", each.factor * symmetric(drive, "forcerange"))
        elif isinstance(motor, Motor):  # an ideal drive, whose largest torque is that of its range
            actuator.set("forcelimited", "true")
            _write_range(actuator, "forcerange", each.factor * motor.torque / abs(gear[0]))


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
