"""Read robots from MJCF (MuJoCo) and URDF files that describe trees of hinges over flat ground."""

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import TypedDict, Unpack

from taichi_sim.base.checks import positive
from taichi_sim.base.files import read_text
from taichi_sim.base.plain_xml import parse_xml
from taichi_sim.rigid.model.assembly import Model, check_start
from taichi_sim.rigid.model.mjcf import read_mjcf
from taichi_sim.rigid.model.urdf import read_urdf
from taichi_sim.rigid.model.urdf_drives import checked_gains


class Reading(TypedDict, total=False):
    """How a file is read, in what it leaves open.

    Attributes:
        angles: hinge angles of the tree's rest pose, by the names of joints [rad]; 0 for the others.
        fixed: whether a URDF robot's base is fixed to the world, as it is if its root is a link ``world`` without mass;
            MJCF says so itself.
        speed: what part of the way to its target a position drive of URDF wants to go in a second [1/s], 10 if None.
            With it, those of MJCF hold rates, too: that at which the file's spring and damping balance, or this one
            where there is no damping. Else they are servos with the torque of the file.
        fastest: rate at full command of continuous joints of URDF whose velocity is not given [rad/s], 10 if None. With
            it, torque motors of MJCF hold rates up to it, and velocity drives that of their command. Else they have the
            torque of the file.
        servos: gains of drives of URDF that are servos, not ideal, by names of joints or patterns of these: stiffness
            [N m/rad] and damping [N m s/rad], or stiffness alone for critical damping, with what hangs on the hinge at
            rest. Without limits a joint's servo holds rates by its damping. Actuators of MJCF have gains of their own.
        time_step: of the simulation [s]; None for that of the file, or 2 ms.
    """

    angles: Mapping[str, float] | None
    fixed: bool
    speed: float | None
    fastest: float | None
    time_step: float | None
    servos: Mapping[str, tuple[float, ...]]


def load_model(path: str | Path, **reading: Unpack[Reading]) -> Model:
    """Read a robot from a file, with the settings and errors of :func:`parse_model` and :func:`check_start`.

    Errors name the file.
    """
    text = read_text(path)
    try:
        model = read_model(text, **reading)
        check_start(model.tree)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    _tell(model)
    return model


def parse_model(text: str, **reading: Unpack[Reading]) -> Model:
    """Read a robot from the text of an MJCF or URDF file.

    Bodies touch the ground, the plane z = 0, and nothing else. What the engine does not support is named in
    one warning if the robot moves more or less alike without it; else it is an error.

    Args:
        text: content of the file.
        **reading: how it is read, see :class:`Reading`.

    Raises:
        ValueError: for a text that is not such a file, or needs what the engine does not support.
    """
    model = read_model(text, **reading)
    _tell(model)
    return model


def read_model(
    text: str,
    *,
    angles: Mapping[str, float] | None = None,
    fixed: bool = False,
    speed: float | None = None,
    fastest: float | None = None,
    time_step: float | None = None,
    servos: Mapping[str, tuple[float, ...]] | None = None,
) -> Model:
    """Read a robot as :func:`parse_model` does, without its warning of what is ignored."""
    for name, value in (("speed", speed), ("fastest", fastest), ("time_step", time_step)):
        if value is not None:
            positive(name, value)
    root = parse_xml(text)
    if root.tag == "mujoco" and fixed:
        raise ValueError("fixed: True is not allowed of MJCF; leave the free joint out of the file")
    gains = checked_gains(servos or {})
    if root.tag == "mujoco" and gains:
        raise ValueError("servos: not allowed of MJCF; give its actuators gains in the file, as kp of position")
    if root.tag == "mujoco":
        return read_mjcf(root, dict(angles or {}), speed, fastest, time_step)
    if root.tag == "robot":
        return read_urdf(root, dict(angles or {}), fixed, speed, fastest, time_step, gains)
    raise ValueError(f"model: <{root.tag}> is unknown; give a file of <mujoco> (MJCF) or <robot> (URDF)")


def _tell(model: Model) -> None:
    """Name what is ignored of a file in one warning, if anything is."""
    if model.ignored:
        warnings.warn(f"model: ignored are {'; '.join(model.ignored)}", stacklevel=3)
