"""Rigs as TOML files."""

import os
import tomllib
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

import tomli_w

from robots.hardware.line_map import LineMap
from robots.hardware.rig import CHANNELS, KPA_PER_UNIT, PRESETS, Channel, PneumaticRig
from taichi_sim.base.files import read_text, write_text

_ALL = {"bladder": CHANNELS[1:9], "foot": CHANNELS[9:]}  # tables that speak of several channels
_NAMES = ("name", "units", "supply_kpa", "vacuum_kpa", "shortest_state_s", "map", "channels")


def write_rig(rig: PneumaticRig, path: str | os.PathLike[str]) -> None:
    """Write a rig, every channel for itself, in kPa."""
    channels = {name: asdict(channel) for name, channel in zip(CHANNELS, rig.channels, strict=True)}
    data = {name: getattr(rig, name) for name in ("name", "supply_kpa", "vacuum_kpa", "shortest_state_s")}
    content = {"units": "kpa", **data, "map": asdict(rig.line_map), "channels": channels}
    write_text(path, tomli_w.dumps(content))


def read_rig(path: str | os.PathLike[str]) -> PneumaticRig:
    """Read a rig; ``[channels.bladder]`` is all bladders, ``[channels.bladder3]`` what differs in the third.

    Raises:
        ValueError: in one line, for an unreadable file, an unknown name or a value that is not allowed.
    """
    if Path(path).suffix.lower() != ".toml":
        raise ValueError(f"rig: '{path}' is neither a preset ({', '.join(PRESETS)}) nor a .toml file")
    text = read_text(path)
    try:
        return _rig(tomllib.loads(text))
    except ValueError as error:  # syntax errors too
        raise ValueError(f"{path}: {error}") from None


def _rig(data: dict[str, Any]) -> PneumaticRig:
    units = data.get("units", "kpa")
    if not isinstance(units, str) or units not in KPA_PER_UNIT:
        raise ValueError(f"units: {units!r} is not allowed; give one of {', '.join(KPA_PER_UNIT)}")
    data = _known(_in_kpa(data, units), "rig", _NAMES)
    default = PneumaticRig()
    simple = {name: data[name] for name in _NAMES if name in data and name not in ("units", "map", "channels")}
    if "map" in data:
        given = _known(data["map"], "map", tuple(entry.name for entry in fields(LineMap)))
        simple["line_map"] = _made("map", lambda: replace(default.line_map, **given))
    tables = _known(data.get("channels", {}), "channels", (*_ALL, *CHANNELS))
    channels = dict(zip(CHANNELS, default.channels, strict=True))
    for table in sorted(tables, key=lambda name: name not in _ALL):  # one channel's own table wins
        given = _known(tables[table], table, tuple(entry.name for entry in fields(Channel)))
        for name in _ALL.get(table, (table,)):
            channels[name] = _made(table, lambda name=name, given=given: replace(channels[name], **given))
    return replace(default, channels=tuple(channels.values()), **{"name": "unnamed", **simple})


def _made(what: str, make: Any) -> Any:
    try:
        return make()
    except ValueError as error:
        raise ValueError(f"{what}: {error}") from None


def _in_kpa(data: Any, units: str) -> Any:
    """The same with all that is named by units, such as ``maximum_psi``, in kPa and named so."""
    if units == "kpa" or not isinstance(data, dict):
        return data
    converted = {}
    for name, value in data.items():
        if "_kpa" in name:
            right = name.replace("_kpa", f"_{units}")
            raise ValueError(f"{name}: is not allowed, as the units are {units}; give {right}")
        if f"_{units}" in name:
            name, value = name.replace(f"_{units}", "_kpa"), _scaled(value, KPA_PER_UNIT[units])
        converted[name] = _in_kpa(value, units)
    return converted


def _scaled(value: Any, factor: float) -> Any:
    if isinstance(value, list):
        return [_scaled(part, factor) for part in value]
    return value * factor if isinstance(value, int | float) and not isinstance(value, bool) else value


def _known(data: object, what: str, names: tuple[str, ...]) -> dict[str, Any]:
    """The data as a dict with no other than these names."""
    if not isinstance(data, dict):
        raise ValueError(f"{what}: give a table with {', '.join(names)}")
    unknown = sorted(set(data) - set(names))
    if unknown:
        raise ValueError(f"{what}: {unknown[0]!r} is unknown; give {', '.join(names)}")
    return data
