"""Options from a file."""

import json
import shutil
import tomllib

import numpy as np
import pytest

pytestmark = pytest.mark.usefixtures("simulator")

TASK = """
terrain = ["flat", "hill:5"]
free = ["shape", "control"]
method = "random"
climbers = 3
generations = 1
start-pressure = 2000.0
geometry = "small"
columns = 4
orientation = 10

[set]
seed = 7
"""


def test_a_task_says_what_options_say(morpholab, tmp_path):
    (tmp_path / "task.toml").write_text(TASK.replace("start-pressure = 2000.0\n", ""))
    assert morpholab("codesign --task task.toml --quiet --out a")[0] == 0
    line = "--terrain flat --terrain hill:5 --free shape,control --method random --climbers 3 --generations 1"
    line += " --geometry small --columns 4 --orientation 10 --seed 7 --quiet"
    assert morpholab(f"codesign {line} --out b")[0] == 0
    assert (tmp_path / "a/config.toml").read_bytes() == (tmp_path / "b/config.toml").read_bytes()


def test_the_command_line_counts_more(morpholab, tmp_path):
    (tmp_path / "task.toml").write_text(TASK)
    line = "codesign --task task.toml --quiet --out a --terrain hill:3 --method hill-climb --climbers 2"
    assert morpholab(line)[0] == 0
    config = tomllib.loads((tmp_path / "a/config.toml").read_text())
    assert [terrain["slope"] for terrain in config["problem"]["terrains"]] == [3.0]
    method = {"name": "hill-climb", "climbers": 2, "seed": 7, "start": {"pressure": 2000.0}}
    assert config["method"].items() >= method.items() and config["generations"] == 1


def method(tmp_path):
    return tomllib.loads((tmp_path / "a/config.toml").read_text())["method"]


def test_settings_of_any_type_can_be_said(morpholab, tmp_path):
    for name, said in (
        ("nes", "mirrored = true\nsigma = 0.2"),
        ("map-elites", 'descriptors = ["orientation"]\nbins = 4\nranges = {orientation = [0.0, 45.0]}'),
        ("hill-climb", "start = {pressure = 2000.0}"),
        ("nes", 'bounds = "random"'),
    ):
        task = f"terrain = ['flat']\nmethod = '{name}'\ngenerations = 0\ngeometry = 'small'\n[set]\n{said}"
        (tmp_path / "task.toml").write_text(task)
        assert morpholab("codesign --task task.toml --quiet --out a")[0] == 0
        assert tomllib.loads(said).items() <= method(tmp_path).items()
        shutil.rmtree(tmp_path / "a")


def test_flags_are_true_or_false(morpholab, tmp_path):
    task = "terrain = ['flat', 'hill:5']\nencoding = 'graded'\ncolumns = 2\nclimbers = 2\ngenerations = 0\n"
    (tmp_path / "task.toml").write_text(task + "geometry = 'small'\nladder = true\nhard = false\n")
    assert morpholab("codesign --task task.toml --quiet --out a")[0] == 0
    problem = tomllib.loads((tmp_path / "a/config.toml").read_text())["problem"]
    assert problem["ladder"] is True and "hard" not in problem


def test_settings_of_the_task_and_the_command_line_add_up(morpholab, tmp_path):
    task = "terrain = ['flat']\nmethod = 'nes'\n[set]\nsigma = 0.2\nmirrored = true\nseed = 7\npopulation = 4\n"
    (tmp_path / "task.toml").write_text(task)
    line = "codesign --task task.toml --quiet --out a --generations 0 --set sigma=0.1 --seed 5"
    assert morpholab(line)[0] == 0
    expected = {"sigma": 0.1, "mirrored": True, "seed": 5, "population": 4}
    assert expected.items() <= method(tmp_path).items()


def test_seeds_of_the_command_line_count_more_than_the_seed_of_a_task(morpholab, tmp_path):
    (tmp_path / "task.toml").write_text(TASK.replace("start-pressure = 2000.0\n", ""))
    assert morpholab("codesign --task task.toml --quiet --out a --generations 0 --seeds 3,4 --climbers 2")[0] == 0
    configs = [tomllib.loads((tmp_path / f"a/seed-{seed}/config.toml").read_text()) for seed in (3, 4)]
    assert [config["method"]["seed"] for config in configs] == [3, 4]


@pytest.mark.kernels
@pytest.mark.parametrize("told", ["climbers = 3", "[set]\nclimbers = 3", "seed = 5", "[set]\nseed = 5"])
def test_what_the_command_line_says_counts_more_also_if_it_says_all_that_the_task_sets(morpholab, tmp_path, told):
    (tmp_path / "task.toml").write_text(f'robot = "vehicle"\n{told}\n')
    line = "codesign --task task.toml --quiet --generations 0 --climbers 2 --out a --seed"
    assert morpholab(f"{line} 9")[0] == 0
    assert morpholab(f"{line.replace('--out a', '--out b')}s 9,10")[0] == 0
    for folder in ("a", "b/seed-9", "b/seed-10"):
        method = tomllib.loads((tmp_path / folder / "config.toml").read_text())["method"]
        assert (method["climbers"], method["seed"]) == (2, 10 if "10" in folder else 9)


def test_files_of_heights_are_looked_for_beside_the_task_too(morpholab, tmp_path):
    (tmp_path / "own").mkdir()
    np.save(tmp_path / "own/course.npy", np.zeros((4, 4)))
    task = TASK.replace('"hill:5"', '"course.npy:0.005"').replace("start-pressure = 2000.0\n", "")
    (tmp_path / "own/task.toml").write_text(task)
    assert morpholab("codesign --task own/task.toml --quiet --out a")[0] == 0
    config = tomllib.loads((tmp_path / "a/config.toml").read_text())
    assert config["problem"]["terrains"][1]["ground"] == "own/course.npy:0.005"


@pytest.mark.parametrize(
    ("task", "message"),
    [
        ("climber = 3", "task: task.toml has an unknown key 'climber'; did you mean climbers?"),
        ("generation = 3", "did you mean generations?"),
        ("hooves = 2", "task: task.toml has an unknown key 'hooves'\n"),
        ("out = 'b'", "task: task.toml has an unknown key 'out'"),
        ("climbers = ", "task: task.toml cannot be read"),
        ("climbers = 0", "argument --climbers: 0 is not allowed; give a whole number, at least 1"),
        ("terrain = ['moon']", "argument --terrain: 'moon'"),
        ("set = {step = 3}", "step: method hill-climb does not take it; its settings are climbers, seed, "),
        ("set = {climber = 3}", "its settings are climbers, seed, start, bounds, streams; did you mean climbers?"),
        ("set = ['climbers']", "set: 'climbers' is not allowed; give NAME=VALUE"),
        ("ladder = 'yes'", "task: ladder: 'yes' is not allowed; give true or false"),
    ],
)
def test_a_wrong_task_is_one_line(morpholab, tmp_path, task, message):
    (tmp_path / "task.toml").write_text(task)
    code, _, error = morpholab("codesign --terrain flat --task task.toml --quiet --out a")
    assert code == 2 and message in error and error.count("\n") == 1 and not (tmp_path / "a").exists()


def test_a_task_that_is_not_there_is_one_line(morpholab):
    code, _, error = morpholab("codesign --terrain flat --task task.toml --out a")
    assert code == 2 and "task: task.toml cannot be read" in error and error.count("\n") == 1


@pytest.mark.parametrize(
    ("line", "unknown"),
    [
        ("--task push --terrain flat --objective speed", "prop_distance"),
        ("--task turn --robot walker --objective speed", "turning"),
        ("--task own.toml", "speedy"),
    ],
)
def test_success_on_what_is_not_measured_is_refused_before_any_search(morpholab, tmp_path, line, unknown):
    own = "robot = 'soft-quadruped'\nterrain = ['flat']\nobjective = ['speed']\nsuccess = ['speedy >= 1']\n"
    (tmp_path / "own.toml").write_text(own)
    code, _, error = morpholab(f"codesign {line} --method random --climbers 2 --generations 0 --quiet --out a")
    told = f"success: {unknown!r} is unknown; choose one of "
    assert code == 2 and told in error and error.count("\n") == 1 and not (tmp_path / "a").exists()


@pytest.mark.kernels
def test_a_task_that_comes_with_the_lab(morpholab, tmp_path):
    """It is searched like any robot, goes on, and tells whether it has succeeded."""
    line = "codesign --task walk --method random --climbers 4 --precision f32 --quiet --out a"
    code, out, _ = morpholab(f"{line} --generations 1")
    assert code == 0 and "task walk: not succeeded, speed is " in out and " in flat and should be >= 0.5" in out
    code, out, _ = morpholab(f"{line} --generations 2 --resume --json")
    assert code == 0 and json.loads(out)["succeeded"] is False
    assert method(tmp_path)["name"] == "random"


@pytest.mark.kernels
def test_a_robot_that_feels_a_light_goes_on(morpholab, tmp_path):
    line = "codesign --task light --method random --climbers 2 --precision f32 --quiet --json --out a"
    assert morpholab(f"{line} --generations 0")[0] == 0
    code, out, _ = morpholab(f"{line} --generations 1 --resume")
    assert code == 0 and json.loads(out)["generation"] == 1 and json.loads(out)["best"] < 0


def test_tasks_are_listed(morpholab):
    code, out, _ = morpholab("tasks")
    assert code == 0 and "walk: walk on flat ground\n  soft-quadruped, 40 variables, flat\n" in out
    assert {"rough", "stairs", "light"} <= {each["name"] for each in json.loads(morpholab("tasks --json")[1])}
