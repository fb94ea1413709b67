"""Files of measurements: TOML with one table per experiment and units in the names of the columns."""

import json
import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np

from robots.calibration.experiments import SIDES, Diameter, Drag, Experiment, Gait
from robots.inflatable.actuation import WEIGHTS
from robots.inflatable.body import NAMED_GEOMETRIES
from robots.inflatable.design import InflatableDesign
from robots.inflatable.kind import InflatableKind, load_gait
from robots.inflatable.schedule import MAXIMUM_PRESSURE
from robots.world import Terrain
from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import choice, number, whole_number
from taichi_sim.base.files import read_text, write_text
from taichi_sim.base.parsing import parse_toml

KIND = InflatableKind()
_LENGTH = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}
_FORCE = {"n": 1.0, "mn": 1e-3}
UNITS: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        **dict.fromkeys(("displacement", "width", "height", "distance"), _LENGTH),
        **dict.fromkeys(("force", "load"), _FORCE),
        "pressure": {"kpa": 1e3, "pa": 1.0, "psi": 6894.757},
        "time": {"s": 1.0, "ms": 1e-3},
        "speed": {"mm_per_s": 1e-3, "cm_per_s": 1e-2, "m_per_s": 1.0},
    }
)
_FEET = {"grips": True, "slides": False}
LoadGait = Callable[[str], InflatableDesign]


@dataclass(frozen=True, eq=False)
class Measurements:
    """Content of a file of measurements.

    Attributes:
        geometry: name of the robot's geometry.
        experiments: in the order drags, diameters, gaits.
        weight: weight of bladders, see ``InflatableActuation``.
    """

    geometry: str
    experiments: tuple[Experiment, ...]
    weight: str = "published"


def read_measurements(path: str | os.PathLike[str], load_gait: LoadGait) -> Measurements:
    """Read a file of measurements, see docs/calibration.md.

    Args:
        path: path of the TOML file.
        load_gait: function from the name or file of a gait to its design.

    Raises:
        ValueError: for an unreadable file, unknown names or units, missing columns or values that are not allowed.
    """
    text = read_text(path)
    readers: dict[str, Callable[[_Table], Experiment]] = {
        "drag": _drag,
        "diameter": _diameter,
        "gait": partial(_gait, load_gait),
    }
    try:
        data = parse_toml(text)
    except ValueError as error:
        told = "these are TOML with tables such as [[drag]]; morpholab calibrate --example FILE writes one"
        raise ValueError(f"{path}: is no file of measurements ({error}); {told}") from None
    try:
        geometry = choice("geometry", data.pop("geometry", "published"), NAMED_GEOMETRIES)
        weight = choice("weight", data.pop("weight", WEIGHTS[0]), WEIGHTS)
        if unknown := sorted(set(data) - set(readers)):
            raise ValueError(f"{unknown[0]!r} is unknown; give geometry and tables [[{']], [['.join(readers)}]]")
        experiments = [
            _experiment(_Table(f"{kind} {place}", table), read)
            for kind, read in readers.items()
            for place, table in enumerate(_tables(kind, data.get(kind, [])), 1)
        ]
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    if not experiments:
        raise ValueError(f"{path}: holds no experiment; give a table [[drag]], [[diameter]] or [[gait]]")
    return Measurements(geometry, tuple(experiments), weight)


class _Table:
    """Table of one experiment; entries are removed when they are read, so that unknown entries are left."""

    def __init__(self, where: str, data: Mapping[str, Any]) -> None:
        self.where, self.left = where, dict(data)

    def error(self, problem: str) -> ValueError:
        return ValueError(f"{self.where}: {problem.removeprefix(f'{self.where}: ')}")

    def has(self, name: str) -> bool:
        return any(key == name or key.startswith(f"{name}_") for key in self.left)

    def either(self, *names: str) -> str:
        """Name of the one column of these that is given."""
        given = [name for name in names if self.has(name)]
        if len(given) != 1:
            raise self.error(f"give one column of {' or '.join(names)}; both are two tables")
        return given[0]

    def column(self, name: str, suffix: str = "", low: float = -math.inf) -> Floats | None:
        """Numbers of a column in SI units, shape (N,); None if there is no such column."""
        allowed = [f"{name}{suffix}_{unit}" for unit in UNITS[name]]
        given = [key for key in self.left if key == name + suffix or key.startswith(f"{name}{suffix}_")]
        given = [key for key in given if suffix or not key.startswith(f"{name}_sd")]
        if not given:
            return None
        if len(given) > 1 or given[0] not in allowed:
            raise self.error(f"{given[-1]}: is not allowed; name the unit, as one of {', '.join(allowed)}")
        values, scale = self.left.pop(given[0]), UNITS[name][given[0][len(name + suffix) + 1 :]]
        listed = values if isinstance(values, list) else [values]
        if not listed:
            raise self.error(f"{given[0]}: is empty; give at least one number")
        return scale * np.array([number(f"{self.where}: {given[0]}", value, low) for value in listed])

    def required(self, name: str, low: float = -math.inf) -> Floats:
        found = self.column(name, low=low)
        if found is None:
            raise self.error(f"column {name} is missing; give one of {', '.join(f'{name}_{u}' for u in UNITS[name])}")
        return found

    def single(self, name: str, low: float) -> float:
        found = self.required(name, low)
        if len(found) != 1:
            raise self.error(f"{name}: {len(found)} values are not allowed; give one")
        return float(found[0])

    def measured(self, name: str, at: Floats | None, low: float = -math.inf) -> tuple[Floats, Floats | None]:
        """Values and standard deviations; a single deviation applies to all values."""
        values, deviations = self.required(name, low), self.column(name, "_sd", 0.0)
        if at is not None and len(values) != len(at):
            raise self.error(f"{name}: {len(values)} values are not allowed for {len(at)} points; give as many")
        if deviations is None:
            if not np.abs(values).max() > 0:
                raise self.error(f"{name}: 0 everywhere is not allowed without {name}_sd; give that too")
            return values, None
        if len(deviations) not in (1, len(values)) or not deviations.min() > 0:
            raise self.error(f"{name}_sd: is not allowed; give one positive number, or one for every point")
        return values, np.broadcast_to(deviations, values.shape).copy()


def _tables(kind: str, given: Any) -> list[dict[str, Any]]:
    if not isinstance(given, list) or not all(isinstance(table, dict) for table in given):
        raise ValueError(f"{kind}: give tables that begin with [[{kind}]]")
    return given


def _experiment(table: _Table, read: Callable[[_Table], Experiment]) -> Experiment:
    """Read the experiment of a table; entries that the reader does not use are refused."""
    found = read(table)
    if table.left:
        raise table.error(f"{min(table.left)!r} is unknown")
    return found


def _drag(table: _Table) -> Drag:
    at = table.required("displacement", 0.0)
    forces, deviations = table.measured("force", at)
    if forces.mean() < 0:
        told = f"a mean of {forces.mean():.3g} N is not allowed; forces that resist the drag are positive"
        raise table.error(f"force: {told}")
    load, foot = table.single("load", 0.0), choice(f"{table.where}: foot", table.left.pop("foot", "grips"), _FEET)
    if load == 0 or at.max() == 0:
        raise table.error(f"{'displacement' if load else 'load'}: 0 is not allowed; it must be positive")
    return Drag(at, forces, load, _FEET[foot], deviations)


def _diameter(table: _Table) -> Diameter:
    at = table.required("pressure", 0.0)
    side = table.either(*SIDES)
    values, deviations = table.measured(side, at, 0.0)
    for pressure in at:
        number(f"{table.where}: pressure", round(float(pressure), 6), 0.0, MAXIMUM_PRESSURE, "Pa")
    return Diameter(at, values, side, deviations)


def _gait(load_gait: LoadGait, table: _Table) -> Gait:
    name = table.left.pop("gait", None)
    if not isinstance(name, str) or not name:
        raise table.error("gait is missing; name inching, rolling or the file of a gait")
    try:
        design = _played(name, load_gait, table)
        terrain = Terrain.parse(str(table.left.pop("terrain", "flat")))
        if ground := {name: table.left.pop(name) for name in KIND.ground_options if name in table.left}:
            terrain = KIND.on_ground(terrain, ground)
    except ValueError as error:
        raise table.error(str(error)) from None
    at = table.column("time", low=0.0)
    kind = table.either("distance", "speed")
    values, deviations = table.measured(kind, at)
    at = np.full(len(values), np.inf) if at is None else at  # without times, values are for the whole gait
    if kind == "speed" and at.min() == 0:
        raise table.error("time: 0 is not allowed of a mean speed; give later times")
    return Gait(at, values, design, name, terrain, kind == "speed", deviations)


def _played(name: str, load_gait: LoadGait, table: _Table) -> InflatableDesign:
    """The gait with the pressure, orientation, columns and repeats that the table gives."""
    counts = {key: table.left.pop(key, None) for key in ("columns", "repeats")}
    cut = [None if value is None else whole_number(key, value, 1) for key, value in counts.items()]
    design = load_gait(name)
    for own in ("materials", "bladders"):
        if getattr(design, own) is not None:
            raise ValueError(f"gait: {name} has {own} of its own, which is not allowed where a robot is fitted")
    pressure = table.single("pressure", 0.0) if table.has("pressure") else design.pressure
    orientation = table.left.pop("orientation_deg", design.orientation)
    return InflatableDesign(pressure, orientation, design.schedule.cut(*cut))


def write_measurements(
    path: str | os.PathLike[str],
    geometry: str,
    experiments: Sequence[Experiment],
    weight: str = WEIGHTS[0],
    load_gait: LoadGait = load_gait,
) -> None:
    """Write a file from which :func:`read_measurements` reads the same, numbers to six digits.

    Drags come first, then diameters, then gaits, by their names.

    Raises:
        ValueError: for gaits that are not those of their names, by ``load_gait``, with fewer columns or more repeats,
            and times of which only some are infinite, which no file says.
    """
    parts = [f'geometry = "{choice("geometry", geometry, NAMED_GEOMETRIES)}"']
    parts[0] += f'\nweight = "{weight}"' if choice("weight", weight, WEIGHTS) != WEIGHTS[0] else ""
    for experiment in experiments:
        if isinstance(experiment, Drag):
            foot = "grips" if experiment.grips else "slides"
            lines = [f'foot = "{foot}"', f"load_n = {experiment.load:g}", _line("displacement_mm", experiment.at)]
            kind, value = "drag", "force_n"
        elif isinstance(experiment, Diameter):
            lines = [_line("pressure_kpa", experiment.at)]
            kind, value = "diameter", f"{experiment.side}_mm"
        else:
            where = {**KIND.world_values(experiment.terrain), "terrain": f'"{experiment.terrain.name}"'}
            lines = [f"gait = {json.dumps(experiment.name, ensure_ascii=False)}", *_as_named(experiment, load_gait)]
            lines += [f"{name} = {list(v) if isinstance(v, tuple) else v}" for name, v in where.items()]
            lines += [_line("time_s", experiment.at)] if _timed(experiment) else []
            kind, value = "gait", "speed_mm_per_s" if experiment.mean_speed else "distance_mm"
        lines.append(_line(value, experiment.values))
        if experiment.deviations is not None:
            quantity, _, unit = value.partition("_")
            lines.append(_line(f"{quantity}_sd_{unit}", experiment.deviations))
        parts.append("\n".join([f"[[{kind}]]", *lines]))
    write_text(path, "\n\n".join(parts) + "\n")


def _as_named(gait: Gait, load_gait: LoadGait) -> list[str]:
    """Entries of a table for what a gait has otherwise than the one of its name."""
    named, design = load_gait(gait.name), gait.design
    schedule = design.schedule
    if named.schedule.cut(min(schedule.columns, named.schedule.columns), schedule.repeats) != schedule:
        raise ValueError(f"experiments: {gait.title} does not play the gait {gait.name}; save it, and name its file")
    for own in ("materials", "bladders"):
        if getattr(design, own) is not None:
            raise ValueError(f"experiments: {own} of {gait.title} are not allowed where a robot is fitted")
    found = {}
    if design.pressure != named.pressure:
        found["pressure_pa"] = number(f"experiments: pressure of {gait.title}", design.pressure, 0.0, unit="Pa")
    found |= {"orientation_deg": design.orientation} if design.orientation != named.orientation else {}
    counts = {name: getattr(schedule, name) for name in ("columns", "repeats")}
    found |= {name: count for name, count in counts.items() if count != getattr(named.schedule, name)}
    return [f"{name} = {value!r}" for name, value in found.items()]


def _timed(gait: Gait) -> bool:
    """Whether values are at times; else they are for all of the gait."""
    finite = np.isfinite(gait.at)
    if finite.any() and not finite.all():
        raise ValueError(f"experiments: times of {gait.title} are infinite in part; give all, or two experiments")
    return bool(finite.all())


def _line(column: str, values: Floats) -> str:
    quantity, _, unit = column.replace("_sd", "").partition("_")
    numbers = ", ".join(f"{value / UNITS[quantity][unit]:.6g}" for value in values)
    return f"{column} = [{numbers}]"
