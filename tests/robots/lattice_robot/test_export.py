"""Lattice robots as parts to print, as tables of a rig, as files of other simulators; and made of meshes."""

import dataclasses
import json
import re

import numpy as np
import pytest
import trimesh

from robots.hardware import OwnLines, PneumaticRig, RigViolation, read_channels, write_csv
from robots.hardware.dry_run import timing_text
from robots.lattice_robot import Drive, Free, LatticeRobot, load_robot, simulate
from robots.lattice_robot.channels import places_alike
from robots.lattice_robot.mesh_robot import MarkedRegion, robot_of_mesh
from robots.lattice_robot.on_rig import played_robot
from robots.lattice_robot.printing import overlapping_parts_of, parts_of
from robots.lattice_robot.record import robot_of_record, save_robot
from robots.lattice_robot.reflexes import Reflexes
from taichi_sim.lattice import Material, body_from_array
from taichi_sim.lattice.files import load_voxel_file

SOFT = Material(5e4, 1000.0, static_friction=1.0, kinetic_friction=0.5, thermal_expansion=0.01, name="soft")
HARD = Material(1e5, 1500.0, static_friction=1.0, kinetic_friction=0.5, name="hard")
FAST = dataclasses.replace(
    PneumaticRig(),
    name="fast",
    channels=tuple(dataclasses.replace(channel, slew_kpa_per_s=1e5) for channel in PneumaticRig().channels),
)
LEGS = OwnLines(("left", "right", "front", "back"), off_kpa=(0.0, 0.0, 20.0, 5.0), on_kpa=(20.0, 20.0, 0.0, 15.0))
FOUR = dataclasses.replace(FAST, name="four", channels=FAST.channels[1:5], lines=LEGS)


def robot(drives=None, **settings):
    """A plate of foam on four legs, of which one is hard; the fifth region is the plate."""
    array, regions = np.zeros((5, 3, 3), int), np.zeros((5, 3, 3), int)
    array[:, :, 2] = 1
    for number, (x, y) in enumerate(((0, 0), (0, 2), (4, 0), (4, 2)), 1):
        array[x, y, :2], regions[x, y, :2] = 1 + (number == 4), number
    body = body_from_array(array, (SOFT, HARD), 0.01, regions=regions)
    usual = (
        Drive("legs", (1, 2, 3, 4), amplitude=(0.2, 0.1, 0.2, 0.15), phase=(0.1, 0.4, 0.1, 0.8)),
        Drive("plate", (0,), mean=1.05, knots=(0.0, 0.1, 0.0), amplitude=0.5, axes="x"),
    )
    given = {"cycles": 1, "settling": 0.05, "frequency": 3.0, "name": "table, with legs"} | settings
    return LatticeRobot(body, usual if drives is None else drives, **given)


# --- printing


def test_each_voxel_is_in_one_part_which_its_material_and_channel_name():
    parts = parts_of(robot())
    volumes = {part.name: 1e6 * part.surface.volume for part in parts}
    names = ["soft, channel plate", "soft, channel legs 2", "soft, channel legs 1", "hard, channel legs 3"]
    assert list(volumes) == names  # regions 1 and 3 share a wave
    assert list(volumes.values()) == pytest.approx([15, 2, 4, 2])
    assert len({part.colour for part in parts}) == 4
    for part in parts:
        assert trimesh.Trimesh(part.surface.vertices, part.surface.faces, process=False).is_watertight


def test_a_folder_has_the_body_each_material_and_each_channel(tmp_path):
    told = robot().save_parts(tmp_path / "parts")
    assert told[0] == "body.stl: 23 cm^3" and len(told) == len(overlapping_parts_of(robot())) == 7
    volumes = {path.name: trimesh.load(path).volume for path in (tmp_path / "parts").iterdir()}
    assert volumes["material_soft.stl"] == pytest.approx(21e3) and volumes["channel_legs_1.stl"] == pytest.approx(4e3)
    assert all(trimesh.load(path).is_watertight for path in (tmp_path / "parts").iterdir())
    assert robot().save_parts(tmp_path / "m.3mf", "draft=2,wall=3")[0].startswith("mould lower: ")
    free = robot((Drive("legs", (1, 2, 3, 4), amplitude=Free(0, 0.2), phase=(0.1, 0.4, Free(0, 1), 0.8)),))
    assert len(parts_of(free.filled(free.start))) == 5 and free.save_parts(tmp_path / "free.stl")


@pytest.mark.parametrize(
    ("path", "mould", "message"),
    [
        ("a.obj", None, "parts: .*a.obj is not allowed; give a file that ends in .3mf or .stl, or a folder"),
        ("a.stl", "draft=2", "parts: .* has place for one surface, a mould has two halves"),
        ("a", "draft=2,thickness=3", "mould: 'thickness=3' is not allowed; give draft=DEGREES,wall=MM,pull=AXIS"),
        ("a", "draft=two", "mould: draft 'two' is not allowed; give a number"),
        ("a", "wall=0", "wall: 0.0 is not allowed"),
        ("a", "draft=46", "draft: 46.0 is not allowed; give a number from 0 to 45 degrees"),
        ("a", "pull=x", r"pull: undercut at voxel \(.*\), .* opens along x$"),
    ],
)
def test_what_cannot_be_printed_is_told(tmp_path, path, mould, message):
    with pytest.raises(ValueError, match=f"^{message}") as error:
        robot().save_parts(tmp_path / path, mould)
    assert "\n" not in str(error.value) and not (tmp_path / path).exists()


# --- tables


def test_waves_that_differ_by_rounding_share_a_channel():
    """Phases that are whole cycles apart, and half a cycle with the amplitude's sign changed."""
    phase, sign = np.array([0.1, 1.1, 4.1, 8.1, 0.6, 0.2]), np.array([1, 1, 1, 1, -1, 1])
    waves = sign * np.cos(2 * np.pi * (np.arange(16)[:, None] / 16 + phase))
    held = waves.T[None], np.zeros((1, 6))
    assert len({wave.tobytes() for wave in waves.T}) > 2
    assert places_alike(*held) == [[0, 1, 2, 3, 4], [5]]
    assert places_alike(held[0], np.array([[0, 0, 0.5, 0, 0, 0]])) == [[0, 1, 3, 4], [2], [5]]


def test_a_table_has_the_waves_of_the_channels_on_the_lines_of_bladders(tmp_path):
    drives = (Drive("blow", (1, 2), "pressure", mean=6e3, amplitude=(4e3, 2e3), phase=0.25),)
    body = robot().body
    normals = np.zeros((body.voxel_count, 3), int)
    normals[:, 2] = 1
    pressed = dataclasses.replace(robot(), body=dataclasses.replace(body, pressure_normals=normals), drives=drives)
    assert pressed.has_table
    table = pressed.table(rig=FAST)
    main = table.pressures[np.array(table.sections) == "main"]
    node = 6 + np.outer(np.cos(2 * np.pi * np.arange(17) / 16), [4, 2])
    assert main[:, 1:3] == pytest.approx(node) and not main[:, 3:].any() and not main[:, 0].any()
    assert table.durations["main"] == pytest.approx(1 / 3, abs=2e-5) and table.loops == 1
    assert not table.pressures[[0, -1]].any()  # vented before and after
    assert "bladder1 bladder2" in timing_text(table)
    write_csv(table, tmp_path / "a.csv")
    read = read_channels(tmp_path / "a.csv")
    assert read.robot == "table, with legs" and read.rhythm == table.rhythm
    assert read.seconds == pytest.approx(table.seconds)
    assert [wave.values for wave in read.waves] == [pytest.approx(1e3 * line[:16]) for line in node.T]


def test_the_calibration_is_stated_and_checked():
    legs = dataclasses.replace(robot(), drives=robot().drives[:1])
    calibrated = {None: (0.8, 1.2), "0.5": (1.0, 1.5), "0.7:1.3": (0.7, 1.3)}
    for told, (low, high) in calibrated.items():
        found = legs.table(rig=FAST, full_scale=told, on_violation="clip").waves[0].calibration
        assert (found.low, found.high) == pytest.approx((low, high), abs=0.01)
        assert (found.low_kpa, found.high_kpa) == (0.0, 20.0)
    line = legs.table(rig=FAST, full_scale="0.7:1.3").pressures[:, 1]
    assert line.max() == pytest.approx(20 * (1.2 - 0.7) / 0.6, rel=0.01)
    for wrong in ("0", "-1", "a", "1:0.5", "1:2:3", "nan"):
        with pytest.raises(ValueError, match=r"^full-scale: .* is not allowed; give a positive number"):
            legs.table(full_scale=wrong)
    with pytest.raises(ValueError, match=r"^bladder3: -.* kPa at .* is not allowed; the rig's limit is 0 kPa"):
        legs.table(rig=FAST, full_scale="0.5")


def test_limits_of_a_rig_are_kept_or_refused(tmp_path):
    with pytest.raises(RigViolation, match=r"kPa/s at .* is not allowed; the rig's limit is 15 kPa/s") as refusal:
        robot().table()
    assert len(refusal.value.violations) > 50
    table = robot().table(on_violation="clip")
    assert len(table.clipped) == len(refusal.value.violations)
    steps = np.diff(table.times)
    rates = np.abs(np.diff(table.pressures, axis=0))[steps > 0] / steps[steps > 0, None]
    assert rates[:, 1:9].max() == pytest.approx(15, rel=1e-3)
    write_csv(table, tmp_path / "a.csv")
    assert read_channels(tmp_path / "a.csv").played_frequency == pytest.approx(1 / table.durations["main"])
    report, seconds = robot().rig_report(None)
    assert report.exceeded and seconds == pytest.approx(2 / 3) and report.states == 32
    assert report.playing_s == pytest.approx(2 / 3, abs=1e-4)


def test_the_highest_frequency_that_a_rig_plays_is_told():
    legs = dataclasses.replace(robot(), drives=robot().drives[:1])
    with pytest.raises(RigViolation) as refusal:
        legs.table(full_scale="0.8:1.2")
    told = re.search(
        r"; a frequency of at most (\S+) Hz is allowed, or --on-violation clip keeps the", str(refusal.value)
    )
    highest = float(told[1])
    assert dataclasses.replace(legs, frequency=highest).table(full_scale="0.8:1.2").clipped == ()
    with pytest.raises(RigViolation):
        dataclasses.replace(legs, frequency=1.01 * highest).table(full_scale="0.8:1.2")
    with pytest.raises(RigViolation, match=r"all\); --on-violation clip keeps the limits$"):
        legs.table(full_scale="0.5")  # a pressure below that of the air is allowed at no frequency


@pytest.mark.kernels
@pytest.mark.parametrize(
    ("settings", "nearness"),
    [({}, 1e-6), ({"units": "psi"}, 1e-6), ({"rate": 480.0}, 1e-3), ({"rig": FOUR, "units": "psi"}, 1e-6)],
)
def test_a_table_plays_in_simulation_as_designed(tmp_path, settings, nearness):
    designed = robot()
    table = designed.table(**{"rig": FAST, **settings})
    write_csv(table, tmp_path / "a.csv")
    played = played_robot(designed, read_channels(tmp_path / "a.csv"))
    assert [drive.name for drive in played.drives] == ["legs 1", "legs 2", "legs 3", "plate"]
    assert played.frequency == pytest.approx(3.0, rel=nearness)
    each = [simulate(one, threads=1, record_every=50) for one in (designed, played)]
    first, second = (one.frames[0].positions for one in each)
    count = min(len(first), len(second))
    assert np.abs(first[:count] - second[:count]).max() < 10 * nearness * 0.05


def test_damaged_tables_and_other_robots_are_refused(tmp_path):
    write_csv(robot().table(rig=FAST), tmp_path / "a.csv")
    text = (tmp_path / "a.csv").read_text()
    for old, new, message in (
        ("nodes=16", "nodes=15", "line .*: section"),
        ("# frequency=3.0\n", "", "frequency is missing in the header"),
        ('"low": 0', '"low": 9', "header is damaged"),
        ("channels-1", "channels-9", "schema 'morpholab-channels-9' is unknown"),
        ("loops=1", "loops=2", "checksum does not fit"),
    ):
        (tmp_path / "b.csv").write_text(text.replace(old, new, 1))
        with pytest.raises(ValueError, match=message) as error:
            read_channels(tmp_path / "b.csv")
        assert str(error.value).startswith(str(tmp_path / "b.csv")) and "\n" not in str(error.value)
    other = robot((Drive("arms", (1,), amplitude=0.1),))
    with pytest.raises(ValueError, match=r"^channel: legs 1 of the table is none of the robot's"):
        played_robot(other, read_channels(tmp_path / "a.csv"))


def test_robots_that_no_rig_plays_say_why():
    grip = robot((Drive("grip", (1,), "friction", amplitude=0.1),))
    with pytest.raises(ValueError, match=r"^drives: no line plays grip \(friction\); it takes drives of scale"):
        grip.table()
    array = np.ones((3, 3, 1), int)
    body = body_from_array(array, SOFT, 0.01, regions=np.arange(9).reshape(array.shape))
    many = LatticeRobot(body, (Drive("all", range(9), amplitude=0.1, phase=tuple(np.arange(9) / 9)),))
    with pytest.raises(ValueError, match=r"^drives: 9 channels are not allowed; the rig dissertation has 8 lines"):
        many.table()
    assert not grip.has_table and not many.has_table
    why = "the rig dissertation has 8 lines for them: let regions share a wave, or give a rig of more"
    assert many.no_table_reason == f"9 channels are not allowed; {why}"
    assert robot((Drive("legs", (1,), amplitude=0.1),)).no_table_reason == ""


# --- files of other simulators


def test_a_robot_that_feels_is_no_vxa(tmp_path):
    """Its reflexes would be lost."""
    feeling = robot((Drive("legs", (1, 2, 3, 4), amplitude=0.1),), reflexes=Reflexes(("touch",)))
    with pytest.raises(ValueError, match=r"^reflexes: a robot that feels is not allowed in a .vxa"):
        feeling.save_voxels(tmp_path / "a.vxa")
    assert not list(tmp_path.iterdir())


@pytest.mark.kernels
def test_a_vxa_moves_as_the_robot_does(tmp_path):
    warm = Drive("warm", (1, 2), "temperature", amplitude=(8.0, 14.0), phase=(0.1, 0.7))
    legs = Drive("legs", (3, 4), amplitude=(0.2, 0.15), phase=(0.3, 0.9), mean=1.0)
    ours = robot((warm, legs))
    ours.save_voxels(tmp_path / "a.vxa")
    settings = {"cycles": 1, "settling": 0.05}
    theirs = dataclasses.replace(load_robot(tmp_path / "a.vxa"), **settings)
    assert theirs.frequency == pytest.approx(3.0, rel=1e-15) and theirs.body.voxel_count == ours.body.voxel_count
    found = [simulate(one, threads=1).distance[0] for one in (ours, theirs)]
    assert found[0] == pytest.approx(found[1], abs=1e-7) and abs(found[0]) > 1e-4


def test_a_vxl_json_holds_the_body(tmp_path):
    robot().save_voxels(tmp_path / "a.vxl.json")
    body, ours = load_voxel_file(tmp_path / "a.vxl.json").body, robot().body
    assert np.array_equal(body.voxels, ours.voxels) and body.materials == ours.materials
    assert np.array_equal(body.regions, ours.regions)


@pytest.mark.parametrize(
    ("drive", "why"),
    [
        (Drive("a", (1,), amplitude=0.1, axes="xy"), "it acts along xy only"),
        (Drive("a", (1,), amplitude=0.1, mean=1.1), "it swings about 1.1"),
        (Drive("a", (1,), knots=(0.1, 0.2), amplitude=1.0), "its wave is no sine"),
        (Drive("a", (1,), "friction", amplitude=0.1), "it sets friction"),
    ],
)
def test_what_a_vxa_cannot_hold_is_told(tmp_path, drive, why):
    with pytest.raises(ValueError, match=f"^drives: a is not allowed in a .vxa, as {why}; it takes sines"):
        robot((drive,)).save_voxels(tmp_path / "a.vxa")
    with pytest.raises(ValueError, match=r"^voxels: .*a.vxd is not allowed; give a file that ends in .vxa or"):
        robot().save_voxels(tmp_path / "a.vxd")
    assert not any(tmp_path.iterdir())


# --- meshes


@pytest.fixture
def meshes(tmp_path):
    """A plate on legs that overlap it by 5 mm, and the legs alone, in millimetres."""
    plate = trimesh.creation.box((80, 40, 20))
    plate.apply_translation([0, 0, 30])
    legs = []
    for x, y in ((-30, -10), (-30, 10), (30, -10), (30, 10)):
        leg = trimesh.creation.box((20, 10, 25))
        leg.apply_translation([x, y, 12.5])
        legs.append(leg)
    trimesh.util.concatenate([plate, *legs]).export(tmp_path / "table.stl")
    trimesh.util.concatenate(legs[:2]).export(tmp_path / "back.ply")
    trimesh.util.concatenate(legs[2:]).export(tmp_path / "front.obj")
    trimesh.creation.box((1, 1, 1)).export(tmp_path / "far.stl")
    return tmp_path


def test_region_meshes_mark_muscles_and_materials(meshes):
    regions = [
        MarkedRegion.from_text(f"back={meshes / 'back.ply'}"),
        MarkedRegion.from_text(f"front={meshes / 'front.obj'},amplitude=0.05:0.1,phase=0.25,modulus=3e5,friction=0.5"),
        MarkedRegion.from_text(f"soles={meshes / 'front.obj'},density=900"),
    ]
    found = robot_of_mesh(meshes / "table.stl", 5.0, regions, friction=0.9, cycles=2)
    assert (found.body.voxel_size, found.cycles, found.name) == (0.005, 2, "table")
    assert found.body.voxel_count == 16 * 8 * 4 + 4 * (4 * 2 * 4)
    assert [drive.name for drive in found.drives] == ["back", "front"]
    assert list(found.free) == ["back_amplitude", "back_phase", "front_amplitude"]
    materials = {m.name: m for m in found.body.materials}
    assert (materials["body"].static_friction, materials["body"].kinetic_friction) == (0.9, pytest.approx(0.72))
    assert (materials["front"].youngs_modulus, materials["soles"].density) == (3e5, 900)
    assert np.bincount(found.body.regions).tolist() == [480, 80, 80]


@pytest.mark.parametrize(
    ("side", "settings", "told"),
    [
        (0.04, {}, "is 0.04 mm long"),
        (40.0, {"scale": 1.0}, "is 40 m long"),
        (0.0004, {"scale": 1.0}, "is 0.4 mm long"),
    ],
)
def test_robots_whose_mesh_is_likely_of_another_unit_are_told_of(tmp_path, side, settings, told):
    trimesh.creation.box((side, side / 2, side / 2)).export(tmp_path / "box.stl")
    region = [MarkedRegion("all", tmp_path / "box.stl", phase=0.0)]
    (doubt,) = robot_of_mesh(tmp_path / "box.stl", side / 4, region, **settings).doubts()
    assert doubt.startswith(f"voxel_size: box {told}; lengths are metres (scale 0.001 is of meshes in millimetres)")


@pytest.mark.parametrize(("side", "scale"), [(4.0, 1e-3), (40.0, 1e-3), (9.0, 1.0), (0.04, 1.0)])
def test_robots_of_usual_sizes_are_not_noted(tmp_path, side, scale):
    trimesh.creation.box((side, side / 2, side / 2)).export(tmp_path / "box.stl")
    made = robot_of_mesh(tmp_path / "box.stl", side / 4, [MarkedRegion("all", tmp_path / "box.stl")], scale=scale)
    assert made.length == pytest.approx(side * scale) and made.doubts() == ()


def bounds(path):
    return trimesh.load(path, force="mesh").bounds


def test_exports_lie_where_the_mesh_does(meshes, tmp_path):
    """In its unit; also of a saved robot, and of a tip that is too thin for voxels, above which the robot stands."""
    moved = trimesh.load(meshes / "table.stl").apply_translation([110.0, -45.0, 17.0])
    moved.export(tmp_path / "moved.stl")
    legs = trimesh.load(meshes / "back.ply").apply_translation([110.0, -45.0, 17.0])
    legs.export(tmp_path / "legs.stl")
    made = robot_of_mesh(tmp_path / "moved.stl", 5.0, [MarkedRegion("legs", tmp_path / "legs.stl", phase=0.0)])
    save_robot(made, tmp_path / "saved.json")
    for number, each in enumerate((made, load_robot(tmp_path / "saved.json"))):
        each.save_parts(tmp_path / f"{number}.stl")
        np.testing.assert_allclose(bounds(tmp_path / f"{number}.stl"), moved.bounds, atol=1e-3)
        each.save_parts(tmp_path / f"{number}")
        np.testing.assert_allclose(bounds(tmp_path / f"{number}/channel_legs.stl"), legs.bounds, atol=0.01 * 5)
        each.save_parts(tmp_path / f"mould{number}", "draft=0,wall=4")
        halves = np.array([bounds(tmp_path / f"mould{number}/mould_{half}.stl") for half in ("lower", "upper")])
        around = np.array([halves.min(axis=(0, 1)), halves.max(axis=(0, 1))])
        np.testing.assert_allclose(around.mean(axis=0), moved.bounds.mean(axis=0), atol=1.0)
    cone = trimesh.creation.cone(20.0, 60.0).apply_transform(np.diag([1.0, -1.0, -1.0, 1.0]))
    cone.apply_translation([0.0, 0.0, 300.0]).export(tmp_path / "tip.stl")
    tip = robot_of_mesh(tmp_path / "tip.stl", 10.0, [MarkedRegion("all", tmp_path / "tip.stl", phase=0.0)])
    tip.save_parts(tmp_path / "cut.stl")
    low, high = bounds(tmp_path / "cut.stl")[:, 2]
    assert tip.body.voxels[:, 2].min() == 0 and low == pytest.approx(260.0) and high == pytest.approx(300.0)


def test_a_robot_of_no_mesh_and_one_of_an_earlier_version_lie_at_their_grid(tmp_path):
    plain = robot()
    assert plain.origin == (0.0, 0.0, 0.0) and "origin" not in plain.describe()
    record = dataclasses.replace(plain, origin=(0.1, 0.2, 0.3)).describe()
    assert robot_of_record(json.loads(json.dumps(record))).origin == (0.1, 0.2, 0.3)
    del record["origin"]
    assert robot_of_record(record).origin == (0.0, 0.0, 0.0)
    with pytest.raises(ValueError, match=r"^origin: shape \(2,\) is not allowed; give \(3,\)$"):
        dataclasses.replace(plain, origin=(1.0, 2.0))


@pytest.mark.parametrize(
    ("texts", "message"),
    [
        (["a=far.stl", "a=back.ply"], "region: names a, a do not all differ"),
        (["a=back.ply", "b=back.ply"], "region: later regions mark all voxels of a"),
        (["a=nothing.stl"], "mesh: .*nothing.stl cannot be read"),
        (["a=far.stl"], "region: .*far.stl of a has no voxel's centre inside"),
    ],
)
def test_regions_that_mark_nothing_are_told(meshes, texts, message):
    regions = [MarkedRegion.from_text(text.replace("=", f"={meshes}/", 1)) for text in texts]
    with pytest.raises(ValueError, match=f"^{message}") as error:
        robot_of_mesh(meshes / "table.stl", 10.0, regions)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("legs.stl", "region: 'legs.stl' is not allowed; give NAME=FILE"),
        ("a=b.stl,colour=1", "region: 'colour=1' of a is not allowed; give values of modulus, density"),
        ("a=b.stl,phase=1:2:3", "a_phase: '1:2:3' is not allowed; give a number, or a range LOW:HIGH"),
        ("a=b.stl,phase=1:0", "low: 1 to 0 is not allowed"),
        ("a=b.stl,modulus=1:2", "a_modulus: '1:2' is not allowed; give a number"),
        ("a=b.stl,modulus=-1", "a_modulus: -1.0 is not allowed; give a positive"),
    ],
)
def test_regions_are_read_strictly(text, message):
    with pytest.raises(ValueError, match=f"^{message}"):
        MarkedRegion.from_text(text)
