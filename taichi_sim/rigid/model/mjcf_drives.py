"""Convert MuJoCo's actuators to drives: servos with the torque that they have there, or motors that hold a rate.

Source: MuJoCo documentation, "XML reference", actuator: force = kp (ctrl - length) - kv velocity of position, and
kv (ctrl - velocity) of velocity actuators, with length = gear x angle; the hinge feels gear x force.
"""

from dataclasses import dataclass
from xml.etree.ElementTree import Element

import numpy as np

from taichi_sim.rigid.model.mjcf_compiler import Compiler
from taichi_sim.rigid.model.mjcf_schema import BIASES, DRIVE_NOTES, DRIVES, GAINS
from taichi_sim.rigid.model.tree import Motor, Passive, Servo
from taichi_sim.rigid.model.xml_values import keyword, named, not_negative, number, numbers

WHOLE_TURN = 2 * np.pi  # rad; targets beyond are likely degrees, which MuJoCo reads as radians
_LAGS = ("filter", "filterexact")  # dynamics by which a control comes late, but to itself
_MOST_GEAR = 1e100  # its square stays a number


@dataclass(frozen=True)
class Ideal:
    """Whether drives hold rates instead of having the torques of the file, and which.

    Attributes:
        speed: what position drives without any damping make up of what lacks in a second [1/s]; others the rate at
            which their spring and their damping balance. None: they are servos.
        fastest: rate of torque motors at full command [rad/s]; velocity drives hold that of their command. None: they
            have the torque of the file.
        quickest: largest speed of a position drive [1/s].
    """

    speed: float | None
    fastest: float | None
    quickest: float


def drive(
    actuator: Element,
    span: tuple[float, float] | None,
    rest: float,
    passive: Passive,
    ideal: Ideal,
    compiler: Compiler,
) -> tuple[Motor | Servo, list[str]]:
    """Convert an actuator to a drive of its hinge, and name the settings that are ignored.

    Commands from -1 to 1 cover the actuator's range.

    Args:
        actuator: element of a position, velocity, motor or general actuator.
        span: smallest and largest angle of the hinge [rad].
        rest: its angle at rest [rad].
        passive: its damper and spring.
        ideal: which drives hold rates.
        compiler: settings of the file.

    Raises:
        ValueError: for other actuators, or if a range is missing or that of forces is not symmetric.
    """
    gear = float(numbers(actuator, "gear", "1")[0])
    if actuator.tag not in DRIVES or gear == 0:
        raise ValueError(f"{named(actuator)}: not allowed; give {', '.join(DRIVES)}, with a gear")
    if abs(gear) > _MOST_GEAR:
        raise ValueError(f"{named(actuator)}: gear {gear:g} is not allowed; give at most {_MOST_GEAR:g}")
    limited = compiler.limits(actuator, "forcerange", "forcelimited") is not None
    torque = abs(gear) * symmetric(actuator, "forcerange") if limited else None
    told = keyword(actuator, "ctrllimited", "auto", "true", "false")
    if not number(actuator, "inheritrange", "0"):
        compiler.limits(actuator, "ctrlrange", "ctrllimited")
    elif told == "auto" and not compiler.automatic:
        raise ValueError(f"{named(actuator)}: inheritrange is not allowed without ctrllimited; give it, or autolimits")
    if (dynamics := actuator.get("dyntype", "none")) not in ("none", *_LAGS):
        raise ValueError(f"{named(actuator)}: dyntype {dynamics!r} is not allowed; give none, {' or '.join(_LAGS)}")
    low, high = _range(actuator, span, gear)
    servo = _servo(actuator, gear, (low, high), rest, torque)
    held = ideal.fastest if servo.by_angle == 0 else ideal.speed
    ignored = (name for name in DRIVE_NOTES if name != "dampratio" or held is not None)
    also = [f"{name} of drives" for name in ignored if numbers(actuator, name, "0").any()]
    also += ["dyntype of drives"] if dynamics in _LAGS else []
    if actuator.tag == "position" and (farthest := max(abs(low), abs(high)) / abs(gear)) > WHOLE_TURN:
        also.append(f"that position drives may be told {farthest:g} rad, as ctrlrange is in radians")
    if held is None:
        return servo, also
    return _holding(servo, passive, ideal), also


def _servo(actuator: Element, gear: float, ends: tuple[float, float], rest: float, torque: float | None) -> Servo:
    """The torque of an actuator by its control, between two ends, and by the angle and the rate of its hinge."""
    middle, half = sum(ends) / 2, (ends[1] - ends[0]) / 2
    if actuator.tag == "motor":
        return Servo(gear * half, 0.0, gear * middle, 0.0, torque)
    by_length, drag, ratio = 0.0, 0.0, 0.0
    constant = number(actuator, "constant", "0")
    if actuator.tag == "velocity":
        gain = drag = _gain(actuator, "kv", "1")
    elif actuator.tag == "position":
        gain, drag, ratio = (_gain(actuator, *each) for each in (("kp", "1"), ("kv", "0"), ("dampratio", "0")))
        by_length = -gain
    else:
        gain = number(actuator, "kp", "1")
        kinds = keyword(actuator, "gaintype", "fixed", *GAINS), keyword(actuator, "biastype", "none", *BIASES)
        if kinds[0] != "fixed" or kinds[1] not in ("none", "affine"):
            raise ValueError(
                f"{named(actuator)}: its gaintype or biastype is not allowed; give fixed, and none or affine"
            )
        if kinds[1] == "affine":
            by_length = number(actuator, "by_length", "0")
            drag, ratio = number(actuator, "kv", "0"), number(actuator, "dampratio", "0")
        else:
            constant = 0.0
        if by_length > 0 or (ratio > 0 and gain != -by_length):
            raise ValueError(f"{named(actuator)}: a bias that grows with angle or rate is not allowed; give at most 0")
    by_angle, by_rate = gear * gear * by_length, gear * gear * drag
    return Servo(
        gear * gain * half, by_angle, gear * (gain * middle + constant) + by_angle * rest, by_rate, torque, ratio
    )


def _holding(servo: Servo, passive: Passive, ideal: Ideal) -> Motor:
    """The drive that holds, as far as the torque of its range goes, the rate at which a servo's law gives none."""
    if servo.by_angle == 0 and servo.by_rate == 0:
        assert ideal.fastest is not None
        largest = _least(servo.torque, abs(servo.by_command) + abs(servo.offset))
        return Motor(largest, float(np.sign(servo.by_command)) * ideal.fastest)
    strongest = _least(servo.torque, abs(2 * servo.by_command))
    if servo.by_angle == 0:
        return Motor(strongest, servo.by_command / servo.by_rate, 0.0, servo.offset / servo.by_rate)
    assert ideal.speed is not None
    lost = servo.by_rate + passive.damping
    eagerness = min(-servo.by_angle / lost if lost > 0 else ideal.speed, ideal.quickest)
    per_angle = eagerness / -servo.by_angle
    return Motor(strongest, per_angle * servo.by_command, -eagerness, per_angle * servo.offset)


def _least(torque: float | None, largest: float) -> float:
    return largest if torque is None else min(torque, largest)


def _gain(actuator: Element, attribute: str, default: str) -> float:
    return not_negative(actuator, attribute, number(actuator, attribute, default))


def symmetric(element: Element, attribute: str) -> float:
    """Read an attribute that holds a largest number in both directions, -x and x.

    Raises:
        ValueError: if it holds anything else.
    """
    low, high = numbers(element, attribute, None, 2)
    if not -low == high > 0:
        raise ValueError(f"{named(element)}: {attribute} {element.get(attribute)!r} is not allowed; give -x and x")
    return float(high)


def _range(actuator: Element, span: tuple[float, float] | None, gear: float) -> tuple[float, float]:
    """Smallest and largest control; a position actuator without a range has that of its hinge."""
    given = bool(numbers(actuator, "ctrlrange", "0 0", 2).any())
    if share := number(actuator, "inheritrange", "0"):
        if given or span is None or share < 0:
            raise ValueError(
                f"{named(actuator)}: inheritrange {share:g} is not allowed; give a positive share of the range that "
                "its joint has, or a ctrlrange"
            )
        middle, half = (span[0] + span[1]) / 2, (span[1] - span[0]) / 2
        return middle - share * half, middle + share * half
    if not given and actuator.tag == "position" and span is not None:
        return min(gear * span[0], gear * span[1]), max(gear * span[0], gear * span[1])
    low, high = numbers(actuator, "ctrlrange", None, 2)
    if not low < high:
        raise ValueError(f"{named(actuator)}: ctrlrange {actuator.get('ctrlrange')!r} is not allowed; give two limits")
    return float(low), float(high)
