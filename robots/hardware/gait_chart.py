"""The picture of a gait table: pressures of all lines over time, as a rig would play them."""

import io
import itertools
from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from robots.hardware.lines import ACTUATOR_LINES, ACTUATORS, spoken
from robots.hardware.rig_table import RigTable
from robots.inflatable.view.colours import BLADDERS, FEET
from robots.view.scene import GROUND, INK
from taichi_sim.base.files import write_bytes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.typing import ColorType

_WIDTH, _ROW, _MARGINS = 9.0, 0.36, 1.0  # [inch]
_LEFT, _END = 0.09, 0.87  # of the rows, as parts of the width
_LETTER, _GAP = 0.068, 0.15  # of a label, and beside it [inch]
_CORE = "#4f6d8f"


def gait_chart(table: RigTable) -> Figure:
    """Draw a gait table: a row for each line of the rig, with its pressure over time.

    A row reaches from the line's lowest pressure to its highest. Gaps separate sections, ticks separate states.

    A dark bar under a row marks the states that wait for this line.

    Args:
        table: a table that was made in this process, not read from a file: only such a table knows its states.
    """
    names = table.channels
    colours, labels = _colours(names), list(map(spoken, names))
    left = max(_LEFT, (_LETTER * max(map(len, labels)) + _GAP) / _WIDTH)
    figure = Figure(figsize=(_WIDTH, _ROW * len(names) + _MARGINS), facecolor="white")
    height = figure.get_figheight()
    axes = figure.add_axes((left, 0.5 / height, _END - left, 1 - _MARGINS / height))
    for row, (name, colour) in enumerate(zip(names, colours, strict=True)):
        pressures = table.pressures[:, row]
        low, high = min(0.0, pressures.min()), max(0.0, pressures.max())
        base, scale = row + 0.88 - 0.74 * -low / (high - low or 1.0), 0.74 / (high - low or 1.0)
        axes.fill_between(table.times, base, base - scale * pressures, color=colour, lw=0)
        axes.hlines(base, table.times[0], table.times[-1], color=INK, lw=0.4)
        for state in table.timing:
            if state.slowest == name:
                axes.hlines(row + 0.97, state.start_s, state.end_s, color=INK, lw=2.2)
        text = f"{low:.3g} to {high:.3g}".replace("-", "\N{MINUS SIGN}")
        axes.text(1.01, row + 0.5, text, transform=axes.get_yaxis_transform(), va="center", fontsize=7, color=INK)
    _mark_sections(table, axes)
    axes.set(xlim=(table.times[0], table.times[-1]), ylim=(len(names), 0.0))
    axes.set_yticks(np.arange(len(names)) + 0.5, labels)
    axes.tick_params(length=0, labelsize=7.5, labelcolor=INK)
    axes.set_xlabel("time [s], the main played once", fontsize=8, color=INK)
    axes.spines[:].set_visible(False)
    unit = "kPa" if table.units == "kpa" else "psi"
    axes.text(1.01, -0.3, unit, transform=axes.get_yaxis_transform(), fontsize=7.5, color=INK)
    return figure


def _colours(names: Sequence[str]) -> "Sequence[ColorType]":
    """Colours of lines: those of the inflatable robot's parts, or of its bladders in turn for lines of other names."""
    if tuple(names[-ACTUATORS:]) == ACTUATOR_LINES:
        return (*(_CORE,) * (len(names) - ACTUATORS), *BLADDERS, *FEET)
    return tuple(itertools.islice(itertools.cycle(BLADDERS), len(names)))


def _mark_sections(table: RigTable, axes: "Axes") -> None:
    for name in table.durations:
        states = [state for state in table.timing if state.section == name]
        start, end = states[0].start_s, states[-1].end_s
        if name == "main":
            axes.axvspan(start, end, color=GROUND, zorder=0)
        label = f"main, played {table.loops}\N{MULTIPLICATION SIGN}" if name == "main" else name
        axes.text((start + end) / 2, -0.3, label, ha="center", fontsize=8, color=INK)
        axes.vlines([state.start_s for state in states], 0, len(table.channels), color="white", lw=0.7)
        axes.axvline(start, color=INK, lw=0.6)


def save_gait_chart(table: RigTable, path: str | PathLike[str]) -> None:
    """Write the picture of a gait table as PNG, SVG or PDF, chosen by the suffix of the path.

    Raises:
        ValueError: if it cannot be written.
        RuntimeError: if the disk is full or broken.
    """
    content = io.BytesIO()
    gait_chart(table).savefig(content, dpi=110, format=Path(path).suffix[1:].lower())
    write_bytes(path, content.getvalue())
