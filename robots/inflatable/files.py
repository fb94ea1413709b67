"""Gait files: designs of the inflatable robot as JSON, in two formats.

Schedules of on and off are written as rows of 0 and 1, all others as tables of numbers, see ``docs/gait-files.md``.
"""

import json
from os import PathLike
from typing import Any

from robots.inflatable.design import InflatableDesign
from robots.inflatable.schedule import GaitSchedule
from taichi_sim.base.files import read_record, read_text, write_record

ROWS_FORMAT = "morpholab-inflatable-design-1"
TABLES_FORMAT = "morpholab-graded-design-1"
BESIDE_TABLES = ("format", "pressure", "orientation", "repeats")  # in files of the second format


def save_design(design: InflatableDesign, path: str | PathLike[str]) -> None:
    """Write a design as JSON: pressure [Pa], one or a list, orientation [degrees], the schedule and its repeats."""
    gait = design.schedule
    schedule = {"schedule": gait.to_text().split("/")} if gait.skip_idle else gait.tables
    record = {"pressure": design.pressure, "orientation": design.orientation, **schedule, "repeats": gait.repeats}
    write_record(path, ROWS_FORMAT if gait.skip_idle else TABLES_FORMAT, record)


def load_design(path: str | PathLike[str]) -> InflatableDesign:
    """Read a design that :func:`save_design` wrote, in either format.

    Raises:
        ValueError: if the file cannot be read as one; names the file and what is wrong with it.
    """
    try:
        record = json.loads(read_text(path))
        form = record.get("format") if isinstance(record, dict) else None
    except (json.JSONDecodeError, RecursionError):
        form = None
    if isinstance(form, str) and form not in (ROWS_FORMAT, TABLES_FORMAT):
        known = f"{ROWS_FORMAT!r} and {TABLES_FORMAT!r}"
        raise ValueError(f"{path}: it is of the format {form[:60]!r}; gaits of this robot are of {known}")
    return read_record(path, TABLES_FORMAT if form == TABLES_FORMAT else ROWS_FORMAT, _design)


def _design(record: dict[str, Any]) -> InflatableDesign:
    """The design of a record of either format."""
    if record["format"] == ROWS_FORMAT:
        schedule = GaitSchedule.from_text("/".join(record["schedule"]), record["repeats"])
    else:
        tables = {name: value for name, value in record.items() if name not in BESIDE_TABLES}
        schedule = GaitSchedule.from_tables(tables, record["repeats"])
    return InflatableDesign(record["pressure"], record["orientation"], schedule)
