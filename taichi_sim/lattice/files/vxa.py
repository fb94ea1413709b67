"""Read robots of VoxCAD (``.vxa``): a body of layers, a palette, and a temperature that drives it.

Source: the files of VoxCAD 0.9 and later, as evosoro and voxcraft-sim write them. Temperatures are relative to the
stress-free one: T = amplitude sin(2 pi (t / period + PhaseOffset) + MaterialTempPhase), the offset of a voxel in
periods, as in those files; the phase of a material in radians.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from taichi_sim.base.arrays import Floats, Ints
from taichi_sim.lattice.files.arrays import body_from_array, labels
from taichi_sim.lattice.files.layers import COMPRESSIONS, decode_layer, decode_numbers
from taichi_sim.lattice.files.voxel_file import MOST_VOXELS, Heat, VoxelFile
from taichi_sim.lattice.materials import Material

MOST_CELLS = 20 * MOST_VOXELS
# What of a material its element says, and what it is else.
_MECHANICAL = {
    "Density": ("density", 1000.0),
    "Poissons_Ratio": ("poissons_ratio", 0.0),
    "CTE": ("thermal_expansion", 0.0),
    "uStatic": ("static_friction", 0.0),
    "uDynamic": ("kinetic_friction", 0.0),
}
# Damping is the simulator's, for all materials.
_DAMPING = {
    "BondDampingZ": ("internal_damping", 1.0),
    "ColDampingZ": ("collision_damping", 1.0),
    "SlowDampingZ": ("global_damping", 0.0),
}
_SIZES = ("X_Voxels", "Y_Voxels", "Z_Voxels")


def read_vxa(root: Element) -> VoxelFile:
    """Read a robot from the root of a ``.vxa`` file, or of a ``.vxc`` file, which has no environment.

    Raises:
        ValueError: for entries that are missing, damaged or not allowed.
    """
    model = root if root.tag == "VXC" else root.find("VXC")
    if root.tag not in ("VXA", "VXC") or model is None:
        raise ValueError(f"<{root.tag}> has no robot; give a file of <VXA> with <VXC>")
    structure = _child(model, "Structure")
    ignored: list[str] = []
    damping = {name: _number(root, f".//Damping/{tag}", usual) for tag, (name, usual) in _DAMPING.items()}
    palette = [_material(m, n, damping, ignored) for n, m in enumerate(model.findall("Palette/Material"), 1)]
    if not palette:
        raise ValueError("Palette: it has no materials; give at least one")
    array, offsets = _structure(structure, ignored)
    filled = array > 0
    size = _number(model, "Lattice/Lattice_Dim", 0.001)
    held = np.array([False, *(_number(m, ".//Fixed", 0.0) != 0 for m in model.findall("Palette/Material"))])
    if int(array.max(initial=0)) > len(palette):
        raise ValueError(f"Data: material {array.max()} is unknown; the palette has 1 to {len(palette)}")
    phases = (np.array([0.0, *(p for _, _, p in palette)])[array] / (2 * math.pi) + offsets)[filled]
    phases %= 1.0
    heat = _heat(root, phases)
    regions = np.zeros(array.shape, np.int64)
    regions[filled] = labels(array[filled], phases if heat else np.zeros(len(phases)))
    body = body_from_array(array, [m for m, _, _ in palette], size, regions=regions, fixed=held[array])
    ignored += _environment(root)
    return replace(
        VoxelFile.of_body(body),
        colours=np.array([c for _, c, _ in palette], np.uint8),
        heat=heat,
        gravity=_gravity(root),
        floor=_switch(root, ".//Gravity/FloorEnabled"),
        time_step_fraction=_optional(root, ".//Integration/DtFrac"),
        ignored=tuple(dict.fromkeys(ignored)),
    )


def _structure(structure: Element, ignored: list[str]) -> tuple[Ints, Floats]:
    """Read material numbers and phase offsets [periods], shape (X, Y, Z) each; sizes are checked first."""
    sizes = [_whole(structure, name) for name in _SIZES]
    if math.prod(sizes) > MOST_CELLS:
        raise ValueError(f"Structure: {' x '.join(map(str, sizes))} places are too many; the most is {MOST_CELLS}")
    compression = structure.get("Compression", "ASCII_READABLE")
    if compression not in COMPRESSIONS:
        raise ValueError(f"Compression: {compression!r} is unknown; give {', '.join(COMPRESSIONS)}")
    ignored += [child.tag for child in structure if child.tag not in (*_SIZES, "Data", "PhaseOffset")]
    count = sizes[0] * sizes[1]
    data = _layers(structure, "Data", sizes[2])
    array = _stacked("Data", data, lambda text: decode_layer(text, compression, count)).astype(np.int64)
    if (array > 0).sum() > MOST_VOXELS:
        raise ValueError(f"Data: {(array > 0).sum()} voxels are not allowed; the most is {MOST_VOXELS}")
    offsets = np.zeros(array.shape)
    if structure.find("PhaseOffset") is not None:
        told = _layers(structure, "PhaseOffset", sizes[2])
        offsets = _stacked("PhaseOffset", told, lambda text: decode_numbers(text, count))
    shape = sizes[::-1]
    return array.reshape(shape).transpose(2, 1, 0), offsets.reshape(shape).transpose(2, 1, 0)


def _layers(structure: Element, name: str, count: int) -> list[str]:
    found = [layer.text or "" for layer in structure.findall(f"{name}/Layer")]
    if len(found) != count:
        raise ValueError(f"{name}: it has {len(found)} layers, but Z_Voxels says {count}")
    return found


def _stacked(name: str, layers: list[str], decode: Callable[[str], NDArray[Any]]) -> NDArray[Any]:
    """Decode all layers, shape (Z, X Y)."""
    found = []
    for number, text in enumerate(layers):
        try:
            found.append(decode(text))
        except ValueError as error:
            raise ValueError(f"{name}: layer {number}: {error}") from None
    return np.array(found)


def _material(
    element: Element, number: int, damping: dict[str, float], ignored: list[str]
) -> tuple[Material, list[int], float]:
    """Read a material, its colour, and its phase [rad]."""
    try:
        given = {name: _number(element, f"Mechanical/{tag}", usual) for tag, (name, usual) in _MECHANICAL.items()}
        modulus = _optional(element, "Mechanical/Elastic_Mod")
        if modulus is None:
            raise ValueError("Elastic_Mod: it is missing; give it")
        if _number(element, "MatType", 0.0):
            ignored.append("MatType")
        if _number(element, "Mechanical/MatModel", 0.0):
            ignored.append("MatModel")
        colour = [_number(element, f"Display/{c}", 1.0) for c in ("Red", "Green", "Blue", "Alpha")]
        phase = _number(element, "Mechanical/MaterialTempPhase", 0.0)
        name = (element.findtext("Name") or "").strip()
        material = Material(modulus, **given, **damping, name=name)  # type: ignore[arg-type]
    except ValueError as error:
        raise ValueError(f"Palette: material {number}: {error}") from None
    return material, [round(255 * min(max(c, 0.0), 1.0)) for c in colour], phase


def _heat(root: Element, phases: Floats) -> Heat | None:
    """Read the temperature over time; None if nothing is heated."""
    thermal = root.find(".//Thermal")
    if thermal is None or not _switch(thermal, "TempEnabled"):
        return None
    amplitude = _number(thermal, "TempAmplitude", _number(thermal, "TempAmp", 0.0))
    if not amplitude:
        return None
    if not _switch(thermal, "VaryTempEnabled"):
        return Heat(0.0, 1.0, np.zeros(len(phases)), mean=amplitude)
    period = _number(thermal, "TempPeriod", 0.1)
    if not period > 0:
        raise ValueError(f"TempPeriod: {period:g} is not allowed; it must be positive")
    return Heat(amplitude, period, phases)


def _gravity(root: Element) -> float | None:
    """Read the gravity along -z [m/s^2], which the file gives along +z; None if the file says nothing."""
    if root.find(".//Gravity") is None:
        return None
    return -_number(root, ".//Gravity/GravAcc", -9.81) if _switch(root, ".//Gravity/GravEnabled") else 0.0


def _environment(root: Element) -> list[str]:
    """Names of the simulator and environment settings in the file that the lattice does not support."""
    found = []
    for path in ("FloorSlope", "FluidEnvironment", "Fixed_Regions/NumFixed", "Forced_Regions/NumForced"):
        if root.find(f".//{path}") is not None and _number(root, f".//{path}", 0.0):
            found.append(path)
    if (contact := _switch(root, ".//Collisions/SelfColEnabled")) is not None and not contact:
        found.append("SelfColEnabled 0")
    return found


def _child(element: Element, tag: str) -> Element:
    found = element.find(tag)
    if found is None:
        raise ValueError(f"{tag}: it is missing in <{element.tag}>")
    return found


def _optional(element: Element, path: str) -> float | None:
    """Finite number in the text of an element; None if the element is missing or empty."""
    text = element.findtext(path)
    if text is None or not text.strip():
        return None
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"{path.rpartition('/')[2]}: {text.strip()[:40]!r} is not allowed; give a finite number")
    return value


def _number(element: Element, path: str, default: float) -> float:
    found = _optional(element, path)
    return default if found is None else found


def _switch(element: Element, path: str) -> bool | None:
    found = _optional(element, path)
    return None if found is None else found != 0


def _whole(element: Element, name: str) -> int:
    value = _optional(element, name)
    if value is None or value < 1 or value % 1:
        raise ValueError(f"{name}: {element.findtext(name)!r} is not allowed; give a whole number, at least 1")
    return int(value)
