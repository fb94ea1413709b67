"""Tables of what a rig's lines are told over time, and the form of their files.

A table has three sections, those of controllers that loop a trajectory: a *prefix* that prepares the robot and plays
the columns once from there, a *main* that begins as it ends and can be looped, and a *suffix* that vents the lines.
Its CSV file has a header that carries what is played exactly, then rows for the rig.
"""

import hashlib
import itertools
import os
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np

from robots.hardware.lines import channel_names, core_count, own_names
from robots.hardware.units import KPA_PER_UNIT, UNIT_SPELLING
from taichi_sim.base.arrays import Floats
from taichi_sim.base.files import read_text, write_text
from taichi_sim.base.short_text import ShortText

Table = TypeVar("Table", bound="RigTable")
SECTIONS = ("prefix", "main", "suffix")
CHANNELS_SCHEMA = "morpholab-channels-1"  # of tables of the channels of robots other than the inflatable one
LINES = "lines"  # what the header calls the names of lines that a rig names itself
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


class RigTable(ShortText, ABC):
    """Commands to the lines of a rig over time, in three sections, of which the second can be looped.

    Attributes:
        times: of the rows [s], shape (N,); see :class:`GaitTable`.
        states: numbers of the states that rows belong to, shape (N,): 0 prepares, then the columns come twice, in
            prefix and main, then lines are vented.
        pressures: gauge pressures of :attr:`channels` in ``units``, shape (N, 11), or (N, C + 10) of C cores, or
            (N, L) of a rig with L lines of its own.
        units: ``"kpa"`` or ``"psi"``.
        rig: name of the rig.
        rate: rows per second; None for rows at corners.
        clipped: what was clipped, a line each.
        timing: of the states; empty in a table that was read.
    """

    times: Floats
    states: np.ndarray
    pressures: Floats
    units: str
    rig: str
    rate: float | None
    clipped: tuple[str, ...]
    timing: tuple[State, ...]

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of what the lines drive, in the order of their pressures."""
        return channel_names(core_count(self.pressures.shape[1]))

    @property
    @abstractmethod
    def columns(self) -> int:
        """States of the main."""

    @property
    @abstractmethod
    def loops(self) -> int:
        """How often the main is played."""

    @abstractmethod
    def header(self) -> list[tuple[str, str]]:
        """What the head of its file says, by name, the schema first."""

    @cached_property
    def sections(self) -> tuple[str, ...]:
        """The section of every row."""
        return tuple(section_of(int(state), self.columns) for state in self.states)

    @property
    def durations(self) -> Mapping[str, float]:
        """Length of each section [s], played once."""
        rows = np.array(self.sections)
        return {name: float(np.ptp(self.times[rows == name])) for name in dict.fromkeys(self.sections)}

    def played_rows(self, loops: int) -> tuple[Floats, Floats]:
        """Times [s] and pressures [kPa], (N, L), of the prefix's rows, then of the main's, played so many times."""
        sections, kpa = np.array(self.sections), self.pressures * KPA_PER_UNIT[self.units]
        before, main = np.flatnonzero(sections == "prefix"), np.flatnonzero(sections == "main")[1:]  # where that ends
        length = self.durations.get("main", 0.0)
        times = np.concatenate([self.times[before], *(self.times[main] + loop * length for loop in range(loops))])
        return times, np.concatenate([kpa[before], *([kpa[main]] * loops)])

    @property
    def seconds(self) -> float:
        """How long it takes, with its loops [s]."""
        lengths = self.durations
        return lengths["prefix"] + self.loops * lengths["main"] + lengths["suffix"]


def seed_text(seed: int | None) -> str:
    """The seed of a search, as headers tell it."""
    return _NO_SEED if seed is None else str(seed)


def seed_of(text: str) -> int | None:
    """The seed that a header tells."""
    return None if text == _NO_SEED else int(text)


def rate_text(rate: float | None) -> str:
    """Rows per second, as headers tell them."""
    return "corners" if rate is None else repr(rate)


def rate_of(text: str) -> float | None:
    """Rows per second that a header tells."""
    return None if text == "corners" else float(text)


def write_csv(table: RigTable, path: str | os.PathLike[str]) -> None:
    """Write a table as CSV, replacing the file in one step.

    Raises:
        ValueError: if the file cannot be written.
    """
    lines = [f"# {name}={value}" for name, value in table.header()]
    lines.append(_column_names(table.units, table.channels))
    for time, section, state, row in zip(table.times, table.sections, table.states, table.pressures, strict=True):
        lines.append(",".join([f"{time:.12g}", section, str(state), *(f"{pressure:.9g}" for pressure in row)]))
    lines.insert(1, f"# checksum={_checksum(lines)}")
    write_text(path, "\n".join(lines) + "\n")


@dataclass(frozen=True, eq=False)
class Content:
    """What a table's file holds.

    Attributes:
        pairs: names and values of the header, in its order.
        lines: all lines of the file.
        units: of the pressures.
        own_names: of the rig's lines, if it names them itself.
    """

    pairs: tuple[tuple[str, str], ...]
    lines: tuple[str, ...]
    units: str
    own_names: tuple[str, ...] = ()

    @property
    def header(self) -> Mapping[str, str]:
        """Values of the header by name; the last of several."""
        return dict(self.pairs)

    @property
    def clipped(self) -> tuple[str, ...]:
        """What was clipped, a line each."""
        return tuple(value for name, value in self.pairs if name == "clipped")

    def rows(self, columns: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Times, states and pressures of the rows of a table with so many columns.

        Raises:
            ValueError: if they are damaged, or the checksum does not fit.
        """
        found = _rows(self.lines, len(self.pairs) + 1, columns)
        # The sum comes after what can be named more precisely.
        if self.header.get("checksum") != _checksum([s for s in self.lines if not s.startswith("# checksum=")]):
            raise ValueError("checksum does not fit; the file was changed or damaged, export it again")
        return found


def read_content(lines: Sequence[str], schema: str, may_name_lines: bool = False) -> Content:
    """The content of a table's file, whose header must name this schema, and may name the lines of its rig.

    Raises:
        ValueError: if the head is damaged.
    """
    head = list(itertools.takewhile(lambda line: line.startswith("#"), lines))
    pairs = tuple((name.strip(), value.strip()) for name, _, value in (line[1:].partition("=") for line in head))
    header = dict(pairs)
    if (given := header.get("schema")) != schema:
        raise ValueError(f"schema {given!r} is unknown; the first line must be '# schema={schema}'")
    if (units := header.get("units", "")) not in KPA_PER_UNIT:
        raise ValueError(f"units {units!r} are unknown; give one of {', '.join(KPA_PER_UNIT)}")
    own = own_names(LINES, header[LINES].split(",")) if may_name_lines and LINES in header else ()
    _check_columns(lines, len(head), units, own)
    return Content(pairs, tuple(lines), units, own)


def clipped_in(path: str | os.PathLike[str]) -> list[str]:
    """What was clipped of the pressures in a table's file to stay within a rig's limits, a line each."""
    return [line.partition("=")[2] for line in read_text(path).splitlines() if line.startswith("# clipped=")]


def read_table(path: str | os.PathLike[str], build: Callable[[Sequence[str]], Table]) -> Table:
    """What a function makes of the lines of a table's file.

    Raises:
        ValueError: if the file is damaged; tells which it is, what is wrong, and where.
    """
    lines = read_text(path).splitlines()
    try:
        return build(lines)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _check_columns(lines: Sequence[str], at: int, units: str, own: Sequence[str]) -> None:
    given = lines[at].split(",") if at < len(lines) else []
    cores = sum(re.fullmatch(rf"core\d+_{UNIT_SPELLING[units]}", name) is not None for name in given)
    expected = _column_names(units, own or channel_names(max(1, cores))).split(",")
    if missing := [name for name in expected if name not in given]:
        raise ValueError(f"line {at + 1}: column {missing[0]} is missing; give {','.join(expected)}")
    if given != expected:
        raise ValueError(f"line {at + 1}: columns must be {','.join(expected)}, in this order")


def _rows(lines: Sequence[str], start: int, columns: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, states and pressures of the rows from line ``start`` on."""
    times: list[float] = []
    states: list[int] = []
    rows: list[list[float]] = []
    size = len(lines[start - 1].split(","))  # of the names
    for index, line in enumerate(lines[start:], start + 1):
        time, state, row = _row(line, index, size)
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


def _row(line: str, index: int, size: int) -> tuple[float, int, list[float]]:
    parts = line.split(",")
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


def _column_names(units: str, channels: Sequence[str]) -> str:
    return ",".join((*_FIRST, *(f"{name}_{UNIT_SPELLING[units]}" for name in channels)))
