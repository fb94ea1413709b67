"""The inflatable robot: its body, its program, its designs on file, and small evaluations."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from program_values import values_after

from robots.inflatable import (
    ACTUATION,
    INCHING,
    PUBLISHED,
    ROLLING,
    SMALL,
    InflatableActuation,
    InflatableDesign,
    InflatableGeometry,
    load_design,
    predicted_steps,
    save_design,
    simulate,
)
from robots.inflatable.body import FIRST_BLADDER, FOOT_1, FOOT_2, FOOT_SEAM, SEAM, SKIN
from robots.inflatable.program import build_program
from robots.inflatable.schedule import GaitSchedule
from robots.inflatable.timing import nominal_steps, play, stroke
from robots.world import Terrain, gravity_vector
from taichi_sim.lattice import Quantity
from taichi_sim.lattice.faces import corners, half_extents, mean_of_face_corners
from taichi_sim.lattice.topology import SIDES

QUICK = InflatableActuation(inflation_rate=0.01, pressure_ramp=50.0, hold_steps=100, settle_steps=60)
TINY = InflatableGeometry(bladder_columns=1, rows=10, foot_rows=2, voxel_size=0.02)
NOTHING = GaitSchedule(np.zeros((10, 8)))


def test_the_published_body():
    body = PUBLISHED.body
    assert (body.voxel_count, len(body.topology.links)) == (1428, 3290)
    counts = np.bincount(body.regions)
    assert counts[[SKIN, SEAM, FOOT_1, FOOT_2, FOOT_SEAM]].tolist() == [2 * 12 * 16, 2 * 3 * 16, 72, 72, 36]
    assert (counts[FIRST_BLADDER:] == 3 * 16 * 2).all()
    assert PUBLISHED.time_step == pytest.approx(1.0602478e-4, rel=1e-7)
    assert PUBLISHED.body_length == pytest.approx(0.22)
    first = body.voxels[body.regions == FIRST_BLADDER]
    last = body.voxels[body.regions == FIRST_BLADDER + 7]
    assert set(first[:, 0]) == set(last[:, 0]) == {1, 2, 3}  # bladder 8 lies under bladder 1
    assert set(first[:, 2]) == {4, 5} and set(last[:, 2]) == {0, 1}


def test_the_skins_are_joined_along_the_edges_only():
    body = PUBLISHED.body
    ends = body.voxels[body.topology.links]
    across = (ends[:, 0, 2] == 2) & (ends[:, 1, 2] == 3)
    assert set(ends[across, 0, 0]) == {1, 15} and across.sum() == 2 * 22


@pytest.mark.parametrize(("geometry", "faces", "outside"), [(SMALL, 1196, 908), (PUBLISHED, 1988, 1416)])
def test_faces_that_count_for_a_place_are_sides_without_a_link_as_gait_files_say(geometry, faces, outside):
    """Inner faces of the cut core count, so a program that takes the outside alone tells other distances."""
    body = geometry.body
    taken = {tuple(voxel) for voxel in body.voxels.tolist()}
    beside = body.voxels[body.topology.faces[:, 0]] + SIDES[body.topology.faces[:, 1]]
    assert len(beside) == 6 * body.voxel_count - 2 * len(body.topology.links) == faces
    assert sum(tuple(place) not in taken for place in beside.astype(int).tolist()) == outside
    pages = (Path(__file__).parents[3] / "docs" / "gait-files.md").read_text()
    assert "sides of its voxels that have no link" in pages and str(faces) in pages and str(outside) in pages


def test_steps_of_the_published_gaits():
    """186,719 steps for gaits that move in every column, 64,032 for none; 26,001 steps of initialisation at 12 kPa."""
    assert play(INCHING.schedule)[1] == play(ROLLING.schedule)[1] == nominal_steps(16) == 186_719
    assert play(NOTHING)[1] == 64_032
    assert ACTUATION.initial_steps(12e3) == 26_001 and ACTUATION.initial_steps(0.0) == 2001
    assert predicted_steps(ROLLING) == 186_719 + 26_001
    assert 186_719 * PUBLISHED.time_step == pytest.approx(19.7968, abs=1e-4)


def test_strokes_are_counted_by_addition():
    """From 0.2 in steps of 3e-4 to at least 2.5: 7667 changes; back it takes 7667 or 7668."""
    steps, level = stroke(ACTUATION, 0.2, True)
    assert steps == 7667 and level == pytest.approx(2.5001)
    assert stroke(ACTUATION, level, False)[0] in (7667, 7668)
    assert stroke(ACTUATION, level, True) == (0, level)


def test_program_of_a_column():
    """Bladder growth, friction, damping and weight at telling steps of the inching gait on a hill."""
    terrain = Terrain(slope=15.0)
    program = build_program([dataclasses.replace(INCHING, pressure=6000.0)], terrain)
    begin = ACTUATION.initial_steps(6000.0)
    done, settle = begin + 7667, begin + 7668
    value = lambda region, quantity, step: float(values_after(program, 0, region, quantity, np.array([step + 1]))[0])  # noqa: E731
    z = [
        value(FIRST_BLADDER, Quantity.SCALE + 2, s)
        for s in (0, begin - 1, begin, begin + 100, done - 1, done, settle + 4000)
    ]
    assert z == pytest.approx([0.2, 0.2, 0.2003, 0.2 + 101 * 3e-4, 2.5001, 2.5001, 2.5001])
    c = 1.7 + 8.3 * 0.5
    assert value(FIRST_BLADDER, Quantity.SCALE + 1, done) == pytest.approx(1 + 2.3001 / c)
    assert value(FIRST_BLADDER, Quantity.SCALE, done) == pytest.approx(1 + 2.3001 / 20)
    assert [value(FOOT_1, Quantity.KINETIC_FRICTION, s) for s in (0, begin, settle)] == [2.0, 1e-4, 2.0]
    assert [value(FOOT_2, Quantity.STATIC_FRICTION, s) for s in (0, begin, settle)] == [2.0, 2.0, 2.0]
    assert [value(FOOT_SEAM, Quantity.STATIC_FRICTION, s) for s in (0, begin, settle)] == [1e-4, 1e-4, 2.0]
    assert value(FIRST_BLADDER, Quantity.STATIC_FRICTION, 0) == pytest.approx(2 / 3)
    assert [value(SKIN, Quantity.GLOBAL_DAMPING, s) for s in (0, begin, settle)] == [0.0, 0.002, 0.01]
    pull = gravity_vector(15.0, 90.0)[2]
    weights = [value(FIRST_BLADDER, Quantity.ACCELERATION + 2, s) for s in (0, begin, done, settle + 4001 + 7668 + 1)]
    assert weights == pytest.approx([pull, 0.0, 0.0, pull])  # the published quirk; deflated again at the end
    assert [value(SKIN, Quantity.ACCELERATION + 2, s) for s in (0, begin)] == pytest.approx([-9.80665, pull])
    ramp = [value(SKIN, Quantity.PRESSURE, s) for s in (0, 1, 12_000, 12_001, begin)]
    assert ramp == [0.0, 0.5, 6000.0, 6000.0, 6000.0]


def test_physical_weight_is_an_option():
    program = build_program([INCHING], Terrain(), InflatableActuation(weight="physical"))
    bladder = program.events[
        (program.events["region"] >= FIRST_BLADDER) & (program.events["quantity"] == Quantity.ACCELERATION + 2)
    ]
    assert (bladder["value"] == pytest.approx(-9.80665)) and (bladder["step"] == 0).all()


def test_gravity_points_downhill():
    """Positive travel is uphill."""
    gravity = gravity_vector(15.0, 90.0)
    assert gravity == pytest.approx([0, -9.80665 * np.sin(np.deg2rad(15)), -9.80665 * np.cos(np.deg2rad(15))])


def test_terrain_friction_replaces_the_robots():
    """In the friction sweeps of the chapter low and high replace 1e-4 and 2.0, and high / 3 the bladders' 2/3."""
    actuation = ACTUATION.on(Terrain(high_friction=1.8, low_friction=0.2))
    assert (actuation.high_friction, actuation.low_friction) == (1.8, 0.2)
    program = build_program([INCHING], Terrain(high_friction=1.8, low_friction=0.2))
    friction = program.events[program.events["quantity"] == Quantity.KINETIC_FRICTION]
    assert np.unique(friction["value"]).tolist() == pytest.approx([0.2, 0.6, 1.8])


def test_mean_of_face_corners_is_the_mean_over_the_corners():
    """Against the definition: four corners of every exposed face, repeated ones counted as often as they occur."""
    from taichi_sim.lattice.faces import FACE_CORNERS

    body, generator = TINY.body, np.random.default_rng(0)
    n = body.voxel_count
    quaternions = generator.normal(size=(2, n, 4))
    quaternions /= np.linalg.norm(quaternions, axis=-1, keepdims=True)
    strains = generator.normal(0, 0.2, (2, len(body.topology.links)))
    extents = half_extents(body, strains, generator.uniform(0.01, 0.03, (2, n, 3)))
    positions = generator.normal(size=(2, n, 3))
    all_corners = corners(positions, quaternions, extents)
    faces = [all_corners[:, v, FACE_CORNERS[side]] for v, side in body.topology.faces]
    expected = np.stack(faces, axis=1).mean(axis=(1, 2))
    assert mean_of_face_corners(body, positions, quaternions, extents) == pytest.approx(expected)


@pytest.mark.kernels
def test_a_quick_evaluation_and_its_frames():
    """Distances follow from the recorded frames; speeds from their conventions; order of designs does not matter."""
    schedule = GaitSchedule(INCHING.schedule.bits[:, :2], repeats=1)
    designs = [dataclasses.replace(INCHING, schedule=schedule), dataclasses.replace(ROLLING, schedule=schedule)]
    options = {"geometry": TINY, "actuation": QUICK, "threads": 1}
    result = simulate(designs, Terrain(), record_every=50, **options)
    assert result.status.tolist() == ["ok", "ok"]
    frames = result.frames
    assert frames.positions.shape[1:] == (2, TINY.body.voxel_count, 3) and frames.times[1] == pytest.approx(
        50 * TINY.time_step
    )
    assert np.isfinite(frames.positions[: result.steps.min() // 50 + 1]).all()
    assert result.speed_simulated == pytest.approx(result.distance / TINY.body_length / (result.steps * TINY.time_step))
    nominal = nominal_steps(2, QUICK) * TINY.time_step
    assert result.speed == pytest.approx(result.distance / TINY.body_length / nominal)
    backwards = simulate(designs[::-1], Terrain(), **options)
    assert np.array_equal(result.distance, backwards.distance[::-1])
    assert backwards.frames is None
    first = frames.positions[0, 0]
    assert np.ptp(first[:, 1]) == pytest.approx(9 * 0.02, rel=0.1)


@pytest.mark.kernels
def test_perturbation_is_seeded_per_robot():
    schedule = GaitSchedule(np.eye(10, 1), repeats=1)
    design = dataclasses.replace(INCHING, schedule=schedule)
    options = {"geometry": TINY, "actuation": QUICK, "perturbation": 1e-5, "threads": 1}
    three = simulate([design] * 3, **options).distance
    assert len(set(three.tolist())) == 3
    assert np.array_equal(simulate([design] * 2, **options).distance, three[:2])
    assert not np.array_equal(simulate([design] * 3, seed=1, **options).distance, three)


@pytest.mark.kernels
def test_robots_of_a_batch_on_terrains_of_their_own_do_as_in_batches_of_their_own():
    design = InflatableDesign(600.0, 20.0, GaitSchedule(np.eye(10, 2), repeats=1))
    terrains = [Terrain(10.0), Terrain(), Terrain(high_friction=1.0, low_friction=0.5)]
    where = {"geometry": TINY, "actuation": QUICK, "threads": 1}
    together = simulate([design] * 3, terrains, **where)
    alone = [simulate(design, terrain, **where).distance[0] for terrain in terrains]
    assert together.distance.tolist() == alone and len(set(alone)) == 3
    with pytest.raises(ValueError, match="terrain: 2 are not allowed for 3 designs; give one, or one each"):
        simulate([design] * 3, terrains[:2], **where)
    with pytest.raises(ValueError, match="terrain: ground and a fluid are not allowed in one batch"):
        simulate([design] * 2, [Terrain(), Terrain.water()], **where)


def test_designs_survive_the_disk(tmp_path):
    path = tmp_path / "design.json"
    save_design(INCHING, path)
    assert load_design(path) == INCHING


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "Expecting property name"),
        ("[]", "it is not of the format"),
        (json.dumps({"format": "morpholab-inflatable-design-1"}), "'schedule' is missing"),
    ],
)
def test_broken_design_files_are_named(tmp_path, content, message):
    path = tmp_path / "broken.json"
    path.write_text(content)
    with pytest.raises(ValueError, match="broken.json: .*" + message):
        load_design(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"pressure": -1.0}, r"pressure: -1.0 is not allowed; give a number from 0 to 15000 Pa"),
        ({"pressure": 15_001.0}, "pressure: 15001.0 is not allowed"),
        ({"pressure": float("nan")}, "pressure: nan is not allowed"),
        ({"orientation": 91.0}, "orientation: 91.0 is not allowed; give a number from 0 to 90 degrees"),
        ({"schedule": np.zeros((10, 8))}, "schedule: ndarray is not allowed; give a GaitSchedule"),
    ],
)
def test_bad_designs_are_refused_in_one_line(change, message):
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(INCHING, **change)


@pytest.mark.kernels
@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: InflatableGeometry(rows=6), "rows: 6 is not allowed"),
        (lambda: InflatableGeometry(voxel_size=-0.01), "voxel_size: -0.01 is not allowed"),
        (
            lambda: InflatableGeometry(bladder_layers=1.5),
            "bladder_layers: 1.5 is not allowed; give a whole number, at least 1",
        ),
        (lambda: InflatableActuation(weight="none"), "weight: 'none' is unknown"),
        (lambda: InflatableActuation(inflated=0.1), "inflated: 0.1 is not allowed"),
        (lambda: InflatableActuation(inflation_rate=0.0), "inflation_rate: 0.0 is not allowed"),
        (lambda: simulate([]), "designs: give at least one"),
        (lambda: simulate(INCHING, perturbation=-1e-3), "perturbation: -0.001 is not allowed"),
        (lambda: simulate(INCHING, record_every=0), "record_every: 0 is not allowed"),
        (lambda: InflatableDesign(13_281.0, 0.0, NOTHING) and simulate(INCHING, precision="f16"), "precision: 'f16'"),
    ],
)
def test_bad_options_are_refused_in_one_line(build, message):
    with pytest.raises(ValueError, match=message):
        build()
