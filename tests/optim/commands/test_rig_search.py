"""Searches, judgements and views of the robot of a rig, as a calibration fitted it."""

import dataclasses
import json
from types import SimpleNamespace

import numpy as np
import pytest
from graded import tabled
from run_products import products

from optim.problems.inflatable.outcomes import effort
from optim.problems.inflatable.problem import GaitProblem
from optim.report.robot_run import RobotSubject
from optim.runs.comparable import JUDGED
from robots.calibration import BOUNDS, Properties, load_calibration, robot_of, save_properties, weight_of_calibration
from robots.inflatable import ACTUATION, INCHING, PUBLISHED, SMALL, InflatableActuation, simulation
from robots.inflatable.design import InflatableDesign
from robots.inflatable.robustness import harder, judge_gait
from robots.inflatable.timing import gait_steps, nominal_steps
from robots.world import Terrain

FITTED = Properties(friction=1.2, low_friction=0.3, modulus=330e3, inflation_rate=2.0)
STIFF = dataclasses.replace(FITTED, modulus=800e3)
OTHER = "it is an option of other kinds (inflatable robot)"
SHORT = "--climbers 4 --generations 2 --quiet"
TIMED = "modulus: 800000 Pa is not allowed with gaits that have times of their own, which count in time steps that are"


@pytest.fixture
def rig(tmp_path):
    save_properties(FITTED, "small", tmp_path / "rig.json")
    return tmp_path / "rig.json"


# its robot


def test_a_softer_robot_keeps_the_time_step_in_which_gaits_count():
    geometry, actuation = FITTED.robot(SMALL)
    assert geometry.time_step == pytest.approx(SMALL.time_step, rel=1e-12)
    assert geometry.youngs_modulus == 330e3 and geometry.bladder_modulus == pytest.approx(330e3 / 1.8)
    counted = ("hold_steps", "settle_steps", "pressure_ramp")
    assert [getattr(actuation, name) for name in counted] == [getattr(ACTUATION, name) for name in counted]
    assert actuation.inflation_rate == pytest.approx(2.0 * SMALL.time_step)
    assert (actuation.high_friction, actuation.low_friction) == (1.2, 0.3)


@pytest.mark.parametrize(("modulus", "fits"), [(200e3, True), (579e3, True), (580e3, False), (800e3, False)])
def test_stiff_skin_needs_shorter_time_steps(modulus, fits):
    properties = dataclasses.replace(FITTED, modulus=modulus)
    geometry = properties.robot()[0]
    assert properties.fits_time_step() == fits == (geometry.time_step == pytest.approx(PUBLISHED.time_step))
    assert geometry.body.recommended_time_step >= 1.08 * geometry.time_step
    if not fits:
        with pytest.raises(ValueError, match=r"at most 579561 Pa$"):
            properties.check_time_step()


@pytest.mark.kernels
def test_a_gait_lasts_as_long_in_a_softer_robot():
    """Its pause is simulated for the time that the file says: at the largest stable step it was 41 % longer."""
    levels = np.zeros((8, 1))
    design = InflatableDesign(0.0, 0.0, tabled(levels, np.ones((2, 1)), 1, None, [50], [300]))
    soft = dataclasses.replace(Properties.of(SMALL), modulus=200e3)
    published, softer = (
        simulation.simulate(design, geometry=geometry, actuation=actuation, threads=1)
        for geometry, actuation in (robot_of("small", "published"), soft.robot(SMALL))
    )
    assert (published.status == "ok").all() and (softer.status == "ok").all()
    assert softer.steps * softer.time_step == pytest.approx(published.steps * published.time_step, rel=1e-9)
    assert softer.steps[0] == gait_steps(design.schedule) == 350


def test_a_robot_is_named_or_fitted():
    assert robot_of("small", "physical") == (SMALL, InflatableActuation(weight="physical"))
    assert robot_of("small", "published", FITTED) == FITTED.robot(SMALL)


def test_properties_come_back_from_their_file(rig):
    assert load_calibration(rig) == (FITTED, "small")


# its problem


def test_a_problem_has_the_robot_of_a_rig():
    problem = GaitProblem((Terrain(), Terrain(15.0)), geometry="small", properties=FITTED, hard=True)
    assert (problem.body, problem.actuation) == FITTED.robot(SMALL)
    usual, hard = problem.conditions[2:]
    assert usual.actuation == problem.actuation and usual.terrain == Terrain(15.0)
    assert hard.actuation == dataclasses.replace(problem.actuation, weight="physical")
    assert hard.terrain == Terrain(15.0, low_friction=0.3)
    description = json.loads(json.dumps(problem.describe()))
    assert description["properties"] == vars(FITTED)
    again = GaitProblem.from_description(description)
    assert again.describe() == description and again.body == problem.body
    assert "properties" in JUDGED and "properties" not in GaitProblem((Terrain(),)).describe()


def test_graded_gaits_of_a_slow_rig_are_played_less_often():
    published = GaitProblem((Terrain(),), columns=2, encoding="graded")
    slow = dataclasses.replace(published, properties=dataclasses.replace(Properties.of(), inflation_rate=1.0))
    assert published.most_steps == 186_719 and slow.most_steps == nominal_steps(16, slow.actuation) > 400_000
    for point in published.space.sample(np.random.default_rng(3), 20):
        usual, other = (dataclasses.replace(one, steps=186_719).design(point) for one in (published, slow))
        assert gait_steps(other.schedule, slow.actuation) <= 186_719 or other.schedule.repeats == 1
        assert other.schedule.repeats <= usual.schedule.repeats
        in_full = slow.design(point)
        assert slow.counted_steps(in_full) == max(slow.most_steps, gait_steps(in_full.schedule, slow.actuation))


def test_effort_does_not_depend_on_how_fast_bladders_fill():
    """Of gaits in which every stroke is a full one."""
    published = GaitProblem((Terrain(),))
    slow = dataclasses.replace(published, properties=dataclasses.replace(Properties.of(), inflation_rate=1.0))
    for point in published.space.sample(np.random.default_rng(1), 4):
        design = published.design(point)
        efforts = [effort(design, one.counted_steps(design), one.actuation)[0] for one in (published, slow)]
        assert efforts[0] == pytest.approx(efforts[1])


def test_a_search_starts_at_a_gait_as_the_rig_plays_it():
    """A motion of 5000 steps is longer than a stroke of a fast rig, not than one of the published robot."""
    gait = tabled(np.tile([1.0, 0.0], (8, 1)), np.ones((2, 2)), 1, None, [5000, 5000], [500, 500])
    design = InflatableDesign(0.0, 10.0, gait)
    published = GaitProblem((Terrain(),), columns=2, encoding="graded", steps=12_000)
    fast = dataclasses.replace(published, properties=dataclasses.replace(Properties.of(), inflation_rate=12.0))
    start = published.start_values(design)
    found = published.design(published.space.from_dict(start))
    assert gait_steps(found.schedule) == gait_steps(design.schedule.cut(None, found.schedule.repeats))
    with pytest.raises(ValueError, match=r"^motion_steps: graded genes move as fast as bladders do"):
        fast.start_values(design)
    slow = dataclasses.replace(published, properties=dataclasses.replace(Properties.of(), inflation_rate=0.7))
    longer = InflatableDesign(0.0, 10.0, dataclasses.replace(gait, motion_steps=[9000, 9000]))
    assert slow.start_values(longer) == start
    with pytest.raises(ValueError, match=r"^motion_steps"):
        published.start_values(longer)


def test_a_judgement_is_of_the_rig(monkeypatch):
    """Its actuation reaches every simulation, and its strokes and friction tell the limits."""
    calls = []

    def stand_in(designs, terrain, *, actuation, **options):
        calls.append((terrain, actuation, options["geometry"]))
        return SimpleNamespace(speed=np.full(len(designs), -0.05), distance=np.full(len(designs), -1.0))

    monkeypatch.setattr("robots.inflatable.simulation.simulate", stand_in)
    monkeypatch.setattr(
        "robots.inflatable.robustness.slip_under_load",
        lambda watched, design, actuation, robot: np.full(2, actuation.low_friction),
    )
    geometry, actuation = FITTED.robot(SMALL)
    found = judge_gait(INCHING, Terrain(15.0), geometry=geometry, actuation=actuation, runs=2)
    assert [call[2] for call in calls] == [geometry] * 2
    assert [call[1].weight for call in calls] == ["published", "physical"]
    assert {dataclasses.replace(call[1], weight="published") for call in calls} == {actuation}
    assert [call[0].low_friction for call in calls] == [None, 0.3]
    assert found.slip_ratio == pytest.approx(0.3) and found.steps == gait_steps(INCHING.schedule, actuation) > 186_719
    assert found.steps <= found.most_steps == nominal_steps(16, actuation)
    assert found.faults == (
        "-0.0500 BL/s remain with friction 0.3 of sliding feet and bladders that keep their weight, less than -0.01",
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"properties": {**vars(FITTED), "wings": 2.0}}, "problem: its description is damaged .*wings"),
        ({"properties": {**vars(FITTED), "friction": -1.0}}, "friction: -1.0 is not allowed"),
        ({"properties": vars(STIFF), "encoding": "graded"}, TIMED),
    ],
)
def test_damaged_descriptions_are_one_line(change, message):
    description = GaitProblem((Terrain(),), properties=FITTED).describe()
    with pytest.raises(ValueError, match=message):
        GaitProblem.from_description({**description, **change})


def test_harder_conditions_of_a_rig_are_never_easier():
    rubber = dataclasses.replace(ACTUATION, low_friction=0.4)
    terrain, actuation = harder(Terrain(5.0), rubber)
    assert terrain.low_friction == 0.4 and actuation == dataclasses.replace(rubber, weight="physical")
    ice = dataclasses.replace(ACTUATION, high_friction=0.15)
    with pytest.raises(ValueError, match=r"^friction: 0.15 of gripping feet is not allowed under the harder"):
        harder(Terrain(), ice)


# the command line


@pytest.mark.usefixtures("rig")
def test_a_search_for_a_rig_end_to_end(morpholab, simulator, tmp_path):
    code, _, error = morpholab(f"codesign --terrain flat --calibration rig.json --out a {SHORT}")
    assert (code, error) == (0, "")
    geometry, actuation = FITTED.robot(SMALL)
    assert {(call.geometry, call.actuation) for call in simulator.calls} == {(geometry, actuation)}
    assert load_calibration(tmp_path / "a/calibration.json") == (FITTED, "small")
    before = products(tmp_path / "a")
    morpholab("codesign --resume --out a --quiet")
    morpholab("codesign --resume --out a --quiet --calibration rig.json")
    assert products(tmp_path / "a") == before
    (tmp_path / "rig.json").unlink()  # the folder has all that it needs
    assert morpholab("codesign --resume --out a --quiet --generations 3")[0] == 0
    assert simulator.calls[-1].actuation == actuation


def test_a_search_for_a_rig_has_the_weight_of_its_fit(morpholab, simulator, tmp_path):
    """So does the file that it writes, with which its designs are simulated."""
    for asked, weight in (("", "physical"), ("--weight published", "published")):
        save_properties(FITTED, "small", tmp_path / "fit.json", "physical")
        simulator.calls.clear()
        folder = tmp_path / weight
        line = f"codesign --terrain flat --calibration {tmp_path / 'fit.json'} --out {folder} {asked} {SHORT}"
        assert morpholab(line)[0] == 0
        assert {call.actuation.weight for call in simulator.calls} == {weight}
        assert weight_of_calibration(folder / "calibration.json") == weight


@pytest.mark.usefixtures("simulator", "rig")
def test_a_run_keeps_its_robot(morpholab, tmp_path):
    morpholab(f"codesign --terrain flat --out published --geometry small {SHORT}")
    morpholab(f"codesign --terrain flat --out fitted --calibration rig.json {SHORT}")
    save_properties(dataclasses.replace(FITTED, friction=1.3), "small", tmp_path / "other.json")
    for folder, given in (("published", "rig.json"), ("fitted", "other.json")):
        code, _, error = morpholab(f"codesign --resume --out {folder} --quiet --calibration {given}")
        assert code == 2 and "error: problem.properties: " in error and error.count("\n") == 1
    code, _, error = morpholab("compare published fitted")
    assert code == 2 and "properties" in error and error.count("\n") == 1


@pytest.mark.usefixtures("rig")
def test_a_folder_that_is_used_again_loses_the_rig_of_before(morpholab, simulator, tmp_path):
    simulator.interrupt_at = 1
    assert morpholab(f"codesign --terrain flat --calibration rig.json --out a {SHORT}")[0] != 0
    assert (tmp_path / "a/calibration.json").exists()
    assert morpholab(f"codesign --terrain flat --geometry small --out a {SHORT}")[0] == 0
    assert not (tmp_path / "a/calibration.json").exists()


@pytest.mark.usefixtures("rig")
def test_views_play_the_robot_of_the_run_or_the_rig(morpholab, simulator, tmp_path, monkeypatch):
    """The geometry is the run's; of a gait's file, the rig's."""
    played = []

    def motion(result, design, terrain, *, actuation, name):
        played.append((simulator.calls[-1].geometry, actuation))
        raise ValueError("enough")

    monkeypatch.setattr("robots.inflatable.view.motion.inflatable_motion", motion)
    other = dataclasses.replace(FITTED, friction=1.3)
    save_properties(other, "published", tmp_path / "other.json")
    morpholab(f"codesign --terrain flat --out a --calibration rig.json {SHORT}")
    for line in ("a", "a --calibration other.json", "a/best.json --calibration other.json", "inching"):
        assert "enough" in morpholab(f"view {line} --out v.html")[2]
    robots = (FITTED.robot(SMALL), other.robot(SMALL), other.robot(), robot_of("published", "published"))
    assert played == [tuple(robot) for robot in robots]


@pytest.mark.usefixtures("rig")
def test_what_a_run_says_of_its_rig(tmp_path):
    run = RobotSubject(GaitProblem((Terrain(),), geometry="small", properties=FITTED))
    told = dict(run.facts)
    assert told["Rig"] == "friction 1.2, low friction 0.3, modulus 3.3e+05 Pa, inflation rate 2 1/s"
    (simulated,) = [line for what, line in run.commands(tmp_path) if what.startswith("Simulate")]
    assert f"--calibration {tmp_path / 'calibration.json'}" in simulated
    assert "Rig" not in dict(RobotSubject(GaitProblem((Terrain(),))).facts)


@pytest.mark.usefixtures("rig")
@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("codesign --terrain flat --out b --calibration none.json", "none.json: cannot be read"),
        ("codesign --terrain flat --out b --encoding graded --calibration stiff.json", TIMED),
        (
            "codesign --out b --robot vehicle --calibration rig.json",
            f"calibration: {OTHER}",
        ),
        ("simulate --gait timed.json --calibration stiff.json", TIMED),
        ("simulate --gait inching --judge --calibration ice.json", "friction: 0.15 of gripping feet is not allowed"),
        (
            "view whegged --out v.html --calibration rig.json",
            f"calibration: {OTHER}",
        ),
    ],
)
def test_bad_lines_are_one_line(morpholab, tmp_path, line, message):
    save_properties(STIFF, "published", tmp_path / "stiff.json")
    save_properties(dataclasses.replace(FITTED, friction=0.15, low_friction=0.01), "small", tmp_path / "ice.json")
    problem = GaitProblem((Terrain(),), columns=2, encoding="graded")
    problem.save(problem.space.sample(np.random.default_rng(0), 1)[0], tmp_path / "timed.json")
    code, out, error = morpholab(line)
    assert (code, out) == (2, "") and error.count("\n") == 1 and f"error: {message}" in error
    assert not (tmp_path / "b").exists()


def test_bounds_of_fits_reach_beyond_the_time_step():
    """So the refusal is no dead code."""
    assert BOUNDS["modulus"][1] > 579_561
