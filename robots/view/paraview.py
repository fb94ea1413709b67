"""Write motions as files for ParaView: a mesh for every frame, and an index with their times.

Source: VTK File Formats, "XML File Formats", of the VTK documentation (docs.vtk.org): unstructured grids (.vtu),
polygonal data (.vtp), compressed binary data arrays; ParaView Data (.pvd), a collection of files with times.
"""

import base64
import struct
import zlib
from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from robots.view.colouring import colouring
from robots.view.mesh import boxes, faces, joined_corners
from robots.view.motion import Motion
from robots.view.scene import GROUND
from robots.view.uneven import nodes, relief_around, tints, triangles
from taichi_sim.base.arrays import Bytes, Floats
from taichi_sim.base.disk_faults import told_as
from taichi_sim.base.files import new_folder, write_bytes, write_text

HEXAHEDRON = 12  # VTK's number for cells with eight corners
# The corners of a box, 4 i + 2 j + k at the signs (i, j, k), in VTK's order: around the bottom, around the top.
VTK_ORDER = np.array([0, 4, 6, 2, 1, 5, 7, 3])
INDEX = """\
<?xml version="1.0"?>
<VTKFile type="Collection" version="1.0">
<Collection>
{}</Collection>
</VTKFile>
"""
FILE = """\
<?xml version="1.0"?>
<VTKFile type="{kind}" version="1.0" byte_order="LittleEndian" header_type="UInt32" compressor="vtkZLibDataCompressor">
<{kind}><Piece {counts}>
<Points>
{points}
</Points>
<{place}>
{cells}
</{place}>
<CellData>
{data}
</CellData>
</Piece></{kind}>
</VTKFile>
"""
TYPES = {"f4": "Float32", "i4": "Int32", "u1": "UInt8"}
Arrays = Mapping[str, NDArray[Any]]


def save_paraview(motion: Motion, folder: str | PathLike[str]) -> int:
    """Write a motion as a folder for ParaView: open ``motion.pvd`` in it.

    Voxels of lattices are hexahedra that share the corners joined by links, with cell data ``region``, ``strain``
    (the mean of a voxel's links), ``contact`` (0 none, 1 floor, 2 itself, 3 both) and ``colour``. Other robots are
    faces with ``part``, the number of their node, and ``colour``. Uneven ground is a surface of triangles with
    ``friction``, the mean factor of their corners, and ``colour``; it is the second part of every time step.

    Args:
        motion: motion to write.
        folder: folder to make, which must not exist yet.

    Returns:
        Bytes written.

    Raises:
        ValueError: if the folder exists or cannot be made.
        RuntimeError: if the disk is full or broken.
    """
    folder = Path(folder)
    if folder.exists():
        raise ValueError(f"folder: {folder} exists; name a new one")
    with told_as(f"folder: {folder} cannot be made"), new_folder(folder) as inside:
        return _fill(motion, inside)


def _fill(motion: Motion, folder: Path) -> int:
    """Write all files of a folder, and return the number of bytes."""
    (folder / "frames").mkdir()
    colours, total, entries = colouring(motion), 0, []
    ground = _ground(motion)
    if ground is not None:
        write_bytes(folder / "ground.vtp", ground)
        total += len(ground)
    for frame, time in enumerate(motion.times):
        colour = np.round(255 * colours.of(frame)).astype("u1")
        suffix, content = (_grid if motion.lattice is not None else _faces)(motion, frame, colour)
        name = f"frames/{frame:05d}.{suffix}"
        write_bytes(folder / name, content)
        entries.append(f'<DataSet timestep="{time:.9g}" file="{name}"/>\n')
        if ground is not None:
            entries.append(f'<DataSet timestep="{time:.9g}" part="1" file="ground.vtp"/>\n')
        total += len(content)
    index = INDEX.format("".join(entries))
    write_text(folder / "motion.pvd", index)
    return total + len(index)


def _grid(motion: Motion, frame: int, colour: Bytes) -> tuple[str, bytes]:
    """Suffix and content of the file for one frame of a lattice."""
    assert motion.lattice is not None and motion.skin is not None and motion.lattice.body.regions is not None
    now, knots = motion.lattice.part([frame]), motion.skin.knots
    points, count = joined_corners(boxes(motion, frame), knots), len(knots)
    data = {
        "region": motion.lattice.body.regions.astype("i4"),
        "strain": now.voxel_strains()[0].astype("f4"),
        "contact": now.contacts()[0].astype("u1"),
        "colour": colour,
    }
    cells = {
        "connectivity": knots[:, VTK_ORDER].ravel().astype("i4"),
        "offsets": np.arange(8, 8 * count + 1, 8, dtype="i4"),
        "types": np.full(count, HEXAHEDRON, "u1"),
    }
    return "vtu", _file("UnstructuredGrid", "Cells", count, points, cells, data)


def _faces(motion: Motion, frame: int, colour: Bytes) -> tuple[str, bytes]:
    """Suffix and content of the file for one frame of a robot that is not a lattice."""
    quads, owners = faces(motion, frame)
    points, count = quads.reshape(-1, 3), len(quads)
    cells = {
        "connectivity": np.arange(4 * count, dtype="i4"),
        "offsets": np.arange(4, 4 * count + 1, 4, dtype="i4"),
    }
    data = {"part": owners.astype("i4"), "colour": colour[owners]}
    return "vtp", _file("PolyData", "Polys", count, points, cells, data)


def _ground(motion: Motion) -> bytes | None:
    """Content of the file of uneven ground; None if the ground is a plane."""
    relief, whole = relief_around(motion), motion.ground.relief
    if relief is None or whole is None:
        return None
    corners = triangles(relief)
    friction = np.ones(relief.heights.shape) if relief.friction is None else relief.friction
    friction, heights = (table.ravel()[corners].mean(axis=1) for table in (friction, relief.heights))
    cells = {
        "connectivity": corners.ravel().astype("i4"),
        "offsets": np.arange(3, 3 * len(corners) + 1, 3, dtype="i4"),
    }
    data = {
        "friction": friction.astype("f4"),
        "colour": np.round(255 * tints(heights, friction, whole) * np.array(GROUND)).astype("u1"),
    }
    return _file("PolyData", "Polys", len(corners), nodes(relief, motion.ground.level), cells, data)


def _file(kind: str, place: str, count: int, points: Floats, cells: Arrays, data: Arrays) -> bytes:
    """Content of a VTK XML file with one piece, whose ``count`` cells are in the element ``place``."""
    return FILE.format(
        kind=kind,
        place=place,
        counts=f'NumberOfPoints="{len(points)}" NumberOf{place}="{count}"',
        points=_array("points", points.astype("f4")),
        cells="\n".join(_array(name, values) for name, values in cells.items()),
        data="\n".join(_array(name, values) for name, values in data.items()),
    ).encode()


def _array(name: str, values: NDArray[Any]) -> str:
    """Compressed VTK data array as XML.

    A header of four numbers precedes the data: blocks, bytes of a block, bytes of the last block if it is partial,
    compressed bytes.
    """
    content = values.astype(values.dtype.newbyteorder("<")).tobytes()
    packed = zlib.compress(content, 3)
    header = struct.pack("<4I", 1, len(content), 0, len(packed))
    wide = values.shape[1] if values.ndim > 1 else 1
    attributes = f'type="{TYPES[values.dtype.str[1:]]}" Name={quoteattr(name)} NumberOfComponents="{wide}"'
    inline = (base64.b64encode(part).decode() for part in (header, packed))
    return f'<DataArray {attributes} format="binary">{"".join(inline)}</DataArray>'
