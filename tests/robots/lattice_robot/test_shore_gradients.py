"""Gradients of a soft walker that wades or walks on sand, over thousands of steps of contact, buoyancy and drag."""

import numpy as np
import pytest

from robots.lattice_robot.presets import feeling_quadruped
from robots.robot import Trial
from robots.world import Terrain
from taichi_sim.base.compute import Compute

STEP = 1e-8  # in the ranges of what is free: larger moves have a foot touch down a time step earlier


@pytest.mark.kernels
@pytest.mark.slow
@pytest.mark.parametrize("ground", ["water:0.012", "ramp:-10,0+water:0.005", "sand:2e5", "rough:0.004+sand:2e5"])
def test_gradients_are_central_differences(ground):
    """In random directions of all waves and weights, to 1e-4 over 4,915 steps."""
    robot, where = feeling_quadruped(1), Trial(Terrain(ground=ground), Compute(precision="f64", threads=1))
    low, span = np.array([(p.low, p.high - p.low) for p in robot.parameters]).T
    drawn = np.random.default_rng(5)
    point, directions = low + span * drawn.uniform(0.3, 0.7, len(low)), span * drawn.normal(size=(10, len(low)))
    assert robot.cycle.end > 4900
    trial = Trial(where.world, where.compute, gradients=("distance",))
    slopes = directions @ robot.run(robot.points(point), trial).gradients["distance"][0]
    errors = []
    for step in (STEP, STEP / 10):
        moves = step * np.concatenate([directions, -directions])
        found = robot.run(point + moves, where).measures["distance"]
        expected = (found[:10] - found[10:]) / (2 * step)
        errors.append(np.linalg.norm(slopes - expected) / np.linalg.norm(expected))
    assert min(errors) < 1e-4, errors
