"""Files of closed surfaces for printers: STL, one surface a file, and 3MF, named and coloured objects in one file.

Lengths are metres inside and millimetres in files: 3MF says so, STL has no unit, and printing takes it as millimetres.
Source: 3MF Core Specification 1.3 (the parts that are needed: objects of triangles, base materials, a build).
"""

import io
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from taichi_sim.base.files import write_bytes
from taichi_sim.lattice.files.surface import Surface

MILLIMETRES = 1e3  # per metre
_CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
_PACKAGE = "http://schemas.openxmlformats.org/package/2006"
_MODEL = "3D/3dmodel.model"
_TYPES = (
    f'<?xml version="1.0" encoding="UTF-8"?>\n<Types xmlns="{_PACKAGE}/content-types">'
    '<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
    '<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>'
)
_RELATIONS = (
    f'<?xml version="1.0" encoding="UTF-8"?>\n<Relationships xmlns="{_PACKAGE}/relationships">'
    f'<Relationship Target="/{_MODEL}" Id="rel0" '
    'Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>'
)
_WRITTEN = (1980, 1, 1, 0, 0, 0)  # so that equal parts give equal bytes


@dataclass(frozen=True, eq=False)
class Part:
    """A surface to print.

    Attributes:
        name: for people, such as ``"material rubber"``.
        surface: closed [m].
        colour: such as ``"#0072B2"``.
    """

    name: str
    surface: Surface
    colour: str = "#b9b4a8"


def save_stl(surface: Surface, path: str | PathLike[str]) -> None:
    """Write a surface as binary STL, in millimetres.

    Raises:
        ValueError: if the file cannot be written.
    """
    corners = (surface.vertices * MILLIMETRES)[surface.faces].astype("<f4")
    records = np.zeros(len(corners), np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("unused", "<u2")]))
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    records["normal"] = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    records["corners"] = corners
    head = b"millimetres".ljust(80) + np.uint32(len(corners)).astype("<u4").tobytes()
    write_bytes(path, head + records.tobytes())


def save_3mf(parts: Sequence[Part], path: str | PathLike[str]) -> None:
    """Write parts as the objects of a 3MF file, in millimetres; the same bytes for the same parts.

    Raises:
        ValueError: if there are no parts, or the file cannot be written.
    """
    if not parts:
        raise ValueError("parts: there are none; give at least one")
    colours = [f"<base name={quoteattr(p.name)} displaycolor={quoteattr(p.colour.upper())}/>" for p in parts]
    objects = [_object(number, part) for number, part in enumerate(parts)]
    items = [f'<item objectid="{number + 2}"/>' for number in range(len(parts))]
    model = (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<model unit="millimeter" xml:lang="en" xmlns="{_CORE}"><resources>'
        f'<basematerials id="1">{"".join(colours)}</basematerials>\n{"".join(objects)}</resources>\n'
        f"<build>{''.join(items)}</build></model>\n"
    )
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as package:
        for name, text in (("[Content_Types].xml", _TYPES), ("_rels/.rels", _RELATIONS), (_MODEL, model)):
            entry = zipfile.ZipInfo(name, _WRITTEN)
            entry.compress_type = zipfile.ZIP_DEFLATED
            package.writestr(entry, text)
    write_bytes(Path(path), buffer.getvalue())


def _object(number: int, part: Part) -> str:
    vertices = (part.surface.vertices * MILLIMETRES).tolist()
    points = "".join(f'<vertex x="{x:.9g}" y="{y:.9g}" z="{z:.9g}"/>' for x, y, z in vertices)
    faces = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in part.surface.faces.tolist())
    return (
        f'<object id="{number + 2}" type="model" name={quoteattr(part.name)} pid="1" pindex="{number}"><mesh>'
        f"<vertices>{points}</vertices><triangles>{faces}</triangles></mesh></object>\n"
    )
