"""Freeform robots: fields, what can be built of them, and how they move."""

import dataclasses
import itertools
import json
import math
import re

import numpy as np
import pytest
import trimesh
from scipy import ndimage

from robots.freeform.fields import PARAMETRISATIONS
from robots.freeform.grid import Grid
from robots.freeform.palette import Palette, Tissue, palette_of
from robots.freeform.robot import FreeformActuation, FreeformRobot, freeform_of
from robots.freeform.solid import clustered, largest_part, thick
from robots.freeform.trials import chosen, projected
from robots.hardware import PneumaticRig, read_channels, write_csv
from robots.lattice_robot import load_robot
from robots.lattice_robot.on_rig import played_robot
from robots.robot import Trial, find_robot, make_robot
from robots.world import Terrain
from taichi_sim.base.compute import Compute
from taichi_sim.lattice import Material

BONE = Tissue(Material(2e5, 2e3, static_friction=0.3, kinetic_friction=0.2), muscle=False)
TWO = Palette((Tissue(), BONE))
QUICK = FreeformActuation(cycles=1, frequency=12.0, settling=0.02)
LONG = FreeformActuation(cycles=1, frequency=12.0, settling=0.06, channels=3)  # over 2,000 steps
F64 = Compute(precision="f64", threads=1)


def robot(shape=(5, 3, 2), **settings):
    symmetry = settings.pop("symmetry", "")
    return FreeformRobot(Grid(shape, symmetry=symmetry), **{"palette": TWO, "actuation": QUICK, **settings})


def sampled(made, count=1, seed=0, relaxed=False):
    rng = np.random.default_rng(seed)
    low, high = (np.array([getattr(p, end) for p in made.parameters]) for end in ("low", "high"))
    points = low + rng.random((count, len(low))) * (high - low)
    whole = [p.is_integer and not (relaxed and p.kind == "binary") for p in made.parameters]
    return np.where(whole, np.rint(points), points)


def named(made, **values):
    """A point with all values at their start, but for those whose names begin so."""
    point = made.start.copy()
    for n, parameter in enumerate(made.parameters):
        for name, value in values.items():
            if parameter.name.startswith(name):
                point[n] = value
    return point


def test_cells_say_what_their_variables_say():
    made = robot((2, 1, 1), palette=Palette())
    names = [p.name for p in made.parameters]
    assert names == [f"{kind}_{n}_1_1" for kind in ("presence", "amplitude", "phase") for n in (1, 2)]
    fields = made.parametrisation(np.array([[1.0, 0.0, 0.1, 0.2, 0.25, 0.5]]))
    np.testing.assert_array_equal(fields.presence, [[1, 0]])
    np.testing.assert_allclose(fields.swing[0], [[0, 0.5], [-1, 0]], atol=1e-12)


def test_variables_of_a_cell_have_its_place():
    made = robot((4, 3, 2), symmetry="y")
    for parameter in made.parameters:
        kind, *sides = parameter.name.replace("tissue_2", "tissue").split("_")
        assert parameter.place == tuple(int(side) - 1 for side in sides)
        assert parameter.step == {"presence": 0.22, "amplitude": 0.1 * 0.2}.get(kind, 0.1)
    assert all(p.place is None for p in robot(fields="blobs").parameters)


def test_descriptors_are_what_designs_may_differ_in():
    soft, channels = Palette(), FreeformActuation(channels=3)
    full = 30 * 1e-6 * 2e3  # of bones alone [kg]
    assert robot().descriptors == {"mass": (0.0, pytest.approx(full)), "payload": (0.0, pytest.approx(full))}
    assert list(robot(actuation=channels).descriptors) == ["mass", "payload", "channels"]
    assert list(robot(palette=soft).descriptors) == ["mass"]
    assert robot(palette=soft, full=True, actuation=channels).descriptors == {"channels": (0.5, 3.5)}
    assert robot(palette=soft, full=True).descriptors == {}


@pytest.mark.parametrize("fields", PARAMETRISATIONS)
@pytest.mark.parametrize("symmetry", ["y", "xz", "xyz"])
def test_both_halves_are_alike_along_axes_of_symmetry(fields, symmetry):
    made = robot((5, 4, 2), symmetry=symmetry, fields=fields)
    found = made.parametrisation(sampled(made))
    for field in (found.presence, found.tissue, found.swing):
        block = field.reshape(5, 4, 2, -1)
        for axis in ("xyz".index(name) for name in symmetry):
            np.testing.assert_array_equal(block, np.flip(block, axis))


@pytest.mark.parametrize("fields", PARAMETRISATIONS)
def test_fields_keep_within_their_bounds(fields):
    found = robot(fields=fields).parametrisation(sampled(robot(fields=fields), 20))
    assert found.presence.min() >= 0 and found.presence.max() <= 1
    assert np.sqrt((found.swing**2).sum(axis=-1)).max() <= 1 + 1e-12


def test_a_filter_is_a_mean_and_leaves_what_is_even():
    grid = Grid((6, 5, 4), symmetry="y")
    weights = grid.smoothing(2.0)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0)
    line = Grid((5, 1, 1)).smoothing(2.0).toarray()
    np.testing.assert_allclose(line[2], np.array([0, 1, 2, 1, 0]) / 4)


def test_a_ball_is_full_inside_and_empty_outside():
    made = robot((9, 9, 9), fields="blobs", detail=1, palette=Palette())
    point = named(made, void_1_radius=3.0, muscle_1_radius=3.0, muscle_1_amplitude=0.2, void_1_x=0, muscle_1_phase=0.25)
    found = made.parametrisation(point[None])
    assert found.presence[0].reshape(9, 9, 9)[4, 4, 4] < 0.01 and found.presence[0, 0] > 0.99
    np.testing.assert_allclose(found.swing[0].reshape(9, 9, 9, 2)[4, 4, 4], [0, 1], atol=0.01)


def test_sharpness_pushes_presence_to_its_ends_and_keeps_the_half():
    values = np.array([0.0, 0.2, 0.5, 0.8, 1.0])
    np.testing.assert_array_equal(projected(values, 0.0), values)
    for sharpness in (1.0, 8.0, 64.0):
        np.testing.assert_allclose(projected(values, sharpness)[[0, 2, 4]], [0, 0.5, 1], atol=1e-12)
    assert projected(values, 64.0)[1] < 1e-6
    np.testing.assert_allclose(chosen(np.array([0.5, 0.7, 0.1]), 1000.0), [0, 1, 0], atol=1e-12)


@pytest.mark.parametrize("feature", [1, 2, 3])
def test_what_is_built_is_one_piece_and_nowhere_thinner(feature):
    made = robot((8, 6, 4), feature=feature, fields="filtered", detail=2.0)
    built = 0
    for seed in range(6):
        fields = made.parametrisation(sampled(made, seed=seed))
        solid = made.solid_at(fields, 0)
        there = np.zeros(made.grid.count, bool)
        there[solid.cells] = True
        block = there.reshape(made.grid.shape)
        built += there.any()
        assert not (there & (fields.presence[0] <= 0.5)).any()
        assert ndimage.label(block)[1] <= 1
        cubes = np.zeros(block.shape, bool)
        for corner in itertools.product(*(range(side - feature + 1) for side in block.shape)):
            part = tuple(slice(c, c + feature) for c in corner)
            if block[part].all():
                cubes[part] = True
        np.testing.assert_array_equal(cubes, block)
    assert built


def test_islands_are_left_out():
    there = np.zeros((5, 3, 1), bool)
    there[:3, 0] = there[4, 2] = there[3, 1] = True  # (3, 1) touches the bar along an edge only
    assert largest_part(there).sum() == 3
    assert not thick(there, 2).any()


def test_few_channels_are_the_nearest_waves():
    rng = np.random.default_rng(0)
    centres = np.array([[0.9, 0], [-0.5, 0.5], [0, -0.8]])
    waves = np.repeat(centres, 20, axis=0) + rng.normal(0, 0.03, (60, 2))
    channel, count = clustered(waves, 3)
    assert count == 3 and len(set(zip(channel.tolist(), np.repeat(range(3), 20).tolist(), strict=True))) == 3
    assert clustered(waves, None)[1] == 60 and clustered(waves[:2], 3)[1] == 2
    assert clustered(np.zeros((5, 2)), 3)[1] == 1  # equal waves are one channel


@pytest.mark.kernels
def test_muscles_that_are_mirror_images_count_as_one_channel():
    """As in the table for a rig, whose lines they share."""
    made = robot(symmetry="y", shape=(4, 4, 2), full=True, palette=Palette())
    point = np.random.default_rng(2).uniform(0.1, 0.9, len(made.parameters))
    found = made.run(point[None], Trial(Terrain()))
    assert found.measures["channels"][0] == 16 and found.measures["cells"][0] == 32
    assert made.columns(point[None])["Channels"] == ["16"]


@pytest.mark.kernels
@pytest.mark.parametrize("channels", [None, 3])
def test_a_design_moves_as_the_lattice_robot_that_it_is_saved_as(channels, tmp_path):
    drive = FreeformActuation(cycles=1, frequency=12.0, settling=0.02, channels=channels)
    made = robot(actuation=drive, symmetry="y", feature=2, shape=(6, 4, 3), perturbation=1e-5)
    point = named(made, presence=1.0, amplitude=0.15)
    point[[n for n, p in enumerate(made.parameters) if p.name.startswith("phase")]] = np.linspace(0, 0.9, 36)
    point[[n for n, p in enumerate(made.parameters) if p.name == "presence_1_1_1"]] = 0.0
    ours = made.simulate(point, Terrain(), compute=F64)
    made.save(point, tmp_path / "best.json")
    saved = load_robot(tmp_path / "best.json")
    theirs = saved.simulate((), Terrain(), compute=F64)
    assert set(ours.measures) == {*theirs.measures, "cells", "channels"}
    for name, values in theirs.measures.items():
        np.testing.assert_array_equal(ours.measures[name], values, err_msg=name)
    if channels:
        assert [d.name for d in saved.drives] == ["channel_1", "channel_2", "channel_3"]
    assert (saved.body.voxel_count < made.grid.count) and saved.perturbation == 1e-5


@pytest.mark.kernels
def test_a_point_is_judged_alike_in_every_batch():
    made = robot(fields="filtered")
    points = sampled(made, 4, seed=3)
    together = made.simulate(points, Terrain(), compute=F64)
    for row in (0, 3):
        alone = made.simulate(points[row], Terrain(), compute=F64)
        np.testing.assert_array_equal(alone.measures["speed"][0], together.measures["speed"][row])


@pytest.mark.kernels
def test_full_mixtures_move_as_the_whole_block():
    made = robot((4, 2, 2), perturbation=0.0, palette=Palette())
    point = named(made, presence=1.0, amplitude=0.2)
    point[-16:] = np.linspace(0, 0.9, 16)
    true = made.simulate(point, Terrain(), compute=F64)
    mixed = made.simulate(point, Terrain(), compute=F64, sharpness=8.0)
    for name in ("distance", "energy", "mass", "jump"):
        np.testing.assert_allclose(mixed.measures[name], true.measures[name], rtol=1e-6, err_msg=name)


@pytest.mark.kernels
@pytest.mark.parametrize(
    "terrain",
    [
        pytest.param(Terrain(), id="ground"),
        pytest.param(Terrain.water(), id="water", marks=pytest.mark.slow),  # steps there are shorter
    ],
)
@pytest.mark.parametrize(("fields", "sharpness"), [("cells", 3.0), ("filtered", 0.0), ("blobs", 0.0), ("network", 1.0)])
def test_gradients_of_mixtures_agree_with_differences(fields, sharpness, terrain):
    made = robot((4, 2, 2), actuation=LONG, fields=fields, target=(0.1, 0.02), detail=2 if fields == "blobs" else None)
    point = sampled(made, seed=1, relaxed=True)
    names = tuple(measure.name for measure in made.measures)
    check(made, point, names, terrain, sharpness, np.ones(len(made.parameters)))


@pytest.mark.kernels
def test_gradients_of_true_designs_agree_with_differences():
    made = robot((5, 3, 2), actuation=LONG)
    moving = np.array([p.name.startswith(("amplitude", "phase")) for p in made.parameters], float)
    check(made, sampled(made, seed=2), ("speed", "energy"), Terrain(), math.inf, moving)


def check(made, point, names, terrain, sharpness, along):
    """Compare gradients with central differences along a random direction."""
    found = made.run(point, Trial(terrain, F64, gradients=names, sharpness=sharpness))
    assert found.status[0] == "ok" and found.steps[0] >= 2000
    span = np.array([p.high - p.low for p in made.parameters])
    direction = np.random.default_rng(5).standard_normal(len(span)) * span * along
    errors = {name: math.inf for name in names}
    for step in (1e-5, 1e-6, 1e-7, 1e-8):
        pair = np.concatenate([point + step * direction, point - step * direction])
        up_down = made.run(pair, Trial(terrain, F64, sharpness=sharpness)).measures
        for name in names:
            difference = (up_down[name][0] - up_down[name][1]) / (2 * step)
            slope = found.gradients[name][0] @ direction
            errors[name] = min(errors[name], abs(difference - slope) / max(abs(slope), 1e-9))
    assert max(errors.values()) < 1e-4, errors


@pytest.mark.kernels
def test_a_robot_of_nothing_fails_with_a_reason():
    made = robot()
    points = np.stack([named(made, presence=0.0), named(made, tissue_2=1.0), named(made, presence=0.0)])
    points[2, 0] = 1.0
    found = made.simulate(points, Terrain(), compute=F64)
    assert found.status.tolist() == ["invalid"] * 3
    assert found.reason.tolist() == [
        "the body is empty",
        "the body has no muscle",
        "the body has 1 connected cells; it needs 4",
    ]


@pytest.mark.kernels
def test_trials_of_true_designs_count_cells_and_channels():
    made = robot(actuation=FreeformActuation(cycles=1, frequency=12.0, settling=0.02, channels=2))
    points = np.stack([named(made, phase=0.25), named(made, presence=0.0), sampled(made)[0]])
    found = made.simulate(points, Terrain(), compute=F64).measures
    assert found["cells"][0] == 30 and found["channels"][0] == 1 and np.isnan(found["cells"][1])
    assert 4 <= found["cells"][2] < 30 and found["channels"][2] == 2
    alone = made.replay(points[2], Terrain(), compute=F64).outcome
    assert [alone.measures[name][0] for name in ("cells", "channels")] == [found["cells"][2], 2]
    assert "cells" not in made.simulate(points, Terrain(), compute=F64, sharpness=2.0).measures


def test_descriptions_make_the_same_robot_again():
    made = robot(symmetry="y", fields="blobs", detail=5, target=(0.3, 0.0), feature=2)
    again = freeform_of(json.loads(json.dumps(made.describe())))
    assert again.describe() == made.describe() and again.parameters == made.parameters


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda: Grid((3, 0, 1)), "shape: 0 is not allowed"),
        (
            lambda: Grid(4, 2),
            r"shape: 4 is not allowed; give the numbers of cells along x, y and z, such as \(12",
        ),
        (lambda: Grid((3, 2)), r"shape: \(3, 2\) is not allowed; give the numbers of cells along x, y and z"),
        (lambda: Grid(symmetry="q"), "symmetry: 'q' is not allowed; give some of xyz, each once"),
        (lambda: Grid((4, 1, 1), symmetry="y"), "symmetry: 'y' does not fit 1 cell along y; give at least 2 cells"),
        (lambda: Grid(voxel_size=0.0), "voxel_size: 0.0 is not allowed"),
        (lambda: Palette(()), "palette: there are no tissues; give at least one"),
        (lambda: Palette((BONE,)), "palette: no tissue is a muscle; give at least one"),
        (lambda: palette_of([{"colour": 1}]), "palette: colour unknown; a tissue has "),
        (lambda: palette_of([{"density": "soft"}]), "density: 'soft' is not allowed; give a finite number"),
        (lambda: palette_of([{"muscle": 3}]), "muscle: 3 is not allowed"),
        (lambda: Tissue(Material(1e5, 1e3, temperature=3.0)), "temperature: 3.0 of a tissue is not allowed"),
        (lambda: FreeformActuation(channels=0), "channels: 0 is not allowed"),
        (lambda: robot((5, 3, 2), feature=3), "feature: 3 cells are not allowed; the grid is 2 cells thin"),
        (lambda: robot(fields="wood"), "fields: 'wood' is unknown"),
        (lambda: robot(detail=2.0), "detail: 2.0 is not allowed with cells, which have none; leave it out"),
        (lambda: robot(fields="blobs", detail=1.5), "detail: 1.5 is not allowed; give a whole number, at least 1"),
        (
            lambda: robot(fields="filtered", detail=99.0),
            "detail: 99.0 is not allowed; give a positive number, at most ",
        ),
        (lambda: robot(target=(1,)), r"target: \(1,\) is not allowed; give \(x, y\) in metres"),
        (lambda: robot(perturbation=0.5), "perturbation: 0.5 is not allowed"),
        (lambda: robot().simulate(np.zeros((1, 3)), Terrain()), r"points: shape \(1, 3\) is not allowed"),
        (lambda: robot().design(np.zeros(120)), "point: it is no robot: the body is empty"),
    ],
)
def test_bad_input_is_told_in_one_line(make, told):
    with pytest.raises(ValueError, match=told) as caught:
        make()
    assert "\n" not in str(caught.value)


def test_a_designed_body_can_be_printed(tmp_path):
    drive = FreeformActuation(cycles=1, frequency=3.0, settling=0.02, channels=4)
    made = robot((8, 6, 5), actuation=drive, fields="filtered", detail=1.5)
    walker = made.design(sampled(made, seed=4)[0])
    walker.save_parts(tmp_path / "walker.stl")
    printed = trimesh.load(tmp_path / "walker.stl")
    assert printed.is_watertight
    assert printed.volume == pytest.approx(walker.body.voxel_count * 10.0**3, rel=0.01)  # mm^3
    assert walker.body.voxel_count < made.grid.count


@pytest.mark.kernels
def test_the_table_of_a_rig_plays_as_designed(tmp_path):
    drive = FreeformActuation(cycles=1, frequency=3.0, settling=0.05, channels=4)
    made = robot((6, 3, 3), actuation=drive, symmetry="y")
    walker = made.design(np.where(sampled(made, seed=6)[0] == 0, 1.0, sampled(made, seed=6)[0]))
    quick = tuple(dataclasses.replace(channel, slew_kpa_per_s=1e5) for channel in PneumaticRig().channels)
    table = walker.table(rig=dataclasses.replace(PneumaticRig(), name="quick", channels=quick))
    write_csv(table, tmp_path / "walker.csv")
    played = played_robot(walker, read_channels(tmp_path / "walker.csv"))
    speeds = [each.simulate((), Terrain(), compute=F64).measures["speed"][0] for each in (walker, played)]
    assert speeds[1] == pytest.approx(speeds[0], rel=1e-5)


PUSHED = Terrain.parse("rough:0.002+light:0.1,0.02+box:0.01,0.02,0.01,0.06,0")


@pytest.mark.kernels
@pytest.mark.parametrize("target", [None, (0.03, -0.01)])
def test_a_light_and_props_are_measured_as_of_the_lattice_robot_that_it_is_saved_as(target, tmp_path):
    """The distance that remains is that to the light, or to the robot's own target where it has one."""
    made = robot(target=target)
    point = sampled(made, seed=2)
    worlds = (PUSHED, Terrain.parse("flat+light:-0.05,0.1"), Terrain())
    together = made.run_in(np.repeat(point, 2, axis=0), worlds, Trial(worlds[0], F64))
    made.save(point, tmp_path / "best.json")
    saved = load_robot(tmp_path / "best.json")
    for world, ours in zip(worlds, together, strict=True):
        theirs = saved.simulate((), world, compute=F64)
        names = [measure.name for measure in made.measures_in((world,))]
        assert set(ours.measures) == {*names, "cells", "channels"} and set(theirs.measures) == set(names)
        for name in names:
            assert (ours.measures[name] == theirs.measures[name][0]).all(), name
    assert {"remaining", "prop_distance", "prop_height"} <= set(together[0].measures)
    assert "prop_height" not in together[1].measures and ("remaining" in together[2].measures) is bool(target)
    assert [m.name for m in made.measures_in(worlds)] == [m.name for m in made.measures]


@pytest.mark.kernels
def test_gradients_to_a_light_and_of_props_agree_with_differences():
    """Of true designs among props; of mixtures, which meet none, to the light."""
    made = robot((5, 3, 2), actuation=LONG)
    moving = np.array([p.name.startswith(("amplitude", "phase")) for p in made.parameters], float)
    terrain = Terrain.parse("flat+light:0.1,0.02+box:0.01,0.02,0.01,0.062,0")
    check(made, sampled(made, seed=2), ("remaining", "prop_distance"), terrain, math.inf, moving)
    points = sampled(made, 2, seed=1, relaxed=True)
    lit = Terrain.parse("flat+light:0.1,0.02")
    check(made, points[:1], ("remaining",), lit, 3.0, np.ones(len(made.parameters)))
    worlds = (lit, Terrain.parse("flat+light:-0.1,0.05"), Terrain())
    together = made.run_in(points, worlds, Trial(lit, F64, sharpness=3.0))
    for world, found in zip(worlds, together, strict=True):
        alone = made.simulate(points, world, compute=F64, sharpness=3.0)
        assert {*alone.measures} == {*found.measures} == {m.name for m in made.measures_in((world,))}
        assert all(np.array_equal(alone.measures[name], found.measures[name]) for name in alone.measures)


def test_a_tissue_of_a_file_gives_a_name_once(tmp_path):
    path = tmp_path / "palette.json"
    path.write_text('[{"youngs_modulus": 1e5, "density": 1e3, "density": 2e3}]')
    kind, source = find_robot("freeform")
    message = f"palette: {path}: 'density' is given twice, which is not allowed; give it once"
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        make_robot(kind, source, {"palette": str(path)})


def test_parts_of_a_symmetric_grid_are_mirror_images_of_themselves():
    """Of two halves that do not touch none is a body; a smaller part in the middle is one."""
    there = np.zeros((5, 4, 2), bool)
    there[:, 0] = there[:, 3] = True
    assert largest_part(there).sum() == 10 and not largest_part(there, "y").any()
    there[0, 1:3] = True
    assert largest_part(there, "y").all() == there.all() and largest_part(there, "y").sum() == 24
    assert not largest_part(there, "xy").any()
    there[0, 1:3], there[:2, 1:3, 0] = False, False
    there[2, 1:3] = True
    np.testing.assert_array_equal(largest_part(there, "xy"), there)
    apart = robot(symmetry="y", shape=(4, 4, 2), palette=Palette())
    fields = apart.parametrisation(np.full((1, len(apart.parameters)), 0.3))
    presence = np.zeros((4, 4, 2))
    presence[:, 0] = presence[:, 3] = 1.0
    solid = apart.solid_at(dataclasses.replace(fields, presence=presence.reshape(1, -1)), 0)
    assert solid.fault == "its mirrored parts do not touch"


@pytest.mark.kernels
def test_balanced_links_are_those_of_every_body_of_a_search():
    """True designs, saved robots and mixtures; runs without them say nothing of links."""
    plain, made = robot((4, 2, 2)), robot((4, 2, 2), links="balanced")
    assert "links" not in plain.describe() and freeform_of(made.describe()).links == "balanced"
    assert plain.cycle.time_step > 1.3 * made.cycle.time_step == pytest.approx(1.3 * made.cycle_on(Terrain()).time_step)
    point = sampled(made, seed=3, relaxed=True)
    true = made.simulate(point, Terrain(), compute=F64)
    assert true.measures["speed"] != plain.simulate(point, Terrain(), compute=F64).measures["speed"]
    assert made.design(point).simulate((), Terrain(), compute=F64).measures["speed"] == true.measures["speed"]
    check(made, point, ("speed", "energy"), Terrain(), 3.0, np.ones(len(made.parameters)))
