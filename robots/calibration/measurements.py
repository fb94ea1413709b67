"""Files of measurements: TOML with a table for every experiment, units in the names of the columns."""

import math
import os
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from robots.calibration.diameter import SIDES, Diameter
from robots.calibration.drag import Drag
from robots.calibration.gait import Gait
from robots.calibration.laboratory import Experiment
from robots.inflatable.body import NAMED_GEOMETRIES
from robots.inflatable.design import InflatableDesign
from robots.inflatable.schedule import MAXIMUM_PRESSURE
from robots.world import Terrain
from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import choice, number, whole_number
from taichi_sim.base.files import read_text, write_text

_LENGTH = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}
UNITS: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "displacement": _LENGTH,
        "width": _LENGTH,
        "height": _LENGTH,
        "distance": _LENGTH,
        "force": {"n": 1.0, "mn": 1e-3},
        "load": {"n": 1.0, "mn": 1e-3},
        "pressure": {"kpa": 1e3, "pa": 1.0, "psi": 6894.757},
        "time": {"s": 1.0, "ms": 1e-3},
        "speed": {"mm_per_s": 1e-3, "cm_per_s": 1e-2, "m_per_s": 1.0},
    }
)
_FEET = {"grips": True, "slides": False}
LoadGait = Callable[[str, int | None, int | None], InflatableDesign]  # name, columns, repeats


@dataclass(frozen=True, eq=False)
class Measurements:
    """What a file says.

    Attributes:
        geometry: name of the robot's geometry.
        experiments: in the order drags, diameters, gaits.
    """

    geometry: str
    experiments: tuple[Experiment, ...]


def read_measurements(path: str | os.PathLike[str], load_gait: LoadGait) -> Measurements:
    """Read a file of measurements, see docs/calibration.md.

    Args:
        path: of the TOML file.
        load_gait: the design of a gait's name or file, cut to so many columns and repeats; None is the gait's own.

    Raises:
        ValueError: in one line, for an unreadable file, unknown names and units, missing columns, bad values.
    """
    text = read_text(path)
    try:
        data = tomllib.loads(text)
        geometry = data.pop("geometry", "published")
        choice("geometry", geometry, NAMED_GEOMETRIES)
        readers: dict[str, Callable[[_Table], Experiment]] = {
            "drag": _drag,
            "diameter": _diameter,
            "gait": lambda table: _gait(table, load_gait),
        }
        if unknown := sorted(set(data) - set(readers)):
            raise ValueError(f"{unknown[0]!r} is unknown; give geometry and tables [[{']], [['.join(readers)}]]")
        experiments = [read(table) for kind, read in readers.items() for table in _tables(kind, data.get(kind, []))]
    except ValueError as error:  # syntax errors too
        raise ValueError(f"{path}: {error}") from None
    if not experiments:
        raise ValueError(f"{path}: holds no experiment; give a table [[drag]], [[diameter]] or [[gait]]")
    return Measurements(geometry, tuple(experiments))


class _Table:
    """One experiment's table; what is read is taken out, so that the rest is unknown."""

    def __init__(self, where: str, data: Mapping[str, Any]) -> None:
        self.where, self.left = where, dict(data)

    def error(self, problem: str) -> ValueError:
        return ValueError(f"{self.where}: {problem}")

    def has(self, name: str) -> bool:
        return any(key == name or key.startswith(f"{name}_") for key in self.left)

    def plain(self, name: str, default: Any) -> Any:
        return self.left.pop(name, default)

    def choice(self, name: str, choices: Sequence[str]) -> str:
        found = self.left.pop(name, choices[0])
        if found not in choices:
            raise self.error(f"{name}: {found!r} is unknown; choose one of {', '.join(choices)}")
        return str(found)

    def column(self, name: str, suffix: str = "", low: float = -math.inf) -> Floats | None:
        """Numbers in SI units, shape (N,); None where there is no such column."""
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

    def measured(self, name: str, at: Floats | None) -> tuple[Floats, Floats | None]:
        """Values and standard deviations; a single deviation is that of all."""
        values, deviations = self.required(name), self.column(name, "_sd", 0.0)
        if at is not None and len(values) != len(at):
            raise self.error(f"{name}: {len(values)} values are not allowed for {len(at)} points; give as many")
        if deviations is None:
            if not np.abs(values).max() > 0:
                raise self.error(f"{name}: 0 everywhere is not allowed without {name}_sd; give that too")
            return values, None
        if len(deviations) not in (1, len(values)) or not deviations.min() > 0:
            raise self.error(f"{name}_sd: is not allowed; give one positive number, or one for every point")
        return values, np.broadcast_to(deviations, values.shape).copy()

    def done(self) -> None:
        if self.left:
            raise self.error(f"{min(self.left)!r} is unknown")


def _tables(kind: str, given: object) -> list[_Table]:
    if not isinstance(given, list) or not all(isinstance(table, dict) for table in given):
        raise ValueError(f"{kind}: give tables that begin with [[{kind}]]")
    return [_Table(f"{kind} {place}", table) for place, table in enumerate(given, 1)]


def _drag(table: _Table) -> Drag:
    at = table.required("displacement", 0.0)
    forces, deviations = table.measured("force", at)
    load, foot = table.single("load", 0.0), table.choice("foot", tuple(_FEET))
    if load == 0 or at.max() == 0:
        raise table.error(f"{'displacement' if load else 'load'}: 0 is not allowed; it must be positive")
    table.done()
    return Drag(at, forces, load, _FEET[foot], deviations)


def _diameter(table: _Table) -> Diameter:
    at = table.required("pressure", 0.0)
    sides = [side for side in SIDES if table.has(side)]
    if len(sides) != 1:
        raise table.error("give one column of width or height; both are two tables")
    values, deviations = table.measured(sides[0], at)
    table.done()
    for pressure in at:
        number(f"{table.where}: pressure", round(float(pressure), 6), 0.0, MAXIMUM_PRESSURE, "Pa")
    return Diameter(at, values, sides[0], deviations)


def _gait(table: _Table, load_gait: LoadGait) -> Gait:
    name = table.plain("gait", None)
    if not isinstance(name, str):
        raise table.error("gait is missing; name inching, rolling or the file of a gait")
    try:
        design = _played(name, load_gait, table)
        terrain = Terrain.parse(str(table.plain("terrain", "flat")))
    except ValueError as error:
        raise table.error(str(error)) from None
    at = table.column("time", low=0.0)
    kinds = [kind for kind in ("distance", "speed") if table.has(kind)]
    if len(kinds) != 1:
        raise table.error("give one column of distance or speed")
    values, deviations = table.measured(kinds[0], at)
    table.done()
    at = np.full(len(values), np.inf) if at is None else at  # without times they are of the whole gait
    if kinds[0] == "speed" and at.min() == 0:
        raise table.error("time: 0 is not allowed of a mean speed; give later times")
    return Gait(at, values, design, name, terrain, kinds[0] == "speed", deviations)


def _played(name: str, load_gait: LoadGait, table: _Table) -> InflatableDesign:
    """The gait with what the table says of it."""
    counts = {key: table.plain(key, None) for key in ("columns", "repeats")}
    cut = [None if value is None else whole_number(key, value, 1) for key, value in counts.items()]
    design = load_gait(name, *cut)
    pressure = table.single("pressure", 0.0) if table.has("pressure") else design.pressure
    return replace(design, pressure=pressure, orientation=table.plain("orientation_deg", design.orientation))


def write_measurements(path: str | os.PathLike[str], geometry: str, experiments: Sequence[Experiment]) -> None:
    """Write a file that :func:`read_measurements` reads; gaits by the names that they have."""
    parts = [f'geometry = "{geometry}"']
    for experiment in experiments:
        if isinstance(experiment, Drag):
            foot = "grips" if experiment.grips else "slides"
            lines = [f'foot = "{foot}"', f"load_n = {experiment.load:g}", _line("displacement_mm", experiment.at)]
            kind, value = "drag", "force_n"
        elif isinstance(experiment, Diameter):
            lines = [_line("pressure_kpa", experiment.at)]
            kind, value = "diameter", f"{experiment.side}_mm"
        else:
            assert isinstance(experiment, Gait)
            lines = [f'gait = "{experiment.name}"', f'terrain = "{experiment.terrain.name}"']
            lines += [_line("time_s", experiment.at)] if np.isfinite(experiment.at).all() else []
            kind, value = "gait", "speed_mm_per_s" if experiment.mean_speed else "distance_mm"
        lines.append(_line(value, experiment.values))
        if experiment.deviations is not None:
            quantity, _, unit = value.partition("_")
            lines.append(_line(f"{quantity}_sd_{unit}", experiment.deviations))
        parts.append("\n".join([f"[[{kind}]]", *lines]))
    write_text(path, "\n\n".join(parts) + "\n")


def _line(column: str, values: Floats) -> str:
    quantity, _, unit = column.replace("_sd", "").partition("_")
    numbers = ", ".join(f"{value / UNITS[quantity][unit]:.6g}" for value in values)
    return f"{column} = [{numbers}]"
