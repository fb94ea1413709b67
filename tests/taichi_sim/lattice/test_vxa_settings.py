"""Settings of VoxCAD's and voxcraft's files, as the simulators that wrote them understand them."""

import warnings

import numpy as np
import pytest
from voxel_files import material, numbers, vxa

from taichi_sim.lattice import LatticeBody, Material
from taichi_sim.lattice.files import VoxelFile, load_voxel_file, save_vxa

ARRAY = np.array([1, 2, 2]).reshape(3, 1, 1)
SIMULATOR = "<Simulator>"
OF_VOXCRAFT = "<Simulator><EnableExpansion>1</EnableExpansion>"
EFFECTS = "<Features><VolumeEffectsEnabled>1</VolumeEffectsEnabled></Features>"


def load(tmp_path, text):
    """The file, and what a warning says is ignored."""
    (tmp_path / "robot.vxa").write_text(text)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        return load_voxel_file(tmp_path / "robot.vxa"), "".join(str(each.message) for each in told)


@pytest.mark.parametrize(
    "heat, amplitude",
    [
        ("<TempAmp>39</TempAmp>", 14.0),  # the peak, above a base of 25
        ("<TempAmplitude>20</TempAmplitude><TempAmp>39</TempAmp>", 20.0),
        ("<TempAmp>20</TempAmp>", -5.0),
    ],
)
def test_an_old_amplitude_is_a_peak_above_the_base(tmp_path, heat, amplitude):
    assert load(tmp_path, vxa(ARRAY, heat=heat))[0].heat.amplitude == amplitude
    without = vxa(ARRAY, heat=heat).replace("<TempBase>25</TempBase>", "")
    assert load(tmp_path, without)[0].heat.amplitude == amplitude
    assert load(tmp_path, vxa(ARRAY, heat="<TempAmp>25</TempAmp>"))[0].heat is None


def test_phases_of_voxcrafts_materials_are_periods_and_yield_to_layers(tmp_path):
    palette = [material(), material("leg", phase="0.5")]
    text = vxa(ARRAY, palette).replace(SIMULATOR, OF_VOXCRAFT)
    assert load(tmp_path, text)[0].heat.phase == pytest.approx([0.0, 0.5, 0.5])
    layered = vxa(ARRAY, palette, more=numbers(np.array([0.1, 0.2, 0.3]).reshape(3, 1, 1)))
    assert load(tmp_path, layered.replace(SIMULATOR, OF_VOXCRAFT))[0].heat.phase == pytest.approx([0.1, 0.2, 0.3])
    turned = np.array([0.1, 0.2 + 0.25 / np.pi, 0.3 + 0.25 / np.pi])
    assert load(tmp_path, layered)[0].heat.phase == pytest.approx(turned)


def test_a_poissons_ratio_needs_volume_effects(tmp_path):
    found, told = load(tmp_path, vxa(ARRAY).replace(EFFECTS, ""))
    assert [m.poissons_ratio for m in found.body.materials] == [0.0, 0.0]
    assert told.endswith("ignored are Poissons_Ratio without VolumeEffectsEnabled 1")
    found, told = load(tmp_path, vxa(ARRAY))
    assert [m.poissons_ratio for m in found.body.materials] == [0.35, 0.35] and not told


def test_voxcrafts_damping_is_its_own(tmp_path):
    bare = vxa(ARRAY).replace("<BondDampingZ>0.8</BondDampingZ>", "").replace("<SlowDampingZ>0.01</SlowDampingZ>", "")
    damped = [load(tmp_path, text)[0].body.materials[0] for text in (bare, bare.replace(SIMULATOR, OF_VOXCRAFT))]
    assert [(m.internal_damping, m.collision_damping, m.global_damping) for m in damped] == [(1, 0.7, 0), (0.1, 0.7, 1)]


@pytest.mark.parametrize(
    "place, setting, told",
    [
        (OF_VOXCRAFT, "<AttachDetach><EnableCollision>0</EnableCollision></AttachDetach>", "EnableCollision 0"),
        (SIMULATOR, "<RecordHistory/>", "EnableExpansion 0"),
        (SIMULATOR, "<GrowthAmplitude>2</GrowthAmplitude>", "GrowthAmplitude"),
        (SIMULATOR, "<EnableExpansion>0</EnableExpansion>", "EnableExpansion 0"),
        (SIMULATOR, "<EnableCilia>1</EnableCilia>", "EnableCilia"),
        (SIMULATOR, "<ForceField><x_forcefield/></ForceField>", "ForceField"),
        (
            "<Environment>",
            "<Boundary_Conditions><NumBCs>1</NumBCs></Boundary_Conditions>",
            "Boundary_Conditions/NumBCs",
        ),
        ("<Lattice>", "<X_Line_Offset>0.5</X_Line_Offset>", "X_Line_Offset"),
        ("<MatModel>0</MatModel>", "<Cilia>1</Cilia>", "Cilia"),
    ],
)
def test_what_would_change_the_motion_is_named(tmp_path, place, setting, told):
    text = vxa(ARRAY).replace(SIMULATOR, place) if place == OF_VOXCRAFT else vxa(ARRAY)
    assert load(tmp_path, text.replace(place, place + setting))[1].endswith(f"ignored are {told}")


def test_stretched_voxels_are_refused(tmp_path):
    text = vxa(ARRAY).replace("<Lattice>", "<Lattice><Y_Dim_Adj>2</Y_Dim_Adj>")
    with pytest.raises(ValueError, match=r"Y_Dim_Adj: 2 is not allowed, as voxels are cubes; give 1$"):
        load(tmp_path, text)


def test_a_layer_may_spell_the_end_of_its_frame(tmp_path):
    """Materials 45, 45 and 14 are "]]>" in a layer."""
    index = np.concatenate([np.arange(50), [44, 44, 13]])
    materials = tuple(Material(1e5 + n, 1e3, poissons_ratio=0.2, name=str(n)) for n in range(50))
    body = LatticeBody([(x, 0, 0) for x in range(53)], materials, index, 0.01)
    save_vxa(VoxelFile.of_body(body), tmp_path / "many.vxa")
    found = load_voxel_file(tmp_path / "many.vxa").body
    assert np.array_equal(found.material_index, index) and found.materials[13].poissons_ratio == 0.2
