"""Studies of rolling and inching, and of sampled gaits: frictions, slopes, other parameters, metrics of bodies."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from graded import QUICK, TINY

from optim.experiments.data import Data
from optim.studies.chapter5 import friction, hardware_friction, metrics, sensitivity, slopes
from optim.studies.chapter5.gaits import Case, GaitRuns
from optim.studies.chapter5.metrics import draw
from optim.studies.chapter5.sensitivity import VARIATIONS, retimed, with_duration, with_pressure, with_voxels
from robots.inflatable import ACTUATION, PUBLISHED, SMALL, InflatableDesign
from robots.inflatable.schedule import GaitSchedule
from robots.inflatable.simulation import travel_directions
from robots.inflatable.timing import nominal_steps
from robots.world import Terrain
from taichi_sim.base.results_folder import ResultsFolder

TWO = GaitRuns(copies=2)


def gaits_of(simulator):
    return [
        (design.pressure, terrain)
        for call in simulator.calls
        for design, terrain in zip(call.designs, call.terrain, strict=True)
    ]


@pytest.mark.long
def test_friction_sweeps_are_the_published_points(simulator, tmp_path):
    summary = friction.study(tmp_path / "a", friction.FrictionSweeps(TWO))
    frictions = [(terrain.low_friction, terrain.high_friction) for _, terrain in gaits_of(simulator)]
    assert (
        len(frictions) == 24 and frictions[:3] == [(1e-4, 2.0), (1e-4, 2.0), (0.2, 1.8)] and frictions[-1] == (2.0, 4.0)
    )
    assert all(pressure == 0 and terrain.slope == 0 for pressure, terrain in gaits_of(simulator))
    assert len(summary["rows"]) == 12 and summary["rows"][0]["published"] == 0.0603
    for name in ("friction.md", "friction.csv", "friction.png", "summary.json"):
        assert (tmp_path / "a" / name).stat().st_size > 100
    simulator.calls.clear()
    friction.study(tmp_path / "a", friction.FrictionSweeps(TWO))
    assert not simulator.calls


def test_the_committed_speeds_of_friction_sweeps_make_their_table_and_nothing_is_played(simulator, tmp_path):
    """A folder of version 1.0, whose settings knew fewer fields, goes on."""
    shutil.copytree(Path(__file__).parents[3] / "docs/data/friction-sweeps", tmp_path / "a")
    summary = friction.study(tmp_path / "a", friction.STUDY.scales["full"])
    assert not simulator.calls and len(summary["rows"]) == 12
    assert summary["largest_deviation"]["within"] == 12 and summary["rows"][0]["mean"] == pytest.approx(
        0.0603, abs=1e-3
    )


def test_the_largest_deviation_from_the_published_speeds_is_told():
    settings = friction.FrictionSweeps(TWO, {"difference": [(0.0, 2.0, 0.06), (0.5, 1.5, 0.03), (1.0, 1.0, 0.0)]})
    rows = friction.rows_of(settings.listed, np.array([[0.061, 0.063], [0.02, 0.03], [np.nan, np.nan]]))
    worst = friction.largest_deviation(rows)
    assert worst == {"low": 0.5, "high": 1.5, "difference": pytest.approx(-0.005), "within": 1, "of": 3}
    text = friction.text_of(rows, worst)
    assert "| difference | 0 | 2 | 0.0620 ± 0.0014 | 0.0600 | +0.0020 |" in text and "all diverged" in text
    assert "1 of 3 points are within 0.004" in text


def test_a_crossing_is_interpolated_where_inching_first_overtakes():
    assert slopes.crossing([0.0, 5.0, 10.0], np.array([0.1, 0.05, -0.05])) == pytest.approx((7.5, 5.0, 10.0))
    assert slopes.crossing([0.0, 1.0, 2.0, 3.0], np.array([1.0, -1.0, 1.0, -1.0])) == pytest.approx((0.5, 0.0, 1.0))
    assert slopes.crossing([0.0, 4.0, 8.0], np.array([0.1, 0.0, -0.1])) == (4.0, 4.0, 8.0)
    assert slopes.crossing([0.0, 1.0], np.array([0.2, 0.1])) is None
    assert slopes.crossing([0.0, 1.0], np.array([-0.2, -0.1])) is None


def test_the_transition_has_the_uncertainty_of_its_copies():
    rolling = np.array([[0.2] * 5, [0.04, 0.05, 0.06, 0.03, 0.07], [-0.1] * 5])
    inching = np.full((3, 5), 0.05)
    found = slopes.transition([0, 4, 8], rolling, inching)
    assert found["slope"] == pytest.approx(4.0) and found["low"] < 4.0 < found["high"] and found["cross"] == 1.0
    few = slopes.transition([0, 4, 8], rolling[:, :4], inching[:, :4])
    assert few["slope"] < 4.0 and few["low"] is few["high"] is few["cross"] is None
    assert slopes.transition([0, 4, 8], rolling + 1, inching) is None


def test_copies_that_diverge_leave_the_others_and_their_slopes():
    rolling, inching = np.array([[0.2] * 6, [0.04, 0.06] * 3, [-0.1] * 6]), np.full((3, 6), 0.05)
    rolling[1, 0] = np.nan
    found = slopes.transition([0, 4, 8], rolling, inching)
    assert found["slope"] == pytest.approx(4 + 4 * 0.002 / 0.152) and found["low"] <= found["slope"] <= found["high"]
    rolling[1] = np.nan
    found = slopes.transition([0, 4, 8], rolling, inching)
    assert found["slope"] == pytest.approx(4.0) and found["between"] == [0.0, 8.0]
    assert slopes.transition([0, 4, 8], np.full((3, 2), np.nan), inching[:, :2]) is None


def test_slopes_at_which_a_gait_has_no_speed_are_told(simulator, tmp_path):
    simulator.diverges = lambda design, terrain: design.pressure > 0 and terrain.slope == 7.5
    summary = slopes.study(tmp_path / "a", slopes.SlopeSweep((0.0, 7.5, 15.0), TWO))
    assert summary["unknown"] == [7.5]
    text = (tmp_path / "a/slopes.md").read_text()
    assert "| 7.5 | all diverged |" in text
    assert text.endswith(" Left out: 7.5 degrees, where all copies of a gait diverged.\n")


def test_slopes_are_studied_for_both_gaits(simulator, tmp_path):
    summary = slopes.study(tmp_path / "a", slopes.SlopeSweep((0.0, 7.5, 15.0), TWO))
    assert [(row["slope"], row["gait"]) for row in summary["rows"][:3]] == [
        (0, "rolling"),
        (0, "inching"),
        (7.5, "rolling"),
    ]
    assert {(pressure, terrain.slope) for pressure, terrain in gaits_of(simulator)} == {
        (pressure, slope) for pressure in (12e3, 0.0) for slope in (0.0, 7.5, 15.0)
    }
    assert (tmp_path / "a/slopes.png").exists() and "| 7.5 |" in (tmp_path / "a/slopes.md").read_text()


@pytest.mark.parametrize("name", VARIATIONS)
def test_a_changed_robot_plays_its_gait_in_the_same_time(name):
    changed = VARIATIONS[name](0.8 if name != "voxels per bladder" else 2 / 3)
    seconds = nominal_steps(16, changed.actuation) * changed.geometry.time_step
    assert seconds == pytest.approx(19.7968 * (0.8 if name == "duration" else 1.0), rel=2e-4)
    assert changed != VARIATIONS[name](1.0)


def test_nothing_changes_with_a_factor_of_one():
    for vary in VARIATIONS.values():
        one = vary(1.0)
        assert (one.pressure, one.actuation) == (12e3, ACTUATION)
        sizes = [
            [
                getattr(g, name)
                for name in (
                    "rows",
                    "foot_rows",
                    "bladder_columns",
                    "bladder_layers",
                    "voxel_size",
                    "youngs_modulus",
                    "bladder_modulus",
                    "density",
                )
            ]
            for g in (one.geometry, PUBLISHED)
        ]
        assert sizes[0] == pytest.approx(sizes[1])


def test_finer_voxels_keep_size_weight_and_stiffness():
    fine = with_voxels(4 / 3).geometry
    assert fine.bladder_columns == 4 and fine.columns * fine.voxel_size == pytest.approx(0.15)
    assert fine.body_length == pytest.approx(0.22, abs=0.002)
    assert fine.density * fine.voxel_size == pytest.approx(PUBLISHED.density * PUBLISHED.voxel_size)
    stiffness = [g.youngs_modulus * g.voxel_size**3 for g in (fine, PUBLISHED)]
    assert stiffness[0] == pytest.approx(stiffness[1])


def test_a_slower_gait_has_more_steps_of_smaller_rates():
    slow = retimed(2.0)
    assert slow.settle_steps == 8002 and slow.inflation_rate == pytest.approx(1.5e-4)
    assert with_duration(2.0).geometry == PUBLISHED
    assert with_pressure(0.5).pressure == with_pressure(0.5).actuation.round_pressure == 6000


def test_settings_build_no_body(monkeypatch):
    """Budgets are made when the module is imported, which whoever lists the studies does: bodies took a second."""
    monkeypatch.setattr(type(PUBLISHED), "body", property(lambda _: pytest.fail("a body was built")))
    assert len(sensitivity.Sensitivity().variants) == 22


@pytest.mark.parametrize(
    ("factors", "message"),
    [
        ({"modulus": (2.0,)}, "factors: 'modulus' is unknown; choose of Young's modulus, density"),
        ({"density": (0.0,)}, "density: 0.0 is not allowed"),
        ({"time step": (1.4,)}, "time step: a factor of 1.4 is not allowed; .* at most 1.3"),
        ({"maximum pressure": (2.0,)}, "maximum pressure: a factor of 2 is not allowed; .* at most 1.25"),
        ({"voxels per bladder": (0.1,)}, "voxels per bladder: a factor of 0.1 is not allowed; it leaves none"),
    ],
)
def test_variations_that_are_not_allowed_are_one_line(factors, message):
    with pytest.raises(ValueError, match=message) as error:
        sensitivity.Sensitivity(factors)
    assert "\n" not in str(error.value)


def test_a_behaviour_survives_with_half_the_distance_and_all_copies():
    usual = np.array([[2.0, 2.2], [1.0, 1.0]])
    found = {
        ("unchanged", 1.0): usual,
        ("density", 2.0): np.array([[1.0, 1.2], [0.4, 0.5]]),
        ("density", 0.5): np.array([[2.0, np.nan], [0.9, 1.0]]),
    }
    rows = sensitivity.rows_of(found, ("rolling", "inching"))
    assert [row["survives"] for row in rows] == [True, True, True, False, False, True]
    assert rows[2]["share"] == pytest.approx(1.1 / 2.1)
    text = sensitivity.text_of(rows)
    assert "**2.0000 (1 of 2 diverged), 0.95**" in text and "2 of 4 behaviours survive." in text


def test_where_the_unchanged_robot_gets_nowhere_nothing_survives_or_dies():
    """One that slides down three times as far has not three times the distance, one that climbs has not lost it."""
    usual, heavy, light = [[-0.1, -0.1], [1.0, 1.0]], [[-0.3, -0.3], [0.4, 0.4]], [[0.5, 0.5], [1.0, 1.0]]
    found = {("unchanged", 1.0): usual, ("density", 2.0): heavy, ("density", 0.5): light}
    found = {change: np.array(lengths) for change, lengths in found.items()}
    rows = sensitivity.rows_of(found, ("rolling", "inching"))
    assert [row["share"] for row in rows] == [None, 1.0, None, 0.4, None, 1.0]
    assert [row["survives"] for row in rows] == [None, True, None, False, None, True]
    text = sensitivity.text_of(rows)
    assert "1 of 2 behaviours survive." in text and text.count("**") == 4  # "Bold" among them


def test_sensitivity_is_studied_robot_by_robot(simulator, tmp_path):
    settings = sensitivity.Sensitivity({"maximum pressure": (0.5,), "density": (2.0,)}, TWO, repeats=1)
    summary = sensitivity.study(tmp_path / "a", settings)
    assert [max(d.pressure for d in call.designs) for call in simulator.calls] == [12e3, 6e3, 12e3]
    assert [call.geometry.density for call in simulator.calls] == [3000.0, 3000.0, 6000.0]
    assert len(summary["rows"]) == 9 and summary["rows"][0]["share"] == 1.0
    unchanged = simulator.calls[0]
    speed = simulator(unchanged.designs[:1], unchanged.terrain[:1]).speed[0]
    assert summary["rows"][0]["mean"] == pytest.approx(speed * nominal_steps(8) * PUBLISHED.time_step)
    simulator.calls.clear()
    more = {"density": (2.0, 0.5)}
    sensitivity.study(tmp_path / "a", replace(settings, factors=more))
    assert [call.geometry.density for call in simulator.calls] == [1500.0]
    assert (tmp_path / "a/sensitivity.png").exists()


SOME = {
    friction: friction.FrictionSweeps(TWO),
    slopes: slopes.SlopeSweep((0.0, 15.0), TWO),
    sensitivity: sensitivity.Sensitivity({"density": (2.0,)}, TWO, repeats=1),
    hardware_friction: replace(hardware_friction.STUDY.scales["small"], robot=TWO),
}


@pytest.mark.long
@pytest.mark.parametrize("module", SOME, ids=lambda module: module.__name__.rpartition(".")[2])
@pytest.mark.parametrize("damage", [lambda kept: kept[1:], lambda kept: np.where(kept == kept.max(), np.inf, kept)])
def test_speeds_that_no_robot_can_have_are_played_again(simulator, tmp_path, module, damage):
    """A row less, or an infinite one, goes into no table."""
    module.study(tmp_path / "a", SOME[module])
    tables = {path.name: path.read_bytes() for path in (tmp_path / "a").glob("*.csv")}
    (path, *_) = sorted((tmp_path / "a").rglob("*.npz"))
    with np.load(path) as kept:
        (name,) = (each for each in kept.files if each in ("speeds", "lengths"))
        np.savez(path, **{name: damage(kept[name])})
    with pytest.warns(UserWarning, match=rf"{path.name}: is damaged, and as good as missing \({name}: "):
        module.study(tmp_path / "a", SOME[module])
    assert tables and {path.name: path.read_bytes() for path in (tmp_path / "a").glob("*.csv")} == tables


def test_metrics_of_made_up_gaits(monkeypatch):
    """Gaits that succeed on flat ground, on the hill, on both, on neither, and one that failed."""
    speeds = np.array([[[0.03, 0.0, 0.03, -0.1, np.nan], [-0.1, 0.01, 0.01, -0.1, 0.1]]])
    rows = {row["threshold"]: row for row in metrics.rows_of([(6e3, 45.0)], speeds)}
    found = rows["climbing"]
    assert (found["flat"], found["hill"], found["both"], found["failed"]) == (2, 3, 1, 1)
    assert found["M_L"] == pytest.approx(1 / 5) and found["M_CI"] == pytest.approx(1 / 4)
    assert found["M_L_low"] < 0.2 < found["M_L_high"]
    assert (rows["strict"]["flat"], rows["strict"]["M_L"]) == (0, 0.0)
    monkeypatch.setattr(metrics, "THRESHOLDS", {"high": (1.0, 1.0)})
    (row,) = metrics.rows_of([(6e3, 45.0)], speeds)
    assert (row["flat"], row["hill"], row["both"]) == (0, 0, 0)


def test_bodies_without_success_have_no_interference_and_few_bodies_no_certainty(tmp_path):
    """The smallest body fails everywhere; of the others learnability and interference go together."""
    speeds = np.full((11, 2, 12), -0.1)
    for body in range(1, 11):
        speeds[body, 0, :11], speeds[body, 1, :body] = 0.1, 0.1
    rows = metrics.rows_of([(1e3 * body, 0.0) for body in range(11)], speeds)
    lenient = [row for row in rows if row["threshold"] == "lenient"]
    assert [lenient[0][name] for name in ("M_L", "M_CI", "M_CI_low", "M_CI_high")] == [0.0, None, None, None]
    assert lenient[10]["M_CI"] == pytest.approx(10 / 11)
    many, few = metrics.correlations(rows)["lenient"], metrics.correlations(rows[:10] + rows[11:15])["lenient"]
    assert (many["n"], many["r"]) == (10, pytest.approx(1.0)) and many["p"] < 1e-6
    assert few["n"] == 9 and few["r"] == pytest.approx(1.0) and few["p"] is few["low"] is few["high"] is None
    draw(rows, tmp_path / "metrics.png")
    assert (tmp_path / "metrics.png").stat().st_size > 10_000


@pytest.mark.long
def test_metrics_are_studied_body_by_body_with_the_same_gaits(simulator, tmp_path):
    settings = metrics.SoftRobotMetrics((0.0, 12e3), (0.0, 90.0), gaits=5)
    summary = metrics.study(tmp_path / "a", settings)
    assert len(simulator.calls) == 6 and all(len(call.designs) == 5 for call in simulator.calls)
    texts = {tuple(design.schedule.to_text() for design in call.designs) for call in simulator.calls}
    assert len(texts) == 1
    assert [call.terrain[0].slope for call in simulator.calls] == [0.0] * 2 + [15.0] * 4
    assert len(summary["rows"]) == 12 and json.loads((tmp_path / "a/summary.json").read_text()) == summary
    simulator.calls.clear()
    metrics.study(tmp_path / "a", replace(settings, pressures=(0.0, 6e3, 12e3)))  # more bodies
    assert [call.designs[0].pressure for call in simulator.calls] == [6e3, 6e3, 6e3]
    with pytest.raises(ValueError, match="holds soft-robot-metrics of other settings"):
        metrics.study(tmp_path / "a", replace(settings, gaits=6))


@pytest.mark.kernels
def test_one_run_on_flat_ground_tells_the_speeds_of_all_orientations(monkeypatch):
    """By the simulator itself, one short gait."""
    monkeypatch.setattr(metrics.SoftRobotMetrics, "schedules", [GaitSchedule(np.eye(10, 8, dtype=bool), 1)])
    robot = GaitRuns(geometry=TINY, actuation=QUICK, copies=1, noise=0.0)
    settings = metrics.SoftRobotMetrics((0.0,), (0.0, 30.0, 90.0), gaits=1, robot=robot)
    ways = metrics.on_flat(settings, 0.0, None, None)
    cases = [
        Case(InflatableDesign(0.0, heading, settings.schedules[0]), Terrain()) for heading in settings.orientations
    ]
    counted = nominal_steps(16, QUICK) * TINY.time_step
    speeds = robot.play(cases).distance / (TINY.body_length * counted)
    found = travel_directions(np.array(settings.orientations)) @ ways[:, 0]
    assert found == pytest.approx(speeds, rel=1e-3) and (found != 0).all()


SMALL_STUDIES = {
    friction: friction.FrictionSweeps(TWO),
    slopes: slopes.SlopeSweep((0.0, 7.5, 15.0), GaitRuns(copies=3)),
    sensitivity: sensitivity.Sensitivity({"density": (0.5, 2.0), "voxels per bladder": (2 / 3,)}, TWO),
    metrics: metrics.SoftRobotMetrics((0.0, 12e3), (22.5, 90.0), gaits=5),
}


def told_again(study, data, folder):
    """What a study makes of the data in a folder, by name."""
    folder.mkdir(exist_ok=True)
    study.STUDY.rewrite(Data(data), folder)
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.long
@pytest.mark.parametrize("study", SMALL_STUDIES, ids=lambda study: study.NAME)
def test_a_study_is_told_again_from_what_its_folder_keeps(simulator, tmp_path, study):
    study.study(tmp_path / "a", SMALL_STUDIES[study])
    simulator.calls.clear()
    found = told_again(study, tmp_path / "a", tmp_path / "b")
    assert set(found) == set(study.STUDY.writes) and not simulator.calls
    for name, content in found.items():
        assert content == (tmp_path / "a" / name).read_bytes(), name


@pytest.mark.long
@pytest.mark.parametrize(
    ("study", "part", "message"),
    [
        (friction, "speeds_1", "its part speeds_1 is missing"),
        (slopes, "slope-sweep", "holds no slope-sweep"),
        (sensitivity, "unchanged_1", "its part unchanged_1 is missing"),
        (metrics, "flat_12000", "its part flat_12000 is missing"),
        (metrics, "hill_0_22.5", "its part hill_0_22.5 is missing"),
    ],
)
def test_a_part_that_is_missing_is_told(simulator, tmp_path, study, part, message):
    study.study(tmp_path / "a", SMALL_STUDIES[study])
    (lost,) = [path for path in (tmp_path / "a").iterdir() if path.stem == part or path.name.startswith(f"{part}-")]
    lost.unlink()
    with pytest.raises(ValueError) as error:
        told_again(study, tmp_path / "a", tmp_path / "b")
    assert str(error.value) == f"{tmp_path / 'a'}: {message}"
    assert not list((tmp_path / "b").iterdir())


@pytest.mark.parametrize(
    ("study", "kept", "message"),
    [
        (friction, {"cases": []}, "friction-sweeps.json: cases: none is there; give at least one"),
        (friction, {}, "friction-sweeps.json: 'cases' is missing"),
        (
            friction,
            {"cases": [{"terrain": {"low_friction": 0.5, "high_friction": 1.0}}]},
            "friction-sweeps.json: cases: friction of 0.5 and 1.0 is none of the published points",
        ),
        (slopes, {"slopes": [3.0, 0.0]}, "slope-sweep.json: slopes: (3.0, 0.0) are not allowed; give at least two"),
        (
            friction,
            {"cases": [{"terrain": {"low_friction": 0.2, "high_friction": 1.8}}]},
            "its parts have 2 cases of 8 copies; give 1 of as many each",
        ),
        (sensitivity, {"robot": {}}, "hand-gait-sensitivity.json: 'repeats' is missing"),
        (metrics, {"gaits": 5, "slope": 15.0, "seed": 1}, "a part has speeds of shape (2, 2), not of 5 gaits"),
    ],
)
def test_settings_that_do_not_fit_their_parts_are_told(tmp_path, study, kept, message):
    folder = ResultsFolder(tmp_path / "a", study.NAME, kept)
    for number in range(3):
        folder.add(f"speeds_{number}", b"", speeds=np.zeros((2, 8)))
    folder.add("flat_0", b"", speeds=np.zeros((2, 2)))
    folder.add("hill_0_0", b"", speeds=np.zeros(2))
    with pytest.raises(ValueError) as error:
        told_again(study, tmp_path / "a", tmp_path / "b")
    assert message in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: GaitRuns(copies=0), "copies: 0 is not allowed; give a whole number, at least 1"),
        (lambda: GaitRuns(noise=1.0), "noise: 1.0 is not allowed; give a number from 0 to 0.01 m"),
        (lambda: slopes.SlopeSweep((0.0, 60.0)), "slope: 60.0 is not allowed; .* from -45 to 45 degrees"),
        (lambda: slopes.SlopeSweep((5.0, 5.0)), "slopes: .* are not allowed; give at least two, ascending"),
        (lambda: friction.FrictionSweeps(TWO, {"sum": ()}), "points: sweep 'sum' is unknown; choose of diff"),
        (lambda: friction.FrictionSweeps(TWO, {"mean": ()}), "points: sweep mean has none; give at least one"),
        (lambda: sensitivity.Sensitivity(repeats=0), "repeats: 0 is not allowed"),
        (lambda: sensitivity.Sensitivity(robot=GaitRuns(SMALL)), "robot: another geometry or actuation is not allowed"),
        (lambda: metrics.SoftRobotMetrics(gaits=0), "gaits: 0 is not allowed"),
        (lambda: metrics.SoftRobotMetrics(robot=TWO), "robot: 2 copies with noise of 1e-08 m are not allowed"),
        (lambda: metrics.SoftRobotMetrics(pressures=(16e3,)), "pressure: 16000.0 is not allowed; .* to 15000 Pa"),
        (lambda: metrics.SoftRobotMetrics(orientations=()), r"orientations: \(\) are not allowed; give at least one"),
    ],
)
def test_bad_settings_are_one_line(make, message):
    with pytest.raises(ValueError, match=message) as error:
        make()
    assert "\n" not in str(error.value)
