"""A robot of two legs from a file, and points of it, for tests."""

import math

import numpy as np
import pytest
from articulated_files import CRAWLER

from robots.articulated import ArticulatedRobot, differentiate, simulate

QUICK = {"duration": 0.4, "friction": math.inf}
HERE = {"precision": "f64", "threads": 1}


def crawler(**settings) -> ArticulatedRobot:
    return ArticulatedRobot(CRAWLER, **{**QUICK, **settings})


def some_points(robot, count: int, seed: int = 0) -> np.ndarray:
    low, high = np.array([(p.low, p.high) for p in robot.parameters]).T
    return low + (high - low) * np.random.default_rng(seed).uniform(0.2, 0.8, (count, len(low)))


def assert_differences(robot, points, factors: int) -> None:
    """Check derivatives of the distance by the last parameters, so many factors, against central differences."""
    found = differentiate(robot, points, **HERE).gradient[:, -factors:]
    for n, step in enumerate(1e-6 * np.eye(points.shape[1])[-factors:]):
        ahead, behind = (simulate(robot, points + side * step, **HERE).distance for side in (1, -1))
        assert found[:, n] == pytest.approx((ahead - behind) / 2e-6, rel=2e-5, abs=1e-8), n
    assert (np.abs(found[:, -2:]) > 1e-6).all()
