"""Lattice robots leave the lab: surfaces to print, moulds to cast them in, and files of other simulators."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from robots.lattice_robot.channels import channels_of
from taichi_sim.base.arrays import Bools
from taichi_sim.base.files import make_folder
from taichi_sim.lattice.files.mould import mould_of
from taichi_sim.lattice.files.parts import MILLIMETRES, Part, save_3mf, save_stl
from taichi_sim.lattice.files.surface import body_surface

if TYPE_CHECKING:
    from robots.lattice_robot.robot import LatticeRobot

# Okabe & Ito, Color Universal Design, 2008, after a grey.
_COLOURS = ("#B9B4A8", "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#F0E442")


@dataclass(frozen=True)
class MouldSettings:
    """How a mould is built.

    Attributes:
        draft: of its walls [degrees].
        wall: thickness [m].
        pull: axis along which its halves part; None for the first that leaves no undercut.
    """

    draft: float = 2.0
    wall: float = 3e-3
    pull: str | None = None

    @classmethod
    def from_text(cls, text: str) -> "MouldSettings":
        """Settings such as ``draft=2,wall=3,pull=z``, the wall in millimetres; what is left out is the default.

        Raises:
            ValueError: for other names, and values that are no numbers.
        """
        given: dict[str, float | str] = {}
        for part in filter(None, (part.strip() for part in text.split(","))):
            name, _, value = part.partition("=")
            if name not in ("draft", "wall", "pull") or not value or name in given:
                raise ValueError(f"mould: {part!r} is not allowed; give draft=DEGREES,wall=MM,pull=AXIS")
            try:
                given[name] = value if name == "pull" else float(value)
            except ValueError:
                raise ValueError(f"mould: {name} {value!r} is not allowed; give a number") from None
        if isinstance(wall := given.get("wall"), float):
            given["wall"] = wall / MILLIMETRES
        return cls(**given)  # type: ignore[arg-type]


def parts_of(robot: "LatticeRobot") -> list[Part]:
    """Surfaces of a robot of which nothing is free, each voxel in one of them: by material, then by channel.

    A part is called as its material, such as ``"foam"``, if nothing drives it, or else ``"foam, channel bar"``.

    Raises:
        ValueError: if the body has no one shape, see ``body_surface``.
    """
    materials, driven = _material_names(robot), _channel_voxels(robot)
    keys = np.column_stack([robot.body.material_index, *driven.values()]).astype(np.int64)
    found = []
    for number, key in enumerate(np.unique(keys, axis=0)):
        channels = [name for name, on in zip(driven, key[1:], strict=True) if on]
        name = materials[key[0]] + (f", channel {' + '.join(channels)}" if channels else "")
        surface = body_surface(robot.body, (keys == key).all(axis=1))
        found.append(Part(name, surface, _COLOURS[number % len(_COLOURS)]))
    return found


def overlapping_parts_of(robot: "LatticeRobot") -> list[Part]:
    """Surfaces of the whole body, of each material and of each channel; a voxel is in several of them."""
    body, found = robot.body, [Part("body", body_surface(robot.body))]
    for index, name in _material_names(robot).items():
        found.append(Part(f"material {name}", body_surface(body, body.material_index == index)))
    for name, voxels in _channel_voxels(robot).items():
        found.append(Part(f"channel {name}", body_surface(body, voxels)))
    return found


def save_parts(
    robot: "LatticeRobot", path: str | PathLike[str], mould: MouldSettings | None = None
) -> Mapping[str, Part]:
    """Write surfaces in millimetres: to a ``.3mf`` file, a ``.stl`` file, or STL files in a folder.

    A 3MF file has the objects of :func:`parts_of`, an STL file the whole body, a folder all of
    :func:`overlapping_parts_of`. A mould has two halves, in a 3MF file or a folder. All lie where the mesh of the
    robot does, if it was made of one.

    Returns:
        What was written, by file name and, in a 3MF file, by object.

    Raises:
        ValueError: for another kind of file, a mould that is asked of a ``.stl``, or a body that has none.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in ("", ".3mf", ".stl"):
        raise ValueError(f"parts: {path} is not allowed; give a file that ends in .3mf or .stl, or a folder")
    if mould is not None and suffix == ".stl":
        raise ValueError(f"parts: {path} has place for one surface, a mould has two halves; give a .3mf or a folder")
    if mould is not None:
        built = mould_of(robot.body, mould.draft, mould.wall, mould.pull)
        parts = [Part("mould lower", built.lower, _COLOURS[1]), Part("mould upper", built.upper, _COLOURS[5])]
    elif suffix == ".stl":
        parts = [Part("body", body_surface(robot.body))]
    else:
        parts = parts_of(robot) if suffix else overlapping_parts_of(robot)
    if any(robot.origin):
        parts = [replace(part, surface=part.surface.moved(robot.origin)) for part in parts]
    if suffix == ".3mf":
        save_3mf(parts, path)
        return {part.name: part for part in parts}
    if suffix == ".stl":
        save_stl(parts[0].surface, path)
        return {path.name: parts[0]}
    make_folder(path)
    files = {f"{re.sub(r'[^A-Za-z0-9]+', '_', part.name).strip('_')}.stl": part for part in parts}
    if len(files) < len(parts):
        raise ValueError(f"parts: names {', '.join(part.name for part in parts)} are too alike; give a .3mf file")
    for name, part in files.items():
        save_stl(part.surface, path / name)
    return files


def _material_names(robot: "LatticeRobot") -> dict[int, str]:
    """Names of the materials in use, by number, all different."""
    used = np.unique(robot.body.material_index).tolist()
    names = {n: robot.body.materials[n].name or f"material {n}" for n in used}
    several = [name for name in names.values() if list(names.values()).count(name) > 1]
    return {n: f"{name} {n}" if name in several else name for n, name in names.items()}


def _channel_voxels(robot: "LatticeRobot") -> dict[str, Bools]:
    """Voxels of each channel, by its name."""
    return {channel.name: channel.voxels(robot) for channel in channels_of(robot)}
