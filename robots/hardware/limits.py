"""What a gait asks of a rig that the rig must not do: named, refused, or clipped.

Bladders burst when overdriven (Powers 2021 dissertation, ch. 5), so every table is checked.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robots.hardware.rig import CHANNELS, PneumaticRig
from robots.hardware.timeline import Commands, State

POLICIES = ("refuse", "clip")


@dataclass(frozen=True)
class Violation:
    """One limit exceeded once.

    Attributes:
        channel: one of ``CHANNELS``.
        time_s: when the command passes the limit of pressure, or begins to change too fast [s].
        value: asked for [kPa, or kPa/s].
        limit: of the rig, in the same unit.
        unit: ``"kPa"`` or ``"kPa/s"``.
    """

    channel: str
    time_s: float
    value: float
    limit: float
    unit: str

    def __str__(self) -> str:
        at = f"{self.value:g} {self.unit} at {self.time_s:g} s"
        return f"{self.channel}: {at} is not allowed; the rig's limit is {self.limit:g} {self.unit}"


class RigViolation(ValueError):
    """A gait exceeds limits of the rig; its text is one line.

    Attributes:
        violations: all of them, in order of time.
    """

    def __init__(self, violations: Sequence[Violation]) -> None:
        """Refuse a gait for at least one violation."""
        self.violations = tuple(violations)
        more = len(self.violations) - 1
        super().__init__(f"{self.violations[0]}" + (f" ({more} more; a dry run names all)" if more else ""))


def violations(commands: Commands, states: Sequence[State], rig: PneumaticRig) -> list[Violation]:
    """What commands would exceed the rig's limits, in order of time.

    Args:
        commands: for the states.
        states: when they are, with strokes as fast as the rig's times tell.
        rig: with the limits.
    """
    found: list[Violation] = []
    before, rates = commands.before, np.abs(commands.targets - commands.before) / commands.strokes(rig, False)
    for number, index in np.argwhere(commands.targets != before):
        name, channel, start = CHANNELS[index], rig.channels[index], states[number].start_s
        first, last, rate = (float(each[number, index]) for each in (before, commands.targets, rates))
        if rate > channel.slew_kpa_per_s * (1 + 1e-9):  # a rate exactly at the limit survives rounding
            found.append(Violation(name, start, rate, channel.slew_kpa_per_s, "kPa/s"))
        limit = min(max(last, channel.minimum_kpa), channel.maximum_kpa)
        if limit != last:
            inside = channel.minimum_kpa <= first <= channel.maximum_kpa
            passed = abs(limit - first) / rate if inside else 0.0
            found.append(Violation(name, start + passed, last, limit, "kPa"))
    return sorted(found, key=lambda violation: violation.time_s)
