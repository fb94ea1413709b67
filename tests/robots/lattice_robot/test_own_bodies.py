"""Bodies from arrays and meshes."""

import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import trimesh
from voxel_files import material, structure, vxa

from taichi_sim.lattice import LatticeBody, LatticeEngine, Material, ProgramBuilder, Quantity, body_from_array
from taichi_sim.lattice.files import VoxelFile, load_voxel_file, save_vxl_json
from taichi_sim.lattice.files.arrays import array_of_body, labels
from taichi_sim.lattice.files.mesh import body_from_mesh, inside, predict, voxelise

SOFT, HARD = Material(1e5, 1e3), Material(1e6, 1e3)


def test_arrays_become_bodies_and_come_back():
    array = np.random.default_rng(0).integers(0, 3, (4, 3, 5))
    body = body_from_array(array, {1: SOFT, 2: HARD}, 0.01)
    assert np.array_equal(body.voxels, np.argwhere(array)) and body.materials == (SOFT, HARD)
    shifted = array_of_body(body)
    assert np.array_equal(shifted, array) and body.region_count == 2
    odd = body_from_array(np.where(array == 2, 7, array), {7: HARD, 1: SOFT}, 0.01)
    assert [odd.materials[m] for m in odd.material_index] == [body.materials[m] for m in body.material_index]


def test_regions_fixed_and_normals_follow_the_voxels():
    array = np.array([[[1, 0], [1, 1]]])
    fixed = np.zeros(array.shape, bool)
    fixed[0, 1, 0] = True
    normals = np.zeros((*array.shape, 3), int)
    normals[0, 1, 1] = (0, 0, 1)
    body = body_from_array(array, SOFT, 0.1, regions=[[[4, 9], [0, 2]]], fixed=fixed, pressure_normals=normals)
    assert body.regions.tolist() == [4, 0, 2] and body.fixed.all(axis=1).tolist() == [False, True, False]
    assert body.pressure_normals.tolist() == [[0, 0, 0], [0, 0, 0], [0, 0, 1]]
    assert labels([3, 1, 3], [[0.5, 0], [0, 0], [0.5, 0]]).tolist() == [1, 0, 1]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: body_from_array(np.zeros((2, 2)), SOFT, 0.1), r"array: shape \(2, 2\) of float64 is not allowed"),
        (lambda: body_from_array([[["a"]]], SOFT, 0.1), r"array: shape \(1, 1, 1\) of <U1 is not allowed"),
        (lambda: body_from_array(np.zeros((2, 2, 1)), SOFT, 0.1), "array: it is empty"),
        (lambda: body_from_array([[[1, 3]]], (SOFT, HARD), 0.1), r"array: material 3 of voxel \(0, 0, 1\) is unknown"),
        (lambda: body_from_array([[[-1, 1.5]]], SOFT, 0.1), r"array: material -1.0 of voxel \(0, 0, 0\) is unknown"),
        (lambda: body_from_array([[[np.nan]]], SOFT, 0.1), r"array: material nan of voxel \(0, 0, 0\) is unknown"),
        (lambda: body_from_array([[[1]]], {}, 0.1), "materials: there are none"),
        (lambda: body_from_array([[[1]]], {0: SOFT}, 0.1), "materials: number 0 is not allowed"),
        (lambda: body_from_array([[[1]]], {1: "rubber"}, 0.1), "materials: number 1 is not allowed; give a Material"),
        (lambda: body_from_array([[[1]]], SOFT, 0.1, regions=[[0]]), r"regions: shape \(1, 1\) is not allowed; give"),
        (lambda: body_from_array([[[1]]], SOFT, 0.0), "voxel_size: 0.0 is not allowed"),
    ],
)
def test_arrays_that_are_no_bodies_are_refused(make, message):
    with pytest.raises(ValueError, match=f"^{message}") as error:
        make()
    assert "\n" not in str(error.value)


# --- meshes


def test_a_box_has_as_many_voxels_as_pitches_wherever_it_lies():
    for corner in ((0, 0, 0), (0.3, -7.1, 1e3)):
        box = trimesh.creation.box(extents=(0.5, 0.3, 0.2))
        box.apply_translation(corner)
        found = voxelise(box, 0.1)
        assert found.filled.shape == (5, 3, 2) and found.filled.all()
        assert found.origin == pytest.approx(np.array(corner) - [0.2, 0.1, 0.05])


def test_voxels_are_where_their_centres_are_inside():
    ball = trimesh.creation.icosphere(subdivisions=4, radius=1.0)
    found = voxelise(ball, 0.1)
    places = np.argwhere(np.ones(found.filled.shape)) * 0.1 + found.origin
    away = np.linalg.norm(places, axis=1).reshape(found.filled.shape)
    clear = np.abs(away - 1) > 0.01  # the mesh is flat between its vertices
    assert (found.filled == (away < 1))[clear].all() and clear.mean() > 0.9
    assert found.filled.sum() * 0.1**3 == pytest.approx(4 / 3 * np.pi, rel=0.02)


def test_lengths_are_rounded_to_whole_pitches():
    for scale in (1.0, 1e-3, 1 / 3):  # halves go up, whatever rounding does to them
        box = trimesh.creation.box(np.array([60, 30, 15]) * scale)
        assert voxelise(box, 7 * scale).filled.shape == (9, 4, 2)
        half = trimesh.creation.box(np.array([20.5, 20.5, 3]) * scale)
        assert voxelise(half, scale).filled.shape == (21, 21, 3)


@pytest.mark.filterwarnings("ignore:mesh. its voxels")
@pytest.mark.parametrize("kind", ["box", "turned box", "ball"])
def test_volumes_are_those_of_meshes_on_average(kind):
    rng, shares = np.random.default_rng(0), []
    for size in rng.uniform(3, 8, (100, 3)):
        mesh = trimesh.creation.icosphere(3, size[0] / 2) if kind == "ball" else trimesh.creation.box(size)
        if kind == "turned box":
            mesh.apply_transform(trimesh.transformations.random_rotation_matrix(rng.random(3)))
        shares.append(voxelise(mesh, 1.0).filled.sum() / mesh.volume)
    assert np.mean(shares) == pytest.approx(1, abs=0.05)


def test_another_volume_is_warned_of():
    with pytest.warns(
        UserWarning, match=r"^mesh: its voxels of pitch 2 have 120 % of its volume; give a smaller pitch"
    ):
        voxelise(trimesh.creation.box((5, 4, 4)), 2)
    with pytest.warns(UserWarning, match=r"^mesh: its voxels of pitch 2 have 83 % of its volume"):
        voxelise(trimesh.creation.box((4.8, 4, 4)), 2)
    voxelise(trimesh.creation.box((4.3, 4, 4)), 2)


def test_holes_of_a_body_stay_empty():
    ring = trimesh.creation.annulus(r_min=0.5, r_max=1.0, height=0.4)
    filled = voxelise(ring, 0.1).filled
    assert not filled[9:11, 9:11].any() and filled[1:4, 9:11].all()
    assert filled.sum() * 0.1**3 == pytest.approx(ring.volume, rel=0.05)


def test_files_of_meshes_in_millimetres(tmp_path):
    for name in ("leg.stl", "leg.obj", "leg.ply"):
        trimesh.creation.box(extents=(40, 20, 10)).export(tmp_path / name)
        body = body_from_mesh(tmp_path / name, 10, SOFT, scale=1e-3)
        assert (body.voxel_count, body.voxel_size) == (8, 0.01)


def four_legged(overlap):
    """A box on four legs that reach into it, in metres."""
    parts = [trimesh.creation.box((0.2, 0.1, 0.03))]
    parts[0].apply_translation([0, 0, 0.065])
    for x, y in ((-0.08, -0.03), (-0.08, 0.03), (0.08, -0.03), (0.08, 0.03)):
        leg = trimesh.creation.box((0.02, 0.02, 0.05 + overlap))
        leg.apply_translation([x, y, (0.05 + overlap) / 2])
        parts.append(leg)
    return trimesh.util.concatenate(parts)


@pytest.mark.parametrize("overlap", [0.005, 0.0])
def test_shells_that_overlap_or_touch_are_one_body(tmp_path, overlap):
    four_legged(overlap).export(tmp_path / "a.stl")
    filled = voxelise(tmp_path / "a.stl", 0.005).filled
    assert filled.sum() == 40 * 20 * 6 + 4 * 4 * 4 * 10 and filled.any(axis=(0, 1)).all()
    assert len(body_from_array(filled, SOFT, 0.005).topology.links)


def test_shells_that_look_inwards_are_holes_and_a_mesh_may_be_inside_out():
    outer, inner = trimesh.creation.box((2, 2, 2)), trimesh.creation.box((1, 1, 1))
    assert voxelise(trimesh.util.concatenate([outer, inner]), 0.25).filled.all()
    inner.invert()
    assert voxelise(trimesh.util.concatenate([outer, inner]), 0.25).filled.sum() == 8**3 - 4**3
    outer.invert()
    assert voxelise(outer, 0.25).filled.all()
    faces = outer.faces.copy()
    faces[::3] = faces[::3, ::-1]
    assert voxelise(trimesh.Trimesh(outer.vertices, faces, process=False), 0.25).filled.all()


def test_pieces_that_are_not_joined_are_warned_of():
    boxes = [trimesh.creation.box(), trimesh.creation.box()]
    boxes[1].apply_translation([2, 0, 0])
    with pytest.warns(UserWarning, match=r"^mesh: its voxels of pitch 0.5 are 2 pieces that are not joined; let parts"):
        voxelise(trimesh.util.concatenate(boxes), 0.5)


def test_meshes_in_millimetres_are_scaled_or_hinted_at():
    metres = four_legged(0.005)
    millimetres = metres.copy()
    millimetres.apply_scale(1000)
    one, other = voxelise(metres, 0.005), voxelise(millimetres, 5, scale=1e-3)
    assert np.array_equal(one.filled, other.filled) and other.pitch == pytest.approx(0.005)
    assert other.origin == pytest.approx(one.origin) and other.centres == pytest.approx(one.centres)
    with pytest.raises(
        ValueError, match=r"if the mesh, 200 long, is in millimetres, so is the pitch: give 10 for 0.01"
    ):
        voxelise(millimetres, 0.01)


def test_small_holes_are_repaired_and_large_ones_refused():
    box = trimesh.creation.box(extents=(4, 2, 2))
    torn = trimesh.Trimesh(box.vertices, box.faces[1:])
    with pytest.warns(UserWarning, match=r"^mesh: closed 1 hole, 1414 mm wide$"):
        assert not torn.is_watertight and voxelise(torn, 1.0).filled.sum() == 16
    assert not torn.is_watertight
    with pytest.raises(ValueError, match=r"mesh: it is not watertight: 3 of 18 edges do not join two triangles; close"):
        voxelise(torn, 1.0, repair=False)
    ball = trimesh.creation.icosphere(subdivisions=2)
    bowl = trimesh.Trimesh(ball.vertices, ball.faces[ball.triangles_center[:, 2] < 0])
    with pytest.raises(ValueError, match=r"mesh: it is not watertight and could not be repaired: \d+ of \d+ edges"):
        voxelise(bowl, 0.2)


def test_a_hole_so_wide_that_volume_is_missing_is_told(tmp_path):
    """Two triangles on adjacent sides leave a hole of four edges, whose cover cuts a wedge off the body."""
    box = trimesh.creation.box(extents=(120, 80, 20))
    sides = [np.flatnonzero(box.face_normals[:, axis] > 0.9) for axis in (0, 1)]
    wedge = next([i, j] for i in sides[0] for j in sides[1] if len({*box.faces[i]} & {*box.faces[j]}) == 2)
    box.update_faces(~np.isin(np.arange(len(box.faces)), wedge))
    box.export(tmp_path / "torn.stl")
    told = "^mesh: closed 1 hole of torn.stl, 99.07 mm wide, 9.9 pitches: the body may lack volume there"
    with pytest.warns(UserWarning, match=told):
        found = voxelise(tmp_path / "torn.stl", 10, scale=0.001)
    assert found.filled.sum() < 192
    whole = voxelise(trimesh.creation.box(extents=(120, 80, 20)), 10, scale=0.001)
    with pytest.warns(UserWarning, match=told):
        assert np.array_equal(inside(tmp_path / "torn.stl", whole, scale=0.001), found.filled)


def test_holes_are_counted_and_the_widest_is_told():
    torn = trimesh.creation.icosphere(subdivisions=3, radius=50)
    torn.update_faces(~np.isin(np.arange(len(torn.faces)), [0, 400, 900]))
    with pytest.warns(UserWarning, match=r"^mesh: closed 3 holes, the largest 4.\d+ mm wide$"):
        voxelise(torn, 10, scale=0.001)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: voxelise(trimesh.Trimesh(), 0.1), "mesh: it is empty"),
        (lambda: voxelise(trimesh.creation.box(), 0.0), "pitch: 0.0 is not allowed; it must be positive"),
        (lambda: voxelise(trimesh.creation.box(), np.nan), "pitch: nan is not allowed"),
        (lambda: voxelise("nothing.stl", 0.1), "mesh: nothing.stl cannot be read: "),
        (lambda: voxelise([1, 2], 0.1), "mesh: list is not allowed"),
        (lambda: voxelise(trimesh.creation.box((1, 1, 0.0)), 0.1), "mesh: it encloses no volume"),
        (lambda: voxelise(trimesh.creation.annulus(0.99, 1.0, 4.0), 0.5), "mesh: no voxel of pitch 0.5 has its centre"),
        (lambda: body_from_mesh(trimesh.creation.box(), 0.1, SOFT, scale=-1), "scale: -1 is not allowed"),
    ],
)
def test_meshes_that_are_no_bodies_are_refused(make, message):
    with pytest.raises(ValueError, match=f"^{message}") as error:
        make()
    assert "\n" not in str(error.value)


def test_what_is_far_too_fine_is_refused_before_memory_is_taken():
    box = trimesh.creation.box()
    tracemalloc.start()
    with pytest.raises(ValueError, match=r"pitch: 0.0001 is too fine, about 1,000,000,000,000 voxels and [\d,.]+ GB"):
        voxelise(box, 1e-4)
    assert tracemalloc.get_traced_memory()[1] < 1e6
    tracemalloc.stop()
    sheet = trimesh.creation.box((1.0, 1.0, 2e-4))  # few voxels, but a large grid
    with pytest.raises(ValueError, match=r"pitch: 0.0001 is too fine, about 200,000,000 voxels"):
        voxelise(sheet, 1e-4)
    with pytest.raises(ValueError, match=r"pitch: 0.1 is too fine, about 1,000 voxels and 0.0 GB; at most 999 and"):
        voxelise(box, 0.1, most_voxels=999)


@pytest.mark.kernels
def test_the_prediction_is_near_what_comes():
    ball = trimesh.creation.icosphere(subdivisions=4)
    predicted, found = predict(ball, 0.1), voxelise(ball, 0.1)
    assert found.filled.sum() == pytest.approx(predicted.voxels, rel=0.02)
    assert found.filled.size == predicted.cells
    body = body_from_array(found.filled, SOFT, 0.01)
    taken = (
        8 * LatticeEngine(body, batch=8, threads=1).bytes_per_robot
        + body.topology.excluded.nbytes
        + found.filled.nbytes
    )
    assert 0.6 * taken < predicted.memory < 2 * taken


# --- one cantilever from three sources


def deflection(body: LatticeBody, load: float) -> float:
    """Of the free end under its own weight as it sags [m], relaxed with damping against the world."""
    free = body.voxels[:, 0].max()
    engine = LatticeEngine(body, self_contact=False, threads=1)
    builder = ProgramBuilder(1)
    every = np.unique(body.regions)
    builder.set(Quantity.ACCELERATION + 2, -load, regions=every)
    builder.set(Quantity.GLOBAL_DAMPING, 0.02, regions=every)
    engine.run(builder.build(6000))
    return float(
        -engine.state().positions[0, body.voxels[:, 0] == free, 2].mean()
        + body.start_positions[body.voxels[:, 0] == free, 2].mean()
    )


@pytest.mark.kernels
def test_the_same_cantilever_from_array_mesh_and_files_bends_the_same(tmp_path):
    """10 x 2 x 2 voxels of 5 mm, held at one end; the deflections are equal to the bit."""
    array = np.ones((10, 2, 2), int)
    array[0] = 2
    tissue = Material(
        1e6,
        1e3,
        static_friction=1.0,
        kinetic_friction=0.5,
        internal_damping=0.8,
        global_damping=0.01,
        collision_damping=0.7,
    )
    held = array == 2
    from_array = body_from_array(array, (tissue, tissue), 0.005, fixed=held)
    box = trimesh.creation.box(extents=(50, 10, 10))
    box.export(tmp_path / "beam.stl")
    found = voxelise(tmp_path / "beam.stl", 5)
    clamp = np.zeros(found.filled.shape, bool)
    clamp[0] = True
    from_mesh = body_from_array(np.where(clamp, 2, 1) * found.filled, (tissue, tissue), 0.005, fixed=clamp)
    save_vxl_json(VoxelFile.of_body(from_array), tmp_path / "beam.vxl.json")
    palette = [material("tissue", "1e6", "1e3"), material("tissue", "1e6", "1e3", more="<Fixed>1</Fixed>")]
    text = vxa(
        array, [p.replace("0.35", "0").replace("<CTE>0.01", "<CTE>0") for p in palette], body=structure(array, "ZLIB")
    )
    (tmp_path / "beam.vxa").write_text(text.replace("<Lattice_Dim>0.05", "<Lattice_Dim>0.005"))
    bodies = [from_array, from_mesh, *(load_voxel_file(tmp_path / f).body for f in ("beam.vxl.json", "beam.vxa"))]
    bends = [deflection(body, 2.0) for body in bodies]
    # w x^2 (6 L^2 - 4 L x + x^2) / (24 E I), between the held and the last centres, half a voxel before the end.
    length, x, weight = 0.0475, 0.045, 2.0 * 1e3 * 1e-4
    theory = weight * x**2 * (6 * length**2 - 4 * length * x + x**2) / (24 * 1e6 * 0.01**4 / 12)
    assert bends[0] == pytest.approx(theory, rel=0.05) and bends == [bends[0]] * 4


@pytest.mark.kernels
def test_a_beam_converges_to_the_analytic_deflection(monkeypatch):
    """A cantilever at h, h/2, h/4, against F L^3 / (3 E I) and the 0.6 % that shear adds to it."""
    monkeypatch.syspath_prepend(str(Path(__file__).parents[3] / "benchmarks"))
    from cantilever import relative_deflection, shear

    errors = [abs(relative_deflection(n) - 1 - shear()) for n in (1, 2, 4)]
    assert errors[0] < 0.01 and errors[1] < errors[0] / 3 and errors[2] < errors[1] / 2


def test_the_benchmark_takes_whole_numbers_only(monkeypatch, capsys):
    monkeypatch.syspath_prepend(str(Path(__file__).parents[3] / "benchmarks"))
    from cantilever import main

    monkeypatch.setattr("sys.argv", ["cantilever.py", "0"])
    with pytest.raises(SystemExit, match="2"):
        main()
    assert "error: argument n: 0 is not allowed; give a whole number, at least 1\n" in capsys.readouterr().err
