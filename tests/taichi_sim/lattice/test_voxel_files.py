"""Files of Voxelyze, VoxCAD, evosoro and voxcraft."""

import base64
import dataclasses
import json
import tracemalloc
import warnings
import zlib

import numpy as np
import pytest
from voxel_files import layers, material, numbers, structure, vxa, vxl

from taichi_sim.lattice import LatticeBody, Material, ProgramBuilder, Quantity, body_from_array
from taichi_sim.lattice.files import (
    Heat,
    VoxelFile,
    load_voxel_file,
    read_vxl_json,
    save_vxa,
    save_vxl_json,
    vxl_json,
    write_vxl_json,
)
from taichi_sim.lattice.files.arrays import array_of_body

SOFT = Material(1e5, 1e3)
ARRAY = np.random.default_rng(0).integers(0, 3, (4, 3, 2))
PHASES = np.round(np.random.default_rng(1).uniform(-1, 1, ARRAY.shape), 3)
ROWS = np.column_stack([np.argwhere(np.ones((3, 2, 1))), np.zeros(6, int)])


def load(tmp_path, text, name="robot.vxa", quiet=False):
    path = tmp_path / name
    path.write_text(text, encoding="latin-1")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore" if quiet else "error")
        return load_voxel_file(path)


@pytest.mark.parametrize("compression", ["ASCII_READABLE", "BASE64", "ZLIB", "QT_ZLIB"])
def test_voxcad_bodies_are_read_whatever_packs_their_layers(tmp_path, compression):
    found = load(tmp_path, vxa(ARRAY, compression=compression))
    assert np.array_equal(array_of_body(found.body), ARRAY) and found.body.voxel_size == 0.05
    muscle, bone = found.body.materials
    assert (muscle.name, muscle.youngs_modulus, muscle.density, muscle.poissons_ratio) == ("muscle", 1e6, 1e6, 0.35)
    assert (bone.youngs_modulus, bone.thermal_expansion, bone.static_friction, bone.kinetic_friction) == (
        5e6,
        -0.01,
        1,
        0.5,
    )
    assert (muscle.internal_damping, muscle.collision_damping, muscle.global_damping) == (0.8, 0.7, 0.01)
    assert found.colours.tolist() == [[255, 128, 0, 255]] * 2 and found.time_step_fraction == 0.9
    assert (found.gravity, found.floor) == (9.81, True) and found.ignored == ()
    assert (found.heat.amplitude, found.heat.period) == (14, 0.25) and not found.heat.phase.any()


def test_every_voxel_has_its_thermal_phase_and_materials_add_theirs(tmp_path):
    palette = [material(phase=np.pi / 2), material("bone")]
    found = load(tmp_path, vxa(ARRAY, palette, more=numbers(PHASES)))
    kinds = ARRAY[ARRAY > 0]
    assert found.heat.phase == pytest.approx((PHASES[ARRAY > 0] + np.where(kinds == 1, 0.25, 0)) % 1)
    assert found.body.region_count == len(np.unique(np.column_stack([kinds, found.heat.phase]), axis=0))


def test_ten_materials_go_on_after_the_digits(tmp_path):
    array = np.arange(1, 13).reshape(3, 2, 2)
    text = vxa(array, [material(f"m{n}", modulus=f"{n}e6") for n in range(1, 13)])
    assert "[15937;]" in text and "[26:48<]" in text  # 10, 11 and 12 are ":", ";" and "<"
    found = load(tmp_path, text)
    assert [m.youngs_modulus for m in found.body.materials] == [n * 1e6 for n in range(1, 13)]
    assert np.array_equal(array_of_body(found.body), array)


def test_temperatures_may_stay_or_be_absent(tmp_path):
    steady = vxa(ARRAY, heat="<TempAmplitude>5</TempAmplitude>").replace("VaryTempEnabled>1", "VaryTempEnabled>0")
    heat = load(tmp_path, steady).heat
    assert (heat.mean, heat.amplitude) == (5.0, 0.0)
    assert load(tmp_path, vxa(ARRAY).replace("TempEnabled>1", "TempEnabled>0")).heat is None
    assert load(tmp_path, vxa(ARRAY, heat="")).heat is None


def test_what_the_lattice_has_not_is_named_once(tmp_path):
    text = vxa(ARRAY, more=numbers(PHASES, "Stiffness")).replace("<NumFixed>0", "<NumFixed>2")
    text = text.replace("<MatModel>0", "<MatModel>1")
    with pytest.warns(UserWarning, match=r"ignored are MatModel, Stiffness, Fixed_Regions/NumFixed$") as told:
        path = tmp_path / "a.vxa"
        path.write_text(text)
        assert load_voxel_file(path).body.voxel_count == (ARRAY > 0).sum()
    assert len(told) == 1


def test_bodies_without_environment_are_read(tmp_path):
    text = f"<VXC><Palette>{material()}</Palette>{structure(np.ones((2, 1, 1), int))}</VXC>"
    found = load(tmp_path, text, "robot.vxc")
    assert (found.body.voxel_count, found.body.voxel_size, found.heat, found.gravity) == (2, 0.001, None, None)


def test_materials_may_be_fixed_to_the_world(tmp_path):
    palette = [material(), material("anchor", more="<Fixed>1</Fixed>")]
    found = load(tmp_path, vxa(ARRAY, palette))
    assert np.array_equal(found.body.fixed.all(axis=1), found.body.material_index == 1)


# --- .vxd


def difference(tmp_path, text, base=None, name="robot.vxd"):
    text_of_base = vxa(np.ones((1, 1, 1), int)) if base is None else base
    swelling = text_of_base.replace("<Simulator>", "<Simulator><EnableExpansion>1</EnableExpansion>")
    (tmp_path / "base.vxa").write_text(swelling)
    return load(tmp_path, text, name)


def replacing(part, path="VXA.VXC.Structure"):
    return part.replace("<Structure", f'<Structure replace="{path}"', 1)


@pytest.mark.parametrize("compression", ["ASCII_READABLE", "BASE64", "ZLIB", "QT_ZLIB"])
def test_differences_replace_the_structure_of_their_base(tmp_path, compression):
    part = replacing(structure(ARRAY, compression, more=numbers(PHASES)))
    found = difference(tmp_path, f"<VXD>{part}</VXD>")
    assert np.array_equal(array_of_body(found.body), ARRAY) and found.heat.amplitude == 14
    assert found.heat.phase == pytest.approx(PHASES[ARRAY > 0] % 1)


def test_differences_replace_numbers_and_add_what_is_not_there(tmp_path):
    text = '<VXD><p replace="VXA.Environment.Thermal.TempPeriod">0.5</p><g replace="VXA.New.Part">1</g></VXD>'
    assert difference(tmp_path, text).heat.period == 0.5
    period = '<a replace="VXA.Environment.Thermal.TempPeriod">3</a>'
    two = f'<VXD>{period}<b replace="VXA.VXC.Lattice.Lattice_Dim">0.1</b></VXD>'
    found = difference(tmp_path, two)
    assert (found.heat.period, found.body.voxel_size) == (3.0, 0.1)
    assert difference(tmp_path, "<VXD></VXD>").body.voxel_count == 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (f"<VXD>{structure(ARRAY)}</VXD>", "Structure: replace None is not allowed; give VXA.PART"),
        ('<VXD><a replace="VXC.Structure"/></VXD>', "a: replace 'VXC.Structure' is not allowed"),
        ('<VXD><a replace="VXA"/></VXD>', "a: replace 'VXA' is not allowed"),
        ('<VXD><a replace="VXA.b[1"/></VXD>', "a: replace 'VXA.b[1' is not allowed"),
        ('<VXD><a replace="VXA..b"/></VXD>', "a: replace 'VXA..b' is not allowed"),
        ("<VXA/>", "<VXA> is no difference; give a file of <VXD>"),
        ('<VXD><a replace="VXA.VXC.Structure"/></VXD>', "X_Voxels: None is not allowed; give a whole number"),
    ],
)
def test_damaged_differences_are_refused(tmp_path, text, message):
    with pytest.raises(ValueError, match=r"robot\.vxd: ") as error:
        difference(tmp_path, text)
    assert message in str(error.value) and "\n" not in str(error.value)


def test_a_difference_needs_its_base(tmp_path):
    with pytest.raises(ValueError, match=r"base\.vxa: cannot be read"):
        load(tmp_path, "<VXD/>", "robot.vxd")


# --- broken .vxa

BOMB = zlib.compress(bytes(200_000_000), 9)
LAUGHS = (
    '<!DOCTYPE z [<!ENTITY a "aaaaaaaaaa">'
    + "".join(f'<!ENTITY {chr(98 + n)} "{10 * f"&{chr(97 + n)};"}">' for n in range(12))
    + "]>"
)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (vxa(ARRAY, head=LAUGHS), "a document type is not allowed; give plain XML"),
        (vxa(ARRAY, head='<!DOCTYPE x SYSTEM "file:///etc/passwd">'), "a document type is not allowed"),
        ("<a>" * 100_000 + "</a>" * 100_000, "more than 200 elements in each other are not allowed"),
        (vxa(ARRAY)[:-9], "this is no XML"),
        (vxa(ARRAY, sizes=(4, 3, 3)), "Data: it has 2 layers, but Z_Voxels says 3"),
        (vxa(ARRAY, sizes=(5, 3, 2)), "Data: layer 0: it has 12 voxels, not 15"),
        (vxa(ARRAY, sizes=(10**6, 10**6, 2)), "1000000 x 1000000 x 2 places are too many; the most is 20000000"),
        (vxa(ARRAY, sizes=(4, 3, -2)), "Z_Voxels: '-2' is not allowed; give a whole number, at least 1"),
        (vxa(ARRAY, sizes=(4, "1e9999", 2)), "Y_Voxels: '1e9999' is not allowed; give a finite number"),
        (vxa(ARRAY + 1), "Data: material 3 is unknown; the palette has 1 to 2"),
        (vxa(0 * ARRAY), "it is empty; give at least one voxel"),
        (vxa(ARRAY, data=layers(ARRAY), compression="LZMA"), "Compression: 'LZMA' is unknown; give ASCII_READABLE, BA"),
        (vxa(ARRAY, data=layers(ARRAY).replace("0", "é", 1).replace("1", " ", 1)), "layer 0: it has 11 voxels, not 12"),
        (vxa(ARRAY, data=layers(ARRAY, "ZLIB"), compression="BASE64"), "Data: layer 0: it has "),
        (vxa(ARRAY, data=layers(ARRAY, "BASE64"), compression="ZLIB"), "Data: layer 0: it is not compressed by zlib"),
        (vxa(ARRAY, data=layers(ARRAY), compression="BASE64"), "Data: layer 0: it has 9 voxels, not 12"),
        (vxa(ARRAY, more=numbers(PHASES[:3])), "PhaseOffset: layer 0: it has 9 numbers, not 12"),
        (vxa(ARRAY, more=numbers(PHASES * np.nan)), "PhaseOffset: layer 0: it has numbers that are not finite"),
        (vxa(ARRAY, [material(modulus="soft")] * 2), "Palette: material 1: Elastic_Mod: 'soft' is not allowed"),
        (vxa(ARRAY, [material(modulus="")] * 2), "Palette: material 1: Elastic_Mod: it is missing; give it"),
        (vxa(ARRAY, [material(density="-1")] * 2), "Palette: material 1: density: -1.0 is not allowed"),
        (vxa(ARRAY, heat="<TempAmp>1</TempAmp><TempPeriod>0</TempPeriod>"), "TempPeriod: 0 is not allowed"),
        (vxa(ARRAY, body="<Nothing/>"), "Structure: it is missing in <VXC>"),
        ("<VXA/>", "<VXA> has no robot; give a file of <VXA> with <VXC>"),
    ],
    ids=range(24),
)
def test_broken_robots_are_refused_in_one_line(tmp_path, text, message):
    with pytest.raises(ValueError, match=r"robot\.vxa: ") as error:
        load(tmp_path, text, quiet=True)
    assert message in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize("compression", ["ZLIB", "QT_ZLIB"])
def test_zip_bombs_are_never_unpacked(tmp_path, compression):
    small = np.ones((500, 400, 1), int)  # such a layer may be as long as the bomb is packed
    packed = (200_000).to_bytes(4, "big") * (compression == "QT_ZLIB") + BOMB
    data = f"<Data><Layer>{base64.b64encode(packed).decode()}</Layer></Data>"
    text = vxa(small, data=data, compression=compression)
    (tmp_path / "robot.vxa").write_text(text)
    tracemalloc.start()
    with pytest.raises(ValueError, match="Data: layer 0: it has more than 200000 voxels, not 200000"):
        load_voxel_file(tmp_path / "robot.vxa")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 12 * len(text)


def test_declared_sizes_take_no_memory(tmp_path):
    (tmp_path / "robot.vxa").write_text(vxa(ARRAY, sizes=(4000, 4000, 1)))
    tracemalloc.start()
    with pytest.raises(ValueError, match="Data: it has 2 layers, but Z_Voxels says 1"):
        load_voxel_file(tmp_path / "robot.vxa")
    assert tracemalloc.get_traced_memory()[1] < 1e6
    tracemalloc.stop()


def test_files_too_large_or_of_another_kind_are_not_opened(tmp_path):
    with (tmp_path / "big.vxa").open("wb") as file:
        file.truncate(50_000_001)
    with pytest.raises(ValueError, match="50000001 bytes are not allowed, give at most 50000000"):
        load_voxel_file(tmp_path / "big.vxa")
    with pytest.raises(ValueError, match=r"robot\.obj: its kind is unknown; give a file of \.vxl\.json"):
        load_voxel_file("robot.obj")


# --- .vxl.json

HELD = {"fixed": [True] * 6, "translate": [0, 0, 0], "rotate": [0, 0, 0], "force": [0, 0, 0], "moment": [0, 0, 0]}


def test_voxelyze_bodies_are_read_with_their_loads(tmp_path):
    pulled = {**HELD, "fixed": [0] * 6, "force": [0, 0, -0.5], "voxelIndices": [4, 5]}
    text = vxl(ROWS, externals=[{**HELD, "voxelIndices": [0, 1]}, pulled], gravityAcceleration=9.81, floorEnabled=True)
    found = load(tmp_path, text, "robot.vxl.json")
    assert np.array_equal(found.body.voxels, ROWS[:, :3]) and found.body.voxel_size == 0.005
    assert found.body.fixed.all(axis=1).tolist() == [True, True, False, False, False, False]
    assert found.force[4].tolist() == [0, 0, -0.5] and not found.force[:4].any()
    assert (found.gravity, found.floor, found.colours.tolist()) == (9.81, True, [[255, 0, 10, 255]])
    builder = ProgramBuilder(1)
    found.apply_loads(builder)
    events = builder.build(1).events
    assert events["quantity"].tolist() == [Quantity.FORCE + 2] and events["value"].tolist() == [-0.5]
    assert found.body.regions[4] == found.body.regions[5] == events["region"][0] != found.body.regions[0]


def test_the_last_brace_may_be_missing_as_voxelyze_leaves_it(tmp_path):
    assert load(tmp_path, vxl(ROWS)[:-1], "a.json").body.voxel_count == 6


def test_moduli_may_be_given_by_curves(tmp_path):
    curve = {"strainData": [0, 0.1, 0.5], "stressData": [0, 2e4, 3e4], "density": 10, "epsilonFail": 0.4}
    with pytest.warns(UserWarning, match="ignored are epsilonFail, stressData beyond its first slope"):
        (tmp_path / "a.vxl.json").write_text(vxl(ROWS, [curve]))
        assert load_voxel_file(tmp_path / "a.vxl.json").body.materials[0].youngs_modulus == 2e5


def test_what_the_file_leaves_out_is_as_in_voxelyze():
    only = read_vxl_json(vxl([(0, 0, 0, 0)], [{"youngsModulus": 1e5}])).body.materials[0]
    assert only == Material(1e5, 1.0)


def random_robot(seed):
    rng = np.random.default_rng(seed)
    voxels = np.argwhere(rng.random((4, 3, 3)) < 0.7) - 2
    count = len(voxels)
    tissue = tuple(
        Material(
            *rng.uniform(1, 1e6, 2),
            *rng.uniform(0, 0.49, 1),
            *rng.random(5),
            scale=tuple(rng.uniform(0.5, 2, 3)),
            thermal_expansion=rng.random(),
            temperature=rng.random(),
            name=f"m {n} é",
        )
        for n in range(3)
    )
    pairs = np.argwhere(np.abs(voxels[:, None] - voxels[None]).sum(axis=2) == 1)
    body = LatticeBody(
        voxels,
        tissue,
        rng.integers(0, 3, count),
        rng.random() + 1e-3,
        rng.integers(0, 5, count),
        pairs[rng.permutation(len(pairs))[:4]],
        rng.random((count, 6)) < 0.2,
        rng.integers(-1, 2, (count, 3)),
        rng.integers(0, 3, count),
    )
    rows = lambda width: np.round(rng.normal(size=(3, width)), 1)[rng.integers(0, 3, count)]  # noqa: E731
    colours = rng.integers(0, 256, (3, 4)).astype(np.uint8)
    return VoxelFile(body, colours, rows(3), rows(3), rows(6), None, 9.81, True)


@pytest.mark.parametrize("seed", range(10))
def test_export_then_import_is_the_identity(tmp_path, seed):
    robot = random_robot(seed)
    save_vxl_json(robot, tmp_path / "robot.vxl.json")
    again = load_voxel_file(tmp_path / "robot.vxl.json")
    assert again.body.materials == robot.body.materials and again.body.voxel_size == robot.body.voxel_size
    for name in ("voxels", "material_index", "regions", "cut_links", "fixed", "pressure_normals", "chambers"):
        assert np.array_equal(getattr(again.body, name), getattr(robot.body, name)), name
    for name in ("colours", "force", "moment", "displacement", "gravity", "floor", "heat"):
        assert np.array_equal(getattr(again, name), getattr(robot, name)), name
    assert write_vxl_json(again) == write_vxl_json(robot)


UNUSUAL = {f.name: 0.375 for f in dataclasses.fields(Material)} | {"scale": (0.5, 1.25, 2.0), "name": "foam"}


@pytest.mark.parametrize("field", UNUSUAL)
def test_every_field_of_a_material_is_kept(field):
    """Robots are described by this file: what it lost, a search that goes on would not have."""
    unusual = dataclasses.replace(Material(1e5, 1e3), **{field: UNUSUAL[field]})
    assert unusual != Material(1e5, 1e3)
    assert first_material(unusual) == unusual


def first_material(given):
    """The material after it was written and read."""
    body = LatticeBody(np.array([[0, 0, 0]]), (given,), [0], 0.1)
    return read_vxl_json(write_vxl_json(VoxelFile.of_body(body))).body.materials[0]


def test_fields_that_voxelyze_has_no_place_for_are_kept_apart(monkeypatch):
    """As that of a later version would be; a file of a version that has more is refused, not read without them."""
    monkeypatch.delitem(vxl_json._NAMES, "CTE")
    unusual = Material(1e5, 1e3, thermal_expansion=7e-4)
    assert first_material(unusual) == unusual and first_material(Material(1e5, 1e3)) == Material(1e5, 1e3)
    body = LatticeBody(np.array([[0, 0, 0]]), (unusual, Material(2e5, 1e3)), [0], 0.1)
    text = write_vxl_json(VoxelFile.of_body(body))
    assert [m.get("morpholab") for m in json.loads(text)["materials"]] == [{"thermal_expansion": 7e-4}, None]
    monkeypatch.undo()
    message = "^materials: number 0: morpholab: thermal_expansion is unknown; the file is of a later version$"
    with pytest.raises(ValueError, match=message):
        read_vxl_json(text)


def test_the_law_of_links_is_kept():
    body = LatticeBody(np.array([[0, 0, 0], [1, 0, 0]]), (Material(1e5, 1e3),), [0, 0], 0.1, links="published")
    text = write_vxl_json(VoxelFile.of_body(body))
    assert read_vxl_json(text).body.links == "published"
    assert read_vxl_json(text.replace('"links": "published"', '"links": "balanced"')).body.is_balanced
    with pytest.raises(ValueError, match=r"links: 1 is unknown; choose one of alike, balanced, published"):
        read_vxl_json(text.replace('"links": "published"', '"links": 1'))


def test_regions_are_kept_though_there_are_fewer_voxels_than_labels():
    body = LatticeBody(np.array([[0, 0, 0], [1, 0, 0]]), (Material(1e5, 1e3),), [0, 0], 0.1, regions=[0, 24])
    assert read_vxl_json(write_vxl_json(VoxelFile.of_body(body))).body.regions.tolist() == [0, 24]


def test_chambers_are_kept_whatever_their_labels():
    body = LatticeBody(np.array([[0, 0, 0], [1, 0, 0]]), (Material(1e5, 1e3),), [0, 0], 0.1, chambers=[1, 7])
    assert read_vxl_json(write_vxl_json(VoxelFile.of_body(body))).body.chambers.tolist() == [0, 1]
    with pytest.raises(ValueError, match=r"^chambers: label -1 is not allowed; give 0 to 99999"):
        LatticeBody(np.array([[0, 0, 0]]), (Material(1e5, 1e3),), [0], 0.1, chambers=[-1])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{]", "this is no JSON"),
        ("[" * 100_000, "this is no JSON"),
        ("[1]", "the document is no object"),
        ("{}", "materials: it is missing, or no list of objects"),
        (vxl(ROWS, []), "materials: there are none; give at least one"),
        (vxl(ROWS, [{"density": 1}]), "materials: number 0: youngsModulus: it is missing; give it, or strainData"),
        (vxl(ROWS, [{"youngsModulus": 1, "CTE": "x"}]), "materials: number 0: CTE: x is not allowed; give a finite"),
        (vxl([(0, 0, 0, 1)]), "voxels: material 1 is unknown; the file has 0 to 0"),
        (vxl([*ROWS, (0, 0, 0, 0)]), "voxels: 2 voxels at (0, 0, 0); one is allowed"),
        (vxl(ROWS)[:-2] + ", 7]}", "voxels: 25 numbers are not allowed; give x, y, z and material"),
        (vxl([]), "voxels: 0 numbers are not allowed"),
        (vxl(ROWS).replace("0.005", "1e999"), "voxelSize: inf is not allowed; give a finite number"),
        (vxl(ROWS).replace("0.005", "NaN"), "this is no JSON: NaN is no number"),
        (vxl(ROWS).replace('"voxels": [0', '"voxels": [1e30'), "voxels: it is no list of whole numbers"),
        (vxl(ROWS, externals=[{**HELD, "voxelIndices": [99]}]), "externals: voxel 99 is unknown; the file has 0 to 5"),
        (vxl(ROWS, externals=[{**HELD, "force": [1]}]), "externals: one is damaged"),
        (vxl(ROWS, morpholab={"regions": [0, 1, 2, 3, 4, 2**40]}), "regions: it is no list of whole numbers"),
        (vxl(ROWS, morpholab={"regions": [0, 1, 2, 3, 4, 10**6]}), "regions: label 1000000 is not allowed"),
        (vxl(ROWS, morpholab={"chambers": [0, 1, 2, 3, 4, 10**6]}), "chambers: label 1000000 is not allowed"),
        (vxl(ROWS, morpholab={"chambers": [0, 0, -1, 0, 0, 0]}), "chambers: label -1 is not allowed; give 0 to 99999"),
        (vxl(ROWS, morpholab={"chambers": [0, 1]}), "chambers: "),
        (vxl(ROWS, morpholab={"cutLinks": [[0, 5]]}), "cut_links: (0, 5) are not neighbouring voxels"),
        (vxl(ROWS, morpholab={"cutLinks": [[0]]}), "morpholab: cutLinks or pressureNormals are damaged"),
    ],
    ids=range(23),
)
def test_broken_json_is_refused_in_one_line(tmp_path, text, message):
    with pytest.raises(ValueError, match=r"robot\.vxl\.json: ") as error:
        load(tmp_path, text, "robot.vxl.json")
    assert message in str(error.value) and "\n" not in str(error.value)


def test_heat_has_no_place_in_json(tmp_path):
    robot = load(tmp_path, vxa(ARRAY))
    with pytest.raises(ValueError, match=r"heat: a \.vxl\.json has no place for it"):
        write_vxl_json(robot)
    assert json.loads(write_vxl_json(VoxelFile.of_body(robot.body)))["voxelSize"] == 0.05


BITS = [b"-", b"9e9", b"null", b"[", b"{}", b'"', b"0", b",", b"1e999", b"\xff", b"<", b"."]


@pytest.mark.parametrize("name", ["robot.vxa", "robot.vxd", "robot.vxl.json"])
def test_random_damage_is_refused_in_one_line_or_read(tmp_path, name):
    rng = np.random.default_rng(0)
    whole = {
        "robot.vxa": vxa(ARRAY, more=numbers(PHASES)),
        "robot.vxl.json": write_vxl_json(random_robot(0)),
        "robot.vxd": f"<VXD>{replacing(structure(ARRAY, 'ZLIB'))}</VXD>",
    }[name]
    (tmp_path / "base.vxa").write_text(vxa(ARRAY))
    counts = {"read": 0, "refused": 0}
    for _ in range(400):
        text = bytearray(whole.encode("utf-8"))
        place = rng.integers(len(text))
        text[place : place + rng.integers(3)] = BITS[rng.integers(len(BITS))]
        (tmp_path / name).write_bytes(text)
        try:
            with warnings.catch_warnings(action="ignore"):
                load_voxel_file(tmp_path / name)
            counts["read"] += 1
        except ValueError as error:
            assert "\n" not in str(error)
            counts["refused"] += 1
    assert min(counts.values()) > 10


def random_vxa_robot(seed):
    random = np.random.default_rng(seed)
    array = random.integers(0, 13, (4, 3, 5))
    array[0, 0, 0] = 1
    materials = [
        Material(*random.uniform(1e4, 1e6, 2), *random.uniform(0, 0.4, 3), thermal_expansion=n / 7, name=f"<{n}> & co")
        for n in range(12)
    ]
    held = np.isin(array, (2, 3))
    body = body_from_array(array, materials, 0.013, fixed=held)
    heat = Heat(11.0, 0.23, random.uniform(0, 1, body.voxel_count))
    return dataclasses.replace(VoxelFile.of_body(body), heat=heat, gravity=9.81, floor=True)


@pytest.mark.parametrize("seed", range(3))
def test_a_vxa_that_was_written_is_read_as_it_was(tmp_path, seed):
    robot = random_vxa_robot(seed)
    save_vxa(robot, tmp_path / "a.vxa")
    found = load_voxel_file(tmp_path / "a.vxa")
    body, ours = found.body, robot.body
    assert np.array_equal(body.voxels, ours.voxels) and body.voxel_size == ours.voxel_size
    assert [body.materials[n] for n in body.material_index] == [ours.materials[n] for n in ours.material_index]
    assert np.array_equal(body.fixed, ours.fixed)
    assert np.array_equal(found.heat.phase, robot.heat.phase) and found.heat.period == robot.heat.period
    assert (found.heat.amplitude, found.gravity, found.floor) == (11.0, 9.81, True) and not found.ignored
    save_vxa(dataclasses.replace(robot, heat=None), tmp_path / "b.vxa")
    assert load_voxel_file(tmp_path / "b.vxa").heat is None


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda f: replace_body(f, cut_links=[[0, 1]]), "cut_links: 1 are not allowed in a .vxa"),
        (lambda f: replace_body(f, fixed=np.eye(6, dtype=bool)[[0, 1]]), "fixed: some degrees of freedom of a voxel"),
        (lambda f: dataclasses.replace(f, force=np.ones((2, 3))), "loads: forces and displacements are not allowed"),
        (lambda f: dataclasses.replace(f, heat=Heat(1, 1, np.zeros(2), 2.0)), "mean: 2 K is not allowed in a .vxa"),
        (
            lambda f: replace_body(f, materials=(Material(1e5, 1e3, scale=(1, 2, 1)),)),
            r"scale: \(1.0, 2.0, 1.0\) of a material is not allowed in a .vxa",
        ),
        (
            lambda f: replace_body(
                f, materials=(SOFT, Material(1, 1, internal_damping=0.5)), material_index=np.array([0, 1])
            ),
            "damping: materials of a .vxa have one in common",
        ),
    ],
)
def test_what_a_vxa_cannot_hold_is_refused(tmp_path, change, message):
    file = VoxelFile.of_body(body_from_array(np.ones((2, 1, 1)), SOFT, 0.01))
    with pytest.raises(ValueError, match=f"^{message}"):
        save_vxa(change(file), tmp_path / "a.vxa")
    assert not (tmp_path / "a.vxa").exists()


def test_a_vxa_has_at_most_seventy_materials(tmp_path):
    materials = [Material(1e5 + n, 1e3) for n in range(71)]
    body = body_from_array(np.arange(1, 72).reshape(-1, 1, 1), materials, 0.01)
    with pytest.raises(ValueError, match=r"^materials: 71 are not allowed in a .vxa; the most is 70"):
        save_vxa(VoxelFile.of_body(body), tmp_path / "a.vxa")


def replace_body(file, **changes):
    return dataclasses.replace(file, body=dataclasses.replace(file.body, **changes))
