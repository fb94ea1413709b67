"""What a task of the pipeline says, and what it must not say."""

import dataclasses
from dataclasses import replace

import numpy as np
import pytest
from small_pipeline import task_of

from optim.pipeline import run as pipeline_run
from optim.pipeline.run import find_gaits
from optim.pipeline.task import read_task
from robots.calibration import Properties, save_properties
from robots.hardware import export_csv
from robots.inflatable import ACTUATION, INCHING, PUBLISHED, ROLLING, SMALL
from robots.inflatable.design import save_design
from robots.inflatable.schedule import GaitSchedule
from robots.world import Terrain


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


def test_a_task_for_a_rig_has_the_weight_of_its_fit(tmp_path):
    save_properties(Properties.of(), "small", tmp_path / "fit.json", "physical")
    text = "terrains = ['flat']\ncalibration = 'fit.json'\ngaits = ['rolling']\n"
    task = task_of(tmp_path, text)
    assert task.weight == task.robot["actuation"].weight == pipeline_run.settings_of(task)["weight"] == "physical"
    assert task_of(tmp_path, f"{text}weight = 'published'").weight == "published"


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
        (
            "terrains = ['flat', 'rough:0.01']\ngaits = ['rolling', 'inching']",
            "terrains: uneven ground .rough:0.01. is not allowed",
        ),
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


def test_gaits_that_cannot_be_legs_are_refused_before_any_simulation(tmp_path):
    """A journey would refuse them after minutes of work."""
    schedule, columns = INCHING.schedule, INCHING.schedule.columns
    for name, core, message in (
        ("ends", np.r_[np.zeros(columns - 1), 3e3], "gaits: ends begins with 0 kPa and ends with 3 kPa; give one that"),
        ("apart", np.zeros((2, columns)), "gaits: apart: a gait with core pressures of several cores is not allowed"),
    ):
        own = GaitSchedule(schedule.levels, schedule.repeats, core_pressure=core)
        save_design(replace(INCHING, schedule=own), tmp_path / f"{name}.json")
        with pytest.raises(ValueError, match=f"^{message}"):
            task_of(tmp_path, f"terrains = ['flat', 'hill:5']\ngaits = ['rolling', '{name}.json']")
        assert task_of(tmp_path, f"terrains = ['flat']\ngaits = ['rolling', '{name}.json']").gaits
        assert task_of(tmp_path, f"terrains = ['flat', 'rough:0.01']\ngaits = ['{name}.json']").gaits


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


def test_a_gait_called_like_one_that_a_search_finds_is_refused_beside_a_search(tmp_path, morpholab):
    """Before anything is written, so that the same command serves once its file has another name."""
    save_design(INCHING, tmp_path / "found-flat.json")
    text = "terrains = ['flat']\ngaits = ['found-flat.json']\n"
    assert list(task_of(tmp_path, text).gaits) == ["found-flat"]
    message = "gaits: found-flat is not allowed beside a search, whose gaits are called so; rename its file"
    with pytest.raises(ValueError, match=f"^{message}$"):
        task_of(tmp_path, f"{text}[search]\n")
    code, _, error = morpholab(f"pipeline {tmp_path / 'task.toml'} --out {tmp_path / 'out'} --quiet")
    assert code == 2 and message in error and not (tmp_path / "out").exists()
