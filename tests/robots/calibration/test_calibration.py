"""Simulated experiments of a calibration, and the robot of its properties."""

import dataclasses

import numpy as np
import pytest
from laboratory import BENCH, QUICK, STEP, TINY, TRUE

from robots.calibration import (
    Diameter,
    Drag,
    Gait,
    Laboratory,
    Properties,
    Replica,
    save_properties,
    weight_of_calibration,
)
from robots.calibration.experiments import LENGTH, WIDTH
from robots.inflatable import ACTUATION, PUBLISHED, SMALL, InflatableActuation, simulate
from robots.inflatable.design import InflatableDesign
from robots.inflatable.program import write_gait
from robots.inflatable.schedule import GaitSchedule
from robots.kind import KINDS
from robots.world import Terrain
from taichi_sim.lattice import LatticeBody, LatticeEngine, Material, ProgramBuilder, Quantity


def test_the_robot_of_its_own_properties_is_itself():
    geometry, actuation = Properties.of().robot()
    assert geometry == PUBLISHED
    assert actuation.inflation_rate == pytest.approx(ACTUATION.inflation_rate, rel=1e-12)
    assert dataclasses.replace(actuation, inflation_rate=ACTUATION.inflation_rate) == ACTUATION


def test_a_stiffer_robot_keeps_its_seconds():
    stiff = dataclasses.replace(Properties.of(SMALL), modulus=1.6e6)
    geometry, actuation = stiff.robot(SMALL)
    assert geometry.time_step == pytest.approx(SMALL.time_step / 2)
    assert geometry.bladder_modulus / geometry.youngs_modulus == pytest.approx(1 / 1.8)
    assert (actuation.hold_steps, actuation.settle_steps) == (2 * ACTUATION.hold_steps, 2 * ACTUATION.settle_steps)
    assert actuation.inflation_rate == pytest.approx(ACTUATION.inflation_rate / 2)
    assert actuation.pressure_ramp == pytest.approx(ACTUATION.pressure_ramp / 2)


def test_a_gait_with_times_of_its_own_keeps_its_seconds_at_other_time_steps(monkeypatch):
    schedule = dataclasses.replace(STEP.schedule, motion_steps=[6000, 900], settle_steps=[1000, 0])
    gait = Gait(np.array([np.inf]), np.ones(1), dataclasses.replace(STEP, schedule=schedule), "own")
    trial, lengths = Replica(Properties.of(SMALL)), {}

    def written(*arguments):
        raise StopIteration(write_gait(*arguments)[2])

    monkeypatch.setattr("robots.calibration.experiments.write_gait", written)
    for stiffest in (400e3, 800e3):
        laboratory = Laboratory(SMALL, stiffest=stiffest)
        monkeypatch.setattr(Laboratory, "engine", lambda *_: (None, None))
        with pytest.raises(StopIteration) as played:
            gait.predict([trial], laboratory)
        lengths[laboratory.time_step] = played.value.value * laboratory.time_step
    (longer, shorter), (one, other) = lengths, lengths.values()
    assert shorter < 0.8 * longer and other == pytest.approx(one, abs=3 * longer)


# experiments


@pytest.mark.parametrize("load", [0.01, 0.5, 1.0, 20.0])
def test_a_dragged_foot_slides_at_its_friction_under_every_load(load):
    trials = [Replica(dataclasses.replace(TRUE, friction=mu)) for mu in (0.3, 4.0)]
    far = Drag(np.linspace(0.1, 1.0, 6), np.ones(6), load)  # where all of it slides
    assert far.predict(trials, BENCH) == pytest.approx(np.array([[0.3], [4.0]]) * load * np.ones(6), rel=1e-12)
    sliding = dataclasses.replace(far, grips=False).predict(trials, BENCH)
    assert sliding == pytest.approx(np.full((2, 6), 0.15 * load), rel=1e-12)


def test_a_stretching_foot_holds_less_than_its_friction():
    early = Drag(np.array([0.0, 1e-6, 2e-5, 5e-3]), np.ones(4), 0.8).predict([Replica(TRUE)], BENCH)[0]
    assert early[0] == 0 and early[1] == pytest.approx(
        WIDTH * TRUE.modulus * TINY.voxel_size * 1e-6
    )  # one link stretches
    assert early[1] < early[2] < 0.5 * early[3]


@pytest.mark.kernels
@pytest.mark.parametrize("friction", [0.1, 0.5])
def test_a_foot_that_is_dragged_slowly_does_what_the_engine_makes_of_it(friction):
    """Where the engine resolves it: friction takes little of the speed of the drag in a step."""
    load, top, steps, settling = 0.5, 20e-3, 10_000, 500
    skin = Material(
        TRUE.modulus, TINY.density, static_friction=friction, kinetic_friction=friction, internal_damping=1.0
    )
    voxels = np.array([(x, y, 0) for x in range(LENGTH + 1) for y in range(WIDTH)])
    fixed = np.zeros((len(voxels), 6))
    fixed[voxels[:, 0] == LENGTH, 0] = 1  # along x alone, so that the floor carries the held end, too
    body = LatticeBody(voxels, (skin,), np.zeros(len(voxels)), TINY.voxel_size, fixed=fixed)
    engine = LatticeEngine(body, time_step=BENCH.time_step, floor=True, precision="f64", threads=1)
    builder = ProgramBuilder(1)
    builder.set(Quantity.ACCELERATION + 2, -load / (LENGTH * WIDTH * TINY.voxel_mass), regions=[0])
    builder.set(Quantity.TRANSLATION, 0.0, regions=[0], step=settling, rate=top / steps)
    at = np.linspace(0.3, 1.0, 8)
    run = engine.run(builder.build(settling + steps, settling + np.rint(steps * at).astype(int)[None]))
    held = np.isin(body.topology.links, np.flatnonzero(voxels[:, 0] == LENGTH)).sum(axis=1) == 1
    forces = TRUE.modulus * TINY.voxel_size**2 * run.strains[0][:, held].sum(axis=1)
    found = Drag(top * at, at, load).predict([Replica(dataclasses.replace(TRUE, friction=friction))], BENCH)[0]
    assert forces == pytest.approx(found, rel=5e-3)


@pytest.mark.kernels
def test_a_softer_pouch_is_rounder():
    softer = dataclasses.replace(TRUE, modulus=220e3)
    measure = Diameter(np.array([2e3, 500.0]), np.ones(2), "height")
    firm, soft = measure.predict([Replica(TRUE), Replica(softer)], BENCH)
    assert firm[0] > firm[1]  # in the order of the points
    assert soft[0] > 1.02 * firm[0]


@pytest.mark.kernels
def test_a_gait_swims_as_simulate_says():
    """With the same substeps."""
    robot = Laboratory(TINY, QUICK, stiffest=TINY.youngs_modulus, perturbation=0.0, precision="f64", threads=1)
    water = Terrain.water()
    (said,) = simulate(STEP, water, geometry=TINY, actuation=QUICK, threads=1).distance
    gait = Gait(np.array([np.inf]), np.ones(1), STEP, terrain=water)
    assert gait.predict([Replica(Properties.of(TINY, QUICK))], robot)[0, 0] == pytest.approx(said, rel=1e-2)


@pytest.mark.kernels
def test_a_gait_goes_as_simulate_says():
    """The same distance, of the whole gait and of its last second."""
    robot = Laboratory(TINY, QUICK, stiffest=TINY.youngs_modulus, perturbation=0.0, precision="f64", threads=1)
    own = Properties.of(TINY, QUICK)
    (said,) = simulate(STEP, Terrain(5.0), geometry=TINY, actuation=QUICK, threads=1).distance
    gait = Gait(np.array([np.inf, 1e9]), np.ones(2), STEP, terrain=Terrain(5.0))
    assert gait.predict([Replica(own)], robot)[0] == pytest.approx([said, said], rel=1e-3)
    speed = dataclasses.replace(gait, mean_speed=True).predict([Replica(own)], robot)[0, 0]
    result = simulate(STEP, Terrain(5.0), geometry=TINY, actuation=QUICK, threads=1)
    assert speed == pytest.approx(result.speed_simulated[0] * TINY.body_length, rel=1e-3)
    late = dataclasses.replace(gait, at=np.array([50.0]), values=np.ones(1), mean_speed=True)  # it rests after its gait
    assert late.predict([Replica(own)], robot)[0, 0] == pytest.approx(said / 50.0, rel=1e-3)


@pytest.mark.kernels
@pytest.mark.parametrize(
    ("weight", "own"),
    [("physical", Properties(1.3, 0.15, 480e3, 2.0)), ("published", Properties.of(SMALL))],
    ids=["fitted", "published"],
)
def test_a_gait_goes_as_simulate_says_where_voxels_of_a_robot_touch(weight, own):
    """As in the published simulator, which misses some such contacts: a robot that has all went up to 6 % farther."""
    drive, wood = InflatableActuation(weight=weight), Terrain(low_friction=0.56, high_friction=0.7)
    start = Laboratory(SMALL, drive, perturbation=0.0, precision="f64", threads=1)
    found = Gait(np.array([np.inf]), np.ones(1), STEP, terrain=wood).predict([Replica(own)], start.as_played(own))
    geometry, played = own.robot(SMALL, drive)
    alone = simulate(STEP, wood, geometry=geometry, actuation=played, threads=1)
    assert found[0, 0] == pytest.approx(alone.distance[0], rel=1e-6)


@pytest.mark.parametrize("weight", ["published", "physical"])
def test_a_fitted_robot_has_the_weight_with_which_it_was_fitted(tmp_path, weight):
    save_properties(Properties.of(), "small", tmp_path / "fit.json", weight)
    options = {"calibration": str(tmp_path / "fit.json")}
    robot = KINDS["inflatable"].build("inching", options)
    assert robot.parts[1].weight == weight == weight_of_calibration(tmp_path / "fit.json")
    assert KINDS["inflatable"].build("inching", {**options, "weight": "published"}).parts[1].weight == "published"


@pytest.mark.kernels
def test_a_gait_of_levels_and_core_pressures_is_played_as_simulate_plays_it():
    levels = np.random.default_rng(1).uniform(0.1, 0.9, (10, 2))
    design = InflatableDesign(1e3, 30.0, GaitSchedule(levels, 1, core_pressure=np.array([3e3, 2e3])))
    quick = InflatableActuation(inflation_rate=0.01, pressure_ramp=50.0, hold_steps=100, settle_steps=50)
    laboratory = Laboratory(TINY, quick, stiffest=TINY.youngs_modulus, perturbation=0.0, precision="f64", threads=1)
    experiment = Gait(np.array([np.inf]), np.zeros(1), design)
    found = experiment.predict([Replica(Properties.of(TINY, quick))], laboratory)
    alone = simulate(design, geometry=TINY, actuation=quick, threads=1)
    assert found[0, 0] == pytest.approx(alone.distance[0], rel=1e-6) and abs(found[0, 0]) > 1e-6
