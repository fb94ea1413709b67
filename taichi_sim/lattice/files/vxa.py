"""Read robots of VoxCAD (``.vxa``): a body of layers, a palette, and a temperature that drives it.

Source: the files of VoxCAD 0.9 and later, as evosoro and voxcraft-sim write them. Temperatures are relative to the
stress-free one: T = amplitude sin(2 pi (t / period + PhaseOffset) + MaterialTempPhase), the offset of a voxel in
periods, as in those files; the phase of a material in radians, but in files of voxcraft in periods, and there an offset
takes its place. Without ``TempAmplitude`` the amplitude is what the peak ``TempAmp`` is above ``TempBase``.
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
# Damping is the simulator's, for all materials: what it is else in VoxCAD, and in voxcraft.
_DAMPING = {
    "BondDampingZ": ("internal_damping", 1.0, 0.1),
    "ColDampingZ": ("collision_damping", 1.0, 1.0),
    "SlowDampingZ": ("global_damping", 0.0, 1.0),
}
_OF_VOXCRAFT = (
    ".//EnableExpansion",
    ".//AttachDetach",
    ".//RecordHistory",
    ".//StopConditionFormula",
    "GPU",
    "RawPrint",
)
# Settings that the lattice does not support, with the value that changes nothing.
_UNSUPPORTED = {
    "FloorSlope": 0,
    "FluidEnvironment": 0,
    "Fixed_Regions/NumFixed": 0,
    "Forced_Regions/NumForced": 0,
    "Boundary_Conditions/NumBCs": 0,
    "Collisions/SelfColEnabled": 1,
    "AttachDetach/EnableCollision": 1,
    "AttachDetach/EnableAttach": 0,
    "AttachDetach/EnableDetach": 0,
    "EnableExpansion": 1,
    "EnableCilia": 0,
    "GrowthAmplitude": 0,
}
_ADJUSTED = [f"{axis}_Dim_Adj" for axis in "XYZ"]
_OFFSET = ["X_Line_Offset", "Y_Line_Offset", "X_Layer_Offset", "Y_Layer_Offset"]
_SIZES = ("X_Voxels", "Y_Voxels", "Z_Voxels")


def read_vxa(root: Element, by_voxcraft: bool = False) -> VoxelFile:
    """Read a robot from the root of a ``.vxa`` file, or of a ``.vxc`` file, which has no environment.

    Args:
        root: of the file.
        by_voxcraft: whether it is surely of voxcraft; else its entries tell.

    Raises:
        ValueError: for entries that are missing, damaged or not allowed.
    """
    model = root if root.tag == "VXC" else root.find("VXC")
    if root.tag not in ("VXA", "VXC") or model is None:
        raise ValueError(f"<{root.tag}> has no robot; give a file of <VXA> with <VXC>")
    structure = _child(model, "Structure")
    ignored: list[str] = []
    by_voxcraft = by_voxcraft or any(root.find(path) is not None for path in _OF_VOXCRAFT)
    damping = {name: _number(root, f".//Damping/{tag}", usual[by_voxcraft]) for tag, (name, *usual) in _DAMPING.items()}
    palette = [_material(m, n, damping, ignored) for n, m in enumerate(model.findall("Palette/Material"), 1)]
    if not palette:
        raise ValueError("Palette: it has no materials; give at least one")
    squeezes = root.tag == "VXC" or _switch(root, ".//VolumeEffectsEnabled")
    if not squeezes and any(material.poissons_ratio for material, _, _ in palette):
        palette = [(replace(material, poissons_ratio=0.0), c, phase) for material, c, phase in palette]
        ignored.append("Poissons_Ratio without VolumeEffectsEnabled 1")
    array, offsets = _structure(structure, ignored)
    filled = array > 0
    size = _number(model, "Lattice/Lattice_Dim", 0.001)
    for tag in _ADJUSTED:
        if (adjusted := _number(model, f"Lattice/{tag}", 1.0)) != 1:
            raise ValueError(f"{tag}: {adjusted:g} is not allowed, as voxels are cubes; give 1")
    held = np.array([False, *(_number(m, ".//Fixed", 0.0) != 0 for m in model.findall("Palette/Material"))])
    if int(array.max(initial=0)) > len(palette):
        raise ValueError(f"Data: material {array.max()} is unknown; the palette has 1 to {len(palette)}")
    own = np.array([0.0, *(p for _, _, p in palette)])[array] / (1.0 if by_voxcraft else 2 * math.pi)
    phases = own if offsets is None else offsets if by_voxcraft else own + offsets
    phases = phases[filled] % 1.0
    heat = _heat(root, phases)
    regions = np.zeros(array.shape, np.int64)
    regions[filled] = labels(array[filled], phases if heat else np.zeros(len(phases)))
    body = body_from_array(array, [m for m, _, _ in palette], size, regions=regions, fixed=held[array])
    ignored += _environment(root)
    if by_voxcraft and heat and root.find(".//EnableExpansion") is None:  # there voxels only shrink with heat
        ignored.append("EnableExpansion 0")
    return replace(
        VoxelFile.of_body(body),
        colours=np.array([c for _, c, _ in palette], np.uint8),
        heat=heat,
        gravity=_gravity(root),
        floor=_switch(root, ".//Gravity/FloorEnabled"),
        time_step_fraction=_optional(root, ".//Integration/DtFrac"),
        ignored=tuple(dict.fromkeys(ignored)),
    )


def _structure(structure: Element, ignored: list[str]) -> tuple[Ints, Floats | None]:
    """Read material numbers, and phase offsets [periods] or None, shape (X, Y, Z) each; sizes are checked first."""
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
    array = array.reshape(sizes[::-1]).transpose(2, 1, 0)
    if structure.find("PhaseOffset") is None:
        return array, None
    told = _layers(structure, "PhaseOffset", sizes[2])
    offsets = _stacked("PhaseOffset", told, lambda text: decode_numbers(text, count))
    return array, offsets.reshape(sizes[::-1]).transpose(2, 1, 0)


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
    """Read a material, its colour, and its phase, in the file's unit."""
    try:
        given = {name: _number(element, f"Mechanical/{tag}", usual) for tag, (name, usual) in _MECHANICAL.items()}
        modulus = _optional(element, "Mechanical/Elastic_Mod")
        if modulus is None:
            raise ValueError("Elastic_Mod: it is missing; give it")
        if _number(element, "MatType", 0.0):
            ignored.append("MatType")
        told = ("MatModel", "Cilia", "sticky", "Sticky", "TurnOnThermalExpansionAfterThisManySeconds")
        ignored += [tag for tag in told if _number(element, f"Mechanical/{tag}", 0.0)]
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
    amplitude = _optional(thermal, "TempAmplitude")
    if amplitude is None:
        base = _number(thermal, "TempBase", 25.0)
        amplitude = _number(thermal, "TempAmp", base) - base
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
    for path, neutral in _UNSUPPORTED.items():
        if (value := _number(root, f".//{path}", neutral)) != neutral:
            found.append(f"{path.rpartition('/')[2]} {value:g}" if neutral else path)
    found += [tag for tag in _OFFSET if _number(root, f".//Lattice/{tag}", 0.0)]
    found += ["ForceField"] * (root.find(".//ForceField") is not None)
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
