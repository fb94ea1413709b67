"""Tables played one after the other without venting in between: is what their rows ask of the lines within the limits?

A table times its states from where its own state 0 ends. Where another one has left the lines elsewhere, the same rows
may ask for strokes that are too fast for the rig.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from robots.hardware.lines import ACTUATORS
from robots.hardware.rig import ROUNDING, Channel, PneumaticRig
from robots.hardware.table import ARRIVED, GaitTable
from robots.hardware.units import KPA_PER_UNIT
from taichi_sim.base.arrays import Floats

CLOSEST = 2e-6  # to which rows tell times [s]: either end of a stroke is rounded to a millionth
DIGITS = 1e-6  # and pressures [kPa]


class Part(NamedTuple):
    """What is played of a table: its prefix without state 0, or its main once."""

    table: GaitTable
    section: str

    @property
    def rows(self) -> tuple[Floats, np.ndarray, Floats]:
        """Times from the part's beginning [s], shape (N,); states, shape (N,); pressures [kPa], shape (N, L)."""
        table, columns = self.table, self.table.columns
        first, last = (1, columns) if self.section == "prefix" else (columns + 1, 2 * columns)
        mine = np.flatnonzero((table.states >= first) & (table.states <= last))
        begin = float(table.times[table.states == first - 1].max())
        mine = mine[table.times[mine] > begin]  # a section begins with the row that ends the one before
        return table.times[mine] - begin, table.states[mine], table.pressures[mine] * KPA_PER_UNIT[table.units]


def joined_faults(parts: Sequence[Part], rig: PneumaticRig) -> list[str]:
    """What parts ask of a rig beyond its limits, played one after the other from the end of the first, a line each.

    Raises:
        ValueError: for a table that does not have the rig's lines.
    """
    for part in parts:
        rig.check_names(part.table.channels)
    found: list[str] = []
    before = parts[0].rows[2][-1]
    for part in parts[1:]:
        times, states, pressures = part.rows
        start, kinds = 0.0, _whole_strokes(part.table)
        for state in np.unique(states):
            mine = states == state
            passed = np.concatenate([[0.0], times[mine] - start])
            rows = np.vstack([before, pressures[mine]])
            for name, channel, line, whole in zip(rig.channel_names, rig.channels, rows.T, kinds, strict=True):
                if fault := _fault(channel, passed, line, whole):
                    found.append(f"{name}: {fault}")
            start, before = float(times[mine][-1]), rows[-1]
    return list(dict.fromkeys(found))


def _whole_strokes(table: GaitTable) -> list[float | None]:
    """The change of pressure that takes a line the rig's time [kPa]; None of cores, where every change takes it."""
    whole = np.subtract(table.line_map.on_kpa, table.line_map.off_kpa).tolist()
    return [None] * (table.pressures.shape[1] - ACTUATORS) + whole


def _fault(channel: Channel, passed: Floats, line: Floats, whole: float | None) -> str:
    """What a line [kPa] is asked in a state beyond a channel's limits; nothing if all is well."""
    first, last = float(line[0]), float(line[-1])
    rates = (np.abs(np.diff(line)) - DIGITS) / (np.diff(passed) + CLOSEST)
    if rates.max() > channel.slew_kpa_per_s * (1 + ROUNDING):
        asked = float(np.max(np.abs(np.diff(line)) / np.diff(passed)))
        return f"{first:g} to {last:g} kPa at {asked:.3g} kPa/s; the rig's limit is {channel.slew_kpa_per_s:g} kPa/s"
    if line[1:].min() < channel.minimum_kpa - DIGITS or line[1:].max() > channel.maximum_kpa + DIGITS:
        return (
            f"{first:g} to {last:g} kPa; the rig's limits are {channel.minimum_kpa:g} and {channel.maximum_kpa:g} kPa"
        )
    way = last - first
    if abs(way) <= ARRIVED:
        return ""
    share = 1.0 if whole is None else min(abs(way) / whole, 1.0)
    needed = share * (channel.rise_s if way > 0 else channel.fall_s) * (1 - ARRIVED / abs(way))  # the rest is no way
    arrived = float(passed[np.flatnonzero(np.abs(line - last) > ARRIVED)[-1] + 1])
    taken = min(arrived, float(passed[-1]) - channel.valve_delay_s)
    if taken < needed - CLOSEST - DIGITS:
        return f"{first:g} to {last:g} kPa in {taken:.3g} s; the rig takes {needed:.3g} s"
    return ""
