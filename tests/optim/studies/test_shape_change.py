"""The searches of chapter 5 as a study: what they search, that they go on, and what the table says of them."""

import json
import shutil

import numpy as np
import pytest

from optim.experiments.data import Data
from optim.experiments.results import Costs
from optim.runs.history import read_history
from optim.studies.catalogue import STUDIES as CATALOGUE
from optim.studies.chapter5 import study as shape_change
from optim.studies.chapter5.champions import Played
from optim.studies.chapter5.experiments import EXPERIMENTS, PAIRED, ShapeChange
from optim.studies.chapter5.found import Found
from optim.studies.chapter5.gaits import Case, GaitRuns, shown, spread
from optim.studies.chapter5.study import best_on_both, curve, summarise, tests, text_of
from robots.inflatable import INCHING, ROLLING, SMALL
from robots.world import Terrain

tests.__test__ = False
QUICK = ShapeChange(climbers=3, generations=1, copies=2, others=2)
FILES = ("table.md", "table.csv", "curves.csv")


def bytes_of(folder):
    return {name: (folder / name).read_bytes() for name in FILES}


@pytest.fixture
def studied(simulator, tmp_path):
    """The folder of a quick study, and its summary."""
    return tmp_path / "a", shape_change.study(tmp_path / "a", QUICK)


def test_the_experiments_are_the_published_ones():
    settings = ShapeChange()
    problems = {e.name: settings.problem(e) for e in EXPERIMENTS}
    assert len(problems) == 8 and len(PAIRED) == 3
    fixed = {name: (p.terrains[0].name, p.free, p.pressure, p.orientation) for name, p in problems.items()}
    everything = ("orientation", "shape", "control")
    assert fixed == {
        "orientation-shape-control-flat": ("flat", everything, None, None),
        "orientation-shape-control-hill": ("hill:15", everything, None, None),
        "shape-control-flat": ("flat", everything[1:], None, 0.0),
        "shape-control-hill": ("hill:15", everything[1:], None, 90.0),
        "control-flat": ("flat", everything[2:], 12e3, 0.0),
        "control-hill": ("hill:15", everything[2:], 0.0, 90.0),
        "rolling-on-the-hill-by-the-text": ("hill:15", everything[2:], 12e3, 0.0),
        "rolling-on-the-hill-as-run": ("hill:15", everything, None, None),
    }
    assert settings.method(EXPERIMENTS[-1])["start"] == {"orientation": 0.0, "pressure": 12e3}
    assert all("start" not in settings.method(e) for e in EXPERIMENTS[:-1])


@pytest.mark.long
def test_a_study_writes_its_table_curves_and_runs(studied):
    folder, summary = studied
    for name in ("table.md", "table.csv", "curves.png", "curves.csv", "summary.json"):
        assert (folder / name).stat().st_size > 100
    assert json.loads((folder / "summary.json").read_text()) == summary
    assert {path.name for path in (folder / "runs").iterdir()} == {e.name for e in EXPERIMENTS}
    rows = {row["row"]: row for row in summary["rows"]}
    assert len(rows) == 8 and rows["control"]["evaluations"] == 2 * 3 * 2
    assert rows["control"]["generations"] == 1 and rows["control"]["published"]["flat_max"] == 0.1576
    assert rows["changing shape by hand"]["flat_max"] == rows["rolling by hand"]["flat_max"]
    assert rows["changing shape by hand"]["hill_max"] == rows["inching by hand"]["hill_max"]
    assert summary["seconds"]["all"]["cpu"] >= summary["seconds"]["control-flat"]["cpu"] > 0


@pytest.mark.long
def test_the_best_designs_are_simulated_again_and_on_the_other_terrain(studied, simulator):
    _, summary = studied
    rows = {row["row"]: row for row in summary["rows"]}
    for name in PAIRED:
        row, one = rows[name], rows[name]["one_design"]
        assert row["flat_max_again"]["mean"] == pytest.approx(row["flat_max"])  # the stand-in knows no noise
        assert row["combined_max"] == pytest.approx((row["flat_max"] + row["hill_max"]) / 2)
        assert (
            one["combined"] == pytest.approx((one["flat"] + one["hill"]) / 2) and one["combined"] <= row["combined_max"]
        )
    assert rows["rolling on the hill, as run"]["one_design"] is None
    noisy = [call for call in simulator.calls if call.__dict__.get("perturbation")]
    assert {call.precision for call in noisy} == {"f64"} and len(noisy) == 1 + len(EXPERIMENTS)


@pytest.mark.long
def test_a_study_goes_on_after_any_interruption_to_the_same_bytes(studied, simulator, tmp_path):
    folder, _ = studied
    (tmp_path / "b").mkdir()
    (tmp_path / "b/.aside-table.md.123").write_text("what a kill left of a write")
    attempts, done = 0, False
    while not done:
        simulator.calls.clear()
        simulator.interrupt_at = 8  # in the gaits by hand, the searches, what follows them
        try:
            shape_change.study(tmp_path / "b", QUICK)
            done = True
        except KeyboardInterrupt:
            attempts += 1
    assert attempts >= 4
    assert bytes_of(tmp_path / "b") == bytes_of(folder)
    simulator.calls.clear()
    shape_change.study(tmp_path / "b", QUICK)
    assert not simulator.calls


@pytest.mark.long
def test_experiments_take_turns(simulator, tmp_path):
    simulator.interrupt_at = 1 + 8 + 3  # gaits by hand, all starts, then two of the first generation
    with pytest.raises(KeyboardInterrupt):
        shape_change.study(tmp_path / "a", QUICK)
    reached = [len(read_history(tmp_path / "a/runs" / e.name).generations) for e in EXPERIMENTS]
    assert reached == [2, 2, 1, 1, 1, 1, 1, 1]
    assert "| control | 3 x 0 | 6 |" in (tmp_path / "a/table.md").read_text()  # that of the starts is there


@pytest.mark.long
def test_a_study_is_told_again_from_its_speeds_without_its_run_folders(studied, simulator, tmp_path):
    folder, summary = studied
    shutil.rmtree(folder / "runs")
    (tmp_path / "again").mkdir()
    simulator.calls.clear()
    shape_change.rewrite(Data(folder), tmp_path / "again")
    assert bytes_of(tmp_path / "again") == bytes_of(folder)
    again = json.loads((tmp_path / "again/summary.json").read_text())
    assert again == {name: value for name, value in summary.items() if name != "seconds"} and not simulator.calls


@pytest.mark.usefixtures("unseen_pictures")
@pytest.mark.long
@pytest.mark.parametrize("damage", ["a line less", "another name", "another order"])
def test_damaged_speeds_are_refused(studied, tmp_path, damage):
    folder, _ = studied
    path = folder / "speeds.csv"
    header, *rows = path.read_text().splitlines()
    if damage == "a line less":
        del rows[4]
    elif damage == "another name":
        rows = [row.replace("control-hill", "control-hall") for row in rows]
    else:
        rows[0], rows[1] = rows[1], rows[0]
    path.write_text("\n".join([header, *rows]) + "\n")
    with pytest.raises(ValueError, match=r"speeds\.csv: its rows of .* are not those of 3 climbers by generation"):
        shape_change.rewrite(Data(folder), tmp_path / "again")


@pytest.mark.usefixtures("unseen_pictures")
@pytest.mark.long
def test_more_generations_go_on_in_the_same_folder_but_not_fewer(studied):
    folder, _ = studied
    more = ShapeChange(climbers=3, generations=2, copies=2, others=2)
    assert shape_change.study(folder, more)["rows"][0]["generations"] == 2
    with pytest.raises(ValueError, match="generations: 1 is below the 2 of the run"):
        shape_change.study(folder, QUICK)
    with pytest.raises(ValueError, match="holds a comparison of other settings"):
        shape_change.study(folder, ShapeChange(climbers=4, generations=2))


@pytest.mark.long
def test_while_searches_go_on_the_table_keeps_what_was_played_of_their_designs(studied, simulator):
    folder, before = studied
    simulator.calls.clear()
    simulator.interrupt_at = len(EXPERIMENTS) + 1
    with pytest.raises(KeyboardInterrupt):
        shape_change.study(folder, ShapeChange(climbers=3, generations=3, copies=2, others=2))
    summary = json.loads((folder / "summary.json").read_text())
    row, old = summary["rows"][0], before["rows"][0]
    assert (row["generations"], summary["played"]) == (2, 1) and "gone on" not in text_of(before)
    assert row["flat_max_again"] == old["flat_max_again"] and row["one_design"] == old["one_design"]
    assert "are those after generation 1; the searches have gone on." in (folder / "table.md").read_text()


@pytest.mark.usefixtures("unseen_pictures")
@pytest.mark.long
def test_all_that_is_played_is_the_robot_and_the_gait_of_the_settings(simulator, tmp_path):
    settings = ShapeChange(climbers=3, generations=1, copies=2, others=2, geometry="small", repeats=1)
    shape_change.study(tmp_path / "a", settings)
    assert all(call.geometry == SMALL for call in simulator.calls)
    assert {design.schedule.repeats for call in simulator.calls for design in call.designs} == {1}


@pytest.mark.long
@pytest.mark.parametrize(
    "name", ["shape-change", "friction-sweeps", "slope-sweep", "hand-gait-sensitivity", "soft-robot-metrics"]
)
def test_studies_write_what_the_catalogue_says(simulator, tmp_path, morpholab, name):
    assert morpholab(f"reproduce {name} --budget small --out a --quiet")[0] == 0
    for written in CATALOGUE[name].writes:
        assert (tmp_path / "a" / written).exists(), written


@pytest.mark.usefixtures("unseen_pictures")
@pytest.mark.long
def test_a_study_in_which_every_simulation_fails_has_a_table_all_the_same(simulator, tmp_path):
    simulator.diverges = lambda design, terrain: True
    summary = shape_change.study(tmp_path / "a", QUICK)
    assert all(row["flat_max"] is None for row in summary["rows"] if "flat_max" in row) and summary["tests"] == []
    assert "all diverged" in (tmp_path / "a/table.md").read_text()


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"climbers": 0}, "climbers: 0 is not allowed; give a whole number, at least 2"),
        ({"generations": -1}, "generations: -1 is not allowed"),
        ({"copies": 0}, "copies: 0 is not allowed"),
        ({"slope": 50}, "slope: 50 is not allowed; give a number from 0.1 to 45 degrees"),
        ({"geometry": "round"}, "geometry: 'round' is unknown; choose one of published, small$"),
        ({"geometry": "two-core"}, "geometry: 'two-core' is unknown; choose one of published, small$"),
    ],
)
def test_bad_settings_are_one_line(setting, message):
    with pytest.raises(ValueError, match=message) as error:
        ShapeChange(**setting)
    assert "\n" not in str(error.value)


def test_budgets_that_a_study_does_not_have_are_refused(morpholab, tmp_path):
    code, _, error = morpholab("reproduce friction-sweeps --budget medium --out a")
    assert code == 2 and "budget: 'medium' is unknown; choose one of small, full" in error and error.count("\n") == 1
    assert not (tmp_path / "a").exists()


def made_up(scores, row=0):
    return Found(np.array(scores, float), (INCHING,) * len(scores[0]), np.size(scores))


def test_rows_tests_and_curves_of_made_up_searches():
    flat = made_up([[0.0, 0.1, np.nan], [0.1, 0.3, np.nan]])
    hill = made_up([[-0.2, 0.0, 0.0], [0.0, 0.02, 0.01]])
    control = made_up([[-0.5, -0.4], [-0.3, -0.1]])
    found = {
        "orientation-shape-control-flat": flat,
        "orientation-shape-control-hill": hill,
        "rolling-on-the-hill-by-the-text": control,
    }
    summary = summarise(ShapeChange(), found, Played({}))
    row = summary["rows"][0]
    assert (row["flat_mean"], row["flat_max"], row["hill_mean"], row["hill_max"]) == pytest.approx(
        (0.2, 0.3, 0.01, 0.02)
    )
    assert row["combined_max"] == pytest.approx(0.16) and row["evaluations"] == 12
    (test,) = summary["tests"]
    # Welch by hand: means 0.01 and -0.2, variances 0.0001 / 3 and 0.02 / 2
    assert test["welch"]["t"] == pytest.approx(0.21 / np.sqrt(0.0001 / 3 + 0.01))
    assert test["effect"]["difference"] == pytest.approx(0.21) and test["climbers"] == [2, 3]
    assert test["paired"] is None  # of other numbers of climbers
    assert curve(flat.scores)["mean"] == pytest.approx([0.05, 0.2]) and curve(flat.scores)["max"] == [0.1, 0.3]
    assert "| orientation, shape, control | 60 x 1 | 12 | 0.2000 (0.0791) | 0.3000 (0.1888) |" in text_of(summary)


def test_the_best_single_design_is_the_best_mean_and_failures_never_win():
    flat = np.array([[0.2, 0.1, 0.3], [-0.5, 0.0, np.nan]])  # own, other
    hill = np.array([[0.02, 0.01], [0.05, 0.1]])
    assert best_on_both({"flat": flat}) == {"combined": 0.05, "flat": 0.1, "hill": 0.0, "found_on": "flat"}
    assert best_on_both({"flat": flat, "hill": hill})["found_on"] == "hill"
    assert best_on_both({"hill": hill})["flat"] == 0.1
    assert best_on_both({"flat": flat[:, 2:]}) is None and best_on_both({}) is None


def test_the_best_climbers_are_those_that_did_not_fail():
    assert made_up([[0.1, np.nan, 0.3, 0.2]]).best(3) == [2, 3, 0]
    assert made_up([[0.1, np.nan, 0.3, 0.2]]).best(9) == [2, 3, 0]


def test_copies_of_a_case_lie_side_by_side(simulator):
    cases = [Case(ROLLING, Terrain()), Case(INCHING, Terrain(15))]
    speeds = GaitRuns(copies=3).speeds(cases)
    assert speeds.shape == (2, 3) and (speeds == speeds[:, :1]).all() and speeds[0, 0] != speeds[1, 0]
    (call,) = simulator.calls
    assert (call.perturbation, call.precision) == (1e-8, "f64")


def test_a_case_does_not_tell_which_folder_keeps_its_ground(tmp_path):
    case = Case(ROLLING, Terrain(5.0, ground="hills.npy:0.01", folder=tmp_path))
    assert json.loads(json.dumps(case.describe()))["terrain"] == {"slope": 5.0, "ground": "hills.npy:0.01"}


def test_a_spread_tells_of_copies_that_diverged():
    assert spread([0.1, 0.3, np.nan])["mean"] == pytest.approx(0.2)
    assert shown(spread([0.1, 0.3, np.nan])) == "0.2000 ± 0.1414 (1 of 3 diverged)"
    assert shown(spread([0.1])) == "0.1000" and shown(spread([np.nan])) == "all diverged"


def test_costs_add_up_over_processes_and_survive_a_torn_line(tmp_path):
    with Costs(tmp_path / "costs").of("a"):
        pass
    with (tmp_path / "costs").open("a") as file:
        file.write('{"part": "a", "wa')
    costs = Costs(tmp_path / "costs")
    with costs.of("b"):
        sum(range(10**6))
    found = costs.total()
    assert list(found) == ["a", "all", "b"] and found["all"]["cpu"] == found["a"]["cpu"] + found["b"]["cpu"] > 0


def test_climbers_that_drew_the_same_numbers_are_compared_in_pairs():
    found = {
        "orientation-shape-control-hill": made_up([[0.0, 0.03, np.nan, 0.0]]),
        "rolling-on-the-hill-as-run": made_up([[-0.2, -0.1, 0.0, np.nan]]),
    }
    (test,) = tests(found)
    paired = test["paired"]
    assert paired["climbers"] == 2 and paired["difference"] == pytest.approx(0.165)
    assert paired["low"] == pytest.approx(0.13) and paired["high"] == pytest.approx(0.2)
    found["rolling-on-the-hill-by-the-text"] = found.pop("rolling-on-the-hill-as-run")
    assert tests(found)[0]["paired"] is None  # it searches other variables, for which the numbers are others


def test_curves_count_climbers_from_when_they_have_found_anything():
    found = curve(np.array([[np.nan, np.nan, 0.1], [np.nan, 0.5, 0.1], [np.nan, 0.5, 0.3]]))
    assert found["mean"] == pytest.approx([0.1, 0.3, 0.4]) and found["max"] == [0.1, 0.5, 0.5]
    assert curve(np.array([[np.nan], [0.1]]))["low"] == [None, pytest.approx(0.1)]
