"""The pipeline: tasks, plans, changes of shape, packages that play from their tables alone."""

import dataclasses
import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from small_pipeline import TASK, decided, task_of, write_task

from optim.pipeline import changes, trials
from optim.pipeline import run as pipeline_run
from optim.pipeline.changes import best_single_gait
from optim.pipeline.package import _possible_files, _states_of
from optim.pipeline.plans import Plan, best_of_one_gait, best_of_one_shape, change_time, rank_plans, route_speed
from optim.pipeline.trials import KeptSimulations, NoWorkingGait, State, check_working
from robots.calibration import Properties, load_calibration, save_properties, weight_of_calibration
from robots.hardware import read_csv
from robots.hardware.table import TIME_STEP
from robots.hardware.time_course import course_difference
from robots.inflatable import INCHING, NAMED_GEOMETRIES, ROLLING
from taichi_sim.base.results_folder import ResultsFolder

TIMES = (11.5, 4.7)
speeds = st.floats(0.001, 1.0)


# plans


@given(st.lists(speeds, min_size=1, max_size=4), st.floats(1.0, 100.0))
def test_without_changes_a_route_is_as_fast_as_the_harmonic_mean(each, stretch):
    expected = len(each) / sum(1 / speed for speed in each)
    assert route_speed(each, [], stretch) == pytest.approx(expected)
    assert route_speed(each, [10.0], stretch) < expected


DESIGNS = {"rolling": ROLLING, "inching": INCHING}


def test_a_long_way_is_worth_a_change_of_shape_and_a_short_one_is_not():
    """By hand: 0.1 and 0.02 against 0.04 and 0.02 BL/s; changing there and back takes 16.2 s."""
    measured = {"rolling": [0.1, -0.5], "inching": [0.04, 0.02]}
    long, short = (rank_plans(DESIGNS, measured, stretch, 0.005, TIMES) for stretch in (20.0, 0.5))
    assert long[0].gaits == ("rolling", "inching") and short[0].gaits == ("inching", "inching")
    assert long[0].speed == pytest.approx(40 / (200 + 1000 + 16.2))
    assert best_of_one_gait(long).gaits == ("inching", "inching") == best_of_one_shape(long, DESIGNS).gaits
    assert all("rolling" not in plan.gaits[1] for plan in long)


def test_changes_take_the_time_of_their_direction():
    assert [change_time(*ends, TIMES) for ends in ((0.0, 1.0), (1.0, 0.0), (1.0, 1.0))] == [11.5, 4.7, 0.0]


def test_the_single_gait_is_the_best_on_its_worst_terrain():
    measured = {"a": np.array([[0.5], [-0.4]]), "b": np.array([[0.1], [0.01]]), "c": np.array([[0.2], [np.nan]])}
    assert best_single_gait(measured) == "b"


def test_a_terrain_without_a_working_gait_is_named_with_what_was_tried(tmp_path):
    task = task_of(tmp_path, "terrains = ['flat', 'hill:15']\ngaits = ['rolling', 'inching']")
    measured = {"rolling": np.array([[0.2, 0.2], [-0.5, -0.5]]), "inching": np.array([[0.1, 0.1], [np.nan, 0.1]])}
    with pytest.raises(NoWorkingGait) as error:
        check_working(measured, task)
    assert str(error.value) == ("hill:15: no gait reaches 0.005 BL/s; tried: rolling -0.5000, inching diverged")


# from end to end, with strokes so small, and a robot, that they take a second


@pytest.fixture
def task(tmp_path, monkeypatch):
    """A task whose fastest plan changes shape, whatever small strokes come to."""
    decided(monkeypatch)
    return write_task(tmp_path)


@pytest.mark.kernels
def test_a_package_from_end_to_end(task, tmp_path, morpholab, monkeypatch):
    """Gaits, tables, the machine, pages; the tables alone give back what was designed, to the digits of the rows.

    And a pipeline that was interrupted goes on to the same package.
    """
    out = tmp_path / "out"
    code, text, error = morpholab(f"pipeline {task} --out {out} --quiet --json --threads 1")
    package, document = out / "package", json.loads(text)
    assert code == (1 if document["faults"] else 0), error
    assert document["plan"]["gaits"] == ["round", "flat"]
    assert all("the next gait reaches" in fault for fault in document["faults"])  # such strokes are chance
    assert all((package / name).is_file() for name in document["files"])
    machine = json.loads((package / "machine.json").read_text())
    assert [state["name"] for state in machine["states"]] == ["flat", "hill-5"] and machine["initial"] == "flat"
    assert {(change["from"], change["to"]) for change in machine["changes"]} == {("flat", "hill-5"), ("hill-5", "flat")}
    for change in machine["changes"]:
        played = read_csv(package / change["table"]).played().schedule
        assert played.core_pressure[-1] == pytest.approx(0.0 if change["to"] == "hill-5" else 400.0, abs=1e-2)
        assert 0.0 < change["shape_error"] < 0.05
    page = (package / "report.html").read_text()
    assert "Changes of shape" in page and "hill-5" in page
    code, text, _ = morpholab(f"pipeline --replay {package} --quiet --json --threads 1")
    states, joined = (json.loads(text)[name] for name in ("states", "changes"))
    assert [(each["rig"], each["faults"]) for each in joined] == [("quick", [])] * 2
    assert code == 0 and all(state["replayed"] == pytest.approx(state["designed"], rel=1e-3) for state in states)
    assert all(state["course"]["stretch"] > 1.1 and 0.0 < state["course"]["mean"] < 0.3 for state in states)
    assert {state["on_rig"] for state in states} == {None}
    code, text, _ = morpholab(f"pipeline --replay {package} --rig dissertation-lag --quiet --threads 1")
    assert (
        code == 0
        and text.count("  over time: its rows take ") == text.count("  on the rig dissertation-lag, in its") == 2
    )

    monkeypatch.setattr(pipeline_run, "find_change", interrupted)
    parts = tmp_path / "parts"
    code, text, _ = morpholab(f"pipeline {task} --out {parts} --quiet --threads 1")
    assert code == 130 and "the same command goes on from there" in text
    assert len(list((parts / "simulated").glob("speed*.npz"))) == 4  # two gaits on two terrains
    monkeypatch.undo()
    decided(monkeypatch)
    monkeypatch.chdir(tmp_path)
    assert morpholab(f"pipeline {task} --out {parts} --quiet --threads 1")[0] in (0, 1)
    for name in ("machine.json", "numbers.json", "tables/flat.csv"):
        assert (parts / "package" / name).read_bytes() == (package / name).read_bytes()


@pytest.mark.kernels
def test_a_package_in_place_of_another_has_no_files_of_that(task, tmp_path, morpholab, monkeypatch):
    """A short stretch is not worth the change of shape; tables of changes that stayed could be played on a rig."""
    plans = {20.0: Plan(("round", "flat"), 0.1), 0.1: Plan(("round", "round"), 0.1)}
    monkeypatch.setattr(pipeline_run, "rank_plans", lambda _designs, _speeds, stretch, *_: [plans[stretch]])
    package, left = tmp_path / "out/package", []
    for stretch in plans:
        task.write_text(f"stretch = {stretch}\n{TASK}")
        code, text, error = morpholab(f"pipeline {task} --out {tmp_path / 'out'} --quiet --json --threads 1")
        assert code in (0, 1), error
        left.append({str(path.relative_to(package)) for path in package.rglob("*") if path.is_file()})
        assert left[-1] - {"tables/own.csv"} == set(json.loads(text)["files"])
        (package / "tables/own.csv").write_text("a person's")
        (package / "calibration.json").write_text("of a task with a calibration")
    assert "tables/flat-to-hill-5.csv" in left[0] - left[1] and "tables/own.csv" in left[1]


@pytest.mark.parametrize("machine", ["", "{", '{"states": [{"name": "../own"}]}'])
def test_names_of_a_damaged_package_are_no_files_to_delete(tmp_path, machine):
    (tmp_path / "machine.json").write_text(machine)
    assert _states_of(tmp_path) == []
    assert _possible_files(["flat", "../own"]) == _possible_files(["flat"])


@pytest.mark.kernels
def test_a_package_of_a_rig(task, tmp_path, morpholab):
    """Its robot is in every simulation, in the package, and in what replays it."""
    fitted = Properties(friction=1.2, low_friction=0.3, modulus=330e3, inflation_rate=2.0)
    save_properties(fitted, "small", tmp_path / "fit.json")
    ground = 'calibration = "fit.json"\nweight = "physical"\nfloor = "wood"\n'
    task.write_text(ground + TASK.replace('geometry = "small"\n', "").replace("hill:5", "hill:3"))
    package = tmp_path / "out/package"
    code, text, error = morpholab(f"pipeline {task} --out {tmp_path / 'out'} --quiet --json --threads 1")
    assert code in (0, 1) and "calibration.json" in json.loads(text)["files"], error
    assert load_calibration(package / "calibration.json") == (fitted, "small")
    assert weight_of_calibration(package / "calibration.json") == "physical"
    machine = json.loads((package / "machine.json").read_text())
    assert machine["simulated"] == {
        "geometry": "small",
        "precision": "f32",
        "runs": 2,
        "seed": 0,
        "properties": vars(fitted),
        "weight": "physical",
    }
    assert all(state["terrain"]["low_friction"] == 0.56 for state in machine["states"])
    page = (package / "report.html").read_text()
    assert "flat: friction 0.56,0.7 (wood); hill:3: friction" in page and "weight of bladders: physical" in page
    replay = f"pipeline --replay {package} --quiet --json --threads 1"
    states = json.loads(morpholab(replay)[1])["states"]
    speeds = [(state["replayed"], state["designed"]) for state in states]
    geometry, drive = fitted.robot(NAMED_GEOMETRIES["small"])
    tables = [read_csv(package / state["table"]) for state in machine["states"]]
    stretches = [course_difference(table, drive, geometry.time_step).stretch for table in tables]
    assert [state["course"]["stretch"] for state in states] == pytest.approx(stretches, rel=1e-6)
    assert geometry.time_step != TIME_STEP
    assert all(replayed == pytest.approx(designed, rel=1e-3) for replayed, designed in speeds)
    del machine["simulated"]["properties"]
    (package / "machine.json").write_text(json.dumps(machine))
    published = [state["replayed"] for state in json.loads(morpholab(replay)[1])["states"]]
    assert not any(
        speed == pytest.approx(designed, rel=1e-2) for speed, (_, designed) in zip(published, speeds, strict=True)
    )


def test_a_crossing_is_kept_for_its_own_gaits_alone(tmp_path, monkeypatch):
    """With other limits another plan may come out in the same folder."""
    played = []

    def journey(legs, **_options):
        played.append([leg.name for leg in legs])
        return SimpleNamespace(speeds=np.full((2, len(legs)), 0.1), steps=np.array([10] * len(legs)))

    monkeypatch.setattr(trials, "simulate_journey", journey)
    task = task_of(tmp_path, "terrains = ['flat', 'hill:15']\ngaits = ['rolling']\nruns = 2")
    kept = KeptSimulations(task, ResultsFolder(tmp_path / "kept", "pipeline", {}))
    rolling, inching = ([State(t, name, DESIGNS[name], [0.1, 0.1]) for t in task.terrains] for name in DESIGNS)
    for states, again in ((rolling, 3), (rolling, 1), (inching, 3)):
        played.clear()
        changes.cross(tuple(states), None, ("inching", INCHING), kept)
        assert len(played) == again  # those with noise if they are new, and the one that is shown


def test_gaits_of_similar_names_are_simulated_apart(tmp_path, monkeypatch):
    speeds = iter([0.1, 0.2])
    monkeypatch.setattr(trials.simulation, "simulate", lambda *_, **__: SimpleNamespace(speed=np.full(2, next(speeds))))
    task = task_of(tmp_path, "terrains = ['flat']\ngaits = ['rolling']\nruns = 2")
    kept = KeptSimulations(task, ResultsFolder(tmp_path / "kept", "pipeline", {}))
    found = [kept.speeds(name, INCHING, task.terrains[0], None)[0] for name in ("w-1", "w_1", "w-1")]
    assert found == [0.1, 0.2, 0.1]


def test_settings_tell_gaits_of_other_bodies_apart(tmp_path):
    task = task_of(tmp_path, "terrains = ['flat']\ngaits = ['rolling']\nruns = 2")
    (name, design), *_ = task.gaits.items()
    other = dataclasses.replace(task, gaits={name: design.with_layout((1, 2, 3))})
    assert (
        pipeline_run.settings_of(other) != pipeline_run.settings_of(task)
        and len(pipeline_run.settings_of(task)["gaits"][name]) == 4
    )


def interrupted(*_args, **_options):
    raise KeyboardInterrupt


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("", "task: give either the file of a task, or --replay"),
        ("task.toml --replay p", "task: give either"),
        ("--replay p --out o", "out: is not allowed with --replay"),
        ("task.toml --out o --rig dissertation", "rig: dissertation is not allowed without --replay"),
        ("--replay p --rig bench", "rig: 'bench' is neither a preset"),
        ("task.toml", "out: none given; name a folder"),
        ("gone.toml --out o", "task: gone.toml cannot be read"),
        ("--replay nothing", "nothing"),
    ],
)
def test_the_command_refuses_in_one_line(line, message, morpholab):
    code, _, error = morpholab(f"pipeline {line}")
    assert code == 2 and message in error and error.count("\n") == 1


EXAMPLE = Path(__file__).parents[3] / "examples" / "pipeline" / "flat-and-water"


def damage(machine, path, value):
    *way, last = path
    for key in way:
        machine = machine[key]
    if value is None:
        del machine[last]
    else:
        machine[last] = value


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (("simulated",), None, "'simulated' is missing"),
        (("states", 0, "table"), None, "'table' is missing"),
        (("states", 0, "table"), "../../secret.csv", "table: '../../secret.csv' is not allowed; it must be"),
        (("states", 0, "terrain"), {"steep": 3}, "steep"),
        (("states", 0, "speed_bl_per_s"), "fast", "speed_bl_per_s: 'fast' is not allowed"),
        (("states",), {"flat": 1}, "is damaged"),
        (("states",), [3], "is damaged"),
        (("states",), [], "is no state machine"),
        (("simulated", "geometry"), ["small"], "geometry: ['small'] is unknown; choose one of"),
        (("simulated", "properties"), {"friction": 1}, "missing 3 required positional arguments"),
        (("simulated", "runs"), 0, "runs: 0 is not allowed; give a whole number, at least 1"),
        (("format",), "other", "is no state machine of a package"),
    ],
)
def test_a_damaged_state_machine_is_one_line(morpholab, tmp_path, monkeypatch, path, value, message):
    monkeypatch.setattr("robots.inflatable.simulation.simulate", None)
    machine = json.loads((EXAMPLE / "machine.json").read_text())
    damage(machine, path, value)
    (tmp_path / "machine.json").write_text(json.dumps(machine))
    code, _, error = morpholab(f"pipeline --replay {tmp_path} --quiet")
    assert code == 2 and message in error and error.count("\n") == 1


@pytest.mark.parametrize("search", ['method = ["a"]', "encoding = []", 'warm_up = "x"', "columns = 1e308"])
def test_types_that_are_wrong_in_a_task_are_one_line(task, tmp_path, morpholab, search):
    (tmp_path / "t.toml").write_text(f"terrains = ['flat']\ngaits = ['rolling']\n[search]\n{search}\n")
    code, _, error = morpholab(f"pipeline {tmp_path / 't.toml'} --out {tmp_path / 'o'} --quiet")
    assert code == 2 and search.split()[0] in error and error.count("\n") == 1


def test_a_folder_of_something_else_stays_as_it_is(task, tmp_path, morpholab):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").write_text("mine")
    code, _, error = morpholab(f"pipeline {task} --out {tmp_path / 'mine'} --quiet")
    assert code == 2 and "holds something else" in error
