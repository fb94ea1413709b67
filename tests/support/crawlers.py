"""A robot of two legs from a file, and points of it, for tests."""

import math

import numpy as np
from articulated_files import CRAWLER

from robots.articulated import ArticulatedRobot

QUICK = {"duration": 0.4, "friction": math.inf}
HERE = {"precision": "f64", "threads": 1}


def crawler(**settings) -> ArticulatedRobot:
    return ArticulatedRobot(CRAWLER, **{**QUICK, **settings})


def some_points(robot, count: int, seed: int = 0) -> np.ndarray:
    low, high = np.array([(p.low, p.high) for p in robot.parameters]).T
    return low + (high - low) * np.random.default_rng(seed).uniform(0.2, 0.8, (count, len(low)))
