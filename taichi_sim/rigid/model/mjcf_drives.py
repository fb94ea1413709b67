"""Convert MuJoCo's actuators to drives: servos with the torque that they have there, or motors that hold a rate.

Source: MuJoCo documentation, "XML reference", actuator: force = kp (ctrl - length) - kv velocity of position, and
kv (ctrl - velocity) of velocity actuators, with length = gear x angle; the hinge feels gear x force.
"""

from dataclasses import dataclass
from xml.etree.ElementTree import Element

import numpy as np

from taichi_sim.rigid.model.mjcf_compiler import Compiler
from taichi_sim.rigid.model.mjcf_schema import DRIVE_NOTES
from taichi_sim.rigid.model.tree import Motor, Passive, Servo
from taichi_sim.rigid.model.xml_values import keyword, named, not_negative, number, numbers

WHOLE_TURN = 2 * np.pi  # rad; targets beyond are likely degrees, which MuJoCo reads as radians
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
        actuator: element of a position, velocity or motor actuator.
        span: smallest and largest angle of the hinge [rad].
        rest: its angle at rest [rad].
        passive: its damper and spring.
        ideal: which drives hold rates.
        compiler: settings of the file.

    Raises:
        ValueError: for other actuators, or if a range is missing or that of forces is not symmetric.
    """
    gear = float(numbers(actuator, "gear", "1")[0])
    if actuator.tag not in ("position", "velocity", "motor") or gear == 0:
        raise ValueError(f"{named(actuator)}: not allowed; give position, velocity or motor, with a gear")
    if abs(gear) > _MOST_GEAR:
        raise ValueError(f"{named(actuator)}: gear {gear:g} is not allowed; give at most {_MOST_GEAR:g}")
    limited = compiler.limits(actuator, "forcerange", "forcelimited") is not None
    torque = abs(gear) * symmetric(actuator, "forcerange") if limited else None
    told = keyword(actuator, "ctrllimited", "auto", "true", "false")
    if not number(actuator, "inheritrange", "0"):
        compiler.limits(actuator, "ctrlrange", "ctrllimited")
    elif told == "auto" and not compiler.automatic:
        raise ValueError(f"{named(actuator)}: inheritrange is not allowed without ctrllimited; give it, or autolimits")
    ignored = (name for name in DRIVE_NOTES if name != "dampratio" or ideal.speed is not None)
    also = [f"{name} of drives" for name in ignored if numbers(actuator, name, "0").any()]
    if actuator.tag == "motor":
        return _motor(actuator, gear, torque, ideal), also
    low, high = _range(actuator, span, gear)
    middle, half = (low + high) / 2 / gear, (high - low) / 2 / gear
    if actuator.tag == "velocity":
        gain = gear * gear * _gain(actuator, "kv", "1")
        if ideal.fastest is not None:
            return Motor(_least(torque, abs(gain * 2 * half)), half, 0.0, middle), also
        return Servo(gain * half, 0.0, gain * middle, gain, torque), also
    if (farthest := max(abs(low), abs(high)) / abs(gear)) > WHOLE_TURN:
        also.append(f"that position drives may be told {farthest:g} rad, as ctrlrange is in radians")
    gain, drag = gear * gear * _gain(actuator, "kp", "1"), gear * gear * _gain(actuator, "kv", "0")
    if ideal.speed is None:
        ratio = _gain(actuator, "dampratio", "0")
        return Servo(gain * half, -gain, gain * (middle - rest), drag, torque, ratio), also
    lost = drag + passive.damping
    eagerness = min(gain / lost if lost > 0 else ideal.speed, ideal.quickest)
    strongest = _least(torque, abs(gain * 2 * half))
    return Motor(strongest, eagerness * half, -eagerness, eagerness * (middle - rest)), also


def _motor(actuator: Element, gear: float, torque: float | None, ideal: Ideal) -> Motor | Servo:
    """A torque motor, or one that holds rates with the torque of its range, which is then symmetric."""
    if ideal.fastest is not None:
        largest = abs(gear) * symmetric(actuator, "ctrlrange")
        return Motor(_least(torque, largest), float(np.sign(gear)) * ideal.fastest)
    low, high = _range(actuator, None, gear)
    return Servo(gear * (high - low) / 2, 0.0, gear * (high + low) / 2, 0.0, torque)


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
