"""What the lines of a rig do when they are told pressures: resolution, limits, delay, slew limit and first-order lag.

A command goes through the regulator, which takes it in steps of its resolution, cuts it to the channel's limits and
reacts after the valve's delay; the line then changes no faster than its slew limit, and the bladder behind it follows
as a first-order system does, lag * dp/dt = line - p.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from robots.hardware.rig import ROUNDING, Channel, PneumaticRig
from taichi_sim.base.arrays import Floats

Course = Callable[[Floats], Floats]  # a line's gauge pressures [kPa] at times [s]
Response = frozenset["Cause"]  # the causes that act; limits of pressure always do


@dataclass(frozen=True)
class Cause:
    """One way in which a line's pressure differs from what the line is told.

    Attributes:
        name: in results, such as ``"lag"`` in ``speed_with_lag``.
        spoken: what people call it.
        parameter: field of a channel that tells how strong it is; at 0 the channel has no such cause.
        apply: what it makes of a course of pressure, given the parameter's value.
    """

    name: str
    spoken: str
    parameter: str
    apply: Callable[[Course, float], Course]

    def acted(self, course: Course, channel: Channel) -> Course:
        """A course as it is behind this part of a channel."""
        value = getattr(channel, self.parameter)
        return self.apply(course, value) if value > 0 else course

    def present(self, rig: PneumaticRig) -> bool:
        """Whether a channel of the rig has it."""
        return any(getattr(channel, self.parameter) > 0 for channel in rig.channels)


def _delayed(course: Course, delay: float) -> Course:
    return lambda at: course(at - delay)


def _in_steps(course: Course, step: float) -> Course:
    return lambda at: np.round(course(at) / step) * step


def _slew_limited(course: Course, rate: float) -> Course:
    return lambda at: slew_limited(course(at), at, rate)


def _lagged(course: Course, lag: float) -> Course:
    return lambda at: lagged(course(at), at, lag)


LAG = Cause("lag", "lag", "lag_s", _lagged)
# In the order in which they act; between the two tuples a command is cut to the channel's limits of pressure.
REGULATOR = (
    Cause("delay", "delays of valves", "valve_delay_s", _delayed),
    Cause("resolution", "steps of regulators", "resolution_kpa", _in_steps),
)
LINE = (Cause("slew", "limits of rate", "slew_kpa_per_s", _slew_limited), LAG)
CAUSES = (*REGULATOR, *LINE)
WHOLE_RESPONSE: Response = frozenset(CAUSES)
AS_COMMANDED: Response = frozenset()  # at any time the line has what it is told


def causes_of(rig: PneumaticRig) -> tuple[Cause, ...]:
    """The ``CAUSES`` of deviations that a rig has; limits of rate every one."""
    return tuple(cause for cause in CAUSES if cause.present(rig))


def line_pressures(
    times: Floats, commands: Floats, rig: PneumaticRig, at: Floats, response: Response = WHOLE_RESPONSE
) -> Floats:
    """Pressures behind all lines, which follow commands from rest.

    Args:
        times: of the commands, increasing [s], shape (N,); between them commands change linearly.
        commands: gauge pressures [kPa], shape (N, C), a column for each channel of the rig.
        rig: with the C channels.
        at: when pressures are asked for, equally spaced [s], shape (S,).
        response: the causes that act.

    Returns:
        Gauge pressures [kPa], shape (S, C).
    """
    found = np.empty((len(at), commands.shape[1]))
    for place, channel in enumerate(rig.channels):
        course = _interpolated(times, commands[:, place])
        for cause in REGULATOR:
            course = cause.acted(course, channel) if cause in response else course
        course = _limited(course, channel)
        for cause in LINE:
            course = cause.acted(course, channel) if cause in response else course
        found[:, place] = course(at)
    return found


def _interpolated(times: Floats, commands: Floats) -> Course:
    return lambda at: np.interp(at, times, commands)


def _limited(course: Course, channel: Channel) -> Course:
    return lambda at: np.clip(course(at), channel.minimum_kpa, channel.maximum_kpa)


def slew_limited(line: Floats, at: Floats, rate: float) -> Floats:
    """A course of pressure that follows another no faster than a rate per second, shape (S,)."""
    most = rate * np.diff(at) * (1 + ROUNDING)
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
