"""Files of voxel robots: reads ``.vxl.json``, ``.vxa``, ``.vxc`` and ``.vxd``, writes ``.vxl.json`` and ``.vxa``.

These are the formats of Voxelyze, VoxCAD and voxcraft.
"""

import warnings
from os import PathLike
from pathlib import Path
from xml.etree.ElementTree import Element

from taichi_sim.base.files import read_bytes, write_text
from taichi_sim.base.plain_xml import parse_xml
from taichi_sim.lattice.body import LatticeBody
from taichi_sim.lattice.files.voxel_file import LARGEST, Heat, VoxelFile, decoded
from taichi_sim.lattice.files.vxa import read_vxa
from taichi_sim.lattice.files.vxa_writer import write_vxa
from taichi_sim.lattice.files.vxd import merged
from taichi_sim.lattice.files.vxl_json import read_vxl_json, write_vxl_json

__all__ = [
    "Heat",
    "VoxelFile",
    "load_voxel_file",
    "read_vxl_json",
    "save_vxa",
    "save_vxl_json",
    "write_vxa",
    "write_vxl_json",
]

SUFFIXES = (".vxl.json", ".json", ".vxa", ".vxc", ".vxd")


def load_voxel_file(path: str | PathLike[str], base: str | PathLike[str] | None = None) -> VoxelFile:
    """Read a voxel robot from a file; one warning names what the lattice does not support.

    Args:
        path: path of a ``.vxl.json``, ``.vxa``, ``.vxc`` or ``.vxd`` file.
        base: the ``.vxa`` that a ``.vxd`` changes; by default ``base.vxa`` in the same folder.

    Raises:
        ValueError: if the file is not readable or not allowed; found before memory is taken for its voxels.
    """
    path = Path(path)
    if not path.name.lower().endswith(SUFFIXES):
        raise ValueError(f"{path}: its kind is unknown; give a file of {', '.join(SUFFIXES)}")
    text = decoded(read_bytes(path, LARGEST))
    below = None
    if path.suffix.lower() == ".vxd":
        below = _root(Path(base) if base is not None else path.with_name("base.vxa"))
    try:
        if path.suffix.lower() == ".json":
            found = read_vxl_json(text)
        else:
            root = parse_xml(text, "file")
            found = read_vxa(root) if below is None else read_vxa(merged(below, root), by_voxcraft=True)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    if found.ignored:
        warnings.warn(f"{path}: ignored are {', '.join(found.ignored)}", stacklevel=2)
    return found


def save_vxl_json(robot: VoxelFile | LatticeBody, path: str | PathLike[str]) -> None:
    """Write a robot, or a body alone, for Voxelyze; :func:`load_voxel_file` restores it to the bit.

    Raises:
        ValueError: for a robot that is driven by heat, and files that cannot be written.
        RuntimeError: if the disk is full or broken.
    """
    file = VoxelFile.of_body(robot) if isinstance(robot, LatticeBody) else robot
    write_text(path, write_vxl_json(file) + "\n")


def save_vxa(robot: VoxelFile, path: str | PathLike[str]) -> None:
    """Write a robot for VoxCAD and voxcraft; :func:`load_voxel_file` restores it to the bit.

    Raises:
        ValueError: for what the format cannot express, and files that cannot be written.
        RuntimeError: if the disk is full or broken.
    """
    write_text(path, write_vxa(robot))


def _root(path: Path) -> Element:
    text = decoded(read_bytes(path, LARGEST))
    try:
        return parse_xml(text, "file")
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
