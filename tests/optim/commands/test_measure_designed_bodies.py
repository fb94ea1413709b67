"""``morpholab measure`` of a body that a search has found: sizes are held as its best design has them."""

import json

import numpy as np
import pytest
from articulated_files import CRAWLER

from robots.articulated.robot import ArticulatedRobot

BODY = "--robot crawler.xml --duration 0.3 --body-sizes front=0.5:2"
TRIED = "--success 'speed >= 0.01' --controllers 12 --quiet --json"


@pytest.fixture
def crawler(tmp_path):
    """The robot's file, in the folder where commands run."""
    (tmp_path / "crawler.xml").write_text(CRAWLER)
    return tmp_path


@pytest.mark.kernels
def test_a_found_body_is_measured_with_the_controllers_of_any(crawler, morpholab):
    line = f"codesign {BODY} --method cma --population 4 --generations 2 --terrain flat --quiet --out run"
    assert morpholab(line)[0] == 0
    code, out, error = morpholab(f"measure --robot run --hold '*_size' {TRIED} --out found")
    assert code == 0, error
    size = json.loads((crawler / "run" / "best.json").read_text())["values"]["front_size"]
    held = json.loads((crawler / "found" / "measures.json").read_text())["robot"]["held"]
    assert held == {"front_size": size}
    fixed = BODY.replace("0.5:2", repr(size))
    code, alone, error = morpholab(f"measure {fixed} {TRIED} --out fixed")
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
        ("--hold '*'", "held: all 8 parameters are; leave some free"),
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
    assert code == 2 and "hold: say what of the best design of run is no controller, of frequency, " in error
