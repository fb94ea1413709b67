"""Gait tables as CSV files (a header that carries the design exactly, then rows for the rig), and their designs."""

import hashlib
import itertools
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from robots.hardware.line_map import LineMap
from robots.hardware.rig import CHANNELS, KPA_PER_UNIT, PneumaticRig
from robots.hardware.table import GaitTable, design_hash, gait_table
from robots.hardware.timeline import section_of
from robots.inflatable.design import InflatableDesign, load_design
from robots.inflatable.schedule import GaitSchedule
from taichi_sim.base.files import read_text, write_text

SCHEMA = "morpholab-gait-2"
_UNIT_SPELLING = {"kpa": "kPa", "psi": "psi"}
_FIRST = ("time_s", "section", "state")
_NO_SEED = "unknown"


def export_csv(
    design: InflatableDesign,
    path: str | os.PathLike[str],
    rig: PneumaticRig | None = None,
    units: str = "kpa",
    *,
    rate: float | None = None,
    on_violation: str = "refuse",
    seed: int | None = None,
) -> GaitTable:
    """Write the gait table of a design as CSV, replacing the file in one step.

    Args:
        design: pressure [Pa], orientation [degrees] and schedule.
        path: of the CSV file.
        rig, units, rate, on_violation, seed: see :func:`robots.hardware.gait_table`.

    Returns:
        The table that was written.

    Raises:
        ValueError: if the rig's limits refuse the gait or the file cannot be written.
    """
    table = gait_table(design, rig, units, rate=rate, on_violation=on_violation, seed=seed)
    write_csv(table, path)
    return table


def write_csv(table: GaitTable, path: str | os.PathLike[str]) -> None:
    """Write a table as CSV, replacing the file in one step.

    Raises:
        ValueError: if the file cannot be written.
    """
    lines = [f"# {name}={value}" for name, value in _header(table)]
    lines.append(_column_names(table.units))
    for time, section, state, row in zip(table.times, table.sections, table.states, table.pressures, strict=True):
        lines.append(",".join([f"{time:.12g}", section, str(state), *(f"{pressure:.9g}" for pressure in row)]))
    lines.insert(1, f"# checksum={_checksum(lines)}")
    write_text(path, "\n".join(lines) + "\n")


def _header(table: GaitTable) -> list[tuple[str, str]]:
    design = table.design
    return [
        ("schema", SCHEMA),
        ("units", table.units),
        ("robot_hash", design_hash(design)),
        ("seed", _NO_SEED if table.seed is None else str(table.seed)),
        ("pressure_pa", repr(design.pressure)),
        ("orientation_deg", repr(design.orientation)),
        ("schedule", design.schedule.to_text()),
        ("repeats", str(design.schedule.repeats)),
        ("loops", str(table.loops)),
        ("rig", table.rig),
        ("rate_hz", "corners" if table.rate is None else repr(table.rate)),
        ("map", table.line_map.to_text()),
        *(("clipped", line) for line in table.clipped),
    ]


def read_csv(path: str | os.PathLike[str]) -> GaitTable:
    """Read a gait table that :func:`export_csv` wrote.

    Raises:
        ValueError: if the file is damaged; tells what is wrong, and where.
    """
    lines = read_text(path).splitlines()
    try:
        return _read(lines)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def read_design(path: Path, from_rows: bool = False) -> InflatableDesign:
    """The design of a gait file (JSON), or of a gait table (``.csv``): that of its header, or what its rows play.

    Raises:
        ValueError: for any other file, and for rows asked of one that has none.
    """
    if path.suffix.lower() == ".csv":
        table = read_csv(path)
        return table.played() if from_rows else table.design
    if from_rows:
        raise ValueError(f"from-rows: {str(path)!r} has no rows; name a gait table (.csv)")
    return load_design(path)


def _read(lines: list[str]) -> GaitTable:
    head = list(itertools.takewhile(lambda line: line.startswith("#"), lines))
    pairs = [(name.strip(), value.strip()) for name, _, value in (line[1:].partition("=") for line in head)]
    header = dict(pairs)
    if (schema := header.get("schema")) != SCHEMA:
        raise ValueError(f"schema {schema!r} is unknown; the first line must be '# schema={SCHEMA}'")
    if (units := header.get("units", "")) not in KPA_PER_UNIT:
        raise ValueError(f"units {units!r} are unknown; give one of {', '.join(KPA_PER_UNIT)}")
    _check_columns(lines, len(head), units)
    try:
        schedule = GaitSchedule.from_text(header["schedule"], int(header["repeats"]))
        design = InflatableDesign(float(header["pressure_pa"]), float(header["orientation_deg"]), schedule)
        fits = header["robot_hash"] == design_hash(design) and header["loops"] == str(schedule.repeats - 1)
        line_map = LineMap.from_text(header["map"])
        seed = None if header["seed"] == _NO_SEED else int(header["seed"])
        rate = None if header["rate_hz"] == "corners" else float(header["rate_hz"])
        rig = header["rig"]
    except KeyError as missing:
        raise ValueError(f"{missing.args[0]} is missing in the header") from None
    except ValueError as error:
        raise ValueError(f"header is damaged ({error})") from None
    if not fits:
        raise ValueError("header is damaged (robot_hash and loops do not fit its design)")
    times, states, pressures = _rows(lines, len(head) + 1, schedule.columns)
    # The sum comes after what can be named more precisely.
    if header.get("checksum") != _checksum([line for line in lines if not line.startswith("# checksum=")]):
        raise ValueError("checksum does not fit; the file was changed or damaged, export it again")
    clipped = tuple(value for name, value in pairs if name == "clipped")
    return GaitTable(times, states, pressures, units, design, line_map, seed, rig, rate, clipped)


def _check_columns(lines: list[str], at: int, units: str) -> None:
    given = lines[at].split(",") if at < len(lines) else []
    expected = _column_names(units).split(",")
    if missing := [name for name in expected if name not in given]:
        raise ValueError(f"line {at + 1}: column {missing[0]} is missing; give {','.join(expected)}")
    if given != expected:
        raise ValueError(f"line {at + 1}: columns must be {','.join(expected)}, in this order")


def _rows(lines: Sequence[str], start: int, columns: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, states and pressures of the rows from line ``start`` on."""
    times: list[float] = []
    states: list[int] = []
    rows: list[list[float]] = []
    for index, line in enumerate(lines[start:], start + 1):
        time, state, row = _row(line, index)
        if section_of(state, columns) != line.split(",")[1] or state > 2 * columns + 1:
            raise ValueError(f"line {index}: section {line.split(',')[1]!r} does not fit state {state}")
        if times:
            if state not in (states[-1], states[-1] + 1):
                raise ValueError(f"line {index}: state {state} does not follow state {states[-1]}")
            begins = section_of(state, columns) != section_of(states[-1], columns)
            if time != times[-1] if begins else time <= times[-1]:
                rule = "equal, as a section begins" if begins else "later"
                raise ValueError(
                    f"line {index}: time {time:g} s after {times[-1]:g} s is not allowed; it must be {rule}"
                )
        times.append(time)
        states.append(state)
        rows.append(row)
    if not states or sorted(set(states)) != list(range(2 * columns + 2)):
        raise ValueError(f"rows end early; give states 0 to {2 * columns + 1}")
    return np.array(times), np.array(states), np.array(rows)


def _row(line: str, index: int) -> tuple[float, int, list[float]]:
    parts = line.split(",")
    size = len(_FIRST) + len(CHANNELS)
    try:
        time, state, row = float(parts[0]), int(parts[2]), [float(part) for part in parts[3:]]
        whole = len(parts) == size and bool(np.isfinite([time, *row]).all())
    except (ValueError, IndexError):
        whole = False
    if not whole:
        raise ValueError(f"line {index}: give {size} values, finite numbers but for the section")
    return time, state, row


def _checksum(lines: Sequence[str]) -> str:
    """SHA-256 of all lines but that of the checksum."""
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()


def _column_names(units: str) -> str:
    return ",".join((*_FIRST, *(f"{name}_{_UNIT_SPELLING[units]}" for name in CHANNELS)))
