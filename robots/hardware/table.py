"""Gait tables: the pressures of a rig's lines that play a gait of the inflatable robot, and reading their files.

The prefix shapes the body; the header of a file carries the design exactly.
"""

import hashlib
import json
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from robots.hardware.line_map import LEVEL_DECIMALS, PRESSURE_DECIMALS, LineMap
from robots.hardware.rig import PneumaticRig
from robots.hardware.rig_table import (
    CHANNELS_SCHEMA,
    RigTable,
    State,
    rate_of,
    rate_text,
    read_content,
    read_table,
    seed_of,
    seed_text,
)
from robots.hardware.start import Start
from robots.hardware.units import KPA_PER_UNIT
from robots.inflatable.actuation import ACTUATION
from robots.inflatable.body import PUBLISHED
from robots.inflatable.design import InflatableDesign, common_pressure, kilopascals, load_design
from robots.inflatable.layout import layout_of, told_layout
from robots.inflatable.materials import RegionMaterials
from robots.inflatable.schedule import ROWS, GaitSchedule
from robots.inflatable.timing import durations
from taichi_sim.base.arrays import Floats, Ints
from taichi_sim.base.parsing import parse_json

TIME_STEP = PUBLISHED.time_step  # in which gaits count their times [s]
ARRIVED = 1e-3  # of a line: how far off it may be [kPa]
SCHEMA = "morpholab-gait-2"


@dataclass(frozen=True, eq=False, repr=False)
class GaitTable(RigTable):
    """Table of commands to a rig's lines over time, which play a gait of the inflatable robot.

    Attributes:
        times: times of the rows [s], shape (N,), with the main section played once. Between rows pressures change
            linearly. Times increase, but a section begins with the row that ends the one before.
        states: number of the state that each row belong to, shape (N,): 0 shapes the body, then the columns come
            twice, in prefix and main, then lines are vented.
        pressures: gauge pressures of :attr:`channels` in ``units``, shape (N, 11), or (N, C + 10) of C cores.
        units: ``"kpa"`` or ``"psi"``.
        design: the design that the table was made from, exactly.
        line_map: map from simulated to line pressures, as played (after clipping).
        seed: seed of the search that found the design; None if not known.
        rig: name of the rig.
        rate: rows per second; None for rows at corners.
        clipped: pressures that were clipped, a line of text each.
        timing: timing of the states; empty in a table that was read.
        start: where the first column begins, as another gait has left the lines; None: bladders are empty and feet
            grip, in the design's shape.
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
    start: Start | None = None

    @property
    def columns(self) -> int:
        """Number of columns of the schedule."""
        return self.design.schedule.columns

    @property
    def loops(self) -> int:
        """Times that the main section is played: once less than the columns are, as the prefix plays them too."""
        return self.design.schedule.repeats - 1

    def schedule(self) -> GaitSchedule:
        """Schedule that the table was made from."""
        return self.design.schedule

    def header(self) -> list[tuple[str, str]]:
        """Header of the table's file: the design, exactly, and how the table was made from it."""
        design = self.design
        return [
            ("schema", SCHEMA),
            ("units", self.units),
            ("robot_hash", design_hash(design)),
            ("seed", seed_text(self.seed)),
            ("pressure_pa", ",".join(map(repr, np.atleast_1d(design.pressure).tolist()))),
            ("orientation_deg", repr(design.orientation)),
            ("schedule", design.schedule.to_text()),
            ("repeats", str(design.schedule.repeats)),
            *([("materials", json.dumps(design.materials.given))] if design.materials is not None else []),
            *([("bladders", told_layout(design.bladders))] if design.bladders is not None else []),
            *([("start", self.start.to_text())] if self.start is not None else []),
            ("loops", str(self.loops)),
            ("rig", self.rig),
            ("rate_hz", rate_text(self.rate)),
            ("map", self.line_map.to_text()),
            *(("clipped", line) for line in self.clipped),
        ]

    def simulated(self, lines: ArrayLike) -> tuple[Floats, Floats]:
        """Compute core pressures [Pa] and levels from line pressures, like :meth:`LineMap.simulated`.

        A table has nine digits: a row that agrees to these with a number of the design gives that very number.
        """
        core, levels = self.line_map.as_read(lines)
        schedule = self.design.schedule
        pressures = [np.ravel(self.design.pressure)]
        if schedule.core_pressure is not None:
            pressures.append(np.ravel(schedule.core_pressure))
        return (
            _exact(core, np.concatenate(pressures), PRESSURE_DECIMALS),
            _exact(levels, np.ravel(schedule.levels), LEVEL_DECIMALS),
        )

    def played(self) -> InflatableDesign:
        """Design that the rows play, by the inverse of the line map.

        The header only says whether the gait is on and off, changes its core pressure and has times of its own, and
        what lines know nothing of: the orientation, paces, materials and bladders. Where the gait is on and off, an
        actuator is on above the middle between its two pressures. How long states of a gait with times of its own last
        after all lines have arrived is how long it settles.

        Raises:
            ValueError: if the rows play no schedule.
        """
        last = np.append(np.flatnonzero(np.diff(self.states)), len(self.states) - 1)
        lines = self.pressures[last] * KPA_PER_UNIT[self.units]
        told_core, levels = self.simulated(lines[:-1])  # the last state vents
        core = np.atleast_2d(told_core)
        given = self.design.schedule
        if self.start is not None:  # where the gait before ends is no part of this one
            core[:, 0] = core[:, 1] if given.core_pressure is None else self.design.pressure
        if given.skip_idle:
            levels = np.round(levels)
        if np.ptp(core, axis=1).any() and given.core_pressure is None:
            raise ValueError(f"core: {core.min():g} to {core.max():g} Pa are not allowed; a gait has one core pressure")
        first, second = np.array_split(np.vstack([levels, core])[:, 1:], 2, axis=1)
        if not np.array_equal(first, second):
            raise ValueError("gait table: the columns of its prefix differ from those of its main")
        own = given.core_pressure
        alike = not np.ptp(core, axis=0).any() and not isinstance(self.design.pressure, tuple)
        if alike and (own is None or own.ndim == 1):  # one pressure, on all lines
            core, second = core[:1], second[: ROWS + 1]
        told = None if own is None else second[ROWS] if len(core) == 1 else second[ROWS:]
        gait = GaitSchedule(second[:ROWS], self.loops + 1, told, skip_idle=given.skip_idle)
        gait = replace(gait, pace=given.pace)
        if given.has_own_times:
            moved = np.zeros(gait.columns, int) if told is None else self._steps(slice(0, -ROWS))[:, 0]
            gait = replace(gait, motion_steps=moved, settle_steps=self._steps(slice(None))[:, 1])
        before = core[:, 0].tolist()
        shared = len(set(before)) == 1 and not isinstance(self.design.pressure, tuple)
        return replace(self.design, pressure=before[0] if shared else tuple(before), schedule=gait)

    def played_at_once(self) -> InflatableDesign:
        """Design that the rows play on lines as fast as the simulator, with the header's times if the rows keep them.

        They do where all lines are done before a column settles as long as the header says, after the motion that it
        says: what states last longer is time that valves and strokes take on a rig.

        Raises:
            ValueError: if the rows play no schedule.
        """
        found, given = self.played(), self.design.schedule
        if not (given.has_own_times and self._keeps_times()):
            return found
        moved, settled = given.motion_steps, given.settle_steps
        return replace(found, schedule=replace(found.schedule, motion_steps=moved, settle_steps=settled))

    def _keeps_times(self) -> bool:
        least, settle = np.array(durations(self.design.schedule, ACTUATION))[: self.columns].T
        arrived, waiting = self._steps(slice(None)).T
        off = 1 if self.rate is None else 1 + math.ceil(1 / self.rate / TIME_STEP)  # of a corner in the rows
        return bool((arrived + waiting >= least + settle - off).all() and (waiting >= settle - off).all())

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


def _exact(found: Floats, known: Floats, decimals: int) -> Floats:
    """Rounded numbers; what is a known number but for the last decimal is replaced by the nearest that is."""
    known = np.unique(known)
    above = np.clip(np.searchsorted(known, found), 1, max(len(known) - 1, 1))
    low, high = known[above - 1], known[np.minimum(above, len(known) - 1)]
    nearest = np.where(found - low <= high - found, low, high)
    return np.where(abs(found - nearest) <= 10.0**-decimals, nearest, np.round(found, decimals))


def on_lines(design: InflatableDesign, rig: PneumaticRig) -> InflatableDesign:
    """The design with a pressure for each of the rig's lines for cores, or with one for all of them.

    Raises:
        ValueError: for a design with several cores that are not alike, and another number of lines for them; and for a
            rig with lines of its own.
    """
    rig.check_plays_gaits()
    pressure, schedule, core = design.pressure, design.schedule, design.schedule.core_pressure
    lines = "a rig has one line for the core" if rig.cores == 1 else f"the rig has {rig.cores} lines for cores"
    allowed = f"{lines}, so give all cores one, or name a rig with a line for each"
    if isinstance(pressure, tuple) and len(pressure) != rig.cores:
        if (common := common_pressure(pressure)) is None:
            raise ValueError(f"pressure: {kilopascals(pressure)} are not allowed; {allowed}")
        pressure = common
    if core is not None and core.ndim == 2 and len(core) != rig.cores:
        if np.ptp(core, axis=0).any():
            raise ValueError(f"core_pressure: {len(core)} rows are not allowed; {allowed}")
        schedule = replace(schedule, core_pressure=core[0])
    return InflatableDesign(pressure, design.orientation, schedule, design.materials, design.bladders)


def design_hash(design: InflatableDesign) -> str:
    """Compute a short fingerprint of a robot's design, equal for equal designs on every machine."""
    pressure, schedule = common_pressure(design.pressure), design.schedule
    content: list[Any] = [design.pressure if pressure is None else float(pressure), float(design.orientation)]
    content += [schedule.to_text(), schedule.repeats]
    content += [design.materials.given] if design.materials is not None else []
    content += [list(design.bladders)] if design.bladders is not None else []
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()[:16]


def read_csv(path: str | os.PathLike[str]) -> GaitTable:
    """Read a gait table that :func:`export_csv` wrote as CSV.

    Raises:
        ValueError: if the file is damaged; tells what is wrong, and where.
    """
    return read_table(path, _read)


def read_design(path: Path, from_rows: bool = False) -> InflatableDesign:
    """Read the design of a gait file (JSON), or of a gait table (``.csv``): its header's, or what its rows play.

    Raises:
        ValueError: for any other file, and for rows asked of one that has none.
    """
    if path.suffix.lower() == ".csv":
        table = read_csv(path)
        return table.played() if from_rows else table.design
    if from_rows:
        raise ValueError(f"from-rows: {str(path)!r} has no rows; name a gait table (.csv)")
    return load_design(path)


def _read(lines: Sequence[str]) -> GaitTable:
    if lines[:1] == [f"# schema={CHANNELS_SCHEMA}"]:
        meant = "use it as --channels, with the robot that it drives: --robot BEST.json --channels FILE.csv"
        raise ValueError(f"it has channels of a robot of another kind, and no gait; {meant}")
    content = read_content(lines, SCHEMA)
    header = content.header
    try:
        schedule = GaitSchedule.from_text(header["schedule"], int(header["repeats"]))
        materials = RegionMaterials.of(parse_json(header["materials"])) if "materials" in header else None
        bladders = layout_of(header["bladders"]) if "bladders" in header else None
        pressure = tuple(map(float, header["pressure_pa"].split(",")))
        design = InflatableDesign(pressure, float(header["orientation_deg"]), schedule, materials, bladders)
        fits = header["robot_hash"] == design_hash(design) and header["loops"] == str(schedule.repeats - 1)
        line_map = LineMap.from_text(header["map"])
        seed, rate, rig = seed_of(header["seed"]), rate_of(header["rate_hz"]), header["rig"]
        start = Start.from_text(header["start"]) if "start" in header else None
    except KeyError as missing:
        raise ValueError(f"{missing.args[0]} is missing in the header") from None
    except ValueError as error:
        raise ValueError(f"header is damaged ({error})") from None
    if not fits:
        raise ValueError("header is damaged (robot_hash and loops do not fit its design)")
    times, states, pressures = content.rows(schedule.columns)
    core, lines = schedule.core_pressure, pressures.shape[1] - ROWS
    for told in (len(pressure), len(core) if core is not None and core.ndim == 2 else 1):
        if told not in (1, lines):
            raise ValueError(f"header is damaged (its design has {told} cores, the table {lines} lines for cores)")
    table = GaitTable(times, states, pressures, content.units, design, line_map, seed, rig, rate, content.clipped)
    return replace(table, start=start)
