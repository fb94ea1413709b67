"""What a rig makes of a table of channels: the waves behind its lines, once their cycle repeats itself."""

from dataclasses import replace

import numpy as np

from robots.hardware.channel_table import ChannelTable, Wave
from robots.hardware.rig import PneumaticRig
from robots.hardware.rig_response import WHOLE_RESPONSE, Response, line_pressures
from taichi_sim.base.arrays import Floats

NODES = 16  # of the waves: as many as a simulated cycle has pieces
_FINE = 16  # samples between nodes
_MOST_CYCLES, _SAME = 256, 1e-4  # kPa, between two cycles that repeat


def waves_behind(table: ChannelTable, rig: PneumaticRig, response: Response = WHOLE_RESPONSE) -> tuple[Wave, ...]:
    """Waves behind the lines of a rig that plays a table: its delays, regulators, limits of rate and lag act.

    They are those of a cycle like the one before it, at equal times from the cycle's start, in the order of the
    table's waves.

    Raises:
        ValueError: for a table of other lines, and a rig so slow that its lines are not in a cycle by then.
    """
    rig.check_names(table.channels)
    lines = _steady(table, rig, response)
    places = map(table.channels.index, table.played_by)
    return tuple(
        replace(wave, values=wave.calibration.values(lines[:, place]))
        for place, wave in zip(places, table.waves, strict=True)
    )


def _steady(table: ChannelTable, rig: PneumaticRig, response: Response) -> Floats:
    """Pressures behind all lines at the nodes of a cycle that repeats, (NODES, C) [kPa]."""
    length, start = table.durations["main"], float(table.times[np.array(table.sections) == "main"][0])
    # Whole cycles of delay change no cycle that repeats, but until they have passed all lines rest, cycle by cycle.
    channels = (replace(each, valve_delay_s=each.valve_delay_s % length) for each in rig.channels)
    rig = replace(rig, channels=tuple(channels))
    cycles, step = 2, length / (NODES * _FINE)
    while cycles <= _MOST_CYCLES:
        times, commands = table.played_rows(cycles)
        at = np.concatenate([np.arange(-np.ceil(start / step), 0), np.arange(cycles * NODES * _FINE + 1)]) * step
        lines = line_pressures(times, commands, rig, start + at, response)
        last, previous = (lines[-1 - NODES * _FINE * (number + 1) :][: NODES * _FINE] for number in (0, 1))
        if np.abs(last - previous).max() <= _SAME:
            return np.asarray(last[::_FINE])
        cycles *= 2
    raise ValueError(
        f"rig: {rig.name} is too slow for the table: after {_MOST_CYCLES} cycles of {length:g} s its lines change "
        "from one to the next; play it at a lower frequency"
    )
