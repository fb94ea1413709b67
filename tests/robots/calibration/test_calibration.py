"""Calibration: files of measurements, simulated experiments, the fit, its uncertainty, and the command."""

import dataclasses
import json
import shutil

import numpy as np
import pytest
from measurements import GRIPPING, SLIDING

from optim.calibration import calibrate, check_names, document, report
from optim.calibration.fit import modulus_near
from optim.calibration.misfit import ASSUMED, GIVEN, REPLICAS, SMALLEST, Linearised, uncertainty
from robots.calibration import (
    BOUNDS,
    NAMES,
    Diameter,
    Drag,
    Gait,
    Laboratory,
    Properties,
    Trial,
    load_calibration,
    read_measurements,
    save_properties,
    weight_of_calibration,
    write_measurements,
)
from robots.calibration.experiments import LENGTH, WIDTH
from robots.inflatable import ACTUATION, INCHING, PUBLISHED, SMALL, InflatableActuation, InflatableGeometry, simulate
from robots.inflatable.design import InflatableDesign
from robots.inflatable.schedule import GaitSchedule
from robots.kind import KINDS
from robots.world import Terrain
from taichi_sim.lattice import LatticeBody, LatticeEngine, Material, ProgramBuilder, Quantity

TINY = InflatableGeometry(bladder_columns=1, rows=10, foot_rows=2, voxel_size=0.02)
QUICK = InflatableActuation(
    inflation_rate=0.004, pressure_ramp=50.0, hold_steps=100, settle_steps=60, low_friction=0.1, high_friction=1.0
)
BENCH = Laboratory(TINY, QUICK, stiffest=600e3, precision="f64", threads=1)  # as feet are dragged
TRUE = Properties(friction=0.7, low_friction=0.15, modulus=330e3, inflation_rate=8.0)
NEAR = BOUNDS | {"modulus": (200e3, 600e3)}
STEP = dataclasses.replace(INCHING, schedule=GaitSchedule(INCHING.schedule.bits[:, :2], 1))


def drag(friction=0.6, load=0.5, grips=True, points=6):
    """What a foot does that sticks, then slides."""
    at = np.linspace(2e-3, 12e-3, points)
    return Drag(at, np.full(points, friction * load), load, grips)


def noisy(experiments, seed, noise=0.002):
    rng = np.random.default_rng(seed)
    measured = []
    for experiment in experiments:
        exact = experiment.predict([Trial(TRUE, 77)], BENCH)[0]
        measured.append(dataclasses.replace(experiment, values=exact * (1 + noise * rng.standard_normal(len(exact)))))
    return measured


@pytest.mark.parametrize("modulus", [300e3, 480e3, 579e3, 700e3])
def test_the_last_fit_has_the_time_step_of_the_robot_that_is_played(modulus):
    found = Properties(1.0, 0.1, modulus, 3.0)
    for geometry in (TINY, PUBLISHED):
        assert Laboratory(geometry, QUICK).as_played(found).time_step == pytest.approx(
            found.robot(geometry)[0].time_step
        )


@pytest.mark.parametrize(
    ("found", "bounds", "within"),
    [
        (480e3, (200e3, 800e3), (200e3, 579e3)),
        (480e3, (200e3, 500e3), (200e3, 500e3)),
        (620e3, (200e3, 800e3), (579e3, 682e3)),
        (620e3, (600e3, 650e3), (600e3, 650e3)),
    ],
)
def test_the_last_fit_stays_where_its_time_step_holds_and_within_the_bounds(found, bounds, within):
    assert modulus_near(found, bounds, 579e3) == pytest.approx(within)


@pytest.mark.kernels
def test_a_calibrated_robot_goes_as_far_elsewhere_as_in_its_fit():
    """Ways depend on the time step: one fitted at another step predicts what no command shows."""
    times = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    track = Gait(times, np.linspace(1e-4, 1e-3, 6), STEP, deviations=np.full(6, 1e-4))
    found = calibrate([track], BENCH, ("friction",), NEAR)
    geometry, _ = found.after.robot(TINY, QUICK)
    assert geometry.time_step > BENCH.time_step
    there = Laboratory(TINY, QUICK, stiffest=TINY.youngs_modulus, precision="f64", threads=1)
    again = np.mean(track.predict([Trial(found.after, n) for n in range(8)], there), axis=0)
    assert there.time_step == geometry.time_step and found.predictions[1] == pytest.approx(again)


# properties


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


# experiments


@pytest.mark.parametrize("load", [0.01, 0.5, 1.0, 20.0])
def test_a_dragged_foot_slides_at_its_friction_under_every_load(load):
    trials = [Trial(dataclasses.replace(TRUE, friction=mu)) for mu in (0.3, 4.0)]
    far = Drag(np.linspace(0.1, 1.0, 6), np.ones(6), load)  # where all of it slides
    assert far.predict(trials, BENCH) == pytest.approx(np.array([[0.3], [4.0]]) * load * np.ones(6), rel=1e-12)
    sliding = dataclasses.replace(far, grips=False).predict(trials, BENCH)
    assert sliding == pytest.approx(np.full((2, 6), 0.15 * load), rel=1e-12)


def test_a_stretching_foot_holds_less_than_its_friction():
    early = Drag(np.array([0.0, 1e-6, 2e-5, 5e-3]), np.ones(4), 0.8).predict([Trial(TRUE)], BENCH)[0]
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
    found = Drag(top * at, at, load).predict([Trial(dataclasses.replace(TRUE, friction=friction))], BENCH)[0]
    assert forces == pytest.approx(found, rel=5e-3)


@pytest.mark.kernels
def test_a_softer_pouch_is_rounder():
    softer = dataclasses.replace(TRUE, modulus=220e3)
    measure = Diameter(np.array([2e3, 500.0]), np.ones(2), "height")
    firm, soft = measure.predict([Trial(TRUE), Trial(softer)], BENCH)
    assert firm[0] > firm[1]  # in the order of the points
    assert soft[0] > 1.02 * firm[0]


@pytest.mark.kernels
def test_a_gait_swims_as_simulate_says():
    """With the same substeps."""
    robot = Laboratory(TINY, QUICK, stiffest=TINY.youngs_modulus, perturbation=0.0, precision="f64", threads=1)
    water = Terrain.water()
    (said,) = simulate(STEP, water, geometry=TINY, actuation=QUICK, threads=1).distance
    gait = Gait(np.array([np.inf]), np.ones(1), STEP, terrain=water)
    assert gait.predict([Trial(Properties.of(TINY, QUICK))], robot)[0, 0] == pytest.approx(said, rel=1e-2)


@pytest.mark.kernels
def test_a_gait_goes_as_simulate_says():
    """The same distance, of the whole gait and of its last second."""
    robot = Laboratory(TINY, QUICK, stiffest=TINY.youngs_modulus, perturbation=0.0, precision="f64", threads=1)
    own = Properties.of(TINY, QUICK)
    (said,) = simulate(STEP, Terrain(5.0), geometry=TINY, actuation=QUICK, threads=1).distance
    gait = Gait(np.array([np.inf, 1e9]), np.ones(2), STEP, terrain=Terrain(5.0))
    assert gait.predict([Trial(own)], robot)[0] == pytest.approx([said, said], rel=1e-3)
    speed = dataclasses.replace(gait, mean_speed=True).predict([Trial(own)], robot)[0, 0]
    result = simulate(STEP, Terrain(5.0), geometry=TINY, actuation=QUICK, threads=1)
    assert speed == pytest.approx(result.speed_simulated[0] * TINY.body_length, rel=1e-3)
    late = dataclasses.replace(gait, at=np.array([50.0]), values=np.ones(1), mean_speed=True)  # it rests after its gait
    assert late.predict([Trial(own)], robot)[0, 0] == pytest.approx(said / 50.0, rel=1e-3)


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
    found = Gait(np.array([np.inf]), np.ones(1), STEP, terrain=wood).predict([Trial(own)], start.as_played(own))
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


# fit


@pytest.mark.kernels
def test_friction_and_modulus_are_recovered_from_noisy_measurements():
    """The rate needs a robot that inches, see the slow test below."""
    names = ("friction", "low_friction", "modulus")
    pouch = Diameter(np.array([500.0, 1e3, 1.5e3, 2e3]), np.ones(4), "height")
    found = calibrate(noisy([drag(), drag(grips=False), pouch], 1), BENCH, names, NEAR)
    assert found.names == names and not found.at_bound
    for name in names:
        assert getattr(found.after, name) == pytest.approx(getattr(TRUE, name), rel=0.05)
    assert found.after.inflation_rate == found.before.inflation_rate
    assert found.misfit[1] < 1 < found.misfit[0]
    assert np.diag(found.uncertainty.correlation) == pytest.approx(1.0)
    record = document(found, "small")
    assert record["warnings"] == [] and json.loads(json.dumps(record)) == record


@pytest.mark.kernels
def test_the_same_data_give_the_same_bits():
    first, second = (calibrate([drag()], BENCH, ("friction",)) for _ in range(2))
    assert first.after == second.after and (first.predictions == second.predictions).all()


@pytest.mark.kernels
def test_a_property_at_its_bound_is_told():
    found = calibrate([drag(friction=0.9)], BENCH, ("friction",), BOUNDS | {"friction": (0.1, 0.5)})
    assert found.at_bound == ("friction",) and found.after.friction == pytest.approx(0.5, rel=0.01)
    assert any("friction ended at a bound" in line for line in document(found, "small")["warnings"])


@pytest.mark.kernels
def test_data_that_cannot_tell_are_refused_after_one_sensitivity():
    """A foot that slides all the time says nothing of how far it stretched."""
    with pytest.raises(ValueError, match="fit: the data cannot tell modulus; add experiments"):
        calibrate([drag()], BENCH, ("friction", "modulus"))


def test_what_does_not_act_and_too_few_points_are_refused_before_any_simulation(monkeypatch):
    monkeypatch.setattr(Drag, "predict", lambda *_: pytest.fail("it was simulated"))
    for names, points, message in (
        (("inflation_rate",), 6, "fit: inflation_rate does not act in these experiments; add a gait"),
        (("low_friction",), 6, "fit: low_friction does not act in these experiments; add a drag of a foot that slides"),
        (("friction",), 1, "data: 1 points are not enough for 1 properties; give at least 2"),
        (("mass",), 6, "fit: 'mass' is unknown; choose of friction, low_friction, modulus, inflation_rate"),
        (("friction", "friction"), 6, "fit: 'friction,friction' is not allowed; name each property once"),
    ):
        with pytest.raises(ValueError, match=message):
            calibrate([drag(points=points)], BENCH, names)


def test_water_tells_nothing_of_friction():
    swim = Gait(np.array([1.0, 2.0, 3.0]), np.ones(3), STEP, terrain=Terrain.water())
    with pytest.raises(ValueError, match="friction does not act"):
        check_names([swim], ("friction",))


# uncertainty


def straight(count, deviation, scatter=0.0, seed=0):
    """A line through noise: residuals at the least squares, with their slopes."""
    rng = np.random.default_rng(seed)
    slopes = np.column_stack([np.ones(count), np.linspace(-1, 1, count)])
    noise = deviation * rng.standard_normal(count)
    residuals = slopes @ np.linalg.lstsq(slopes, noise, rcond=None)[0] - noise
    return Linearised(np.zeros(count), residuals, slopes, np.full((count, count), scatter))


def given(count):
    """Experiments of points whose deviations are given."""
    return np.full(count, GIVEN)


def assumed(count):
    """Experiments of points whose deviations are assumed, all of one."""
    return np.zeros(count, int)


def test_errors_are_those_of_a_straight_line():
    """Of unit deviations: 1 / sqrt(N), and 1 / sqrt(sum x^2); no correlation about the middle."""
    count = 400
    found = straight(count, 1.0)
    expected = [count**-0.5, (found.slopes[:, 1] ** 2).sum() ** -0.5]
    known = uncertainty(found, given(count), np.ones(count))
    assert known.errors == pytest.approx(expected, rel=0.1)
    assert known.reach == pytest.approx(1.96 * known.errors, rel=1e-3)
    assert known.correlation[0, 1] == pytest.approx(0.0, abs=1e-9)


def test_assumed_deviations_follow_the_residuals_and_given_ones_only_grow():
    count, quiet, loud = 400, straight(400, 0.1), straight(400, 3.0)
    everywhere = np.ones(count)
    unit = uncertainty(straight(count, 1.0), given(count), everywhere).errors
    assert uncertainty(quiet, assumed(count), everywhere).errors == pytest.approx(0.1 * unit, rel=0.15)
    assert uncertainty(quiet, given(count), everywhere).errors == pytest.approx(unit, rel=0.15)
    assert uncertainty(loud, given(count), everywhere).errors == pytest.approx(3 * unit, rel=0.15)


def test_equal_readings_are_not_without_error():
    """Four that lie on the curve tell a friction to 0.2 % / sqrt(4), not exactly; what is given is believed."""
    count, none = 4, np.zeros((4, 4))
    exact = Linearised(np.zeros(count), np.zeros(count), np.full((count, 1), 1 / ASSUMED), none)
    everywhere = np.ones(count)
    assert uncertainty(exact, assumed(count), everywhere).errors == pytest.approx([SMALLEST / 2])
    assert uncertainty(exact, given(count), everywhere).errors == pytest.approx([ASSUMED / 2])
    barely = dataclasses.replace(exact, residuals=np.full(count, 1.01 * SMALLEST / ASSUMED * (3 / 4) ** 0.5))
    assert uncertainty(barely, assumed(count), everywhere).errors == pytest.approx([1.01 * SMALLEST / 2])


@pytest.mark.parametrize("apart", [True, False], ids=["a property each", "all properties in all"])
@pytest.mark.parametrize(
    ("sizes", "noises", "experiments"),
    [
        ((8, 8), (1.0, 3.0), (GIVEN, 1)),  # one with deviations, one noisier than is assumed
        ((8, 8), (1.0, 0.3), (GIVEN, 1)),
        ((8, 8), (3.0, 0.3), (0, 1)),  # both without
        ((4, 4, 15), (1.0, 4.0, 0.3), (0, 1, 2)),
        ((3, 8), (4.0, 1.0), (0, 1)),  # few readings, loud
    ],
)
def test_intervals_hold_the_truth_as_often_as_they_say(sizes, noises, experiments, apart):
    """Each experiment has a noise of its own: one factor for all would hold the truth in 53 to 77 of 100 cases."""
    rng, count, draws = np.random.default_rng(4), len(sizes), 600
    part = np.repeat(np.arange(count), sizes)
    slopes = rng.standard_normal((len(part), count))
    if apart:
        slopes *= part[:, None] == np.arange(count)
    held = np.zeros(count)
    for _ in range(draws):
        noise = np.array(noises)[part] * rng.standard_normal(len(part))
        error = np.linalg.lstsq(slopes, noise, rcond=None)[0]
        found = Linearised(np.zeros(len(part)), slopes @ error - noise, slopes, np.zeros((len(part),) * 2))
        held += np.abs(error) < uncertainty(found, np.array(experiments)[part], np.ones(len(part))).reach
    assert (held / draws > 0.92).all()
    if apart:
        assert (held / draws < 0.98).all()


def test_scatter_that_is_common_to_all_points_is_no_smaller_for_many():
    count, everywhere = 400, np.ones(400)
    found = uncertainty(straight(count, 1.0, scatter=0.25), given(count), everywhere)
    assert found.errors[0] ** 2 == pytest.approx(0.25 * (1 + 1 / REPLICAS) + 1 / count, rel=0.02)
    assert found.chaos[0] > 0.98 and found.chaos[1] == pytest.approx(0.0, abs=1e-9)


# files


def test_another_kind_of_file_is_told_which_is_wanted(tmp_path):
    (tmp_path / "a.csv").write_text("time_s,distance_mm\n0.5,1.8\n")
    with pytest.raises(ValueError, match=r"^\S*a.csv: is no file of measurements \(.*\); these are TOML .*") as error:
        read_measurements(tmp_path / "a.csv", None)
    assert str(error.value).endswith("calibrate --example FILE writes one") and "\n" not in str(error.value)


GOOD = """
geometry = "small"

[[drag]]
load_n = 0.5
displacement_mm = [1, 2, 3]
force_n = [0.3, 0.31, 0.29]
force_sd_mn = 5

[[diameter]]
pressure_psi = [0.1, 0.2]
width_cm = [11.0, 10.5]

[[gait]]
gait = "inching"
terrain = "hill:5"
columns = 2
repeats = 1
speed_mm_per_s = 12.0
speed_sd_mm_per_s = 1.0
"""


def named(name):
    return {"inching": INCHING}[name]


def test_a_file_says_what_was_measured(tmp_path):
    (tmp_path / "a.toml").write_text(GOOD)
    found = read_measurements(tmp_path / "a.toml", named)
    foot, pouch, gait = found.experiments
    assert found.geometry == "small" and foot.grips and foot.load == 0.5
    assert foot.at == pytest.approx([1e-3, 2e-3, 3e-3]) and foot.deviations == pytest.approx([5e-3] * 3)
    assert pouch.side == "width" and pouch.at == pytest.approx([689.4757, 1378.9514]) and pouch.deviations is None
    assert pouch.values == pytest.approx([0.11, 0.105])
    assert gait.at.tolist() == [np.inf] and gait.mean_speed and gait.values == pytest.approx([0.012])
    assert gait.terrain == Terrain(5.0) and gait.design == STEP


def test_a_gait_may_be_measured_on_a_known_floor_and_bladders_may_weigh(tmp_path):
    ground = 'terrain = "hill:5"\nfloor = "wood"\nbladder_friction = 0.3'
    (tmp_path / "a.toml").write_text('weight = "physical"\n' + GOOD.replace('terrain = "hill:5"', ground))
    found = read_measurements(tmp_path / "a.toml", named)
    gait = found.experiments[-1]
    assert gait.terrain == Terrain(5.0, 0.7, 0.56, bladder_friction=0.3) and found.weight == "physical"
    assert gait.informs == ("inflation_rate", "modulus")
    (tmp_path / "usual.toml").write_text(GOOD)
    usual = read_measurements(tmp_path / "usual.toml", named)
    assert usual.weight == "published" and usual.experiments[-1].informs[1:3] == ("friction", "low_friction")
    write_measurements(tmp_path / "b.toml", "small", found.experiments)
    assert read_measurements(tmp_path / "b.toml", named).experiments[-1].terrain == gait.terrain


def test_files_come_back(tmp_path):
    experiments = [
        dataclasses.replace(drag(grips=False), deviations=np.full(6, 1e-3)),
        Diameter(np.array([1e3, 2e3]), np.array([0.03, 0.04]), "height"),
        Gait(np.array([0.5, 1.0]), np.array([0.01, 0.02]), INCHING, "inching"),
    ]
    write_measurements(tmp_path / "b.toml", "small", experiments)
    for given, read in zip(experiments, read_measurements(tmp_path / "b.toml", named).experiments, strict=True):
        assert type(given) is type(read) and given.title == read.title
        for name in ("at", "values", "deviations"):
            a, b = getattr(given, name), getattr(read, name)
            assert (a is None and b is None) or b == pytest.approx(a, rel=1e-5)


BAD = [
    ("displacement_mm", "displacement_inch", "drag 1: displacement_inch: is not allowed; name the unit, as one of"),
    ("force_n =", "force =", "drag 1: force: is not allowed; name the unit, as one of force_n, force_mn"),
    ("force_n = [0.3, 0.31, 0.29]", "", "drag 1: column force is missing; give one of force_n, force_mn"),
    ("load_n = 0.5", "", "drag 1: column load is missing"),
    ("load_n = 0.5", "load_n = 0", "drag 1: load: 0 is not allowed; it must be positive"),
    ("0.31, 0.29", "0.31", "drag 1: force: 2 values are not allowed for 3 points; give as many"),
    ("0.31", "nan", "drag 1: force_n: nan is not allowed; give a finite number"),
    ("0.31", '"0.31"', "drag 1: force_n: '0.31' is not allowed; give a finite number"),
    ("force_sd_mn = 5", "force_sd_mn = 0", "drag 1: force_sd: is not allowed; give one positive number"),
    ("[1, 2, 3]", "[-1, 2, 3]", "drag 1: displacement_mm: -1 is not allowed; give a finite number, at least 0"),
    ("load_n = 0.5", 'load_n = 0.5\nfoot = "left"', "drag 1: foot: 'left' is unknown; choose one of grips, slides"),
    ("load_n = 0.5", "load_n = 0.5\nweight = 1", "drag 1: 'weight' is unknown"),
    ("width_cm = [11.0, 10.5]", "", "diameter 1: give one column of width or height"),
    ("[0.1, 0.2]", "[0.1, 20]", "diameter 1: pressure: 137895.14 is not allowed"),
    ('"inching"', '"crawling"', "gait 1: gait: 'crawling' is neither a known gait"),
    ("columns = 2", "columns = 20", "gait 1: columns: 20 is not allowed; the gait has 8"),
    ("columns = 2", 'floor = "gravel"', "gait 1: floor: gravel is not allowed, as no friction on it was published"),
    (
        "columns = 2",
        "friction = 0.5",
        "gait 1: friction: 0.5 is not allowed; give that of sliding and of gripping feet",
    ),
    ("columns = 2", "seam_friction = -1", "gait 1: seam_friction: -1 is not allowed"),
    ('geometry = "small"', 'weight = "none"', "weight: 'none' is unknown; choose one of published, physical"),
    ("hill:5", "moon", "gait 1: terrain: 'moon' is unknown"),
    ("speed_mm_per_s = 12.0", "", "gait 1: column speed is missing"),
    ('geometry = "small"', 'geometry = "large"', "geometry: 'large' is unknown; choose one of published, small"),
    ("[[gait]]", "[[walk]]", "'walk' is unknown; give geometry and tables [[drag]], [[diameter]], [[gait]]"),
    ("[[drag]]", "[[drag]", "Expected ']]'"),
]


@pytest.mark.parametrize(("old", "new", "message"), BAD)
def test_bad_measurements_are_one_line(morpholab, tmp_path, old, new, message):
    assert old in GOOD
    (tmp_path / "a.toml").write_text(GOOD.replace(old, new, 1))
    code, out, error = morpholab("calibrate a.toml")
    assert (code, out) == (2, "") and error.count("\n") == 1
    assert error.startswith("morpholab calibrate: error: a.toml: ") and message in error


# the command


DRAGS = GRIPPING + SLIDING


@pytest.mark.kernels
def test_a_calibration_goes_from_a_file_to_simulate(morpholab, tmp_path, monkeypatch):
    (tmp_path / "a.toml").write_text(DRAGS)
    code, out, _ = morpholab("calibrate a.toml --out fit --json --quiet --threads 1")
    record = json.loads(out)
    assert code == 0 and set(record["fitted"]) == {"friction", "low_friction"} and record["warnings"] == []
    assert record["properties"]["friction"] == pytest.approx(0.8, rel=0.03)
    assert record["properties"]["low_friction"] == pytest.approx(0.2, rel=0.03)
    low, high = record["fitted"]["friction"]["interval_95"]
    assert low < 0.8025 < high and high - low == pytest.approx(2 * 1.96 * 0.01, rel=0.1)  # 0.01 N / 0.5 N / sqrt(4)
    assert (tmp_path / "fit/calibration.png").stat().st_size > 5000
    properties, geometry = load_calibration(tmp_path / "fit/calibration.json")
    assert geometry == "small" and vars(properties) == record["properties"]
    used = {}
    monkeypatch.setattr("robots.inflatable.simulation.simulate", lambda *_, **given: used.update(given) or stand_in())
    code, _, _ = morpholab("simulate --gait inching --calibration fit/calibration.json")
    assert code == 0 and used["geometry"] == SMALL
    assert used["actuation"].high_friction == properties.friction


@pytest.mark.kernels
def test_a_calibration_that_a_kill_has_cut_off_can_be_repeated(morpholab, tmp_path, monkeypatch):
    """Its numbers are there, but not its picture."""
    save, fitted = report.save_calibration, []

    def calibrated(*given):
        fitted[:] = fitted or [calibrate(*given)]
        return fitted[0]

    def killed(*given):
        shutil.copytree(tmp_path / "fit", tmp_path / "killed")
        save(*given)

    monkeypatch.setattr("optim.calibration.calibrate", calibrated)
    monkeypatch.setattr(report, "save_calibration", killed)
    (tmp_path / "a.toml").write_text(DRAGS[: DRAGS.rindex("[[drag]]")])
    assert morpholab("calibrate a.toml --out fit --quiet --threads 1")[0] == 0
    assert {path.name for path in (tmp_path / "killed").iterdir()} == {"calibration.json", ".aside-claim"}
    monkeypatch.setattr(report, "save_calibration", save)
    assert morpholab("calibrate a.toml --out killed --quiet --threads 1")[::2] == (0, "")
    whole, again = ({path.name: path.read_bytes() for path in (tmp_path / n).iterdir()} for n in ("fit", "killed"))
    assert again == whole


@pytest.mark.parametrize("weight", ["published", "physical"])
def test_the_robot_that_is_fitted_has_the_weight_of_the_file(morpholab, tmp_path, monkeypatch, weight):
    used = []

    def stopped(experiments, laboratory, *others):
        used.append(laboratory)
        raise ValueError("seen: enough")

    monkeypatch.setattr("optim.calibration.calibrate", stopped)
    (tmp_path / "a.toml").write_text(f'weight = "{weight}"\n{DRAGS}')
    assert morpholab("calibrate a.toml --quiet")[0] == 2
    assert used[0].drive(Properties.of()).weight == used[0].actuation.weight == weight


def stand_in():
    """What ``simulate`` needs of a result."""
    numbers = dict.fromkeys(("distance", "speed", "speed_simulated"), np.array([0.1]))
    numbers["displacement"] = np.array([[0.0, 0.1]])
    return type("Result", (), {**numbers, "status": np.array(["ok"]), "steps": np.array([3]), "frames": None})


BAD_LINES = [
    ("calibrate", "data: give either a file of measurements, or --example FILE"),
    ("calibrate a.toml --example b.toml", "data: give either"),
    ("calibrate --example b.toml --out d", "out: it is of a fit; leave it out with --example"),
    ("calibrate --example b.toml --fit modulus", "fit: it is of a fit; leave it out with --example"),
    ("calibrate none.toml", "none.toml: cannot be read"),
    ("calibrate empty.toml", "empty.toml: holds no experiment"),
    ("calibrate --example a.toml", "path: a.toml exists; name a new file"),
    ("calibrate a.toml --geometry small", "geometry: small is not allowed beside a.toml"),
    ("calibrate a.toml --fit inflation_rate", "fit: inflation_rate does not act in these experiments; add a gait"),
    ("calibrate a.toml --fit mass", "fit: 'mass' is unknown"),
    ("calibrate a.toml --bounds friction=2:1", "bounds: 'friction=2:1' is not allowed; give friction=LOW:HIGH"),
    ("calibrate a.toml --fit modulus --bounds friction=1:2", "bounds: 'friction=1:2' is not used; fitted are modulus"),
    ("calibrate a.toml --bounds mass=1:2", "bounds: 'mass' is unknown"),
    ("calibrate a.toml --out a.toml", "out: a.toml is a file; name a new folder"),
    ("simulate --gait inching --calibration a.toml", "a.toml: "),
    ("simulate --gait inching --calibration wrong.json", "wrong.json: geometry: 'large' is unknown"),
]


@pytest.mark.parametrize(("line", "message"), BAD_LINES)
def test_bad_lines_are_one_line(morpholab, tmp_path, line, message):
    (tmp_path / "a.toml").write_text(DRAGS)
    (tmp_path / "empty.toml").write_text("")
    (tmp_path / "wrong.json").write_text(
        '{"format": "morpholab-calibration-1", "geometry": "large", '
        '"properties": {"friction": 1, "low_friction": 1, "modulus": 1, "inflation_rate": 1}}'
    )
    code, out, error = morpholab(line)
    assert (code, out) == (2, "") and error.count("\n") == 1 and f"error: {message}" in error


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_the_example_gives_its_truth_back(morpholab, tmp_path, seed):
    code, out, _ = morpholab(f"calibrate --example rig.toml --seed {seed} --quiet --json")
    truth = json.loads(out)["truth"]
    assert code == 0 and set(truth) == set(NAMES)
    code, out, _ = morpholab("calibrate rig.toml --quiet --json")
    assert code == 0
    for name, found in json.loads(out)["fitted"].items():
        assert found["after"] == pytest.approx(truth[name], rel=0.05)


@pytest.mark.kernels
def test_a_gait_of_levels_and_core_pressures_is_played_as_simulate_plays_it():
    levels = np.random.default_rng(1).uniform(0.1, 0.9, (10, 2))
    design = InflatableDesign(1e3, 30.0, GaitSchedule(levels, 1, core_pressure=np.array([3e3, 2e3])))
    quick = InflatableActuation(inflation_rate=0.01, pressure_ramp=50.0, hold_steps=100, settle_steps=50)
    laboratory = Laboratory(TINY, quick, stiffest=TINY.youngs_modulus, perturbation=0.0, precision="f64", threads=1)
    experiment = Gait(np.array([np.inf]), np.zeros(1), design)
    found = experiment.predict([Trial(Properties.of(TINY, quick))], laboratory)
    alone = simulate(design, geometry=TINY, actuation=quick, threads=1)
    assert found[0, 0] == pytest.approx(alone.distance[0], rel=1e-6) and abs(found[0, 0]) > 1e-6
