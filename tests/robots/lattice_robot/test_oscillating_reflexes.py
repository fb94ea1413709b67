"""Robots whose muscles follow coupled oscillators: waves, batches, files, and derivatives through the oscillators."""

import dataclasses
import json

import numpy as np
import pytest

from robots.lattice_robot import Drive, Free, LatticeRobot, Reflexes, differentiate, load_robot, simulate
from robots.lattice_robot.record import robot_of_record
from robots.lattice_robot.senses import SENSES
from robots.world import Terrain
from taichi_sim.lattice import Material, body_from_array

SOFT = Material(1e5, 1e3, static_friction=1.0, kinetic_friction=0.8, collision_damping=0.5)
EVERY = tuple(name for name in SENSES if name != "pressure")  # of which bodies with chambers alone have any
FLOATING = "strain", "tilt", "velocity", "clock"


def swimmer_or_walker(reflexes=None, **settings) -> LatticeRobot:
    """Seventeen voxels in three muscles, without symmetry."""
    array = np.ones((6, 3, 1), int)
    array[5, 2, 0] = 0
    body = body_from_array(array, SOFT, 0.01, regions=np.arange(18).reshape(6, 3, 1) % 3)
    drive = Drive("legs", (0, 1, 2), amplitude=Free(0, 0.2, 0.1), phase=(0.1, 0.4, Free(0, 1, 0.8)))
    return LatticeRobot(body, (drive,), reflexes=reflexes, **{"cycles": 1, "settling": 0.05, **settings})


def oscillating(*senses, **given) -> Reflexes:
    """Oscillators that change by up to a third."""
    return Reflexes(senses, kind="oscillators", gain=0.3, **given)


def weighted(robot: LatticeRobot, seed: int = 1) -> np.ndarray:
    """A point with random weights."""
    count = robot.weights_of(robot.start[None]).shape[1]
    return np.concatenate([robot.start[:-count], np.random.default_rng(seed).normal(size=count) * 0.8])


def errors(robot: LatticeRobot, terrain: Terrain, steps) -> np.ndarray:
    """Of derivatives against central differences along four directions, the first two of weights alone."""
    point = weighted(robot)
    found = differentiate(robot, point[None], terrain, threads=1)
    span = np.array([free.high - free.low for free in robot.free.values()])
    directions = np.random.default_rng(0).normal(size=(4, len(point))) * span
    directions[:2, : -robot.weights_of(point[None]).shape[1]] = 0
    differ = []
    for step in steps:
        run = simulate(robot, point + step * np.concatenate([directions, -directions]), terrain, threads=1)
        expected = (run.distance[:4] - run.distance[4:]) / (2 * step)
        differ.append(np.abs(directions @ found.gradient[0] - expected) / np.abs(expected))
    assert found.distance[0] == simulate(robot, point[None], terrain, threads=1).distance[0]
    return np.min(differ, axis=0)


@pytest.mark.kernels
def test_without_weights_a_robot_plays_its_waves():
    """To the bit, through any curve and about any mean."""
    curve = Drive("legs", (0, 1, 2), mean=0.95, amplitude=0.1, phase=(0.1, 0.4, 0.8), knots=(0.0, 1.0, -0.3))
    for drives in (swimmer_or_walker().drives, (curve,)):
        plain = dataclasses.replace(swimmer_or_walker(), drives=drives)
        feeling = dataclasses.replace(plain, reflexes=oscillating("strain", "touch"))
        assert simulate(plain).distance[0] == simulate(feeling).distance[0]


LATE = [((), {}), ((3,), {"noise": 0.05, "delay": 2})]


@pytest.mark.kernels
def test_the_gradient_is_that_of_central_differences():
    """By weights and waves: to 1e-6 in water over 400 steps, through hidden neurons that hear late."""
    hidden, late = LATE[1]
    quick = swimmer_or_walker(oscillating(*FLOATING, hidden=hidden, **late), frequency=40.0, settling=0.0)
    assert errors(quick, Terrain.water(), (1e-6, 1e-7)).max() < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize(("hidden", "late"), LATE)
def test_long_gradients_are_central_differences(hidden, late):
    """With contact on a slope over 4,500 steps to 1e-4."""
    walker = swimmer_or_walker(oscillating(*EVERY, hidden=hidden, light=(0.1, 0.03), coupling=1.0, **late))
    assert errors(walker, Terrain(2.0), (1e-7, 1e-8, 1e-9)).max() < 1e-4


@pytest.mark.kernels
def test_robots_of_a_batch_have_their_own():
    """Each does what it does alone; coupling matters."""
    robot = swimmer_or_walker(oscillating("strain", "tilt"))
    points = np.stack([robot.start, weighted(robot, 1), weighted(robot, 2)])
    together = simulate(robot, points).distance
    assert np.ptp(together) > 1e-5
    assert np.array_equal(together, [simulate(robot, point[None]).distance[0] for point in points])
    loose = dataclasses.replace(robot, reflexes=oscillating("strain", "tilt", coupling=0.0))
    assert simulate(loose, points[1:2]).distance[0] != together[1]


def test_a_design_is_written_and_read(tmp_path):
    """With its kind; weights have a name each."""
    robot = swimmer_or_walker(oscillating("clock", coupling=0.25))
    again = robot_of_record(json.loads(json.dumps(robot.describe())))
    assert again.reflexes == robot.reflexes and [name for name in again.free][-1] == "reflex_27"  # (2 + 1) 3 3
    assert again.reflexes.spoken == "feels clock, coupled oscillators"
    robot.save(weighted(robot), tmp_path / "best.json")
    best = load_robot(tmp_path / "best.json")
    assert best.reflexes.kind == "oscillators" and len(best.reflexes.weights) == 27 and not best.free


def test_growth_counts_in_how_small_a_voxel_gets():
    """Amplitudes grow by the gain, of a sine by no more."""
    robot = swimmer_or_walker(oscillating("clock"))
    wave = 1 + 0.5 * np.sin(2 * np.pi * np.arange(16) / 16)[None]
    assert robot.reflexes.least(wave, np.ones(1)) == pytest.approx(1 - 1.3 * 0.5)
    drive = dataclasses.replace(robot.drives[0], amplitude=0.75)
    huge = dataclasses.replace(robot, drives=(drive,))
    assert huge.fault(huge.start).startswith("legs shrinks to 0.025 of a voxel")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Reflexes(kind="spikes"), "kind: 'spikes' is unknown; choose one of network, oscillators"),
        (lambda: Reflexes(coupling=0.5), "coupling: 0.5 is not allowed with a network"),
        (lambda: oscillating("clock", coupling=2.5), "coupling: 2.5"),
        (lambda: swimmer_or_walker(oscillating("tilt", weights=(1.0, 2.0))), "weights: 2 are not allowed; give 27"),
    ],
)
def test_bad_input(make, message):
    """One line each."""
    with pytest.raises(ValueError, match="^" + message):
        make()
