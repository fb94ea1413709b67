"""A small laboratory for tests of calibration, and measurements that it makes."""

import dataclasses

import numpy as np

from robots.calibration import BOUNDS, Drag, Laboratory, Properties, Replica
from robots.inflatable import INCHING, InflatableActuation, InflatableGeometry
from robots.inflatable.schedule import GaitSchedule

TINY = InflatableGeometry(bladder_columns=1, rows=10, foot_rows=2, voxel_size=0.02)
QUICK = InflatableActuation(
    inflation_rate=0.004, pressure_ramp=50.0, hold_steps=100, settle_steps=60, low_friction=0.1, high_friction=1.0
)
BENCH = Laboratory(TINY, QUICK, stiffest=600e3, precision="f64", threads=1)  # as feet are dragged
TRUE = Properties(friction=0.7, low_friction=0.15, modulus=330e3, inflation_rate=8.0)
NEAR = BOUNDS | {"modulus": (200e3, 600e3)}
STEP = dataclasses.replace(INCHING, schedule=GaitSchedule(INCHING.schedule.bits[:, :2], 1))


def drag(friction=0.6, load=0.5, grips=True, points=6):
    """What a foot does that sticks, then slides."""
    at = np.linspace(2e-3, 12e-3, points)
    return Drag(at, np.full(points, friction * load), load, grips)


def noisy(experiments, seed, noise=0.002):
    rng = np.random.default_rng(seed)
    measured = []
    for experiment in experiments:
        exact = experiment.predict([Replica(TRUE, 77)], BENCH)[0]
        measured.append(dataclasses.replace(experiment, values=exact * (1 + noise * rng.standard_normal(len(exact)))))
    return measured
