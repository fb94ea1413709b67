"""Tables of pressures as files that simple programs read: numbers alone, and arrays of a C header."""

import os
import re
from pathlib import Path

import numpy as np

from robots.hardware.rig_table import SECTIONS, RigTable
from robots.hardware.units import UNIT_SPELLING
from taichi_sim.base.files import write_text


def write_plain(table: RigTable, path: str | os.PathLike[str]) -> None:
    """Write a table as CSV of numbers alone: time [s], then pressures of all lines, in the order of its channels.

    The main is written as often as it is played. Rows that begin a section, and so repeat the one before, are left out.

    Raises:
        ValueError: if the file cannot be written.
    """
    sections, main = np.array(table.sections), table.durations.get("main", 0.0)
    prefix, cycle, suffix = (np.flatnonzero(sections == name) for name in SECTIONS)
    order = np.concatenate([prefix, *[cycle] * table.loops, suffix])
    later = np.concatenate([np.full(len(cycle), loop * main) for loop in range(table.loops)] or [np.empty(0)])
    shift = np.concatenate([np.zeros(len(prefix)), later, np.full(len(suffix), (table.loops - 1) * main)])
    times = table.times[order] + shift
    kept = np.append(True, np.diff(np.maximum.accumulate(times)) > 1e-9)  # sums of times have roundings
    rows = np.column_stack([times, table.pressures[order]])[kept]
    write_text(path, "".join(",".join(f"{value:.9g}" for value in row) + "\n" for row in rows))


def write_c_header(table: RigTable, path: str | os.PathLike[str]) -> None:
    """Write a table as constant arrays of C: times and pressures, and where each section begins and ends.

    Names begin with that of the file, ``gait`` for ``gait.h``.

    Raises:
        ValueError: if the file cannot be written, or its name gives no names of C.
    """
    name = Path(path).stem
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name):
        raise ValueError(
            f"c-header: {name} is not allowed; give a file whose name is a word of letters, such as gait.h"
        )
    write_text(path, "\n".join([*_declarations(table, name), *_arrays(table, name), "#endif", ""]))


def _declarations(table: RigTable, name: str) -> list[str]:
    """Macros: units, counts, and the first row of each section and the one after its last."""
    upper, sections = name.upper(), np.array(table.sections)
    lines = [
        f"/* Gauge pressures in {UNIT_SPELLING[table.units]} of {', '.join(table.channels)}.",
        "   Between rows they change in straight lines. Play the prefix, the main as often as LOOPS says (its last row",
        "   is its first), and the suffix, which vents. */",
        f"#ifndef {upper}_H",
        f"#define {upper}_H",
        f'#define {upper}_UNITS "{UNIT_SPELLING[table.units]}"',
        f"#define {upper}_CHANNELS {table.pressures.shape[1]}",
        f"#define {upper}_ROWS {len(table.times)}",
        f"#define {upper}_LOOPS {table.loops}",
    ]
    for section in SECTIONS:
        rows = np.flatnonzero(sections == section)
        lines.append(f"#define {upper}_{section.upper()}_BEGIN {rows[0]}")
        lines.append(f"#define {upper}_{section.upper()}_END {rows[-1] + 1} /* not included */")
    return lines


def _arrays(table: RigTable, name: str) -> list[str]:
    """Times and pressures."""
    upper = name.upper()
    times = ", ".join(_c_float(value) for value in table.times)
    rows = [f"  {{{', '.join(_c_float(value) for value in row)}}}," for row in table.pressures]
    return [
        f"static const float {name}_time_s[{upper}_ROWS] = {{{times}}};",
        f"static const float {name}_pressure[{upper}_ROWS][{upper}_CHANNELS] = {{",
        *rows,
        "};",
    ]


def _c_float(value: float) -> str:
    text = f"{value + 0.0:.9g}"
    return f"{text}f" if "." in text or "e" in text else f"{text}.0f"
