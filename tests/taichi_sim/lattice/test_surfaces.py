"""Closed surfaces of voxels: manifolds of the right volume, their files, and moulds around them."""

import io
import zipfile
from xml.etree import ElementTree

import numpy as np
import pytest
import trimesh

from taichi_sim.lattice import LatticeBody, Material, body_from_array
from taichi_sim.lattice.files.mesh import voxelise
from taichi_sim.lattice.files.mould import mould_of
from taichi_sim.lattice.files.parts import Part, save_3mf, save_stl
from taichi_sim.lattice.files.surface import GAP, body_surface, cell_surface

SOFT, HARD = Material(1e5, 1e3, name="soft"), Material(1e6, 1e3, name="hard")
CORNERS = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
CORE = "{http://schemas.microsoft.com/3dmanufacturing/core/2015/02}"


def table():
    """A plate on four legs."""
    array = np.zeros((6, 4, 4), int)
    array[:, :, 3] = 1
    array[::5, ::3, :3] = 1
    return array


def as_stl(surface):
    """What a reader makes of the triangles of an STL file, which knows no vertices."""
    mesh = trimesh.Trimesh(surface.vertices, surface.faces, process=False)
    return trimesh.load(io.BytesIO(mesh.export(file_type="stl")), file_type="stl")


def check_manifold(cells, cut=(), tolerance=0.01):
    found = cell_surface(cells, cut)
    mesh = trimesh.Trimesh(found.places + found.shifts, found.faces, process=False)
    read = trimesh.load(io.BytesIO(mesh.export(file_type="stl")), file_type="stl")
    for one in (mesh, read):
        assert one.is_watertight and one.is_winding_consistent
        assert one.volume == pytest.approx(len(cells), rel=tolerance)
    assert len(read.vertices) == len(mesh.vertices)  # no two vertices came together


def test_surfaces_are_manifolds_for_every_way_in_which_cells_meet():
    for number in range(1, 256):
        check_manifold(CORNERS[[bool(number >> bit & 1) for bit in range(8)]])


def test_surfaces_of_random_cells_are_manifolds_also_with_cut_links():
    random = np.random.default_rng(1)
    for share in (0.1, 0.3, 0.5, 0.7, 0.9):
        cells = np.argwhere(random.random((6, 5, 4)) < share)
        check_manifold(cells)
        pairs = [
            (i, j)
            for i in range(len(cells))
            for j in range(i + 1, len(cells))
            if np.abs(cells[i] - cells[j]).sum() == 1 and random.random() < 0.4
        ]
        check_manifold(cells, pairs, 0.02)


def test_boxes_have_exact_surfaces_in_metres_and_of_the_rest_size():
    body = body_from_array(np.ones((3, 2, 1)), SOFT, 0.01)
    surface = body_surface(body)
    assert surface.volume == pytest.approx(6e-6, rel=1e-12)
    assert surface.vertices.min(axis=0).tolist() == [-0.005] * 3 and len(surface.faces) == 2 * 22
    grown = Material(1e5, 1e3, scale=(1.2, 1.0, 0.5))
    larger = body_surface(body_from_array(np.ones((3, 2, 1)), grown, 0.01))
    assert np.ptp(larger.vertices, axis=0) == pytest.approx([0.036, 0.02, 0.005])
    assert larger.volume == pytest.approx(6e-6 * 0.6)


def test_some_voxels_of_a_body_have_a_surface_of_their_own():
    array = np.ones((4, 2, 2), int)
    array[2:] = 2
    body = body_from_array(array, (SOFT, HARD), 0.01)
    parts = [body_surface(body, body.material_index == n) for n in (0, 1)]
    assert [part.volume for part in parts] == pytest.approx([8e-6, 8e-6])
    assert all(as_stl(part).is_watertight for part in parts)


def test_a_printed_body_becomes_the_same_voxels(tmp_path):
    array = np.random.default_rng(3).random((7, 6, 5)) < 0.6
    array[0, 0, 0] = array[-1, -1, -1] = True
    save_stl(body_surface(body_from_array(array, SOFT, 0.01)), tmp_path / "body.stl")
    with pytest.warns(UserWarning, match=r"mesh: its voxels of pitch 10 are \d+ pieces"):
        back = voxelise(tmp_path / "body.stl", 10, scale=1e-3)
    assert np.array_equal(back.filled, array) and back.pitch == pytest.approx(0.01)


@pytest.mark.filterwarnings("ignore:.* of its volume")
@pytest.mark.parametrize("height", [2.5, 7.5, 12.5, 17.5, 22.5])
def test_a_face_through_the_centres_of_a_layer_takes_all_of_it_or_nothing(tmp_path, height):
    """Beside a tower that decides where centres lie, so that rounding would decide place by place."""
    for width in (40, 60, 80, 100):
        block = trimesh.creation.box(bounds=[[0, 0, 0], [width, 30, height]])
        tower = trimesh.creation.box(bounds=[[-20, 0, 0], [0, 30, 30]])
        trimesh.util.concatenate([block, tower]).export(tmp_path / "body.stl")
        layers = voxelise(tmp_path / "body.stl", 5.0).filled[4:].reshape(width // 5 * 6, -1)
        assert (layers.all(axis=0) == layers.any(axis=0)).all()


def test_files_are_in_millimetres_and_name_their_parts(tmp_path):
    body = body_from_array(np.ones((3, 2, 1)), SOFT, 0.01)
    parts = [Part('soft & "blue"', body_surface(body), "#0072B2"), Part("b", body_surface(body))]
    save_stl(parts[0].surface, tmp_path / "a.stl")
    read = trimesh.load(tmp_path / "a.stl")
    assert read.is_watertight and read.volume == pytest.approx(6000)
    save_3mf(parts, tmp_path / "a.3mf")
    with zipfile.ZipFile(tmp_path / "a.3mf") as package:
        assert package.namelist() == ["[Content_Types].xml", "_rels/.rels", "3D/3dmodel.model"]
        model = ElementTree.fromstring(package.read("3D/3dmodel.model"))
    assert model.get("unit") == "millimeter"
    objects = list(model.iter(CORE + "object"))
    assert [each.get("name") for each in objects] == ['soft & "blue"', "b"]
    assert [each.get("displaycolor") for each in model.iter(CORE + "base")] == ["#0072B2", "#B9B4A8"]
    vertices = [[float(v.get(axis)) for axis in "xyz"] for v in objects[0].iter(CORE + "vertex")]
    faces = [[int(t.get(f"v{n}")) for n in (1, 2, 3)] for t in objects[0].iter(CORE + "triangle")]
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    assert mesh.is_watertight and mesh.volume == pytest.approx(6000)
    assert {item.get("objectid") for item in model.iter(CORE + "item")} == {each.get("id") for each in objects}
    first = (tmp_path / "a.3mf").read_bytes()
    save_3mf(parts, tmp_path / "a.3mf")
    assert (tmp_path / "a.3mf").read_bytes() == first


# --- moulds


@pytest.mark.parametrize(("pull", "turn"), [("z", (0, 1, 2)), ("x", (2, 0, 1)), ("y", (1, 2, 0))])
@pytest.mark.parametrize(("draft", "wall"), [(2.0, 3e-3), (5.0, 8e-3), (0.0, 1e-3)])
def test_draft_and_wall_hold_wherever_they_are_measured(pull, turn, draft, wall):
    body = body_from_array(table().transpose(turn), SOFT, 0.01)
    mould = mould_of(body, draft, wall)
    axis, edge = "xyz".index(pull), 0.01
    assert mould.pull == pull
    for half, way in ((mould.lower, -1), (mould.upper, 1)):
        mesh = as_stl(half)
        assert mesh.is_watertight and mesh.is_winding_consistent
        lean = np.degrees(np.arcsin(np.abs(mesh.face_normals[:, axis])))
        outside = np.isclose(mesh.triangles, mesh.bounds[0]) | np.isclose(mesh.triangles, mesh.bounds[1])
        others = [n for n in range(3) if n != axis]
        on_the_outside = outside.all(axis=1)[:, others].any(axis=1)
        cavity_walls = lean[(lean < 60) & ~on_the_outside]
        assert len(cavity_walls) and cavity_walls == pytest.approx(draft, abs=0.01)
        # They face the opening: whatever is cast can leave.
        facing = mesh.face_normals[:, axis][(lean < 60) & ~on_the_outside] * way
        assert (facing <= 1e-6).all()
        # The nearest of the cavity to the outside, across the pull and at the end of the half.
        inner = mesh.vertices[(np.abs(mesh.vertices[:, others] - mesh.bounds[:1, others]) > 1e-9).all(axis=1)]
        inner = inner[(np.abs(inner[:, others] - mesh.bounds[1:, others]) > 1e-9).all(axis=1)]
        inner = inner[np.abs(inner[:, axis] - mesh.bounds[(1 + way) // 2, axis]) > 1e-9]
        away = np.minimum(inner - mesh.bounds[0], mesh.bounds[1] - inner)
        assert away[:, others].min() == pytest.approx(wall, rel=1e-3)
        assert np.abs(inner[:, axis] - mesh.bounds[(1 + way) // 2, axis]).min() == pytest.approx(wall, rel=1e-3)
    assert mould.parting == pytest.approx(mould.lower.vertices[:, axis].max())
    assert mould.parting == pytest.approx(mould.upper.vertices[:, axis].min())
    assert edge * GAP < 1e-4  # by which the cavity is larger than the body where nothing else widens it


def test_the_cavity_is_the_body_widened_by_its_draft():
    body = body_from_array(np.ones((4, 3, 2)), SOFT, 0.01)
    mould, wide = mould_of(body, 3.0, 5e-3), np.tan(np.radians(3)) * 0.01
    ends = np.array([0.04, 0.03]) + 2 * GAP * 0.01
    base, top = np.prod(ends + 2 * wide), np.prod(ends)
    middle = np.prod(ends + wide)
    cavity = 0.01 * (base + 4 * middle + top) / 6  # a prismatoid
    block = np.prod(ends + 2 * wide + 0.01) * 0.015
    for half in (mould.lower, mould.upper):
        assert half.volume == pytest.approx(block - cavity, rel=1e-9)


def test_random_bodies_without_undercuts_are_moulded_and_others_are_not():
    random, moulded = np.random.default_rng(0), 0
    for _ in range(30):
        heights = random.integers(0, 4, (5, 4))
        array = np.arange(3) < heights[..., None]
        body = body_from_array(array, SOFT, 0.01) if array.any() else None
        if body is None:
            continue
        mould = mould_of(body, 2.0, 3e-3, "z")
        assert as_stl(mould.lower).is_watertight and as_stl(mould.upper).is_watertight
        moulded += 1
    assert moulded > 20


def test_a_body_with_undercuts_is_refused_and_told_where():
    array = np.ones((3, 3, 3), int)
    array[1, :, 1] = array[:, 1, 1] = 0  # a groove all the way, from two sides
    body = body_from_array(array, SOFT, 0.01)
    with pytest.raises(ValueError, match=r"^pull: undercut at voxel \(0, 1, 2\), counted .* opens along z$"):
        mould_of(body, pull="z")
    array[:, :, 1] = 0
    array[1, 1, 1] = 1
    array[1, 1, 0], array[0, 0, 1] = 0, 1
    with pytest.raises(
        ValueError, match=r"^pull: undercut at voxel \(.*\), .* no two-part mould opens along z or x or y$"
    ):
        mould_of(body_from_array(array, SOFT, 0.01))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda body: mould_of(body, draft=50), "draft: 50 is not allowed; give a number from 0 to 45 degrees"),
        (lambda body: mould_of(body, draft=-1), "draft: -1 is not allowed"),
        (
            lambda body: mould_of(body, draft=30),
            "draft: 30 degrees over 30 mm widen the cavity by half a voxel and more",
        ),
        (lambda body: mould_of(body, wall=0.0), "wall: 0.0 is not allowed; give a positive finite number"),
        (lambda body: mould_of(body, pull="w"), "pull: 'w' is not allowed; give x, y or z"),
        (lambda body: body_surface(body, np.zeros(body.voxel_count, bool)), "cells: there are none"),
        (lambda body: save_3mf([], "a.3mf"), "parts: there are none"),
    ],
)
def test_what_cannot_be_built_is_refused_in_one_line(make, message):
    with pytest.raises(ValueError, match=f"^{message}") as error:
        make(body_from_array(table(), SOFT, 0.01))
    assert "\n" not in str(error.value)


def test_bodies_without_one_rest_size_have_no_surface():
    grown = Material(1e5, 1e3, scale=(1.1, 1.1, 1.1), name="grown")
    body = LatticeBody(np.array([[0, 0, 0], [1, 0, 0]]), (SOFT, grown), np.array([0, 1]), 0.01)
    with pytest.raises(ValueError, match=r"^scale: \(1.0, 1.0, 1.0\) of soft and \(1.1, 1.1, 1.1\) of grown differ"):
        body_surface(body)
    with pytest.raises(ValueError, match=r"^scale: 1, 1.1 differ; give all materials one"):
        mould_of(body)
