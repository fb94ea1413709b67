"""Folders for ParaView, read back."""

import base64
import struct
import xml.etree.ElementTree as ElementTree
import zlib

import motions
import numpy as np
import pytest

from robots.view.mesh import boxes, faces
from robots.view.paraview import VTK_ORDER, save_paraview

pytestmark = pytest.mark.kernels

TYPES = {"Float32": "<f4", "Int32": "<i4", "UInt8": "u1"}


def arrays(path):
    """All data arrays of a file, by name; its kind and its piece's counts."""
    file = ElementTree.parse(path).getroot()
    assert file.get("compressor") == "vtkZLibDataCompressor" and file.get("header_type") == "UInt32"
    found = {}
    for array in file.iter("DataArray"):
        blocks, size, partial, packed = struct.unpack("<4I", base64.b64decode(array.text[:24]))
        content = zlib.decompress(base64.b64decode(array.text[24:]))
        assert (blocks, partial, len(content), len(base64.b64decode(array.text[24:]))) == (1, 0, size, packed)
        values = np.frombuffer(content, TYPES[array.get("type")])
        wide = int(array.get("NumberOfComponents"))
        found[array.get("Name")] = values.reshape(-1, wide) if wide > 1 else values
    return found, file.get("type"), {k: int(v) for k, v in file.find(".//Piece").attrib.items()}


def entries(folder):
    return [(float(e.get("timestep")), e.get("file")) for e in ElementTree.parse(folder / "motion.pvd").iter("DataSet")]


def test_voxels_are_hexahedra_with_what_they_feel(tmp_path):
    motion = motions.inflatable().every(6)
    total = save_paraview(motion, tmp_path / "p")
    assert total == sum(file.stat().st_size for file in (tmp_path / "p").rglob("*.*"))
    listed = entries(tmp_path / "p")
    assert [time for time, _ in listed] == pytest.approx(motion.times)
    for frame, (_, name) in enumerate(listed):
        found, kind, counts = arrays(tmp_path / "p" / name)
        voxels = len(motion.nodes)
        assert kind == "UnstructuredGrid" and counts["NumberOfCells"] == voxels
        assert counts["NumberOfPoints"] == len(found["points"]) < 8 * voxels
        assert np.array_equal(found["offsets"], 8 * np.arange(1, voxels + 1)) and (found["types"] == 12).all()
        cells = found["points"][found["connectivity"].reshape(-1, 8)]
        middles = motion.translation[frame]
        assert np.abs(cells.mean(axis=1) - middles).max() < 0.5 * motions.TINY.voxel_size
        states = motion.lattice.part(np.array([frame]))
        assert found["strain"] == pytest.approx(states.voxel_strains()[0], abs=1e-6)
        assert np.array_equal(found["contact"], states.on_floor()[0] + 2 * states.on_itself()[0])
        assert np.array_equal(found["region"], motion.lattice.body.regions)


def test_hexahedra_go_round_the_bottom_then_the_top():
    """Right-handed, as VTK's figure of the cell has them, so that volumes are positive."""
    corners = boxes(motions.soft_walker(), 0)[0][VTK_ORDER]
    bottom = np.cross(corners[1] - corners[0], corners[3] - corners[0])
    assert bottom @ (corners[4] - corners[0]) > 0
    assert np.abs(corners[4:] - corners[:4] - (corners[4] - corners[0])).max() < 1e-9


def test_other_robots_are_faces_with_their_parts(tmp_path):
    motion = motions.two_wheels()
    save_paraview(motion, tmp_path / "p")
    name = entries(tmp_path / "p")[3][1]
    found, kind, counts = arrays(tmp_path / "p" / name)
    quads, owners = faces(motion, 3)
    assert kind == "PolyData" and counts["NumberOfPolys"] == len(quads)
    assert np.abs(found["points"][found["connectivity"]].reshape(-1, 4, 3) - quads).max() < 1e-6
    assert np.array_equal(found["part"], owners) and found["colour"].shape == (len(quads), 3)


def test_folders_that_exist_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"^folder: .* exists; name a new one$"):
        save_paraview(motions.two_wheels(), tmp_path)
    (tmp_path / "file").write_text("mine")
    with pytest.raises(ValueError, match=r"^folder: .* cannot be made \(.*\)$"):
        save_paraview(motions.two_wheels(), tmp_path / "file" / "p")
