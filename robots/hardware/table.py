"""Gait tables: the pressures of a rig's lines over time, what they play, and their files.

A table has three sections, those of controllers that loop a trajectory: a *prefix* that shapes the body and plays the
columns once from there, a *main* that begins as it ends and can be looped, and a *suffix* that vents the lines. Its CSV
file has a header that carries the design exactly, then rows for the rig.
"""

import hashlib
import itertools
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from robots.hardware.line_map import LineMap
from robots.hardware.rig import CHANNELS, KPA_PER_UNIT
from robots.inflatable.body import PUBLISHED
from robots.inflatable.design import InflatableDesign, common_pressure, kilopascals, load_design
from robots.inflatable.materials import RegionMaterials
from robots.inflatable.schedule import ROWS, GaitSchedule
from taichi_sim.base.arrays import Floats, Ints
from taichi_sim.base.files import read_text, write_text

TIME_STEP = PUBLISHED.time_step  # in which gaits count their times [s]
SECTIONS = ("prefix", "main", "suffix")
ARRIVED = 1e-3  # of a line: how far off it may be [kPa]
SCHEMA = "morpholab-gait-2"
_UNIT_SPELLING = {"kpa": "kPa", "psi": "psi"}
_FIRST = ("time_s", "section", "state")
_NO_SEED = "unknown"


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


def section_of(state: int, columns: int) -> str:
    """The section of a state: shaping and the first pass, the second pass, venting."""
    return SECTIONS[0] if state <= columns else SECTIONS[1] if state <= 2 * columns else SECTIONS[2]


@dataclass(frozen=True, eq=False)
class GaitTable:
    """Commands over time, as a rig plays them.

    Attributes:
        times: of the rows [s], shape (N,), with the main played once; between rows pressures change linearly. They
            increase, but a section begins with the row that ends the one before.
        states: numbers of the states that rows belong to, shape (N,): 0 shapes the body, then the columns come
            twice, in prefix and main, then lines are vented.
        pressures: gauge pressures of ``CHANNELS`` in ``units``, shape (N, 11).
        units: ``"kpa"`` or ``"psi"``.
        design: that it was made of, exactly.
        line_map: from simulated to line pressures, as played (after clipping).
        seed: of the search that found the design; None if not known.
        rig: name of the rig.
        rate: rows per second; None for rows at corners.
        clipped: what was clipped, a line each.
        timing: of the states; empty in a table that was read.
    """

    times: Floats
    states: np.ndarray
    pressures: Floats
    units: str
    design: InflatableDesign
    line_map: LineMap
    seed: int | None = None
    rig: str = ""
    rate: float | None = None
    clipped: tuple[str, ...] = ()
    timing: tuple[State, ...] = ()

    channels = CHANNELS

    @property
    def loops(self) -> int:
        """How often the main is played: once less than the columns are, as the prefix plays them too."""
        return self.design.schedule.repeats - 1

    @cached_property
    def sections(self) -> tuple[str, ...]:
        """The section of every row."""
        return tuple(section_of(int(state), self.design.schedule.columns) for state in self.states)

    @property
    def durations(self) -> Mapping[str, float]:
        """Length of each section [s], played once."""
        rows = np.array(self.sections)
        return {name: float(np.ptp(self.times[rows == name])) for name in dict.fromkeys(self.sections)}

    @property
    def seconds(self) -> float:
        """How long the gait takes, with its loops [s]."""
        lengths = self.durations
        return lengths["prefix"] + self.loops * lengths["main"] + lengths["suffix"]

    def schedule(self) -> GaitSchedule:
        """The schedule that the table was made of."""
        return self.design.schedule

    def played(self) -> InflatableDesign:
        """What the rows play, by the inverse of the map.

        The header only says whether the gait is on and off, changes its core pressure and has times of its own, and
        what lines know nothing of: the orientation, paces and materials. Where the gait is on and off, an actuator is
        on above the middle between its two pressures. How long states of a gait with times of its own last after all
        lines have arrived is how long it settles.

        Raises:
            ValueError: if the rows play no schedule.
        """
        last = np.append(np.flatnonzero(np.diff(self.states)), len(self.states) - 1)
        lines = self.pressures[last] * KPA_PER_UNIT[self.units]
        core, levels = self.line_map.simulated(lines[:-1])  # the last state vents
        given = self.design.schedule
        if given.skip_idle:
            levels = np.round(levels)
        if np.ptp(core) > 0 and given.core_pressure is None:
            raise ValueError(f"core: {core.min():g} to {core.max():g} Pa are not allowed; a gait has one core pressure")
        first, second = np.array_split(np.vstack([levels, core])[:, 1:], 2, axis=1)
        if not np.array_equal(first, second):
            raise ValueError("gait table: the columns of its prefix differ from those of its main")
        told = None if given.core_pressure is None else second[ROWS]
        gait = GaitSchedule(second[:ROWS], self.loops + 1, told, skip_idle=given.skip_idle)
        gait = replace(gait, pace=given.pace)
        if given.has_own_times:
            moved = np.zeros(gait.columns, int) if told is None else self._steps(slice(0, 1))[:, 0]
            gait = replace(gait, motion_steps=moved, settle_steps=self._steps(slice(None))[:, 1])
        return replace(self.design, pressure=float(core[0]), schedule=gait)

    def _steps(self, lines: slice) -> Ints:
        """Time steps of each column until some lines have arrived, and from there to its end, shape (T, 2).

        As the main has it, but where that is not played, the prefix.
        """
        pressures, found = self.pressures[:, lines] * KPA_PER_UNIT[self.units], []
        columns = self.design.schedule.columns
        for state in np.arange(1, columns + 1) + (columns if self.loops else 0):
            place = np.flatnonzero(self.states == state)
            begin, end = place[0] - 1, place[-1]
            on_the_way = np.flatnonzero((np.abs(pressures[begin:end] - pressures[end]) > ARRIVED).any(axis=1))
            arrival = begin + (on_the_way[-1] + 1 if on_the_way.size else 0)
            found.append(np.diff(self.times[[begin, arrival, end]]))
        return np.round(np.array(found) / TIME_STEP).astype(int)


def with_one_pressure(design: InflatableDesign) -> InflatableDesign:
    """The design with the one core pressure that the rig's one line for the core stands for.

    Raises:
        ValueError: for a design with several cores that are not alike.
    """
    if (pressure := common_pressure(design.pressure)) is None:
        told = kilopascals(design.pressure)
        raise ValueError(f"pressure: {told} are not allowed; a rig has one line for the core, so give all cores one")
    schedule, core = design.schedule, design.schedule.core_pressure
    if core is not None and core.ndim == 2:
        if np.ptp(core, axis=0).any():
            allowed = "a rig has one line for the core, so give all cores one"
            raise ValueError(f"core_pressure: {len(core)} rows are not allowed; {allowed}")
        schedule = replace(schedule, core_pressure=core[0])
    return InflatableDesign(pressure, design.orientation, schedule, design.materials)


def design_hash(design: InflatableDesign) -> str:
    """A short fingerprint of a robot's design, equal for equal designs on every machine."""
    played, schedule = with_one_pressure(design), design.schedule
    content: list[Any] = [played.pressure, played.orientation, schedule.to_text(), schedule.repeats]
    content += [design.materials.given] if design.materials is not None else []
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()[:16]


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
        *([("materials", json.dumps(design.materials.given))] if design.materials is not None else []),
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
        materials = RegionMaterials.of(json.loads(header["materials"])) if "materials" in header else None
        design = InflatableDesign(float(header["pressure_pa"]), float(header["orientation_deg"]), schedule, materials)
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
