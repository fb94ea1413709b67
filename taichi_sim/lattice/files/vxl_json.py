"""Read and write the JSON files of Voxelyze (``.vxl.json``): voxels, materials, loads.

Source: Voxelyze (Hiller & Lipson 2014), what its ``loadJSON`` reads and its ``saveJSON`` writes. Its writer leaves out
the last brace of a file without loads, and its reader takes no notice of gravity, floor and temperature: here both are
read. Entries that Voxelyze does not know stand under "morpholab", which it ignores, in the document or in a material.
"""

import json
import sys
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np

from taichi_sim.base.arrays import Bools, Floats, Ints
from taichi_sim.base.checks import choice, known_names
from taichi_sim.base.parsing import parse_json
from taichi_sim.lattice.body import LINK_LAWS, USUAL_LINKS, LatticeBody
from taichi_sim.lattice.files.arrays import labels
from taichi_sim.lattice.files.voxel_file import MOST_VOXELS, VoxelFile
from taichi_sim.lattice.materials import Material

# Names in the file and of Material; what the file leaves out is as in Voxelyze.
_NAMES = {
    "youngsModulus": "youngs_modulus",
    "density": "density",
    "poissonsRatio": "poissons_ratio",
    "staticFriction": "static_friction",
    "kineticFriction": "kinetic_friction",
    "internalDamping": "internal_damping",
    "globalDamping": "global_damping",
    "collisionDamping": "collision_damping",
    "CTE": "thermal_expansion",
    "temperature": "temperature",
}
_COLOURS = ("red", "green", "blue", "alpha")
_LOADS = (("translate", 3), ("rotate", 3), ("force", 3), ("moment", 3))
_OWN = "morpholab"
_READ = ("voxelSize", "materials", "voxels", "externals", "gravityAcceleration", "floorEnabled", _OWN)


def read_vxl_json(text: str) -> VoxelFile:
    """Read a robot from the text of a ``.vxl.json`` file.

    Raises:
        ValueError: for entries that are missing, damaged or not allowed.
    """
    document = _parsed(text)
    ignored: list[str] = []
    found = [_material(m, n, ignored) for n, m in enumerate(_list(document, "materials"))]
    if not found:
        raise ValueError("materials: there are none; give at least one")
    flat = _whole(document.get("voxels"), "voxels")
    if flat.size % 4 or not flat.size:
        raise ValueError(f"voxels: {flat.size} numbers are not allowed; give x, y, z and material of at least one")
    if flat.size > 4 * MOST_VOXELS:
        raise ValueError(f"voxels: {flat.size // 4} are not allowed; give at most {MOST_VOXELS}")
    voxels, index = flat.reshape(-1, 4)[:, :3], flat.reshape(-1, 4)[:, 3]
    if index.min() < 0 or index.max() >= len(found):
        raise ValueError(f"voxels: material {index.max()} is unknown; the file has 0 to {len(found) - 1}")
    fixed, loads = _externals(_list(document, "externals", needed=False), len(voxels))
    own = _own(document.get(_OWN, {}), labels(index, loads))
    materials = tuple(m for m, _ in found)
    body = LatticeBody(voxels, materials, index, _number(document, "voxelSize"), fixed=fixed, **own)
    if document.get("relativeAmbientTemperature"):
        ignored.append("relativeAmbientTemperature")
    ignored += [str(entry) for entry in document if entry not in (*_READ, "relativeAmbientTemperature")]
    gravity, floor = document.get("gravityAcceleration"), document.get("floorEnabled")
    return VoxelFile(
        body,
        np.array([c for _, c in found], np.uint8),
        loads[:, 6:9],
        loads[:, 9:],
        loads[:, :6],
        gravity=None if gravity is None else _number(document, "gravityAcceleration"),
        floor=None if floor is None else bool(floor),
        ignored=tuple(dict.fromkeys(ignored)),
    )


def write_vxl_json(file: VoxelFile) -> str:
    """Write a robot as the text of a ``.vxl.json`` file, from which its numbers are restored to the bit.

    Raises:
        ValueError: for a robot that is driven by heat, which the format cannot express.
    """
    if file.heat is not None:
        raise ValueError("heat: a .vxl.json has no place for it; leave it out")
    body = file.body
    document: dict[str, Any] = {
        "voxelSize": body.voxel_size,
        "materials": [_material_record(m, c) for m, c in zip(body.materials, file.colours.tolist(), strict=True)],
        "voxels": np.column_stack([body.voxels, body.material_index]).ravel().tolist(),
    }
    loads = np.column_stack([file.displacement, file.force, file.moment])
    externals = _external_records(np.asarray(body.fixed, bool), loads)
    optional = {"gravityAcceleration": file.gravity, "floorEnabled": file.floor, "externals": externals or None}
    normals = np.asarray(body.pressure_normals)
    own = {
        "regions": np.asarray(body.regions).tolist(),
        "cutLinks": body.cut_links.tolist() or None,
        "pressureNormals": normals.tolist() if normals.any() else None,
        "chambers": np.unique(np.asarray(body.chambers), return_inverse=True)[1].tolist()
        if body.has_chambers
        else None,
        "links": None if body.links == USUAL_LINKS else body.links,
    }
    return json.dumps({**document, **_given(optional), _OWN: _given(own)}, allow_nan=False)


def _given(entries: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in entries.items() if value is not None}


def _parsed(text: str) -> dict[str, Any]:
    """Parse the document, whose last brace may be missing."""

    def refuse(constant: str) -> None:
        raise ValueError(f"{constant} is no number")

    try:
        try:
            document = parse_json(text, constant=refuse)
        except json.JSONDecodeError:
            document = parse_json(text.rstrip().rstrip(",") + "}", constant=refuse)
    except ValueError as error:
        raise ValueError(f"this is no JSON: {error}") from None
    if not isinstance(document, dict):
        raise ValueError("the document is no object")
    return document


def _list(document: Mapping[str, Any], name: str, needed: bool = True) -> list[Any]:
    found = document.get(name)
    if found is None and not needed:
        return []
    if not isinstance(found, list) or not all(isinstance(entry, dict) for entry in found):
        raise ValueError(f"{name}: it is missing, or no list of objects")
    return found


def _number(record: Mapping[str, Any], name: str, default: float | None = None) -> float:
    value = record.get(name, default)
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= sys.float_info.max:
        raise ValueError(f"{name}: {str(value)[:40]} is not allowed; give a finite number")
    return float(value)


def _whole(given: Any, name: str) -> Ints:
    """Check and convert a flat list of whole numbers."""
    try:
        numbers = np.asarray(given, float)
    except (TypeError, ValueError, OverflowError):
        numbers = np.array([[np.nan]])
    if numbers.ndim != 1 or not (np.abs(numbers) < 2**31).all() or (numbers % 1).any():
        raise ValueError(f"{name}: it is no list of whole numbers")
    return numbers.astype(np.int64)


def _own(record: Any, regions: Ints) -> dict[str, Any]:
    """Read the entries that only this project writes: those of ``LatticeBody`` that other formats lack.

    Without regions in the file, those given are returned.
    """
    if not isinstance(record, dict):
        raise ValueError(f"{_OWN}: it is no object")
    known_names(record, "regions", "cutLinks", "pressureNormals", "chambers", "links")
    if "regions" in record:
        regions = _whole(record["regions"], "regions")
    chambers = _whole(record.get("chambers", [0] * len(regions)), "chambers")
    links_law = choice("links", record.get("links", USUAL_LINKS), LINK_LAWS)
    links = record.get("cutLinks", [])
    normals = record.get("pressureNormals", [[0, 0, 0]] * len(regions))
    try:
        return {
            "regions": regions,
            "cut_links": np.array(links, np.int64).reshape(-1, 2),
            "pressure_normals": np.array(normals, np.int64).reshape(-1, 3),
            "chambers": chambers,
            "links": links_law,
        }
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{_OWN}: cutLinks or pressureNormals are damaged") from None


def _material(record: Mapping[str, Any], number: int, ignored: list[str]) -> tuple[Material, list[int]]:
    """Read a material and its colour."""
    name = str(record.get("name", ""))
    known = {*_NAMES, *_COLOURS, "name", "externalScaleFactor", "strainData", "stressData", _OWN}
    ignored.extend(str(entry) for entry in record if entry not in known)
    try:
        given = {ours: _number(record, theirs) for theirs, ours in _NAMES.items() if theirs in record}
        if "youngs_modulus" not in given:
            given["youngs_modulus"] = _slope(record)
            ignored.append("stressData beyond its first slope")
        given.setdefault("density", 1.0)
        given |= _own_fields(record.get(_OWN, {}))
        scale = record.get("externalScaleFactor", (1.0, 1.0, 1.0))
        colours = [int(_number(record, c, 255.0)) for c in _COLOURS]
        if not all(0 <= c <= 255 for c in colours):
            raise ValueError(f"red: {colours} are not allowed; give 0 to 255")
        return Material(**given, scale=tuple(scale), name=name), colours
    except (TypeError, ValueError) as error:
        raise ValueError(f"materials: number {number}: {error}") from None


def _own_fields(record: Any) -> dict[str, Any]:
    """Read the fields of a material for which Voxelyze has no place."""
    if not isinstance(record, dict):
        raise ValueError(f"{_OWN}: it is no object")
    if unknown := sorted(record.keys() - _without_a_place()):
        raise ValueError(f"{_OWN}: {unknown[0]} is unknown; the file is of a later version")
    return record


def _without_a_place() -> set[str]:
    """Fields of ``Material`` for which Voxelyze has no place."""
    return {f.name for f in fields(Material)} - {"name", "scale", *_NAMES.values()}


def _slope(record: Mapping[str, Any]) -> float:
    """Young's modulus of a stress-strain curve: its first slope."""
    try:
        strains, stresses = np.array(record["strainData"], float), np.array(record["stressData"], float)
        first = int(np.flatnonzero(strains > 0)[0])
        return float(stresses[first] / strains[first])
    except (KeyError, IndexError, TypeError, ValueError):
        raise ValueError("youngsModulus: it is missing; give it, or strainData and stressData") from None


def _externals(records: list[Any], count: int) -> tuple[Bools, Floats]:
    """Read fixed degrees of freedom, shape (V, 6), and displacements, forces and moments, shape (V, 12)."""
    fixed, loads = np.zeros((count, 6), bool), np.zeros((count, 12))
    for record in records:
        chosen = _whole(record.get("voxelIndices", []), "externals: voxelIndices")
        if chosen.size and (chosen.min() < 0 or chosen.max() >= count):
            raise ValueError(f"externals: voxel {chosen.max()} is unknown; the file has 0 to {count - 1}")
        rows = [record.get(name, [0.0] * width) for name, width in (("fixed", 6), *_LOADS)]
        try:
            found = np.concatenate([np.asarray(row, float) for row in rows])
        except (TypeError, ValueError, OverflowError):
            found = np.array([np.nan])
        if found.shape != (18,) or not np.isfinite(found).all():
            raise ValueError("externals: one is damaged; give fixed[6], translate[3], rotate[3], force[3], moment[3]")
        fixed[chosen], loads[chosen] = found[:6].astype(bool), found[6:]
    return fixed, loads


def _external_records(fixed: Bools, loads: Floats) -> list[dict[str, Any]]:
    kinds, kind = np.unique(np.column_stack([fixed, loads]), axis=0, return_inverse=True)
    records = []
    for number, row in enumerate(kinds):
        if row.any():
            held, *parts = np.split(row, (6, 9, 12, 15))
            record = {name: part.tolist() for (name, _), part in zip(_LOADS, parts, strict=True)}
            chosen = np.flatnonzero(kind.ravel() == number).tolist()
            records.append({"fixed": held.astype(bool).tolist(), **record, "voxelIndices": chosen})
    return records


def _material_record(material: Material, colour: list[int]) -> dict[str, Any]:
    usual = {f.name: f.default for f in fields(Material)}
    record: dict[str, Any] = {"name": material.name}
    for theirs, ours in _NAMES.items():
        if ours != "temperature" or material.temperature != usual["temperature"]:
            record[theirs] = float(getattr(material, ours))
    own = {ours: getattr(material, ours) for ours in sorted(_without_a_place())}
    own = {ours: value for ours, value in own.items() if value != usual[ours]}
    colours = dict(zip(_COLOURS, colour, strict=True))
    return {**record, "externalScaleFactor": list(material.scale), **colours, **({_OWN: own} if own else {})}
