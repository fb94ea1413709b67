"""Motions of small robots that tests look at, simulated once."""

from functools import cache

import numpy as np

from robots import quadruped, rover
from robots.braitenberg import PUBLISHED, VehicleBody, contralateral, trace
from robots.braitenberg.motion import vehicle_motion
from robots.frames import Frames
from robots.inflatable import InflatableActuation, InflatableDesign, InflatableGeometry, InflatableResult, simulate
from robots.inflatable.schedule import GaitSchedule
from robots.inflatable.view.motion import inflatable_motion
from robots.lattice_robot import walker
from robots.lattice_robot.motion import lattice_robot_motion
from robots.quadruped.motion import quadruped_motion
from robots.rover.motion import rover_motion
from robots.view.motion import Motion

QUICK = InflatableActuation(inflation_rate=0.05, pressure_ramp=50.0, hold_steps=100, settle_steps=30)
TINY = InflatableGeometry(bladder_columns=1, rows=10, foot_rows=2, voxel_size=0.02)
STILL = GaitSchedule(np.zeros((10, 1)), repeats=1)
DESIGN = InflatableDesign(6e3, 30.0, GaitSchedule(np.eye(10)[:, [0, 4, 8]], repeats=1))
LIGHTS = [(9.0, 0.0)]


@cache
def inflatable() -> Motion:
    """Bladders 1 and 5, then foot 1, one after the other."""
    result = simulate(DESIGN, geometry=TINY, actuation=QUICK, precision="f32", record_every=10, threads=1)
    return inflatable_motion(result, DESIGN, actuation=QUICK)


@cache
def soft_walker() -> Motion:
    """Active legs in antiphase."""
    materials = np.full((3, 2, 2), walker.PASSIVE)
    materials[0], materials[2], materials[1, :, 0] = walker.ACTIVE, walker.ANTIPHASE, walker.EMPTY
    drive = walker.WalkerActuation(cycles=1, settling=0.05)
    design = walker.WalkerDesign(materials)
    result = walker.simulate(design, actuation=drive, precision="f32", record_every=40, threads=1)
    return lattice_robot_motion(result, walker.walker_robot(design, actuation=drive), name="walker")


@cache
def legged() -> Motion:
    """A legged quadruped that fidgets."""
    weights = np.random.default_rng(0).uniform(-1, 1, (1, 5, 8))
    result = quadruped.simulate(quadruped.LEGGED, weights, LIGHTS, steps=40, record_every=4, precision="f32", threads=1)
    return quadruped_motion(quadruped.LEGGED, result, LIGHTS)


@cache
def two_wheels() -> Motion:
    """A two-wheel vehicle that drives."""
    result = rover.simulate(rover.Rover(), (1.0, 1.0), steps=200, record_every=20, precision="f32", threads=1)
    return rover_motion(rover.Rover(), result, rover.LIGHTS)


@cache
def vehicle() -> Motion:
    """A Braitenberg vehicle that reaches its light."""
    body = VehicleBody.published(6553)
    traces = trace([body], contralateral(np.ones(2))[None, None], PUBLISHED, threads=1)
    return vehicle_motion(traces, body, PUBLISHED).every(20)


ALL = (inflatable, soft_walker, legged, two_wheels, vehicle)


def posed(places=((0.0, 0.0, 0.0),), geometry=TINY) -> InflatableResult:
    """The robot as it was built, moved to some places one after the other."""
    body, one = geometry.body, np.ones(1)
    positions = body.start_positions + np.array(places)[:, None, None]
    orientations = np.broadcast_to([1.0, 0, 0, 0], (*positions.shape[:3], 4))
    extents = np.full((*positions.shape[:3], 6), geometry.voxel_size / 2)
    frames = Frames(positions, orientations, 0.5 * np.arange(len(places)), extents, 2 * extents[..., ::2])
    return InflatableResult(
        one, one, one, np.array(["ok"]), one[:, None], np.array([99]), 1e-4, frames, body, np.zeros((1, 2))
    )


def shown(places=((0.0, 0.0, 0.0),), gait=STILL) -> Motion:
    """The motion of the robot as it was built, at some places one after the other."""
    return inflatable_motion(posed(places), InflatableDesign(0.0, 0.0, gait), actuation=QUICK)
