"""Convert MuJoCo's actuators to drives, which hold a rate as far as their torque allows.

Source: MuJoCo documentation, "XML reference", actuator: force = kp (ctrl - length) - kv velocity of position, and
kv (ctrl - velocity) of velocity actuators, with length = gear x angle; the hinge feels gear x force.
"""

from xml.etree.ElementTree import Element

import numpy as np

from taichi_sim.rigid.model.mjcf_compiler import Compiler
from taichi_sim.rigid.model.mjcf_schema import DRIVE_NOTES
from taichi_sim.rigid.model.tree import Motor
from taichi_sim.rigid.model.xml_values import keyword, named, not_negative, number, numbers

WHOLE_TURN = 2 * np.pi  # rad; targets beyond are likely degrees, which MuJoCo reads as radians
_MOST_GEAR = 1e100  # its square stays a number


def drive(
    actuator: Element,
    span: tuple[float, float] | None,
    rest: float,
    damping: float,
    speed: float,
    fastest: float,
    quickest: float,
    compiler: Compiler,
) -> tuple[Motor, list[str]]:
    """Convert an actuator to a drive of its hinge, and name the settings that are ignored.

    Commands from -1 to 1 cover the actuator's range.

    A position actuator wants the rate at which its spring and its damping balance, a velocity actuator that of its
    control. If the file sets no limit, the torque is the largest that the spring or the damper can have.

    Args:
        actuator: element of a position, velocity or motor actuator.
        span: smallest and largest angle of the hinge [rad].
        rest: its angle at rest [rad].
        damping: damping of the hinge [N m s].
        speed: speed of position drives without any damping [1/s].
        fastest: rate of drives by torque at full command [rad/s].
        quickest: largest speed of a position drive [1/s].
        compiler: settings of the file.

    Raises:
        ValueError: for other actuators, or if a range is missing or not symmetric.
    """
    gear = float(numbers(actuator, "gear", "1")[0])
    if actuator.tag not in ("position", "velocity", "motor") or gear == 0:
        raise ValueError(f"{named(actuator)}: not allowed; give position, velocity or motor, with a gear")
    if abs(gear) > _MOST_GEAR:
        raise ValueError(f"{named(actuator)}: gear {gear:g} is not allowed; give at most {_MOST_GEAR:g}")
    limited = compiler.limits(actuator, "forcerange", "forcelimited") is not None
    torque = abs(gear) * symmetric(actuator, "forcerange") if limited else np.inf
    keyword(actuator, "ctrllimited", "auto", "true", "false")
    if "inheritrange" not in actuator.attrib:
        compiler.limits(actuator, "ctrlrange", "ctrllimited")
    also = [f"{name} of drives" for name in DRIVE_NOTES if numbers(actuator, name, "0").any()]
    if actuator.tag == "motor":
        torque = min(torque, abs(gear) * symmetric(actuator, "ctrlrange"))
        return Motor(torque, float(np.sign(gear)) * fastest), ["torques of motors, which are driven by rate", *also]
    low, high = _range(actuator, span, gear)
    middle, half = (low + high) / 2 / gear, (high - low) / 2 / gear
    also = ["how stiff drives are, but not kp / kv" if actuator.tag == "position" else "gains of drives", *also]
    if actuator.tag == "velocity":
        strongest = abs(gear) * _gain(actuator, "kv", "1") * (high - low)
        return Motor(min(torque, strongest), half, 0.0, middle), also
    if (farthest := max(abs(low), abs(high)) / abs(gear)) > WHOLE_TURN:
        also.append(f"that position drives may be told {farthest:g} rad, as ctrlrange is in radians")
    gain = _gain(actuator, "kp", "1")
    drag = gear * gear * _gain(actuator, "kv", "0") + damping
    eagerness = min(gear * gear * gain / drag if drag > 0 else speed, quickest)
    strongest = abs(gear) * gain * (high - low)
    return Motor(min(torque, strongest), eagerness * half, -eagerness, eagerness * (middle - rest)), also


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
