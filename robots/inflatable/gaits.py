"""Designs of the inflatable robot whose actuators are on or off, and those that know more: files, and simulation.

A gait with graded inflation or times of its own is a ``RelaxedDesign``; here both kinds are treated alike.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from typing import Any

import numpy as np

from robots.inflatable import robot as inflatable
from robots.inflatable.actuation import Column, nominal_steps, play
from robots.inflatable.cores import Pressure, highest_pressure
from robots.inflatable.gradient import simulate_relaxed
from robots.inflatable.relaxed_motion import nominal_gait_steps, relaxed_columns
from robots.inflatable.relaxed_schedule import RelaxedDesign, RelaxedSchedule, Schedule
from robots.inflatable.robot import ACTUATION, DESIGN_FORMAT, InflatableActuation, InflatableDesign, InflatableResult
from robots.world import Terrain
from taichi_sim.base.arrays import Floats, Ints
from taichi_sim.base.files import read_record, read_text, write_record

GRADED_FORMAT = "morpholab-graded-design-1"
BESIDE_TABLES = ("format", "pressure", "orientation", "repeats")  # in files of that format

GaitDesign = InflatableDesign | RelaxedDesign


def design_of(pressure: Pressure, orientation: float, schedule: Schedule) -> GaitDesign:
    """The design with a schedule of either kind."""
    if isinstance(schedule, RelaxedSchedule):
        return RelaxedDesign(pressure, orientation, schedule)
    return InflatableDesign(pressure, orientation, schedule)


def simulate(
    designs: Sequence[GaitDesign] | GaitDesign, terrain: Terrain | None = None, **options: Any
) -> InflatableResult:
    """Evaluate designs, see ``robots.inflatable.simulate`` for the options.

    Where one of a batch is graded, all are played as such; graded gaits of a batch have as many columns.

    Raises:
        ValueError: in one line, for what is not allowed.
    """
    listed = [designs] if isinstance(designs, InflatableDesign | RelaxedDesign) else list(designs)
    if any(isinstance(design, RelaxedDesign) for design in listed):
        return simulate_relaxed([as_graded(design) for design in listed], terrain, **options)
    return inflatable.simulate([d for d in listed if isinstance(d, InflatableDesign)], terrain, **options)


def as_graded(design: GaitDesign) -> RelaxedDesign:
    """The design as one that could have more than on and off."""
    return design if isinstance(design, RelaxedDesign) else RelaxedDesign.from_design(design)


def is_timed(schedule: Schedule) -> bool:
    """Whether a gait has times of its own, which count in time steps of the published robot."""
    return isinstance(schedule, RelaxedSchedule) and schedule.timed


@dataclass(frozen=True, eq=False)
class PlayedGait:
    """The columns of a gait in the order played, N of them.

    Attributes:
        edges: time steps at which columns begin, and at which the last ends, shape (N + 1,).
        settles: time steps at which the motion of columns ends, shape (N,).
        levels: that bladders and feet are told, from 0 (off) to 1 (on), shape (10, N).
        pressures: of the core when columns begin, and when the last ends [Pa], shape (N + 1,); it changes linearly
            until the motion ends. Of a design with several, those of its cores, shape (N + 1, cores).
    """

    edges: Ints
    settles: Ints
    levels: Floats
    pressures: Floats

    @property
    def steps(self) -> int:
        """Of the whole gait."""
        return int(self.edges[-1])


def played(design: GaitDesign, actuation: InflatableActuation = ACTUATION) -> PlayedGait:
    """When a gait does what; cheap."""
    gait = design.schedule
    columns, steps = _columns(design, actuation)
    core = gait.pressure if isinstance(gait, RelaxedSchedule) else None
    before = np.array(design.pressure)
    after = np.repeat(before[None], gait.columns, axis=0) if core is None else core
    return PlayedGait(
        edges=np.array([*(column.start for column in columns), steps]),
        settles=np.array([column.start + column.motion_steps for column in columns]),
        levels=np.tile(gait.levels, gait.repeats),
        pressures=np.concatenate([before[None], *([after] * gait.repeats)]),
    )


def steps_of(design: GaitDesign, actuation: InflatableActuation = ACTUATION) -> int:
    """Time steps of a gait, without those of the initialisation; cheap."""
    return _columns(design, actuation)[1]


def simulated_steps(
    design: GaitDesign, actuation: InflatableActuation = ACTUATION, ramp_steps: int | None = None
) -> int:
    """Time steps of a gait with those of the initialisation; cheap.

    Args:
        design: the gait.
        actuation: how it is driven.
        ramp_steps: of the core pressure, see ``InflatableActuation.initial_steps``.
    """
    return actuation.initial_steps(highest_pressure(design.pressure), ramp_steps) + steps_of(design, actuation)


def counted_steps(design: GaitDesign, actuation: InflatableActuation = ACTUATION) -> int:
    """Time steps by which ``InflatableResult.speed`` counts the speed of a design; cheap."""
    gait = design.schedule
    if isinstance(gait, RelaxedSchedule):
        return nominal_gait_steps(gait, steps_of(design, actuation), actuation)
    return nominal_steps(gait.columns * gait.repeats, actuation)


def _columns(design: GaitDesign, actuation: InflatableActuation) -> tuple[list[Column], int]:
    if isinstance(design, RelaxedDesign):
        return relaxed_columns(design.schedule, actuation)
    return play(design.schedule, actuation)


def save_gait(design: GaitDesign, path: str | PathLike[str]) -> None:
    """Write a design as JSON: one of on and off as ``save_design`` does, others with tables of their columns."""
    if isinstance(design, InflatableDesign):
        inflatable.save_design(design, path)
        return
    gait = design.schedule
    record = {"pressure": design.pressure, "orientation": design.orientation, **gait.tables, "repeats": gait.repeats}
    write_record(path, GRADED_FORMAT, record)


def load_gait(path: str | PathLike[str]) -> GaitDesign:
    """Read a design that :func:`save_gait` or ``save_design`` wrote.

    Raises:
        ValueError: one line that names the file and what is wrong with it.
    """
    form = _format_of(path)
    if form == GRADED_FORMAT:
        return read_record(path, GRADED_FORMAT, _graded)
    if isinstance(form, str) and form != DESIGN_FORMAT:
        known = f"{DESIGN_FORMAT!r} and {GRADED_FORMAT!r}"
        raise ValueError(f"{path}: it is of the format {form[:60]!r}; gaits of this robot are of {known}")
    return inflatable.load_design(path)


def _format_of(path: str | PathLike[str]) -> Any:
    """What a file says it is; nothing if it is no record."""
    try:
        record = json.loads(read_text(path))
    except (ValueError, RecursionError):
        return None
    return record.get("format") if isinstance(record, dict) else None


def _graded(record: dict[str, Any]) -> RelaxedDesign:
    tables = {name: value for name, value in record.items() if name not in BESIDE_TABLES}
    gait = RelaxedSchedule.from_tables(tables, record["repeats"])
    return RelaxedDesign(record["pressure"], record["orientation"], gait)
