"""What the lines of a rig do when they are told pressures: resolution, limits, delay, slew limit and first-order lag.

A command goes through the regulator, which takes it in steps of its resolution, cuts it to the channel's limits and
reacts after the valve's delay; the line then changes no faster than its slew limit, and the bladder behind it follows
as a first-order system does, lag * dp/dt = line - p.
"""

from dataclasses import dataclass, fields

import numpy as np

from robots.hardware.rig import PneumaticRig
from taichi_sim.base.arrays import Floats


@dataclass(frozen=True)
class Response:
    """Which parts of a rig's pneumatics act; limits of pressure always do.

    Attributes:
        delay: of valves.
        slew: limits of rate.
        resolution: of regulators.
        lag: the first-order lag of lines.
    """

    delay: bool = True
    slew: bool = True
    resolution: bool = True
    lag: bool = True


WHOLE_RESPONSE = Response()
CAUSES = tuple(field.name for field in fields(Response))
STRETCHED = Response(**dict.fromkeys(CAUSES, False))  # the table's times alone


def causes_of(rig: PneumaticRig) -> tuple[str, ...]:
    """The ``CAUSES`` of deviations that a rig has; limits of rate every one."""
    has = {
        "delay": any(channel.valve_delay_s for channel in rig.channels),
        "slew": True,
        "resolution": any(channel.resolution_kpa for channel in rig.channels),
        "lag": any(channel.lag_s for channel in rig.channels),
    }
    return tuple(cause for cause in CAUSES if has[cause])


def line_pressures(
    times: Floats, commands: Floats, rig: PneumaticRig, at: Floats, response: Response = WHOLE_RESPONSE
) -> Floats:
    """Pressures behind all lines, which follow commands from rest.

    Args:
        times: of the commands, increasing [s], shape (N,); between them commands change linearly.
        commands: gauge pressures [kPa], shape (N, C), a column for each channel of the rig.
        rig: with the C channels.
        at: when pressures are asked for, equally spaced [s], shape (S,).
        response: which parts act.

    Returns:
        Gauge pressures [kPa], shape (S, C).
    """
    found = np.empty((len(at), commands.shape[1]))
    for place, channel in enumerate(rig.channels):
        delay = channel.valve_delay_s if response.delay else 0.0
        told = np.interp(at - delay, times, commands[:, place])
        if response.resolution and channel.resolution_kpa > 0:
            told = np.round(told / channel.resolution_kpa) * channel.resolution_kpa
        line = np.clip(told, channel.minimum_kpa, channel.maximum_kpa)
        if response.slew:
            line = slew_limited(line, at, channel.slew_kpa_per_s)
        found[:, place] = lagged(line, at, channel.lag_s) if response.lag else line
    return found


def slew_limited(line: Floats, at: Floats, rate: float) -> Floats:
    """A course of pressure that follows another no faster than a rate per second, shape (S,)."""
    most = rate * np.diff(at) * (1 + 1e-9)  # a rate exactly at the limit survives rounding
    if (np.abs(np.diff(line)) <= most).all():
        return line
    followed = line.copy()
    for place, limit in enumerate(most):
        followed[place + 1] = followed[place] + np.clip(line[place + 1] - followed[place], -limit, limit)
    return followed


def lagged(line: Floats, at: Floats, lag: float) -> Floats:
    """The response of a first-order lag [s] to a course that is linear between its samples, exact; shape (S,)."""
    if lag == 0:
        return line
    followed, steps = line.copy(), np.diff(at)
    behind = np.diff(line) / steps * lag  # how far it stays behind a ramp in the end
    kept = np.exp(-steps / lag)
    for place in range(len(steps)):
        off = followed[place] - line[place] + behind[place]
        followed[place + 1] = line[place + 1] - behind[place] + off * kept[place]
    return followed
