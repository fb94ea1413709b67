"""Tasks that come with the lab, and those of the user's own."""

import numpy as np
import pytest

from robots.outcome import Outcome
from robots.robot import Compute
from robots.tasks import Success, builtin_tasks, find_task

OWN = """
title = "crawl"
robot = "crawler.py"
terrain = ["flat", "hill:5"]
success = ["speed >= 0.1", "energy <= 2"]
"""


@pytest.mark.parametrize("name", builtin_tasks())
def test_every_task_has_a_robot_worlds_and_bounds_that_it_can_keep(name):
    task = builtin_tasks()[name]
    assert task.robot.parameters and task.robot.differentiable and task.worlds and task.title
    assert task.success and len(task.worlds) == len(task.options["terrain"])
    assert find_task(name) == task


def test_a_bound_is_kept_by_designs_that_are_whole():
    found = Outcome({"speed": np.array([0.2, 0.5, 0.9])}, np.array(["ok", "ok", "diverged"]))
    assert Success.parse("speed >= 0.5").kept(found).tolist() == [False, True, False]
    assert Success.parse("speed<=0.2").kept(found).tolist() == [True, False, False]
    assert Success.parse("speed <= 2e-1").text == "speed <= 0.2"


@pytest.mark.kernels
def test_a_design_succeeds_in_every_world():
    task = find_task("walk")
    robot = task.robot.design(task.robot.start)
    compute = Compute(precision="f32", threads=1)
    (outcome,) = (robot.simulate((), world, compute=compute) for world in task.worlds)
    speed = float(outcome.measures["speed"][0])
    for bound, succeeds in ((speed - 0.01, True), (speed + 0.01, False)):
        asked = (Success("speed", ">=", bound), Success("mass", "<=", 1.0))
        given = type(task)(task.name, task.options, success=asked)
        missed = [] if succeeds else [f"speed is {speed:.4g} in flat and should be >= {bound!r}"]
        assert given.succeeded(robot, (), compute) is succeeds and given.missed(robot, (), compute) == missed
    assert type(task)(task.name, task.options).succeeded(robot) is None


def test_a_task_of_the_users_own(tmp_path):
    """Its robot's file is found beside it; values are those that the command line would take."""
    source = "from robots.lattice_robot.presets import soft_quadruped\nrobot = soft_quadruped(2)\n"
    (tmp_path / "crawler.py").write_text(source)
    (tmp_path / "crawl.toml").write_text(OWN)
    task = find_task(tmp_path / "crawl.toml")
    assert task.name == "crawl" and task.title == "crawl" and task.robot.describe()["cycles"] == 2
    assert [world.name for world in task.worlds] == ["flat", "hill:5"]
    assert [one.text for one in task.success] == ["speed >= 0.1", "energy <= 2"]
    (tmp_path / "ice.toml").write_text('robot = "soft-quadruped"\nground-friction = "0.3,0.2"\n')
    (ice,) = find_task(tmp_path / "ice.toml").worlds
    assert (ice.name, ice.static_friction, ice.kinetic_friction) == ("flat", 0.3, 0.2)
    (tmp_path / "vehicle.toml").write_text('robot = "vehicle"\nenvironment = 2\n')
    assert [world.name for world in find_task(tmp_path / "vehicle.toml").worlds] == ["2"]


@pytest.mark.parametrize("place", ["", "hill:5+", "flat+"])
@pytest.mark.parametrize("things", ["", "+sand:200000.0", "+light:0.1,0.05+box:0.02,0.02,0.02,0.1,0.0"])
def test_a_file_of_heights_is_looked_for_beside_the_task_too(tmp_path, monkeypatch, place, things):
    (tmp_path / "a+b").mkdir()
    monkeypatch.chdir(tmp_path)
    np.save("a+b/course.npy", np.zeros((4, 4)))
    text = f"{place}course.npy:0.005{things}"
    (tmp_path / "a+b/push.toml").write_text(f"robot = 'soft-quadruped'\nterrain = ['{text}', 'flat']\n")
    ground = "a+b/course.npy:0.005" + things.partition("+light")[0]
    assert [world.ground for world in find_task("a+b/push.toml").worlds] == [ground, None]
    np.save("course.npy", np.zeros((4, 4)))  # which comes first
    assert find_task("a+b/push.toml").worlds[0].ground == ground.removeprefix("a+b/")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("success = ['speed > 1']", "success: 'speed > 1' is not allowed; give MEASURE >= NUMBER"),
        ("success = ['speed >= fast']", "success: 'speed >= fast' is not allowed"),
        ("success = 3", "success: 3 is not allowed"),
        ("title = 3", "title: 3 is not allowed; give a text"),
        ("robot = 3", "robot: 3 is not allowed; give a text"),
        ("start-pressure = 2\nstart_pressure = 3", "task: task gives start_pressure twice; give it once"),
        ("robot = ", "task: .*task.toml cannot be read"),
    ],
)
def test_bad_files(tmp_path, text, message):
    (tmp_path / "task.toml").write_text(text)
    with pytest.raises(ValueError, match="^" + message):
        find_task(tmp_path / "task.toml")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("terrain = ['lava']", "terrain: 'lava' is unknown"),
        ("terrain = 3", "terrain: '3' is unknown"),
        ("ground_friction = 'ice'", "ground_friction: 'ice' is not allowed; give 2 numbers"),
    ],
)
def test_worlds_that_are_not_allowed(tmp_path, text, message):
    (tmp_path / "task.toml").write_text(f"robot = 'soft-quadruped'\n{text}\n")
    with pytest.raises(ValueError, match="^" + message):
        _ = find_task(tmp_path / "task.toml").worlds


def test_names_that_are_too_long_are_those_of_no_file(tmp_path):
    name = 300 * "a"
    (tmp_path / "task.toml").write_text(f"robot = '{name}'\nterrain = '{name}.npy:1'\n")
    assert find_task(tmp_path / "task.toml").options == {"robot": name, "terrain": [f"{name}.npy:1"]}


def test_what_is_not_there():
    with pytest.raises(
        ValueError, match=r"^task: 'wlk' is unknown; give a file, or one of walk, .* did you mean walk\?"
    ):
        find_task("wlk")
    with pytest.raises(ValueError, match=r"^success: 'height' is unknown; choose one of speed, "):
        _ = type(find_task("walk"))("walk", {"robot": "soft-quadruped"}, success=(Success("height", ">=", 1.0),)).robot


def test_a_mark_of_byte_order_before_a_task_is_skipped(tmp_path):
    path = tmp_path / "own.toml"
    path.write_text("robot = 'walker'\nterrain = ['flat']\n", encoding="utf-8-sig")
    assert find_task(path).options == {"robot": "walker", "terrain": ["flat"]}
