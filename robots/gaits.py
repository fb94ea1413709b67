"""Designs of the inflatable robot whose actuators are on or off, and those that know more: files, and simulation.

A gait with graded inflation or times of its own is a ``RelaxedDesign``; here both kinds are treated alike.
"""

import json
from collections.abc import Sequence
from os import PathLike
from typing import Any

import numpy as np

from robots import inflatable
from robots.files import read_record, read_text, write_record
from robots.inflatable import ACTUATION, InflatableActuation, InflatableDesign, InflatableResult
from robots.inflatable_actuation import Column, play
from robots.inflatable_gradient import simulate_relaxed
from robots.relaxed_motion import play_constant
from robots.relaxed_schedule import RelaxedDesign, RelaxedSchedule
from robots.schedule import GaitSchedule
from robots.terrain import Terrain

GRADED_FORMAT = "morpholab-graded-design-1"

GaitDesign = InflatableDesign | RelaxedDesign


def design_of(pressure: float, orientation: float, schedule: GaitSchedule | RelaxedSchedule) -> GaitDesign:
    """The design with a schedule of either kind."""
    if isinstance(schedule, RelaxedSchedule):
        return RelaxedDesign(pressure, orientation, schedule)
    return InflatableDesign(pressure, orientation, schedule)


def simulate(
    designs: Sequence[GaitDesign] | GaitDesign, terrain: Terrain | None = None, **options: Any
) -> InflatableResult:
    """Evaluate designs of one kind, see ``robots.inflatable.simulate`` for the options.

    Raises:
        ValueError: in one line, for a mixture and whatever else is not allowed.
    """
    listed = [designs] if isinstance(designs, InflatableDesign | RelaxedDesign) else list(designs)
    if any(isinstance(design, RelaxedDesign) for design in listed):
        return simulate_relaxed([as_graded(design) for design in listed], terrain, **options)
    return inflatable.simulate([d for d in listed if isinstance(d, InflatableDesign)], terrain, **options)


def as_graded(design: GaitDesign) -> RelaxedDesign:
    """The design as one that could have more than on and off."""
    return design if isinstance(design, RelaxedDesign) else RelaxedDesign.from_design(design)


def columns_of(design: GaitDesign, actuation: InflatableActuation = ACTUATION) -> list[Column]:
    """The columns of a gait as they are played."""
    return _played(design, actuation)[0]


def steps_of(design: GaitDesign, actuation: InflatableActuation = ACTUATION) -> int:
    """Time steps of a gait, without those of the initialisation; cheap."""
    return _played(design, actuation)[1]


def _played(design: GaitDesign, actuation: InflatableActuation) -> tuple[list[Column], int]:
    if isinstance(design, RelaxedDesign):
        return play_constant(design.schedule, actuation)
    return play(design.schedule, actuation)


def save_gait(design: GaitDesign, path: str | PathLike[str]) -> None:
    """Write a design as JSON: one of on and off as ``save_design`` does, others with tables of their columns."""
    if isinstance(design, InflatableDesign):
        inflatable.save_design(design, path)
        return
    gait = design.schedule
    tables = {
        name: table.tolist()
        for name in ("inflation", "grip", "motion_steps", "settle_steps")
        if (table := getattr(gait, name)) is not None
    }
    core = {} if gait.pressure is None else {"core_pressure": gait.pressure.tolist()}
    record = {"pressure": design.pressure, "orientation": design.orientation, **tables, **core, "repeats": gait.repeats}
    write_record(path, GRADED_FORMAT, record)


def load_gait(path: str | PathLike[str]) -> GaitDesign:
    """Read a design that :func:`save_gait` or ``save_design`` wrote.

    Raises:
        ValueError: one line that names the file and what is wrong with it.
    """
    if _format_of(path) == GRADED_FORMAT:
        return read_record(path, GRADED_FORMAT, _graded)
    return inflatable.load_design(path)


def _format_of(path: str | PathLike[str]) -> Any:
    """What a file says it is; nothing if it is no record."""
    try:
        record = json.loads(read_text(path))
    except json.JSONDecodeError:
        return None
    return record.get("format") if isinstance(record, dict) else None


def _graded(record: dict[str, Any]) -> RelaxedDesign:
    names = {"inflation", "grip", "motion_steps", "settle_steps", "core_pressure", "repeats"}
    tables = {name: value for name, value in record.items() if name in names}
    core = tables.pop("core_pressure", None)
    gait = RelaxedSchedule(**tables, pressure=None if core is None else np.asarray(core, float))
    return RelaxedDesign(record["pressure"], record["orientation"], gait)
