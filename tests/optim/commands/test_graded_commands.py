"""Graded gaits on the command line: searched, simulated, drawn, exported and reported as binary ones are."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from graded import settling, tabled
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from run_products import log, products

from optim.problems.inflatable.graded_encoding import LEAST_MOTION
from robots.hardware import read_csv
from robots.inflatable import INCHING
from robots.inflatable.design import InflatableDesign, load_design, save_design
from robots.inflatable.robustness import GaitJudgement
from robots.inflatable.timing import gait_timeline
from robots.inflatable.view.schedule_chart import draw_schedule
from robots.view import scene
from robots.world import Terrain

SEARCH = "--terrain flat --encoding graded --columns 2 --climbers 3 --generations 3 --geometry small --seed 2 --quiet"
SMALL = "--geometry small"
SINGLE = f"{SMALL} --precision f32"  # as pictures are made in
REAL = f"{SMALL} --columns 1 --repeats 1 --threads 1"
BRIEF = settling(np.repeat([[0.05, 0.1], [0.0, 0.02]], 5, axis=0), [40, 0], 2)


@pytest.fixture
def brief(tmp_path):
    """The file of a gait that takes little time."""
    save_design(InflatableDesign(0.0, 90.0, BRIEF), tmp_path / "brief.json")
    return tmp_path / "brief.json"


@pytest.mark.usefixtures("simulator")
def test_a_search_ends_with_the_files_of_its_gait_and_can_be_resumed(morpholab, tmp_path):
    code, out, _ = morpholab(f"codesign {SEARCH} --steps 60000 --out runs/a --json")
    assert code == 0 and json.loads(out)["files"] == ["best.json", "gait.csv", "robot_flat.png"]
    best = load_design(tmp_path / "runs/a/best.json")
    assert isinstance(best, InflatableDesign) and best.schedule.columns == 2 and best.schedule.has_own_times
    assert read_csv(tmp_path / "runs/a/gait.csv").design.schedule == best.schedule
    config = (tmp_path / "runs/a/config.toml").read_text()
    assert 'encoding = "graded"' in config and "steps = 60000" in config
    assert morpholab(f"codesign {SEARCH.replace('generations 3', 'generations 1')} --steps 60000 --out runs/b")[0] == 0
    assert morpholab("codesign --resume --generations 3 --out runs/b --quiet")[0] == 0
    ours, theirs = (products(tmp_path / "runs" / name) for name in "ba")
    assert ours["best.json"] == theirs["best.json"] and ours["gait.csv"] == theirs["gait.csv"]
    code, _, error = morpholab("codesign --resume --steps 50000 --out runs/b --quiet")
    assert code == 2 and "problem.steps" in error
    assert morpholab("export runs/a --csv a.csv")[0] == 0
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "runs/a/gait.csv").read_bytes()
    code, out, _ = morpholab("report runs/a --no-player --out page.html --json --quiet")
    page = (tmp_path / "page.html").read_text()
    assert code == 0 and "as often as 60,000 time steps allow, encoded as graded" in page
    assert json.loads(out)["design"]["terrains"][0]["speed"] == log(tmp_path / "runs/a")[-1]["best"]


@pytest.mark.usefixtures("simulator")
def test_a_graded_gait_can_be_what_is_not_free(morpholab, tmp_path, brief):
    line = "codesign --terrain flat --free shape --gait brief.json --climbers 2 --generations 1 --quiet"
    assert morpholab(f"{line} --repeats 1 --out a")[0] == 0
    assert load_design(tmp_path / "a/best.json").schedule == BRIEF.cut(None, 1)
    assert morpholab("codesign --resume --generations 2 --out a --quiet")[0] == 0


@pytest.mark.usefixtures("simulator")
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("--encoding graded --repeats 3", "repeats: 3 is not allowed; graded gaits are played as often as --steps"),
        ("--encoding bits --steps 9", "steps: 9 is not allowed with encoding 'bits'; they are of a free graded gait"),
        ("--free shape --gait brief.json --steps 9", "steps: 9 is not allowed with a fixed gait; they are of a free"),
        ("--free shape --gait brief.json --columns 3", "columns: 3 is not allowed; the gait has 2"),
        ("--encoding graded --steps 0", "argument --steps: 0 is not allowed; give a whole number, at least 1"),
    ],
)
def test_options_that_do_not_fit_are_one_line(morpholab, brief, options, message):
    code, _, error = morpholab(f"codesign --terrain flat {options} --out a --quiet")
    assert code == 2 and error.splitlines()[-1].startswith(f"morpholab codesign: error: {message}")


@pytest.mark.kernels
def test_simulate_takes_files_and_rows_and_writes_what_it_writes_of_others(morpholab, tmp_path, brief):
    code, out, err = morpholab(f"simulate --gait brief.json --slope 5 --out a --record-every 200 --json {SINGLE}")
    assert code == 0, err
    document = json.loads(out)
    assert code == 0 and document["status"] == "ok" and document["repeats"] == 2
    assert json.loads(document["schedule"])["settle_steps"] == [40, 0]
    assert document["steps"] == gait_timeline(load_design(brief)).steps
    assert abs(document["speed"]) < abs(document["speed_simulated"])
    names = {path.name for path in (tmp_path / "a").iterdir()}
    assert names == {"design.json", "result.json", "gait.csv", "robot.png", "frames.npz"}
    assert load_design(tmp_path / "a/design.json") == load_design(brief)
    for option in ("", "--from-rows"):
        again = json.loads(morpholab(f"simulate --gait a/gait.csv {option} --slope 5 --json {SINGLE}")[1])
        assert again | {"gait": 0} == document | {"gait": 0}
    code, out, _ = morpholab(f"simulate --gait brief.json --pressure 500 --json {REAL} {SINGLE}")
    cut = json.loads(out)
    assert (cut["pressure"], cut["orientation"], cut["repeats"]) == (500.0, 90.0, 1) and cut["steps"] < 500
    assert len(json.loads(cut["schedule"])["settle_steps"]) == 1


@pytest.mark.kernels
def test_graded_gaits_are_seen_in_motion(morpholab, tmp_path, brief):
    code, out, _ = morpholab("view brief.json --geometry small --threads 1 --frames 20 --out page.html --quiet")
    assert code == 0 and out.startswith("brief on flat: 736 parts")
    assert "bladder 1" in (tmp_path / "page.html").read_text()


@pytest.mark.usefixtures("brief")
def test_gradients_are_checked_at_a_graded_gait_away_from_empty_and_full(morpholab, monkeypatch):
    """Whole cycles in a row, played once."""
    given = {}
    report = SimpleNamespace(document=dict, text=lambda: "checked")
    check = lambda problems, **_: given.update(problems) or report  # noqa: E731
    monkeypatch.setattr("optim.measures.gradient_trust.check_gradient", check)
    assert morpholab("gradient-check --gait brief.json --horizons 1,4 --quiet")[:2] == (0, "checked\n")
    for columns, name in ((1, "1 column"), (4, "4 columns")):
        problem, point = given[name]
        gait = problem.relaxed_design(point, 0.0).schedule
        cycle = BRIEF.cut(min(columns, 2), 1)
        assert np.array_equal(gait.levels, np.tile(np.clip(cycle.levels, 0.15, 0.85), columns // cycle.columns))
        assert gait.settle_steps.tolist() == np.tile(cycle.settle_steps, columns // cycle.columns).tolist()
        assert gait.repeats == 1 and (gait.motion_steps == LEAST_MOTION).all()


def test_what_no_genes_say_has_no_gradient_check(morpholab, tmp_path):
    held = settling(INCHING.schedule.levels[:, :2], [0, 0], 1, [9999, 9])
    save_design(InflatableDesign(0.0, 90.0, held), tmp_path / "held.json")
    code, _, error = morpholab("gradient-check --gait held.json --quiet")
    assert (code, error) == (
        2,
        "morpholab gradient-check: error: motion_steps: graded genes move as fast as bladders "
        "do; give at most 100, and settle_steps\n",
    )


def test_a_chart_fills_the_part_of_a_cell_that_is_on():
    axes = Figure().add_subplot()
    levels = np.zeros((10, 2))
    levels[:, 0] = np.arange(1, 11) / 10
    draw_schedule(axes, tabled(levels[:8], levels[8:], 1), [0.0, 3.0, 4.0])
    (cells,) = axes.collections
    on = ~np.isclose(cells.get_facecolor()[:, :3], to_rgb(scene.GROUND)).all(axis=1)
    boxes = [np.ptp(path.vertices[:4], axis=0) for path in np.array(cells.get_paths(), dtype=object)[on]]
    np.testing.assert_allclose([height for _, height in boxes], 0.88 * levels[:, 0], rtol=1e-9)
    np.testing.assert_allclose([width for width, _ in boxes], 3.0)
    assert (~on).sum() == 19 and axes.get_xlim() == (0, 4)


@pytest.mark.parametrize(
    ("speed", "code", "told"),
    [
        (0.03, 0, ("0.0300 BL/s, standard deviation 0.0000, 8 runs\n", "slip 0.30 of the way while", "physical\n")),
        (-0.03, 0, ("not physical: -0.0300 BL/s remain",)),
        (np.nan, 1, ("on hill:15: a run diverged\n",)),
    ],
)
def test_a_judgement_tells_what_a_gait_is_worth(morpholab, monkeypatch, brief, speed, code, told):
    runs = np.full(8, speed)
    found = GaitJudgement(runs, runs, np.full((8, 2), 0.03), runs / 0.3, 1000)
    monkeypatch.setattr("robots.inflatable.robustness.judge_gait", lambda *_, **__: found)
    line = f"simulate --gait {brief} --slope 15 --judge"
    known, out, _ = morpholab(line)
    assert known == code and all(text in out for text in told), out
    known, out, _ = morpholab(f"{line} --json")
    document = json.loads(out)
    assert known == code and document["physical"] == (speed == 0.03) and document["steps"] == 1000


def test_a_judgement_is_of_the_world_and_the_weight_given(morpholab, monkeypatch, brief):
    runs, calls = np.full(8, 0.03), []

    def stand_in(design, terrain, **options):
        calls.append((terrain, options["actuation"].weight, options["closely"]))
        return GaitJudgement(runs, runs, np.full((8, 2), 0.03), runs / 0.3, 1000)

    monkeypatch.setattr("robots.inflatable.robustness.judge_gait", stand_in)
    for options, expected in (
        ("--slope 5 --floor wood --weight physical", (Terrain(5.0, 0.70, 0.56), "physical", True)),
        ("--friction 0.1,1 --weight published", (Terrain(0.0, 1.0, 0.1), "published", True)),
    ):
        assert morpholab(f"simulate --gait {brief} {options} --judge")[0] == 0
        assert calls[-1] == expected
    code, _, error = morpholab(f"simulate --gait {brief} --perturbation 1e-6 --judge")
    assert code == 2 and "perturbation: 1e-06 is not allowed with --judge, which plays with noise of its own" in error


@pytest.mark.kernels
def test_a_small_robot_is_judged(morpholab, brief):
    code, out, _ = morpholab(f"simulate --gait {brief} {SMALL} --slope 5 --judge --precision f32 --threads 1 --json")
    document = json.loads(out)
    assert code == 0 and document["runs"] == 8 and document["speed"] != document["hard_speed"]
    assert document["slip_deviation"] >= 0 and document["terrain"] == "hill:5"
    assert document["kept"]["half the time step"] is not None and document["part_slip"]["all"] > 0
