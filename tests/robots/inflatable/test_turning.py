"""Derivatives by the heading where the ground turns with it: by the robot turning the other way."""

from dataclasses import replace

import numpy as np
import pytest

from robots.inflatable import GaitSchedule, InflatableActuation, InflatableDesign, InflatableGeometry
from robots.inflatable.gradient import differentiate
from robots.inflatable.program import build_program
from robots.inflatable.simulation import engine_of, simulate, summarise
from robots.inflatable.timing import Counting
from robots.inflatable.turning import rise_by_turn, turned_quaternions, turned_vectors
from robots.world import Terrain
from taichi_sim.base.compute import Compute
from taichi_sim.lattice import LatticeState, Relief

HEADING = 37.0
GEOMETRY = InflatableGeometry(bladder_columns=1, rows=8, foot_rows=2)
WHERE = {
    "geometry": GEOMETRY,
    "actuation": InflatableActuation(inflation_rate=0.005, hold_steps=100, settle_steps=60, ramp_steps=300),
    "precision": "f64",
}


def design(heading=HEADING, repeats=1):
    levels = np.random.default_rng(2).uniform(0.2, 0.8, (10, 1))
    return InflatableDesign(3000.0, heading, GaitSchedule(levels, repeats))


@pytest.mark.kernels
@pytest.mark.parametrize("counting", [Counting(), Counting(window=1), Counting(stages=2)])
def test_a_plane_gives_the_same_whether_world_or_robot_turns(counting):
    """Gravity and the way turn on the plane; on ground that is uneven by an atom's size the robot does."""
    one, other = (
        differentiate(design(repeats=2), Terrain.parse(name), counting=counting, **WHERE).orientation
        for name in ("hill:6", "hill:6+rough:1e-12,0.1")
    )
    assert abs(one) > 1e-6 and other == pytest.approx(one, rel=1e-5)


@pytest.mark.kernels
def test_a_ramp_that_turns_moves_the_robot_as_differences_say():
    ramp, step = Terrain.parse("ramp:6,-3"), 1e-6
    by = differentiate(design(), ramp, **WHERE).orientation[0]
    ends = simulate([design(HEADING + step), design(HEADING - step)], ramp, **WHERE).distance
    assert by == pytest.approx((ends[0] - ends[1]) / (2 * step), rel=1e-3)
    plane = differentiate(design(), replace(ramp, ground=None), **WHERE).orientation[0]
    assert abs(by - plane) > abs(by) / 10  # what the ground's turn adds


def distances_of_turned(terrain, turns):
    """Distances along the heading of robots that are turned [rad] on the same ground [m]."""
    count, positions, quaternions = len(turns), [], []
    each = [design()] * count, [terrain] * count, [WHERE["actuation"]] * count
    engine = engine_of(GEOMETRY, *each[1:], Compute("cpu", "f64"), each[0])
    relief = terrain.uneven.relief(HEADING, GEOMETRY.voxel_size)
    x, y, z = GEOMETRY.body.start_positions.T
    for turn in turns:
        cosine, sine = np.cos(turn), np.sin(turn)
        centres = np.stack([cosine * x - sine * y, sine * x + cosine * y, z], axis=1)
        centres[:, 2] += relief.rise(centres, GEOMETRY.voxel_size)
        positions.append(centres)
        quaternions.append(np.tile([np.cos(turn / 2), 0, 0, np.sin(turn / 2)], (len(x), 1)))
    still = np.zeros((count, len(x), 3))
    engine.set_state(LatticeState(np.array(positions), np.array(quaternions), still, still))
    program = build_program(*each, None, GEOMETRY)
    return summarise(engine.run(program), program, each[0], GEOMETRY, each[2]).distance


@pytest.mark.kernels
@pytest.mark.parametrize("ground", ["wave:0.02,1", "rough:0.01,0.1", "patches:0.3,1,0.03", "blocks:0.002,0.03"])
def test_on_any_ground_it_is_that_of_a_robot_turned_the_other_way(ground):
    terrain, step = Terrain.parse(ground), 1e-6
    by = differentiate(design(), terrain, **WHERE).orientation[0]
    ends = distances_of_turned(terrain, np.radians([-step, step]))
    assert by == pytest.approx((ends[0] - ends[1]) / (2 * step), rel=1e-3)


def test_vectors_and_quaternions_turn_about_the_vertical():
    angle = 1e-7
    turned = np.array([np.cos(angle), np.sin(angle), 0.0])
    np.testing.assert_allclose((turned - [1, 0, 0]) / angle, turned_vectors(np.array([1.0, 0, 0])), atol=1e-6)
    w, x, y, z = quaternion = np.array([0.5, -0.1, 0.7, 0.5])
    cosine, sine = np.cos(angle / 2), np.sin(angle / 2)
    product = np.array([cosine * w - sine * z, cosine * x - sine * y, cosine * y + sine * x, cosine * z + sine * w])
    np.testing.assert_allclose((product - quaternion) / angle, turned_quaternions(quaternion), atol=1e-6)


def test_a_robot_beside_the_axis_rises_where_it_turns_uphill():
    slope = 0.2 * np.arange(41)[None, :] * 0.05 * np.ones((41, 1))  # rises along y
    relief = Relief(slope, 0.05, (-1.0, -1.0))
    assert rise_by_turn(relief, np.array([[0.43, 0.01, 0.0]]), 0.01) == pytest.approx(0.2 * 0.43, rel=1e-6)
