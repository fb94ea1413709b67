"""The pipeline: tasks, plans, changes of shape, packages that play from their tables alone."""

import dataclasses
import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from small_pipeline import TASK, decided, write_task

from optim.pipeline import changes, trials
from optim.pipeline import run as pipeline_run
from optim.pipeline.changes import best_single_gait
from optim.pipeline.plans import best_of_one_gait, best_of_one_shape, change_time, rank_plans, route_speed
from optim.pipeline.run import find_gaits
from optim.pipeline.task import read_task
from optim.pipeline.trials import KeptSimulations, NoWorkingGait, State, check_working
from robots.calibration import Properties, load_calibration, save_properties
from robots.hardware import export_csv, read_csv
from robots.inflatable import ACTUATION, INCHING, PUBLISHED, ROLLING, SMALL
from robots.inflatable.design import save_design
from robots.world import Terrain
from taichi_sim.base.results_folder import ResultsFolder

TIMES = (11.5, 4.7)
speeds = st.floats(0.001, 1.0)


# tasks


def task_of(tmp_path, text: str):
    path = tmp_path / "task.toml"
    path.write_text(text)
    return read_task(path)


def test_a_task_names_terrains_gaits_and_how_to_search(tmp_path):
    save_design(INCHING, tmp_path / "climb.json")
    export_csv(ROLLING, tmp_path / "table.csv")
    task = task_of(
        tmp_path,
        """
        terrains = ["flat", "hill:15"]
        gaits = ["rolling", "climb.json", "table.csv"]
        runs = 3
        [search]
        method = "genetic"
        generations = 5
        encoding = "graded"
        columns = 2
        population = 12
        [limits]
        least_speed = 0.01
        """,
    )
    assert [terrain.name for terrain in task.terrains] == ["flat", "hill:15"]
    assert task.gaits == {"rolling": ROLLING, "climb": INCHING, "table": ROLLING}
    assert task.search.generations == 5 and task.problem(task.terrains[1]).encoding == "graded"
    assert task.method_settings["population"] == 12 and task.limits.least_speed == 0.01
    assert task.robot == {"geometry": PUBLISHED, "actuation": ACTUATION} and task.limits.most_steps == 186_719


@pytest.mark.parametrize(("given", "most"), [("", 411_151), ("most_steps = 5", 5)])
def test_a_task_for_a_rig_has_its_robot(tmp_path, given, most):
    slow = dataclasses.replace(Properties.of(), inflation_rate=1.0)
    save_properties(slow, "small", tmp_path / "fit.json")
    search = 'method = "genetic"'
    task = task_of(tmp_path, f"terrains = ['flat']\ncalibration = 'fit.json'\n[search]\n{search}\n[limits]\n{given}")
    geometry, actuation = slow.robot(SMALL)
    assert task.robot == {"geometry": geometry, "actuation": actuation} and task.limits.most_steps == most
    assert task.problem(task.terrains[0]).actuation == actuation
    assert pipeline_run.settings_of(task)["calibration"] == vars(slow)
    assert "calibration" not in pipeline_run.settings_of(dataclasses.replace(task, calibration=None))
    named = task_of(
        tmp_path, "terrains = ['flat']\ngaits = ['rolling']\ncalibration = 'fit.json'\ngeometry = 'published'"
    )
    assert named.robot["geometry"] == PUBLISHED


def test_a_mark_of_byte_order_before_a_task_is_skipped(tmp_path):
    path = tmp_path / "task.toml"
    path.write_text("terrains = ['flat']\ngaits = ['rolling']\n", encoding="utf-8-sig")
    assert read_task(path).terrains == (Terrain(),)


def test_a_task_says_what_the_ground_is_and_what_bladders_weigh(tmp_path):
    text = "terrains = ['flat', 'hill:5', 'water']\ngaits = ['rolling']\n"
    task = task_of(tmp_path, f"{text}floor = 'acrylic'\nbladder_friction = 0.3\nweight = 'physical'")
    own = {"high_friction": 0.51, "low_friction": 0.38, "bladder_friction": 0.3}
    assert task.terrains == (Terrain(**own), Terrain(5.0, **own), Terrain.water())
    assert task_of(tmp_path, f"{text}friction = [0.38, 0.51]").terrains[1] == Terrain(5.0, 0.51, 0.38)
    assert task.robot["actuation"].weight == "physical"
    usual, asked = (pipeline_run.settings_of(each) for each in (task_of(tmp_path, text), task))
    assert "weight" not in usual and usual["terrains"][0] == Terrain().document
    assert asked["weight"] == "physical" and asked["terrains"][1]["bladder_friction"] == 0.3
    searched = task_of(tmp_path, "terrains = ['flat']\nweight = 'physical'\nfloor = 'wood'\n[search]\ngenerations = 1")
    problem = searched.problem(searched.terrains[0])
    assert problem.weight == "physical" and problem.terrains == (Terrain(0.0, 0.7, 0.56),)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("terrain = ['flat']", "task: .*task.toml has an unknown key 'terrain'; did you mean terrains?"),
        ("gaits = ['rolling']", "task: .* has no terrains; give some, such as"),
        ("terrains = []\ngaits = ['rolling']", "terrains: none given; give at least one"),
        ("terrains = ['flat', 'flat']\ngaits = ['rolling']", "terrains: flat, flat given"),
        ("terrains = ['moon']", "terrain: 'moon' is unknown"),
        ("terrains = 'flat'", "terrains: 'flat' is not allowed; give names"),
        ("terrains = ['flat']", "gaits: none given, and no search"),
        ("terrains = ['flat']\ngaits = ['gone.json']", "gone.json"),
        ("terrains = ['flat']\ngaits = ['rolling', 'rolling']", "gaits: 'rolling' is given twice"),
        ("terrains = ['flat']\ngaits = ['rolling']\nruns = 1", "runs: 1 is not allowed"),
        ("terrains = ['flat']\ngaits = ['rolling']\nframes = 0", "frames: 0 is not allowed"),
        ("terrains = ['flat']\ngaits = ['rolling']\nstretch = -1.0", "stretch: -1"),
        ("terrains = ['flat']\ngaits = ['rolling']\nprecision = 'f16'", "precision: 'f16' is unknown"),
        ("terrains = ['flat']\ngaits = ['rolling']\n[limits]\nleast_sped = 1", "least_sped.*did you mean least_speed"),
        ("terrains = ['flat']\ngaits = ['rolling']\n[limits]\nnext_speed = 2.0", "limits.next_speed: 2"),
        ("terrains = ['flat']\ngaits = ['rolling']\n[limits]\nleast_speed = 0.0", "limits.least_speed: 0.0 is not"),
        ("terrains = ['flat']\n[search]\nmethod = 'genetics'", "search.method: 'genetics' is unknown"),
        ("terrains = ['flat']\n[search]\ngeneration = 3", "unknown key 'generation' in \\[search\\]; did you mean gen"),
        ("terrains = ['flat']\n[search]\nencoding = 'graced'", "encoding: 'graced' is unknown"),
        ("terrains = ['flat']\n[search]\npopulation = 1", "population: 1 is not allowed"),
        ("terrains = ['flat']\ngaits = ['rolling']\ncalibration = 3", "calibration: 3 is not allowed; give the"),
        ("terrains = ['flat']\ngaits = ['rolling']\ncalibration = 'gone.json'", "gone.json: cannot be read"),
        ("terrains = ['flat']\ngaits = ['rolling']\nfloor = 'gravel'", "floor: gravel is not allowed"),
        ("terrains = ['flat']\ngaits = ['rolling']\nfloor = 3", "floor: 3 is"),
        ("terrains = ['flat']\ngaits = ['rolling']\nfriction = 0.5", "friction: 0.5 is not allowed; give that of"),
        ("terrains = ['flat']\ngaits = ['rolling']\nfriction = [0.5, 'x']", "friction: 'x' is not allowed"),
        ("terrains = ['flat']\ngaits = ['rolling']\nseam_friction = 'x'", "seam_friction: 'x' is not allowed"),
        ("terrains = ['flat']\ngaits = ['rolling']\nweight = 'heavy'", "weight: 'heavy' is unknown"),
        ("terrains = ['water']\ngaits = ['rolling']\nfloor = 'wood'", "friction: 0.56,0.7 is not allowed in a fluid"),
        ("terrains = [", "task: .* cannot be read"),
    ],
)
def test_bad_tasks_are_refused_in_one_line_before_any_simulation(tmp_path, text, message):
    with pytest.raises(ValueError, match=message) as error:
        task_of(tmp_path, text)
    assert "\n" not in str(error.value)


def test_a_rig_with_lines_for_several_cores_is_refused(tmp_path):
    (tmp_path / "rig.toml").write_text("cores = 2\n")
    with pytest.raises(ValueError, match=r"^rig: 2 lines for cores are not allowed; the tables of a package have one"):
        task_of(tmp_path, "terrains = ['flat']\nrig = 'rig.toml'\ngaits = ['rolling']")


def test_gaits_that_the_rig_cannot_play_are_refused_or_left_out(tmp_path, monkeypatch):
    (tmp_path / "rig.toml").write_text("[channels.core]\nmaximum_kpa = 40.0\n")
    text = "terrains = ['flat']\nrig = 'rig.toml'\ngaits = "
    with pytest.raises(ValueError, match=r"^gaits: rolling: core: 50 kPa at .*; the rig's limit is 40 kPa"):
        task_of(tmp_path, text + "['inching', 'rolling']")
    task = task_of(tmp_path, text + "['inching']\n[search]")
    found = iter((ROLLING, INCHING))
    monkeypatch.setattr(pipeline_run, "_search", lambda *_: next(found))
    assert list(find_gaits(task, tmp_path)) == ["inching"]
    assert list(find_gaits(task, tmp_path)) == ["inching", "found-flat"]


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
    states = json.loads(text)["states"]
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
    speeds = [(state["replayed"], state["designed"]) for state in json.loads(morpholab(replay)[1])["states"]]
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
