"""``morpholab measure`` of a body that a search has found: sizes are held as its best design has them."""

import json

import numpy as np
import pytest
from articulated_files import CRAWLER

from morpholab import build_method, open_run, run_search
from optim.problems import problem_of_run
from optim.problems.robot import RobotProblem
from optim.runs.config import read_config, settings_of
from robots.articulated.robot import ArticulatedRobot
from robots.free import Free
from robots.partly_fixed import held_at

BODY = "--robot crawler.xml --duration 0.3 --body-sizes front=0.5:2"
TRIED = "--success 'speed >= 0.01' --controllers 12 --quiet --json"


@pytest.fixture
def crawler(tmp_path):
    """The robot's file, in the folder where commands run."""
    (tmp_path / "crawler.xml").write_text(CRAWLER)
    return tmp_path


@pytest.mark.kernels
def test_a_found_body_is_measured_with_the_controllers_of_any(crawler, morpholab):
    line = f"codesign {BODY} --method cma --population 4 --generations 2 --terrain hill:2 --quiet --out run"
    assert morpholab(line)[0] == 0
    code, out, error = morpholab(f"measure --robot run --hold '*_size' {TRIED} --out found")
    assert code == 0, error
    size = json.loads((crawler / "run" / "best.json").read_text())["values"]["front_size"]
    held = json.loads((crawler / "found" / "measures.json").read_text())
    assert held["robot"]["held"] == {"front_size": size} and held["environments"] == ["hill:2"]  # as in the run
    fixed = BODY.replace("0.5:2", repr(size))
    code, alone, error = morpholab(f"measure {fixed} --environments hill:2 {TRIED} --out fixed")
    assert code == 0, error
    found, alone = json.loads(out), json.loads(alone)
    assert found["learnability"] == alone["learnability"] and found["resistance"] == alone["resistance"]


@pytest.mark.kernels
def test_of_a_robot_without_a_run_starting_values_are_held(crawler, morpholab):
    code, _, error = morpholab(f"measure {BODY} --hold '*_size' --hold frequency {TRIED} --out a")
    assert code == 0, error
    robot = ArticulatedRobot(CRAWLER, duration=0.3, body_sizes={"front": 1.0})
    held = json.loads((crawler / "a" / "measures.json").read_text())["robot"]["held"]
    assert held["front_size"] == 1.0 and held["frequency"] == robot.start[0] and len(held) == 2
    assert np.isfinite(json.loads((crawler / "a" / "metrics.json").read_text())["learnability"]["value"])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("--hold size", "hold: size matches none of frequency, "),
        ("--hold '*'", "hold: all 8 parameters are held; leave some free"),
    ],
)
def test_what_cannot_be_held_is_refused(options, message, crawler, morpholab):
    code, out, error = morpholab(f"measure {BODY} {options} {TRIED} --out a")
    assert code == 2 and not out and f"error: {message}" in error


@pytest.mark.kernels
def test_a_run_of_which_nothing_is_held_is_refused(crawler, morpholab):
    assert (
        morpholab(f"codesign {BODY} --method random --generations 1 --climbers 2 --terrain flat --quiet --out run")[0]
        == 0
    )
    code, _, error = morpholab(f"measure --robot run {TRIED} --out a")
    assert code == 2 and "hold: nothing of the best design of run; name what is no controller, of frequency, " in error


@pytest.mark.kernels
def test_a_search_with_parameters_held_goes_on_and_its_design_is_the_robots(crawler, morpholab):
    robot = ArticulatedRobot(CRAWLER, duration=0.3, body_sizes={"front": Free(0.5, 2.0)})
    held = held_at(robot, [*robot.start[:-1], 1.5], ["*_size"])
    problem, folder = RobotProblem(held, ["flat"]), crawler / "run"
    settings = {"climbers": 2, "seed": 0}
    with open_run(folder, settings_of(problem, "random", settings, 2)) as run:
        run_search(problem, build_method("random", problem.space, settings), run, 2)
    assert problem_of_run(folder, read_config(folder)).describe() == problem.describe()
    code, out, error = morpholab("codesign --resume --generations 3 --quiet --json --out run")
    assert code == 0, error
    assert json.loads((folder / "best.json").read_text())["values"]["front_size"] == 1.5
    best = json.loads(morpholab("status run --json")[1])[0]["best"]
    code, out, _ = morpholab("simulate --robot run --quiet --json")
    assert code == 0 and json.loads(out)["speed"] == pytest.approx(best)
