"""Gradients with a horizon: where they lead, what a problem says of them, and robots that have none."""

import dataclasses
import warnings

import numpy as np
import pytest

from optim import maximise
from optim.lab import differentiate
from optim.problem import Request, evaluate_request
from optim.problems import problem_of_description
from optim.problems.robot import RobotProblem
from robots.braitenberg.robot import VehicleRobot
from robots.lattice_robot import Drive, Free, LatticeRobot
from robots.lattice_robot.presets import feeling_quadruped
from robots.world import Terrain
from taichi_sim.lattice import Material, body_from_array


def problem(horizon=None, cycles=4, ground="rough:0.006,0.05,1"):
    terrain = Terrain.parse(ground)
    return RobotProblem(feeling_quadruped(cycles), (terrain,), measure="speed", gradient_horizon=horizon, threads=1)


def length(given):
    """Of the gradient of the speed, as if all variables had a range of one: the median of three drawn points."""
    points = given.space.sample(np.random.default_rng(0), 3)
    found = evaluate_request(given, Request(points, "gradients", np.inf)).gradients
    return np.median(np.linalg.norm(found * given.space.span, axis=1))


@pytest.mark.kernels
def test_what_grows_without_bound_is_bounded_by_a_horizon():
    """Of a robot that feels, exact gradients grow with the time of the trial, those with a horizon far less."""
    exact = [length(problem(None, cycles)) for cycles in (1, 4)]
    short = [length(problem(0.03, cycles)) for cycles in (1, 4)]
    assert exact[1] > 100 * exact[0]
    assert short[1] / short[0] < exact[1] / exact[0] / 100 and short[1] < exact[1] / 100


@pytest.mark.kernels
def test_a_call_that_differentiates_tells_of_chaos_and_takes_a_horizon():
    given = problem(cycles=5)
    point, where = given.space.sample(np.random.default_rng(0), 1), given.worlds[0]
    with pytest.warns(UserWarning, match=r"^speed: by its derivative, a small change of .* gradient-check measures"):
        exact = differentiate(given.robot, point, where, measures="speed", threads=1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it may still be large
        short = differentiate(given.robot, point, where, measures="speed", gradient_horizon=1e-3, threads=1)
    sizes = [np.abs(found.outcome.gradients["speed"]).max() for found in (exact, short)]
    assert sizes[1] < sizes[0] / 100 and exact["speed"] == short["speed"]
    with pytest.raises(ValueError, match=r"^gradient_horizon: Braitenberg vehicle has none; leave it out$"):
        differentiate("vehicle", gradient_horizon=0.1)


@pytest.mark.kernels
def test_derivatives_that_hold_are_not_doubted_though_the_measure_is_next_to_zero():
    """A symmetric robot goes nowhere: any change is many times its way, as its derivative rightly says."""
    drives = [Drive(name, (place,), amplitude=Free(0.0, 0.4)) for place, name in enumerate(("back", "front"))]
    rubber = Material(1e5, 1e3, static_friction=1.0, kinetic_friction=0.8)
    body = body_from_array(np.ones((4, 1, 1), int), [rubber], 0.01, regions=np.array([0, 0, 1, 1]).reshape(4, 1, 1))
    found = differentiate(LatticeRobot(body, tuple(drives), cycles=1), where="water", measures="distance")
    assert abs(found["distance"][0]) < 1e-9 < np.abs(found.outcome.gradients["distance"]).max()


@pytest.mark.kernels
@pytest.mark.slow
def test_prints_in_sand_fade_too():
    """A print lasts as long as a foot is in the ground, and carries derivatives with it."""
    exact, long, short = (length(problem(horizon, 2, "sand:200000")) for horizon in (None, 0.03, 1e-6))
    assert long < exact / 10 and long < 1.5 * short


@pytest.mark.kernels
def test_a_problem_with_a_horizon_is_described_and_made_again():
    given = problem(0.03)
    again = problem_of_description(given.describe())
    assert given.describe()["gradient_horizon"] == 0.03 and again.describe() == given.describe()
    assert "gradient_horizon" not in problem().describe()
    assert dataclasses.replace(again, gradient_horizon=None).describe() == problem().describe()


@pytest.mark.parametrize(("horizon", "told"), [(0, "0"), (-1.0, "-1.0"), (float("inf"), "inf"), ("far", "'far'")])
def test_bad_horizons_are_told(horizon, told):
    with pytest.raises(ValueError, match=f"^gradient_horizon: {told} is not allowed; give a positive finite number$"):
        problem(horizon)


def test_other_robots_have_none_and_methods_must_take_gradients():
    with pytest.raises(ValueError, match=r"^gradient_horizon: Braitenberg vehicle has none; leave it out$"):
        RobotProblem(VehicleRobot(), gradient_horizon=0.1)
    with pytest.raises(
        ValueError, match=r"^gradient_horizon: it is not allowed with a method that takes no gradients; l"
    ):
        maximise(problem(0.03), "nes", progress=False)
