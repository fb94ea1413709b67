import math
from dataclasses import replace

import numpy as np
import pytest

from robots.kind import KINDS
from robots.lattice_robot.walker import (
    ACTIVE,
    ANTIPHASE,
    PASSIVE,
    WalkerActuation,
    WalkerDesign,
    WalkerTissue,
    load_walker,
    save_walker,
    simulate,
)
from robots.lattice_robot.walker_encoding import DirectBody
from robots.lattice_robot.walker_robot import WalkerRobot
from robots.robot import Trial
from robots.world import Terrain
from taichi_sim.base.compute import Compute
from taichi_sim.lattice import LatticeEngine
from taichi_sim.lattice.faces import corners

QUICK = WalkerActuation(settling=0.05, cycles=1)
# A bar of active voxels on one foot, found by a search: it leans forward and hops.
HOPPER = np.zeros((4, 1, 2), int)
HOPPER[:, 0, 1] = HOPPER[0, 0, 0] = ACTIVE


def random_designs(count, shape=(3, 3, 2), seed=0):
    return [WalkerDesign(m) for m in np.random.default_rng(seed).integers(0, 4, (count, *shape))]


def walk(*materials, **settings):
    return simulate([WalkerDesign(np.asarray(m)) for m in materials], **{"threads": 1, "actuation": QUICK, **settings})


@pytest.mark.kernels
def test_a_body_that_does_not_change_stays():
    still = WalkerActuation(amplitude=0.0, cycles=2)
    table = np.full((4, 4, 3), ACTIVE)
    table[1:3, :, 0] = table[:, 1:3, 0] = 0
    result = walk(table, np.full((2, 2, 2), ACTIVE), HOPPER, actuation=still)
    assert (result.status == "ok").all() and np.abs(result.distance).max() < 2e-6
    assert np.array_equal(result.speed, result.distance / (np.array([4, 2, 4]) * 0.02) * 4 / 2)


@pytest.mark.kernels
def test_a_lopsided_body_hops_ten_centimetres_in_one_and_a_half_seconds():
    result = walk(HOPPER, actuation=WalkerActuation())
    assert result.distance[0] > 0.08 and result.speed[0] == result.distance[0] / 0.08 / 1.5
    back = walk(HOPPER[::-1], actuation=WalkerActuation())
    assert back.distance[0] < -0.04


@pytest.mark.kernels
def test_results_depend_neither_on_the_batch_nor_on_order_or_place():
    designs = random_designs(4)
    same_voxels = [WalkerDesign(np.where(designs[0].materials == 0, 0, kind)) for kind in (ACTIVE, ANTIPHASE)]
    moved = WalkerDesign(np.pad(designs[1].materials, ((0, 0), (2, 1), (3, 0))))
    designs += [*same_voxels, moved, designs[2]]
    together = simulate(designs, actuation=QUICK, threads=2)
    assert (together.status == "ok").all() and len(np.unique(together.distance)) == 6
    backwards = simulate(designs[::-1], actuation=QUICK, threads=1)
    assert np.array_equal(together.distance, backwards.distance[::-1])
    alone = [simulate(design, actuation=QUICK, threads=1).distance[0] for design in designs]
    assert np.array_equal(together.distance, alone)
    assert together.distance[1] == together.distance[6]


@pytest.mark.kernels
def test_bodies_walk_in_several_worlds_as_in_each_alone(monkeypatch):
    """Each body once in all worlds of a kind; a fault stays one everywhere."""
    designs = [*random_designs(3), WalkerDesign(np.zeros((3, 3, 2), int))]
    points = np.stack([design.materials.ravel() for design in designs]).astype(float)
    robot = WalkerRobot((3, 3, 2), actuation=QUICK)
    worlds = [Terrain(), Terrain(10.0), Terrain(-5.0, static_friction=0.9, kinetic_friction=0.4), Terrain.water()]
    trial = Trial(worlds[0], Compute(threads=1))
    alone = [robot.run(points, replace(trial, world=world)) for world in worlds]
    batches, construct = [], LatticeEngine.__init__
    monkeypatch.setattr(LatticeEngine, "__init__", lambda *a, **k: batches.append(1) or construct(*a, **k))
    together = robot.run_in(points, worlds, trial)
    assert len(batches) == 2 * len({design.connected[0].tobytes() for design in designs[:3]})  # on land, and in water
    for one, other in zip(together, alone, strict=True):
        for name in one.measures:
            np.testing.assert_array_equal(one.measures[name], other.measures[name], err_msg=name)
        assert one.status.tolist() == other.status.tolist() and one.reason.tolist() == other.reason.tolist()
    assert [bool(reason) for reason in together[1].reason] == [False, False, False, True]
    assert together[0].measures["distance"][0] != together[1].measures["distance"][0]


@pytest.mark.kernels
def test_without_friction_the_centre_of_mass_moves_as_gravity_says():
    slippery = {"high_friction": 0.0}
    level = simulate(random_designs(3), Terrain(**slippery), actuation=QUICK, threads=1)
    assert np.abs(level.distance).max() < 1e-9
    steep = simulate(random_designs(3), Terrain(20.0, **slippery), actuation=QUICK, threads=1)
    dt = steep.time_step
    begin, end = 0.25 + round(0.05 / dt) * dt, 0.5 + round(0.05 / dt) * dt
    assert steep.distance == pytest.approx(-0.5 * 9.80665 * math.sin(math.radians(20)) * (end**2 - begin**2), rel=2e-3)


@pytest.mark.kernels
def test_volumes_change_as_designed_on_the_floor():
    blocks = np.full((4, 2, 2), PASSIVE)
    blocks[:2], blocks[2] = ACTIVE, ANTIPHASE
    result = walk(blocks, record_every=23, actuation=WalkerActuation(cycles=1))
    frames = result.frames[0]
    assert frames.positions.shape == (2 * 736 // 23 + 1, 1, 16, 3) and frames.times[-1] == pytest.approx(0.5)
    extents = frames.extents[:, 0]
    volumes = np.prod(extents[..., ::2] + extents[..., 1::2], axis=-1) / 0.02**3
    sine = 0.14 * np.sin(2 * np.pi * 4 * frames.times)
    active, antiphase, passive = volumes[:, :8].mean(1), volumes[:, 8:12].mean(1), volumes[:, 12:].mean(1)
    assert active == pytest.approx((1 + sine) ** 3, abs=0.15) and antiphase == pytest.approx((1 - sine) ** 3, abs=0.15)
    assert passive == pytest.approx(1.0, abs=0.15) and active.max() > 1.4 > 0.7 > active.min()
    heights = corners(frames.positions[:, 0], frames.orientations[:, 0], extents)[..., 2].min(axis=(1, 2)) + 0.01
    assert heights.min() > -0.004 and heights.max() < 0.002


@pytest.mark.kernels
def test_the_body_is_the_largest_part_whose_voxels_share_faces():
    materials = np.zeros((5, 3, 3), int)
    materials[0, :, 2], materials[1, 0, 1] = ACTIVE, ACTIVE  # three, and one across an edge
    materials[3, :2, :2] = ANTIPHASE
    places, kinds = WalkerDesign(materials).connected
    assert places.tolist() == [[0, 0, 0], [0, 0, 1], [0, 1, 0], [0, 1, 1]] and set(kinds) == {ANTIPHASE}
    assert walk(materials).distance[0] == walk(np.where(materials == ANTIPHASE, materials, 0)).distance[0]


@pytest.mark.kernels
def test_failures_are_data():
    lonely = np.zeros((3, 3, 3), int)
    lonely[0, 0, 0] = lonely[2, 2, 2] = ACTIVE
    result = walk(np.zeros((2, 2, 2)), lonely, np.full((2, 2, 2), PASSIVE), HOPPER, record_every=500)
    assert result.status.tolist() == ["invalid"] * 3 + ["ok"]
    assert result.reason.tolist() == [
        "the body is empty",
        "the body has 1 connected voxels; it needs 4",
        "the body has no active voxel",
        "",
    ]
    assert np.isnan(result.distance[:3]).all() and np.isnan(result.speed[:3]).all() and (result.steps[:3] == 0).all()
    assert result.bodies[0] is None and result.frames[2] is None and result.frames[3] is not None
    burst = walk(HOPPER, tissue=WalkerTissue(time_step_safety=0.2))
    assert burst.status[0] == "diverged" and np.isnan(burst.distance[0]) and burst.steps[0] > 0


@pytest.mark.kernels
def test_single_precision_walks_as_far():
    f32, f64 = (walk(HOPPER, precision=precision).distance[0] for precision in ("f32", "f64"))
    assert f32 == pytest.approx(f64, rel=0.01) and f32 != f64


def test_designs_survive_files(tmp_path):
    for number, design in enumerate(random_designs(3, (4, 3, 2))):
        path = tmp_path / f"{number}.json"
        save_walker(design, path)
        assert np.array_equal(load_walker(path).materials, design.materials)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "it is no JSON of the format"),
        ("{}", "it is not of the format"),
        ('{"format": "morpholab-walker-design-1"}', "'layers' is missing"),
        ('{"format": "morpholab-walker-design-1", "layers": [["00", "0"]]}', "layers: they differ in size"),
        ('{"format": "morpholab-walker-design-1", "layers": []}', "layers: they differ in size"),
        ('{"format": "morpholab-walker-design-1", "layers": [["07"]]}', r"materials: 7 of voxel \(1, 0, 0\)"),
        ('{"format": "morpholab-walker-design-1", "layers": 3}', "'int' object is not iterable"),
    ],
)
def test_damaged_files_are_refused_in_one_line(tmp_path, text, message):
    path = tmp_path / "walker.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=f"walker.json: {message}") as error:
        load_walker(path)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: WalkerDesign(np.zeros((2, 2))), r"materials: shape \(2, 2\) is not allowed; give \(X, Y, Z\)"),
        (
            lambda: WalkerDesign(np.full((1, 1, 1), 1.5)),
            r"materials: 1.5 of voxel \(0, 0, 0\) is not allowed; give 0 e",
        ),
        (lambda: simulate([]), "designs: give at least one WalkerDesign"),
        (lambda: simulate([HOPPER]), "designs: give at least one WalkerDesign"),
        (lambda: walk(HOPPER, terrain=Terrain(low_friction=0.1)), "low_friction: 0.1 is not allowed; a walker has no"),
        (lambda: walk(HOPPER, record_every=0), "record_every: 0 is not allowed"),
        (lambda: WalkerActuation(amplitude=0.6), "amplitude: 0.6 is not allowed; give a number from 0 to 0.5"),
        (lambda: WalkerActuation(cycles=0), "cycles: 0 is not allowed"),
        (lambda: walk(HOPPER, tissue=WalkerTissue(voxel_size=0.0)), "voxel_size: 0.0 is not allowed; it must be posi"),
    ],
)
def test_what_makes_no_sense_is_refused_in_one_line(make, message):
    with pytest.raises(ValueError, match=f"^{message}") as error:
        make()
    assert "\n" not in str(error.value)


@pytest.mark.kernels
def test_a_walker_that_nothing_has_designed_is_a_block_that_moves():
    """So commands that take any robot have one to show; searches begin where their own variables say."""
    offered = WalkerRobot((4, 2, 2), actuation=WalkerActuation(cycles=1))
    assert offered.design(offered.start).body.fault == ""
    outcome = offered.simulate(offered.start[None], offered.worlds[0])
    assert outcome.status[0] == "ok" and outcome.measures["voxels"][0] == 16
    assert [parameter.first for parameter in offered.parameters] == [1.0] * 16


def test_whole_numbers_that_are_given_as_fractions_are_rounded():
    body = DirectBody((2, 1, 1))
    np.testing.assert_array_equal(body.design(np.array([1.9, 2.2])).materials.reshape(-1), [2, 2])


@pytest.mark.kernels
def test_bodies_are_searched_and_kept_with_the_links_that_are_chosen():
    """So are their parts that leave the lab, and what a command needs to repeat a saved body."""
    usual, made = (WalkerRobot((3, 3, 2), actuation=QUICK, links=law) for law in ("alike", "balanced"))
    point = np.array([[2.0 + place % 2 for place in range(18)]])
    assert made.run(point, Trial(Terrain())).measures["speed"] != usual.run(point, Trial(Terrain())).measures["speed"]
    assert made.steps > usual.steps and "links" not in {**usual.describe(), **usual.command_options()}
    assert KINDS["walker"].from_description(made.describe()).links == made.command_options()["links"] == "balanced"
    assert usual.changed({"links": "balanced"}).links == "balanced"
    kept = made.design(point[0])
    assert kept.run(np.zeros((1, 0)), Trial(Terrain())).measures == made.run(point, Trial(Terrain())).measures
    with pytest.raises(ValueError, match=r"^links: 'tight' is unknown; choose one of alike, balanced, published"):
        replace(made, links="tight")
