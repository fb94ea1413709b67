"""The speed of a gait of which a search plays a part: the same for the search and all that plays the robot it found."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from graded import GRIPPING, TINY

from optim.problems.inflatable.problem import GaitProblem
from optim.problems.uncertain import TrialWorlds
from robots.inflatable import NAMED_GEOMETRIES
from robots.inflatable.actuation import PUBLISHED_STEPS
from robots.inflatable.convention import SpeedConvention
from robots.inflatable.robustness import judge_gait
from robots.inflatable.timing import Counting
from robots.inflatable.variations import Conditions, at_half_step
from robots.robot import Outcome, Robot, Trial
from robots.world import Terrain
from taichi_sim.base.compute import Compute
from taichi_sim.base.short_text import decimal

FLAT = Terrain()
HERE = Compute.given({"precision": "f32", "threads": 1})
PARTS = [{"stages": 4}, {"stages": 2, "warm_up": 2000}, {"warm_up": 2000}]


def searched(**options) -> tuple[GaitProblem, np.ndarray]:
    """A search for gaits that do not last long, and a point of it."""
    given = {"encoding": "graded", "columns": 2, "geometry": "small", "steps": 5000, "pressure": 0.0, "threads": 1}
    made = GaitProblem((FLAT,), **{**given, **options})
    return made, made.space.sample(np.random.default_rng(1), 1)[0]


def played(robot: Robot) -> Outcome:
    """What a robot does, as `simulate`, reports and the lab play it."""
    return robot.run(np.zeros((1, 0)), Trial(FLAT, compute=HERE))


@pytest.fixture
def tiny(monkeypatch):
    monkeypatch.setitem(NAMED_GEOMETRIES, "small", TINY)


@pytest.mark.kernels
@pytest.mark.parametrize("part", PARTS)
def test_a_search_and_all_that_plays_its_robot_count_one_speed(tiny, tmp_path, monkeypatch, part):
    made, point = searched(**part)
    found, robot = made.evaluate(point).objectives[0, 0], made.robot_of(point)
    outcome, whole = played(robot), played(dataclasses.replace(robot, convention=None))
    assert outcome.measures["speed"] == found != whole.measures["speed"]
    titles = []
    monkeypatch.setattr("robots.inflatable.view.picture.inflatable_picture", lambda r, *_, **__: titles.append(r.speed))
    monkeypatch.setattr("robots.inflatable.view.picture.save_picture", lambda *_: None)
    robot.save_picture(FLAT, tmp_path / "robot.png")
    assert [title.item() for title in titles] == [found]
    assert robot.title_of(outcome, FLAT).replace("\N{MINUS SIGN}", "-").startswith(f"{decimal(found)} BL/s")
    (logged,) = made.logged(point, found, {"speed_flat": found})
    assert logged["speed"] == found
    if "stages" in part:  # the speed is that of a part of the way
        assert "distance" not in logged
    else:
        assert logged["distance"] == pytest.approx(outcome.measures["distance"].item())
    assert f"BL/s ({made.convention.spoken}; " in robot.spoken(outcome)


@pytest.mark.kernels
@pytest.mark.parametrize("part", PARTS[:2])
def test_draws_of_a_searchs_robot_count_as_in_the_search(tiny, part):
    """So does robust.json, which plays the robot in draws of its own."""
    unknown = "friction=20%,timing=5%"
    made, point = searched(uncertain=unknown, draws=2, **part)
    robot = made.robot_of(point)
    trials = TrialWorlds.of(robot, made.terrains, unknown, 2)
    outcomes = robot.run_in(np.zeros((1, 0)), trials.worlds, Trial(FLAT, compute=HERE), trials.variants)
    speeds = [float(each.measures["speed"][0]) for each in outcomes]
    assert len(set(speeds)) == 2 and np.mean(speeds) == pytest.approx(made.evaluate(point).objectives.item(), rel=1e-12)


@pytest.mark.kernels
def test_a_judgement_counts_as_the_search_does(tiny):
    made, point = searched(**PARTS[1])
    given = {"geometry": TINY, "actuation": made.actuation, "runs": 2, "precision": "f32", "threads": 1}
    found = judge_gait(made.design(point), convention=made.convention, **given)
    assert found.speed == pytest.approx(made.evaluate(point).objectives.item(), rel=0.05)
    whole = judge_gait(made.design(point), **given)
    assert (found.slip < whole.slip).any() and found.steps == whole.steps  # feet slip in the warm-up, too


def test_half_the_time_step_counts_twice_as_many():
    made, point = searched(**PARTS[1])
    given = Conditions(made.design(point), FLAT, made.body, made.actuation, made.convention)
    assert at_half_step(given).convention == SpeedConvention(Counting(4000, 2), 10000)
    assert SpeedConvention().slower(2) == SpeedConvention()
    assert SpeedConvention().least_steps(at_half_step(given).actuation) == pytest.approx(2 * PUBLISHED_STEPS, abs=100)


@pytest.mark.kernels
def test_another_body_has_its_own_length_and_another_gait_the_usual_convention(tiny, monkeypatch):
    monkeypatch.setitem(NAMED_GEOMETRIES, "published", GRIPPING)
    made, point = searched()
    robot = made.robot_of(point)
    other = robot.changed({"geometry": "published"})
    outcome = played(other)
    steps = max(5000, int(outcome.steps[0]))
    expected = outcome.measures["distance"] / GRIPPING.body_length / (steps * GRIPPING.time_step)
    assert outcome.measures["speed"] == pytest.approx(expected, rel=1e-12) and GRIPPING.body_length != TINY.body_length
    assert robot.changed({"repeats": 1}).convention is None


def test_results_of_another_number_of_stages_are_refused():
    result = SimpleNamespace(stages=np.ones((1, 1)), steps=np.array([9]), time_step=1e-4, speed=np.ones(1))
    made, _ = searched(stages=4)
    with pytest.raises(ValueError, match="stages: 1 of a result are not allowed; simulate with counting, 4 stages"):
        made.speeds(result)
