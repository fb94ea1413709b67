"""``morpholab codesign`` and the problem behind it, with a stand-in for the simulator."""

import json
import os
import re

import numpy as np
import pytest
from run_products import log, products

from optim.problems.inflatable.problem import GaitProblem
from optim.problems.inflatable.settings import PARTS
from robots.hardware import read_csv
from robots.inflatable import INCHING, ROLLING, load_design
from robots.inflatable.schedule import GaitSchedule
from robots.world import Terrain
from taichi_sim.base.compiler import compiler

pytestmark = pytest.mark.usefixtures("simulator")

SHORT = "--climbers 4 --generations 3 --geometry small"


def test_codesign_end_to_end(morpholab, simulator, tmp_path):
    code, out, error = morpholab(f"codesign --terrain flat --terrain hill:15 --seed 2 --out runs/a --json {SHORT}")
    assert code == 0 and error.count("\n") >= 4
    folder, document, lines = tmp_path / "runs/a", json.loads(out), log(tmp_path / "runs/a")
    assert document["files"] == ["best.json", "gait.csv", "robot_flat.png", "robot_hill_15.png"]
    assert all((folder / name).exists() for name in document["files"])
    assert {key: document[key] for key in lines[-1]} == lines[-1]
    assert [line["evaluations"] for line in lines] == [4, 8, 12, 16]
    assert document["best"] == np.mean([document["best_details"][f"speed_{t}"] for t in ("flat", "hill:15")])
    best = load_design(folder / "best.json")
    assert best.pressure == document["best_point"]["pressure"]
    assert read_csv(folder / "gait.csv").schedule() == best.schedule
    # One call for all climbers per terrain and generation.
    assert [call.terrain.name for call in simulator.calls] == ["flat", "hill:15"] * 4
    assert {len(call.designs) for call in simulator.calls} == {4}
    environment = json.loads((folder / "environment.json").read_text())
    assert {
        "versions",
        "platform",
        "cpu_count",
        "device",
        "precision",
        "seed",
        "command",
    } <= environment.keys()
    assert environment["seed"] == 2 and environment["versions"][compiler()].startswith("1.")


def test_codesign_ends_with_the_speed_on_screen(morpholab):
    code, out, error = morpholab(f"codesign --terrain flat --out a --quiet {SHORT}")
    assert code == 0 and re.search(r"best speed: -?0\.\d{4} BL/s \(flat -?0\.\d{4}\) after 16 evaluations", out)
    assert error == ""


def test_a_core_beyond_the_rig_is_clipped_in_the_table_and_told_in_its_header(morpholab, tmp_path):
    code, out, error = morpholab(f"codesign --free control --pressure 13000 --terrain flat --out a --quiet {SHORT}")
    assert (code, error) == (0, "") and load_design(tmp_path / "a/best.json").pressure == 13_000
    (told,) = read_csv(tmp_path / "a/gait.csv").clipped
    assert told.startswith("core: 54.1667 kPa") and told.endswith("the rig's limit is 50 kPa")
    assert "\ngait.csv: clipped 1 time to a rig's limits, as its header tells" in out


@pytest.mark.parametrize("method", ["hill-climb", "random"])
def test_interrupted_runs_continue_exactly(morpholab, simulator, tmp_path, method):
    line = f"codesign --terrain flat --seed 7 --method {method} {SHORT}"
    assert morpholab(f"{line} --out whole")[0] == 0
    simulator.calls, simulator.interrupt_at = [], 3
    code, out, _ = morpholab(f"{line} --out cut")
    assert (code, "chatter" in out) == (130, True)
    assert re.fullmatch(
        r"interrupted: generation 1/3: best .*, 8 evaluations\n"
        r"cut keeps every complete generation, go on with --resume",
        out.removeprefix("chatter of the simulator\n" * 3).strip(),
    )
    assert len(log(tmp_path / "cut")) == 2
    assert morpholab("codesign --resume --out cut")[0] == 0  # its settings are in the folder
    assert products(tmp_path / "cut") == products(tmp_path / "whole")


def test_resume_starts_a_run_that_is_not_there_yet(morpholab, tmp_path):
    assert morpholab(f"codesign --terrain flat --out a {SHORT}")[0] == 0
    code, _, error = morpholab(f"codesign --terrain flat --out b --resume {SHORT}")
    assert code == 0 and "note: b holds no run to go on with; a new search begins there" in error  # mistyped, perhaps
    assert "new search" not in morpholab("codesign --resume --out b --generations 3")[2]
    assert products(tmp_path / "a") == products(tmp_path / "b")


def test_a_finished_run_says_its_result_again(morpholab, simulator, tmp_path):
    _, first, _ = morpholab(f"codesign --terrain flat --out a --json {SHORT}")
    before = {path: (path.read_bytes(), path.stat().st_mtime_ns) for path in (tmp_path / "a").iterdir()}
    simulator.calls = []
    code, second, _ = morpholab("codesign --out a --resume --json")
    assert code == 0 and second == first and simulator.calls == []
    after = {path: (path.read_bytes(), path.stat().st_mtime_ns) for path in (tmp_path / "a").iterdir()}
    assert after == before


def test_more_generations_redraw_the_best(morpholab, tmp_path):
    morpholab(f"codesign --terrain flat --out a {SHORT}")
    old = (tmp_path / "a/gait.csv").read_bytes()
    code, _, _ = morpholab("codesign --out a --resume --generations 40")
    assert code == 0 and len(log(tmp_path / "a")) == 41
    assert (tmp_path / "a/gait.csv").read_bytes() != old
    assert read_csv(tmp_path / "a/gait.csv").schedule() == load_design(tmp_path / "a/best.json").schedule


@pytest.mark.parametrize(
    ("options", "name"),
    [
        ("--seed 5", "method.seed"),
        ("--method random", "method.name"),
        ("--climbers 5", "method.climbers"),
        ("--start-pressure 5", "method.start"),
        ("--terrain hill:5", "problem.terrains"),
        ("--free control", "problem.free"),
        ("--geometry published", "problem.geometry"),
        ("--precision f64", "problem.precision"),
        ("--columns 4", "problem.columns"),
        ("--generations 2", "generations"),
    ],
)
def test_a_run_continues_with_its_own_settings_only(morpholab, tmp_path, options, name):
    morpholab(f"codesign --terrain flat --out a {SHORT}")
    before = products(tmp_path / "a")
    code, _, error = morpholab(f"codesign --out a --resume --quiet {options}")
    assert code == 2 and f"error: {name}: " in error and error.count("\n") == 1
    assert products(tmp_path / "a") == before


def test_a_run_that_continues_takes_no_part_of_its_start(morpholab, tmp_path):
    start = "--start-orientation 10 --start-pressure 5000"
    morpholab(f"codesign --terrain flat --out a {SHORT} {start}")
    code, _, error = morpholab("codesign --out a --resume --quiet --start-orientation 10")
    assert code == 2 and "error: method.start: {'orientation': 10" in error and error.count("\n") == 1
    assert morpholab(f"codesign --out a --resume --quiet {start}")[0] == 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("--set start=3", "start: 3 is not allowed; give values by name"),
        ("--set start={'orientation':'x'}", "start: 'x' of orientation is not allowed; give a number"),
        ("--method genetic --set mutation=null", "mutation: nothing is not allowed; give a value, or leave it out"),
        ("--method gradient --set sharpest=abc", "sharpest: 'abc' is not allowed; give a number from 1 to 1e+12"),
        ("--method map-elites --set offset=-1.7e308", "offset: -1.7e+308 is not allowed; give a number from -1e+100"),
        ("--set seed=3 --seed 4", "set: seed=3 is not allowed beside --seed 4; leave one out"),
        ("--set learning-rate=1 --learning-rate 2", "set: learning_rate=1 is not allowed beside --learning-rate 2.0"),
        ("--set climbers=2 --set climbers=3", "set: climbers is given twice; leave one out"),
        (
            "--set start={'pressure':1} --start-pressure 2",
            "set: start={'pressure': 1} is not allowed beside options that",
        ),
        ("--method gradient --set verify=false", "set: verify=False is not allowed; this search needs verify=True"),
        ("--set seed=3 --seeds 0-1", "set: seed=3 is not allowed with --seeds; leave one out"),
        ("--climbers 100000000000", "climbers: 100000000000 is not allowed; give a whole number, at most 100000"),
    ],
)
def test_a_setting_that_is_not_allowed_is_one_line(morpholab, simulator, tmp_path, options, message):
    options = options.replace("'", '\\"')
    code, _, error = morpholab(f"codesign --terrain flat --out a --generations 1 {options}")
    assert code == 2 and f"error: {message}" in error and error.count("\n") == 1
    assert simulator.calls == [] and not (tmp_path / "a").exists()


def test_an_existing_run_is_not_overwritten(morpholab, tmp_path):
    morpholab(f"codesign --terrain flat --out a {SHORT}")
    before = products(tmp_path / "a")
    code, _, error = morpholab(f"codesign --terrain flat --out a {SHORT}")
    assert code == 2 and "out: a holds a run already; continue it with --resume" in error and error.count("\n") == 1
    assert products(tmp_path / "a") == before


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ("--terrain flat --free shape,control", {"orientation": {0.0}}),
        ("--terrain hill:15 --free control", {"orientation": {90.0}, "pressure": {0.0}}),
        ("--terrain flat --terrain hill:15 --free control", {"orientation": {0.0}, "pressure": {12e3}}),
        ("--terrain hill:15 --free orientation", {"pressure": {0.0}, "schedule": {INCHING.schedule}}),
        (
            "--terrain flat --free shape --gait inching",
            {"orientation": {90.0}, "schedule": {INCHING.schedule}},
        ),
        ("--terrain flat --free control --pressure 5000", {"orientation": {0.0}, "pressure": {5000.0}}),
        ("--terrain hill:15 --free control --orientation 30", {"orientation": {30.0}, "pressure": {0.0}}),
    ],
)
def test_what_is_not_free_is_fixed(morpholab, simulator, options, expected):
    code, _, error = morpholab(f"codesign --out a {options} {SHORT}")
    assert code == 0 and ("note: " in error) == ("--gait" not in options)
    designs = [design for call in simulator.calls for design in call.designs]
    for name in ("orientation", "pressure", "schedule"):
        values = {getattr(design, name) for design in designs}
        assert values == expected[name] if name in expected else len(values) > 5


def test_fixed_schedules_can_be_cut_and_free_ones_sized(morpholab, simulator):
    morpholab(f"codesign --out a --terrain flat --free shape --gait rolling --columns 2 --repeats 1 {SHORT}")
    assert simulator.calls[-1].designs[0].schedule == GaitSchedule(ROLLING.schedule.bits[:, :2], 1)
    morpholab(f"codesign --out b --terrain flat --columns 12 --repeats 3 {SHORT}")
    schedule = simulator.calls[-1].designs[0].schedule
    assert (schedule.columns, schedule.repeats) == (12, 3)


def test_climbers_can_start_from_a_given_body(morpholab, simulator):
    morpholab(f"codesign --out a --terrain hill:15 --start-orientation 0 --start-pressure 12000 {SHORT}")
    starts = simulator.calls[0].designs
    assert {(design.orientation, design.pressure) for design in starts} == {(0.0, 12e3)}
    assert len({design.schedule for design in starts}) == 4
    assert len({design.orientation for design in simulator.calls[1].designs}) > 1


def test_failures_do_not_win(morpholab, simulator, tmp_path):
    simulator.diverges = lambda design, terrain: terrain.slope > 0 and design.pressure > 2000
    morpholab(f"codesign --out a --terrain flat --terrain hill:15 {SHORT} --climbers 12")
    lines = log(tmp_path / "a")
    assert sum(line["failed"] for line in lines) > 0
    assert load_design(tmp_path / "a/best.json").pressure <= 2000
    simulator.diverges = lambda design, terrain: True
    code, out, _ = morpholab(f"codesign --out b --terrain flat --json {SHORT}")
    assert code == 1 and json.loads(out)["best"] is None and json.loads(out)["files"] == []
    code, out, _ = morpholab("codesign --out b --resume")
    assert code == 1 and out == "b: nothing succeeded in 16 evaluations\n"


def full(*_):
    raise OSError(28, "No space left on device")


@pytest.mark.parametrize("name", ["gait.csv", "robot_flat.png"])
def test_a_disk_that_is_full_after_the_search_is_one_line_too(morpholab, monkeypatch, tmp_path, name):
    line, replace = f"codesign --terrain flat --quiet {SHORT}", os.replace

    def fills(source, target):
        if name in str(target):
            full()
        replace(source, target)

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", fills)
        code, _, error = morpholab(f"{line} --out a")
    assert code == 1 and re.fullmatch(
        r"morpholab codesign: failed: a: cannot be written \(.*No space left on device\)+; "
        r"its 4 complete generations are kept, go on with --resume\n",
        error,
    )
    assert morpholab("codesign --resume --quiet --out a")[0] == 0 and (tmp_path / "a" / name).exists()


def test_a_full_disk_is_one_line_and_loses_nothing(morpholab, simulator, monkeypatch, tmp_path):
    line = f"codesign --terrain flat --quiet {SHORT}"
    assert morpholab(f"{line} --out whole")[0] == 0
    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", full)
        code, _, error = morpholab(f"{line} --out a")
    assert code == 1 and error == "morpholab codesign: failed: out: a cannot be written (No space left on device)\n"
    call = simulator.__call__
    with monkeypatch.context() as patch:

        def fills_the_disk(*args, **options):
            if len(simulator.calls) == 2 + 4:  # two generations after the four of the whole run
                patch.setattr(os, "replace", full)
            return call(*args, **options)

        patch.setattr("robots.inflatable.simulation.simulate", fills_the_disk)
        code, _, error = morpholab(f"{line} --out b")
    assert code == 1 and re.fullmatch(
        r"morpholab codesign: failed: b: cannot be written \(.*No space left on device\)+; "
        r"its 2 complete generations are kept, go on with --resume\n",
        error,
    )
    assert morpholab("codesign --resume --quiet --out b")[0] == 0
    assert products(tmp_path / "b") == products(tmp_path / "whole")
    assert not [path for path in (tmp_path / "b").iterdir() if path.name.startswith(".aside")]


# the problem behind codesign


@pytest.mark.parametrize(
    "free", ["orientation", "shape", "control", "orientation,control", "orientation,shape,control"]
)
def test_a_problem_can_be_built_from_its_description(free):
    fixed = {name: getattr(INCHING, name) for part, name in PARTS.items() if part not in free.split(",")}
    terrains = (Terrain(), Terrain(15.0, high_friction=1.5))
    problem = GaitProblem(terrains, **fixed, geometry="small", columns=8, threads=2)
    description = json.loads(json.dumps(problem.describe()))
    again = GaitProblem.from_description(description)
    assert again.describe() == description and again.space == problem.space and again.terrains == terrains
    assert problem.free == tuple(free.split(","))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"wings": 2}, "problem: its description is damaged .*wings"),
        ({"free": ["shape"]}, r"problem.free: \['shape'\] contradicts the rest"),
        ({"terrains": [{"slope": 60.0}]}, "slope: 60.0 is not allowed"),
        ({"geometry": "big"}, "geometry: 'big' is unknown; choose one of published, small"),
        ({"weight": "none"}, "weight: 'none' is unknown"),
        ({"columns": 0}, "columns: 0 is not allowed"),
        ({"pressure": 16e3}, "pressure: 16000.0 is not allowed"),
    ],
)
def test_damaged_descriptions_are_one_line(change, message):
    description = GaitProblem((Terrain(),), pressure=5e3).describe()
    with pytest.raises(ValueError, match=message):
        GaitProblem.from_description({**description, **change})


def test_points_and_designs_are_the_published_code():
    problem = GaitProblem((Terrain(),))
    f, phi = ROLLING.schedule.to_codes()
    point = np.concatenate([[0.0, 12e3], f, phi])
    assert problem.design(point) == ROLLING and problem.space.size == 22
    assert problem.space.step.tolist() == [9.0, 1200.0] + [0.9] * 20


def test_a_point_that_fails_anywhere_has_failed(simulator):
    problem = GaitProblem((Terrain(), Terrain(15.0)))
    points = problem.space.sample(np.random.default_rng(0), 6)
    simulator.diverges = lambda design, terrain: terrain.slope == 0 and design.pressure > 6000
    evaluation = problem.evaluate(points)
    assert np.array_equal(evaluation.failed, points[:, 1] > 6000) and 0 < evaluation.failed.sum() < 6
    assert np.array_equal(np.isnan(evaluation.objectives[:, 0]), evaluation.failed)
    assert not np.isnan(evaluation.details["speed_hill:15"]).any()
    alone = [problem.evaluate(point[None]).objectives[0, 0] for point in points]
    assert np.array_equal(alone, evaluation.objectives[:, 0], equal_nan=True)


def test_gaits_refuse_gradients_of_true_designs_in_one_line(morpholab):
    line = "codesign --terrain flat --encoding bits --geometry small --method lamarckian --population 4 --quiet --out a"
    code, _, error = morpholab(line)
    assert code == 2 and "method: it wants gradients of true designs, which gaits do not have" in error


def test_numbers_of_several_worlds_have_a_line_each():
    from optim.commands.codesign import _told_by_world

    numbers = {"speed_flat": 0.5, "jump_flat": 0.25, "speed_hill:5": 0.125, "solved": 1.0}
    assert _told_by_world(numbers, ["flat", "hill:5"], "speed") == [
        "solved 1.0000",
        "  flat: speed 0.5000, jump 0.2500",
        "  hill:5: speed 0.1250",
    ]
    assert _told_by_world({"jump": 0.25, "speed_flat": 0.5}, ["flat"], "speed") == ["jump 0.2500, flat 0.5000"]
