"""When a rig does what: states, one after the other, as pressures over time.

A state is what all lines are told at once. It lasts until its slowest changing channel is done: its valve's delay and
its stroke (Powers 2021 dissertation, ch. 5: bladders inflate at different rates); then it dwells, if it shall.

Sections are those of controllers that loop a trajectory: a *prefix* that shapes the body and plays the columns once
from there, a *main* that begins as it ends and can be looped, and a *suffix* that vents the lines.
"""

import math
from dataclasses import dataclass

import numpy as np

from robots.hardware.commands import Commands
from robots.hardware.rig import CHANNELS, PneumaticRig
from taichi_sim.base.arrays import Floats

SECTIONS = ("prefix", "main", "suffix")
_CLOSEST = 6  # decimals of a time [s] that tell corners apart


@dataclass(frozen=True)
class State:
    """One state in time.

    Attributes:
        number: counted from 0, the shaping of the body.
        section: one of ``SECTIONS``.
        start_s: of the state [s], with the main played once.
        end_s: [s].
        slowest: the channel that it waits for; empty if nothing changes.
        changes: channels that change.
    """

    number: int
    section: str
    start_s: float
    end_s: float
    slowest: str
    changes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Timeline:
    """Commands over time.

    Attributes:
        states: in order.
        times: of the rows [s], shape (N,); increasing, but for the first row of a section, which is the last of the
            section before.
        numbers: of the states that rows belong to, shape (N,).
        pressures: [kPa], shape (N, 11).
    """

    states: tuple[State, ...]
    times: Floats
    numbers: np.ndarray
    pressures: Floats


def section_of(state: int, columns: int) -> str:
    """The section of a state: shaping and the first pass, the second pass, venting."""
    return SECTIONS[0] if state <= columns else SECTIONS[1] if state <= 2 * columns else SECTIONS[2]


def strokes(before: Floats, target: Floats, portions: Floats, rig: PneumaticRig, keep_slew: bool) -> Floats:
    """How long each line takes from one pressure to another [kPa]; with ``keep_slew`` not faster than its limit [s].

    The ``portions`` are those of whole strokes, see ``Commands``.
    """
    rise, fall, slew = np.array([(c.rise_s, c.fall_s, c.slew_kpa_per_s) for c in rig.channels]).T
    times = np.where(target > before, rise, fall) * portions
    return np.maximum(times, np.abs(target - before) / slew) if keep_slew else times


def timeline(commands: Commands, rig: PneumaticRig, rate: float | None = None, keep_slew: bool = False) -> Timeline:
    """Go from vented lines to one row of targets after the other.

    Args:
        commands: for the states.
        rig: gives the times.
        rate: rows per second; states then last whole samples. None: rows at the corners, which straight lines join.
        keep_slew: slow strokes down that are faster than the rig allows.
    """
    delays = np.array([channel.valve_delay_s for channel in rig.channels])
    before, ticks, start = np.zeros(len(CHANNELS)), 0, 0.0
    states: list[State] = []
    times, numbers, rows = [0.0], [0], [before]
    for number, target in enumerate(commands.targets):
        section = section_of(number, commands.columns)
        if states and section != states[-1].section:
            times, numbers, rows = [*times, start], [*numbers, number], [*rows, before]
        stroke = strokes(before, target, commands.portions[number], rig, keep_slew)
        changing = np.flatnonzero(target != before)
        done = (delays + stroke)[changing]
        moving, resting = commands.moving_s[number], commands.resting_s[number]
        if changing.size:
            length = max(float(done.max()), moving) + resting
        else:
            length = max(rig.shortest_state_s, moving + resting)
        if rate is None:
            length = max(length, 10.0**-_CLOSEST)
            passed = np.unique(np.round([*stroke[changing], length], _CLOSEST))
            passed = passed[passed > 0]
            moments = start + passed
        else:
            count = max(1, math.ceil(length * rate * (1 - 1e-12)))
            moments = (ticks + np.arange(1, count + 1)) / rate
            passed, ticks = np.arange(1, count + 1) / rate, ticks + count
        times.extend(moments.tolist())
        numbers.extend([number] * len(moments))
        rows.extend(before + (target - before) * np.minimum(passed[:-1, None] / stroke, 1.0))
        rows.append(target)  # free of rounding
        slowest = CHANNELS[changing[np.argmax(done)]] if changing.size else ""
        names = tuple(CHANNELS[index] for index in changing)
        states.append(State(number, section, start, times[-1], slowest, names))
        before, start = target, times[-1]
    return Timeline(tuple(states), np.array(times), np.array(numbers), np.array(rows))
