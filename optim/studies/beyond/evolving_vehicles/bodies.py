"""Bodies of vehicles that evolve: places of two sensors on the published grid, and what controllers do in them."""

from typing import Any

import numpy as np

from optim.experiments.body_metrics import Environments, Measuring, Tries, controllers_of
from optim.measures.overlap import learnability, resistance
from optim.measures.sampled import SampledMetrics, sampled_metrics
from optim.problems.robot import RobotProblem
from optim.space import Space, Variable
from robots.braitenberg import VehicleBody
from robots.braitenberg.body import DESIGNS
from robots.braitenberg.experiment import PUBLISHED
from robots.braitenberg.robot import VehicleRobot
from robots.braitenberg.sweeps import sweep
from robots.tasks import Success
from taichi_sim.base.arrays import Floats
from taichi_sim.base.compute import Compute

PLACES = round(np.sqrt(DESIGNS))  # of each sensor
PER_AXIS = round(np.sqrt(PLACES))
BODY = Space(tuple(Variable(f"l{j}{axis}", 0, PER_AXIS - 1, "integer") for j in (1, 2) for axis in "xy"))
HERE = Compute(threads=1)
BOUND = PUBLISHED.radius  # m, distance from the light at which a controller has succeeded
OBJECTIVE = ("worst", "approach")


def body_of(point: Floats) -> VehicleBody:
    """The vehicle with its sensors at places of the grid, x and y of each, shape (4,)."""
    x1, y1, x2, y2 = (int(n) for n in point)
    return VehicleBody.published(PLACES * (PER_AXIS * x1 + y1) + PER_AXIS * x2 + y2 + 1)


def drawn_body(seed: int) -> Floats:
    """A random body, shape (4,)."""
    return BODY.sample(np.random.default_rng((seed, 7)), 1)[0]


def problem_of(body: Floats) -> RobotProblem:
    """Designing a controller for a body, by its worst environment."""
    robot = VehicleRobot(body_of(body))
    return RobotProblem(robot, robot.worlds, objective=OBJECTIVE, summed=True, precision=HERE.precision, threads=1)


def tried(body: Floats, controllers: int, seed: int) -> tuple[SampledMetrics, float]:
    """Metrics of a body over drawn controllers, and its performance: how near the best of them comes to the light [m].

    Performance is minus the distance, in the mean over the environments; NaN if every controller failed.
    """
    robot, near = VehicleRobot(body_of(body)), Success("closest", "<=", BOUND)
    tries = Tries(robot, Environments(robot.worlds, ((near,),) * len(robot.worlds)), HERE)
    drawn = controllers_of(Space(tuple(robot.parameters)), Measuring(controllers, seed=seed))
    found = [tries.outcomes(points) for points in drawn]
    solved = np.concatenate([np.stack([near.kept(each) for each in part], axis=1) for part in found])
    left = np.concatenate([np.mean([_left(each) for each in part], axis=0) for part in found])
    known = left[np.isfinite(left)]
    return sampled_metrics(solved), -float(known.min()) if known.size else np.nan


def exact(body: Floats, weights: int) -> tuple[float, float]:
    """M_L and M_CI of a body over a grid of so many values of each weight; 121 are the published ones."""
    overlap = sweep([body_of(body)], weights, threads=1)[0]
    return float(learnability(overlap)), float(resistance(overlap))


def _left(outcome: Any) -> Floats:
    """Distance left of each controller [m]; NaN where it failed."""
    return np.where(
        np.asarray(outcome.status_or_reason) == "ok", np.asarray(outcome.measures["closest"], float), np.nan
    )
