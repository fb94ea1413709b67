"""Designs of the inflatable shape-changing robot, their files, and the two gaits that were made by hand.

Gait files are JSON, in two formats: schedules of on and off are rows of 0 and 1, all others are tables of numbers, see
``docs/gait-files.md``; with materials of its regions a design is of a third, with a layout of bladders of a fourth.

Source: Powers 2021 dissertation, ch. 5 ("A soft robot that adapts to environments through shape change"); Shah, Powers
et al., Nature Machine Intelligence 3, 51-59, 2021.
"""

from dataclasses import dataclass, replace
from itertools import product
from os import PathLike
from typing import TYPE_CHECKING, Any, Self, TypeVar

import numpy as np

from robots.inflatable.layout import Layout, checked_layout, layout_mask, told_layout
from robots.inflatable.materials import RegionMaterials
from robots.inflatable.schedule import MAXIMUM_PRESSURE, GaitSchedule
from taichi_sim.base.checks import known_names, number
from taichi_sim.base.files import read_record, read_text, write_record
from taichi_sim.base.parsing import parse_json

if TYPE_CHECKING:
    from robots.inflatable.body import InflatableGeometry

ROWS_FORMAT = "morpholab-inflatable-design-1"
TABLES_FORMAT = "morpholab-graded-design-1"
MATERIALS_FORMAT = "morpholab-inflatable-design-2"
LAYOUT_FORMAT = "morpholab-inflatable-design-3"
FORMATS = (ROWS_FORMAT, TABLES_FORMAT, MATERIALS_FORMAT, LAYOUT_FORMAT)
BESIDE_TABLES = ("format", "pressure", "orientation", "repeats")  # in files of the second format

Pressure = float | tuple[float, ...]  # of all cores alike, or of each [Pa]
Number = TypeVar("Number")


def checked_pressure(given: object) -> Pressure:
    """A pressure of all cores as a float, several as a tuple.

    Raises:
        ValueError: for anything else, and beyond 0 to 15,000 Pa.
    """
    if not isinstance(given, list | tuple) and not (isinstance(given, np.ndarray) and given.ndim):
        return number("pressure", given, 0.0, MAXIMUM_PRESSURE, "Pa")
    if not len(given):
        raise ValueError("pressure: none is given; give one for all cores, or one each")
    each = tuple(number("pressure", one, 0.0, MAXIMUM_PRESSURE, "Pa") for one in given)
    return each[0] if len(each) == 1 else each


def each_pressure(pressure: Number | tuple[Number, ...], geometry: "InflatableGeometry") -> tuple[Number, ...]:
    """The pressure of every core [Pa].

    Raises:
        ValueError: if several pressures are not as many as the cores.
    """
    if not isinstance(pressure, tuple):
        return (pressure,) * geometry.cores
    if len(pressure) != geometry.cores:
        allowed = "give one, for the one core" if geometry.cores == 1 else f"give one, or {geometry.cores}, one a core"
        raise ValueError(f"pressure: {len(pressure)} values are not allowed; {allowed}")
    return pressure


def highest_pressure(pressure: Pressure) -> float:
    """The highest pressure of any core [Pa], which says how long the ramp lasts."""
    return max(np.atleast_1d(pressure).tolist())


def common_pressure(pressure: Pressure) -> float | None:
    """The pressure that all cores have [Pa]; None where they differ."""
    first, *others = set(np.atleast_1d(pressure).tolist())
    return None if others else first


def kilopascals(pressure: Pressure) -> str:
    """Pressures in words, such as ``"12 kPa"`` or ``"12 and 0 kPa"``."""
    *before, last = (f"{one / 1000:.3g}" for one in np.atleast_1d(pressure).tolist())
    return f"{', '.join(before)} and {last} kPa" if before else f"{last} kPa"


@dataclass(frozen=True)
class InflatableDesign:
    """A design of the inflatable robot: the core pressure that gives its shape, its heading, and its schedule.

    Attributes:
        pressure: core pressure [Pa], 0 (flat) to 15,000; 12,000 makes it round. In a body with several cores a number
            counts for all of them, and a tuple has one for each, from the end of foot 1 on. Where columns of the
            schedule have core pressures, this is the pressure before the gait: one number, if cores share them.
        orientation: heading [degrees], from 0, the rolling direction along x, to 90, the inching direction along y.
        schedule: when and how far bladders inflate and feet grip.
        materials: of the body's regions, and friction of the feet; None is as the geometry has them.
        bladders: places that have a bladder; None is as the geometry has them. The schedule leaves the others empty.

    Raises:
        ValueError: for a field that is not allowed, or a schedule that fills bladders which are not there.
    """

    pressure: Pressure
    orientation: float
    schedule: GaitSchedule
    materials: RegionMaterials | None = None
    bladders: Layout | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "pressure", checked_pressure(self.pressure))
        object.__setattr__(self, "orientation", number("orientation", self.orientation, 0.0, 90.0, "degrees"))
        if not isinstance(self.schedule, GaitSchedule):
            raise ValueError(f"schedule: {type(self.schedule).__name__} is not allowed; give a GaitSchedule")
        if self.materials is not None and not isinstance(self.materials, RegionMaterials):
            raise ValueError(f"materials: {type(self.materials).__name__} is not allowed; give RegionMaterials")
        after = self.schedule.core_pressure
        if isinstance(self.pressure, tuple) and after is not None and after.ndim == 1:
            raise ValueError(
                f"pressure: {len(self.pressure)} values are not allowed with a gait that has core pressures of its "
                "columns; give one"
            )
        if self.bladders is not None:
            object.__setattr__(self, "bladders", checked_layout("bladders", self.bladders))
            self.check_layout(self.bladders)

    @property
    def last_pressure(self) -> Pressure:
        """Pressure of the cores with which the gait ends [Pa]."""
        core = self.schedule.core_pressure
        return self.pressure if core is None else checked_pressure(core.T[-1].tolist())

    def check_layout(self, bladders: Layout) -> None:
        """Refuse a layout without a bladder that the schedule fills.

        Raises:
            ValueError: that names the first such bladder and the column.
        """
        filled = np.argwhere((self.schedule.inflation > 0) & ~layout_mask(bladders)[:, None])
        if len(filled):
            place, column = filled[0] + 1
            told = f"bladder {place} is not there (there are: {told_layout(bladders)})"
            raise ValueError(f"bladders: {told}, but column {column} of the gait fills it; leave it empty, or add it")

    def with_layout(self, bladders: Layout) -> Self:
        """Return the design for a body with only these bladders; its schedule leaves the others empty.

        Raises:
            ValueError: for places that are not allowed.
        """
        places = checked_layout("bladders", bladders)
        return replace(self, schedule=self.schedule.emptied(~layout_mask(places)), bladders=places)


INCHING = InflatableDesign(
    pressure=0.0,
    orientation=90.0,
    schedule=GaitSchedule.from_text("/".join(["10101010"] * 4 + ["00000000"] * 4 + ["01010101", "10101010"])),
)
"""The published gait by hand of the flat robot: it inches."""
ROLLING = InflatableDesign(
    pressure=12e3,
    orientation=0.0,
    schedule=GaitSchedule(np.vstack([np.eye(8)[::-1], np.zeros((2, 8))])),
)
"""The published gait by hand of the round robot: it rolls."""
BY_HAND = {"inching": INCHING, "rolling": ROLLING}


def core_shapes(geometry: "InflatableGeometry", pressure: float) -> list[tuple[float, ...]]:
    """List the core pressures [Pa] of all 2^N shapes of a geometry with N cores, each inflated or not.

    Shape s has core k inflated where bit k of s is 1, the first core's being the lowest bit: so the first shape is
    flat, the second has the first core alone, and the last has all.

    Args:
        geometry: geometry of the body.
        pressure: pressure of inflated cores [Pa].

    Raises:
        ValueError: for a pressure that is not allowed, or none.
    """
    inflated = checked_pressure(pressure)
    if isinstance(inflated, tuple) or inflated == 0:
        raise ValueError(f"pressure: {pressure!r} is not allowed; give one above 0 Pa")
    return [shape[::-1] for shape in product((0.0, inflated), repeat=geometry.cores)]


def save_design(design: InflatableDesign, path: str | PathLike[str]) -> None:
    """Write a design as JSON: pressure [Pa], one or a list, orientation [degrees], the schedule and its repeats.

    Materials of its regions and the places of its bladders follow, if it has some of its own.
    """
    gait, made = design.schedule, design.materials.given if design.materials is not None else {}
    if made or design.bladders is not None:
        own = {"schedule": gait.to_text(), "repeats": gait.repeats, **({"materials": made} if made else {})}
        shape = {"pressure": design.pressure, "orientation": design.orientation}
        laid = {} if design.bladders is None else {"bladders": list(design.bladders)}
        write_record(path, LAYOUT_FORMAT if laid else MATERIALS_FORMAT, {**shape, **own, **laid})
        return
    schedule = {"schedule": gait.to_text().split("/")} if gait.skip_idle else gait.tables
    record = {"pressure": design.pressure, "orientation": design.orientation, **schedule, "repeats": gait.repeats}
    write_record(path, ROWS_FORMAT if gait.skip_idle else TABLES_FORMAT, record)


def load_design(path: str | PathLike[str]) -> InflatableDesign:
    """Read a design that :func:`save_design` wrote, in any of its formats.

    Raises:
        ValueError: if the file cannot be read as one; names the file and what is wrong with it.
    """
    text = read_text(path)
    try:
        record = parse_json(text)
        form = record.get("format") if isinstance(record, dict) else None
    except ValueError:
        form = None
    if isinstance(form, str) and form not in FORMATS:
        known = (
            f"{ROWS_FORMAT!r} and {TABLES_FORMAT!r}, with materials {MATERIALS_FORMAT!r} or with bladders "
            f"{LAYOUT_FORMAT!r}"
        )
        raise ValueError(f"{path}: it is of the format {form[:60]!r}; gaits of this robot are of {known}")
    return read_record(path, form if form in FORMATS else ROWS_FORMAT, _design_of)


def _design_of(record: dict[str, Any]) -> InflatableDesign:
    """The design of a record of any format."""
    if record["format"] != TABLES_FORMAT:  # whose tables are checked by their names
        own = {MATERIALS_FORMAT: ("materials",), LAYOUT_FORMAT: ("materials", "bladders")}.get(record["format"], ())
        known_names(record, *BESIDE_TABLES, "schedule", *own)
    if record["format"] in (MATERIALS_FORMAT, LAYOUT_FORMAT):
        schedule = GaitSchedule.from_text(record["schedule"], record["repeats"])
        is_laid = record["format"] == LAYOUT_FORMAT
        materials = None if is_laid and "materials" not in record else RegionMaterials.of(record["materials"])
        bladders = record["bladders"] if is_laid else None
        return InflatableDesign(record["pressure"], record["orientation"], schedule, materials, bladders)
    if record["format"] == ROWS_FORMAT:
        schedule = GaitSchedule.from_text("/".join(record["schedule"]), record["repeats"])
    else:
        tables = {name: value for name, value in record.items() if name not in BESIDE_TABLES}
        schedule = GaitSchedule.from_tables(tables, record["repeats"])
    return InflatableDesign(record["pressure"], record["orientation"], schedule)
