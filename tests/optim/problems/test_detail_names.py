"""What built-in problems tell beside objectives: they name it all, so that descriptors are checked without any work."""

import numpy as np
import pytest
from linear_robot import Linear

from optim.problems.braitenberg import VehicleProblem
from optim.problems.inflatable.problem import GaitProblem
from optim.problems.robot import RobotProblem
from optim.problems.walker import WalkerProblem
from robots.lattice_robot.walker import WalkerActuation
from robots.world import Terrain

pytestmark = pytest.mark.kernels
GAITS = {"columns": 1, "encoding": "graded", "geometry": "small", "steps": 100}
PROBLEMS = {
    "gaits": lambda: GaitProblem((Terrain(), Terrain(9.0)), **GAITS),
    "hard gaits": lambda: GaitProblem((Terrain(9.0),), **GAITS, hard=True, objectives="terrains"),
    "gaits with effort": lambda: GaitProblem((Terrain(),), **GAITS, effort=0.1),
    "walker": lambda: WalkerProblem((2, 2, 1), actuation=WalkerActuation(cycles=1), threads=1),
    "vehicle": lambda: VehicleProblem(threads=1),
    "limited": lambda: RobotProblem(VehicleProblem().offered, objective=("approach", "closest<=0.1"), threads=1),
}


@pytest.mark.parametrize("name", PROBLEMS)
def test_a_problem_names_all_details_of_its_evaluations(name, monkeypatch):
    monkeypatch.setattr("robots.inflatable.simulation.simulate", Linear().simulate)
    problem = PROBLEMS[name]()
    told = problem.evaluate(problem.space.sample(np.random.default_rng(0), 2)).details
    assert problem.detail_names == set(told)
