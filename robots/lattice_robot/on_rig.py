"""A lattice robot on a pneumatic rig: the waves of its channels as pressures of lines, and back."""

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np

from robots.hardware.channel_play import waves_behind
from robots.hardware.channel_table import ChannelTable, PressureScale, Rhythm, Wave, too_few_lines
from robots.hardware.own_lines import lines_of, misplaced
from robots.hardware.rig import PneumaticRig
from robots.lattice_robot.channels import Channel, channels_of
from robots.lattice_robot.drive import UNITS, Drive

if TYPE_CHECKING:
    from robots.lattice_robot.robot import LatticeRobot

PLAYED = ("scale", "temperature", "pressure")  # what lines can do; nothing blows up friction
FullScale = float | tuple[float, float]


def full_scale_of(text: str) -> FullScale:
    """Parse ``0.2``, above rest, or ``0.8:1.2``, where a line is off and where it is on.

    Raises:
        ValueError: for anything else.
    """
    try:
        parts = [float(part) for part in text.split(":")]
    except ValueError:
        parts = []
    wrong = len(parts) not in (1, 2) or not np.isfinite(parts).all()
    if wrong or (parts[0] <= 0 if len(parts) == 1 else parts[0] >= parts[1]):
        raise ValueError(
            f"full-scale: {text!r} is not allowed; give a positive number such as 0.2, above rest, or LOW:HIGH"
        )
    return parts[0] if len(parts) == 1 else (parts[0], parts[1])


def unplayed(robot: "LatticeRobot", rig: PneumaticRig | None = None) -> str:
    """Why a rig, the dissertation's if None, does not play a robot of which nothing is free; empty if it can."""
    other = [f"{drive.name} ({drive.quantity})" for drive in robot.drives if drive.quantity not in PLAYED]
    if other:
        return f"no line plays {', '.join(other)}; it takes drives of {', '.join(PLAYED)}"
    rig, names = rig or PneumaticRig(), [channel.name for channel in channels_of(robot)]
    why = too_few_lines(len(names), rig)
    return f"{len(names)} channels are not allowed; {why}" if why else misplaced(names, rig.channel_lines)


def waves_of(robot: "LatticeRobot", rig: PneumaticRig, full_scale: FullScale | None = None) -> list[Wave]:
    """The waves of a robot's channels on the lines of a rig for them, of which nothing is free.

    Pressures are on lines as they are. Another quantity goes in proportion from the line's pressure when off to that
    when on, see ``LineMap`` and ``OwnLines``: from ``full_scale``'s first value to its second, or from rest to
    ``full_scale`` above it; by default from the lowest to the highest value of all channels of this quantity.

    Raises:
        ValueError: if no rig plays the robot, or ``full_scale`` stands for several quantities, or for none.
    """
    if why := unplayed(robot, rig):
        raise ValueError(f"drives: {why}")
    channels = channels_of(robot)
    scaled = sorted({channel.quantity for channel in channels} - {"pressure"})
    if full_scale is not None and len(scaled) != 1:
        told = " and of ".join(scaled)
        why = f"it would be of {told}; leave it out" if scaled else "pressures are played as they are; leave it out"
        raise ValueError(f"full-scale: {full_scale!r} is not allowed, as {why}")
    found = []
    lines = lines_of([channel.name for channel in channels], rig.channel_lines)
    for channel, line in zip(channels, lines, strict=True):
        calibration = _calibration(channel, channels, line.off_kpa, line.on_kpa, full_scale)
        fields = ("drive", "quantity", "axes", "regions", "rest", "relative")
        about: dict[str, Any] = {name: getattr(channel, name) for name in fields}
        about |= {"regions": list(channel.regions), "unit": UNITS[channel.quantity]}
        found.append(Wave(channel.name, channel.values, calibration, about))
    return found


def _calibration(
    channel: Channel, channels: list[Channel], off: float, on: float, full_scale: FullScale | None
) -> PressureScale:
    if channel.quantity == "pressure":
        return PressureScale(0.0, 1e3, 0.0, 1.0)  # Pa are kPa
    if isinstance(full_scale, tuple):
        return PressureScale(*full_scale, off, on)
    if full_scale is not None:
        return PressureScale(channel.rest, channel.rest + full_scale, off, on)
    values = np.array([other.values for other in channels if other.quantity == channel.quantity])
    low, high = float(values.min()), float(values.max())
    return PressureScale(low, high if high > low else low + 1.0, off, on)


def rhythm_of(robot: "LatticeRobot") -> Rhythm:
    """When the waves of a robot are played."""
    nodes = len(channels_of(robot)[0].values)
    return Rhythm(robot.frequency, robot.cycles, robot.settling, nodes)


def played_robot(robot: "LatticeRobot", table: ChannelTable, rig: PneumaticRig | None = None) -> "LatticeRobot":
    """Replace a robot's drives by what the rows of a rig's table play.

    Args:
        robot: of which nothing is free.
        table: of its channels.
        rig: that plays the table, with its delays, regulators, limits of rate and lag, in a cycle like the one before
            it; None: lines have at any time what the rows tell them.

    Raises:
        ValueError: if the table is of channels that the robot does not have, or of other lines than the rig's.
    """
    drives = []
    for wave in table.played() if rig is None else waves_behind(table, rig):
        about, values = wave.about, wave.values
        own = next((drive for drive in robot.drives if drive.name == about["drive"]), None)
        same = own is not None and (own.quantity, own.axes) == (about["quantity"], about["axes"])
        if own is None or not same or not set(about["regions"]) <= set(own.regions):
            raise ValueError(f"channel: {wave.name} of the table is none of the robot's; give the robot that it is of")
        mean, knots = (None, values - about["rest"]) if about["relative"] else (0.0, values)
        given = {
            "mean": mean,
            "amplitude": 1.0,
            "knots": tuple(knots.tolist()),
            "axes": about["axes"],
            "proportions": own.proportions,
        }
        drives.append(Drive(wave.name, tuple(about["regions"]), about["quantity"], **given))
    least, most = robot.size_range  # so that both have the same time step
    played = dataclasses.replace(robot, drives=tuple(drives), frequency=table.played_frequency)
    return dataclasses.replace(played, lowest_size=least, highest_size=most)
