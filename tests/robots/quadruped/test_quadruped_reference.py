"""The quadrupeds against runs of an Open Dynamics Engine scene built from the same numbers."""

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest

from robots.quadruped import LEGGED, WHEELED, WHEGGED, engine
from taichi_sim.rigid import State

pytestmark = pytest.mark.kernels

RUNS = np.load(Path(__file__).parents[2] / "data/quadruped_runs.npz")
CASES = list(RUNS["cases"])
ROBOTS = pytest.mark.parametrize("robot", [LEGGED, WHEELED, WHEGGED], ids=lambda robot: robot.kind)


@pytest.fixture(scope="module")
def comparison():
    """The script that prints what is tested here."""
    folder = str(Path(__file__).parents[3] / "benchmarks")
    sys.path.insert(0, folder)
    try:
        yield importlib.import_module("quadruped_reference")
    finally:
        sys.path.remove(folder)


@ROBOTS
def test_robots_go_where_those_of_the_reference_go_under_nine_commands(comparison, robot):
    """1 mm while they settle, 5 mm with equal commands, 10 mm with opposed wheels, 50 mm else; millimetres of all."""
    found = comparison.deviations(RUNS, robot)
    missed = {
        case: 1e3 * deviation.max()
        for case, deviation in zip(CASES, found, strict=True)
        if not deviation[: comparison.bounded_steps(robot.kind, case, deviation.size)].max() <= comparison.BOUNDS[case]
    }
    assert not missed and found.shape == (9, 400)


def test_runs_that_leave_the_reference_are_those_that_a_hair_moves_as_far(comparison):
    """Robots that start 1e-5 m higher or lower end elsewhere, by more than the bound that holds else."""
    for (kind, case), steps in comparison.ILL_CONDITIONED.items():
        robot = next(each for each in comparison.ROBOTS if each.kind == kind)
        simulator = engine(robot, precision="f64", threads=1)
        rest = simulator.rest()
        positions = rest.position + np.array([[0, 0, 0], [0, 0, 1e-5], [0, 0, -1e-5]])
        start = State(positions, rest.orientation, rest.angles, rest.velocity, rest.rates)
        commands = RUNS["commands"][CASES.index(case)][None, None]
        ends = simulator.run(399, commands=commands, start=start).position
        assert np.linalg.norm(ends[1:] - ends[0], axis=1).min() > comparison.BOUNDS[case] and steps >= 10


@ROBOTS
def test_random_controllers_come_to_the_distributions_of_the_reference(comparison, robot):
    """Distance travelled, height and light of 500: Kolmogorov and Smirnov's distance, quantiles of 90 % and 99 %."""
    theirs = comparison.quantities(RUNS[f"{robot.kind}_random_end"])
    ours = comparison.quantities(comparison.random_ends(RUNS, robot))
    found = [comparison.agreement(name, ours[name], theirs[name]) for name in theirs]
    assert [each.name for each in found if not each.holds] == []
    assert all(0.08 < each.limit < 0.09 for each in found)


@ROBOTS
def test_single_precision_comes_to_these_distributions_too(comparison, robot):
    theirs = comparison.quantities(RUNS[f"{robot.kind}_random_end"])
    ours = comparison.quantities(comparison.random_ends(RUNS, robot, "f32"))
    assert all(comparison.agreement(name, ours[name], theirs[name]).holds for name in ("distance", "light"))


def test_distributions_that_differ_are_told_apart(comparison):
    """A tenth more or less of the distance, and another tail."""
    theirs = comparison.quantities(RUNS["whegged_random_end"])["distance"]
    assert comparison.agreement("same", theirs, theirs).holds
    assert not comparison.agreement(
        "other body", comparison.quantities(RUNS["legged_random_end"])["distance"], theirs
    ).holds
    assert not comparison.agreement("no tail", np.minimum(theirs, np.quantile(theirs, 0.8)), theirs).holds
