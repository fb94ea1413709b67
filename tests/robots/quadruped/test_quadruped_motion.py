"""Motions of quadrupeds."""

import numpy as np
import pytest

from robots import quadruped, rover
from robots.quadruped.motion import quadruped_motion
from robots.view.motion import BALL
from robots.view.rigid_motion import rigid_motion
from taichi_sim.lattice.faces import rotate

LIGHTS = [(9.0, 0.0), (0.0, 9.0)]


@pytest.fixture(scope="module")
def legged():
    weights = np.random.default_rng(0).uniform(-1, 1, (2, 5, 8))
    return quadruped.simulate(quadruped.LEGGED, weights, LIGHTS, steps=60, record_every=1, precision="f32", threads=1)


@pytest.mark.kernels
def test_a_quadruped_at_the_start_stands_as_built(legged):
    motion = quadruped_motion(quadruped.LEGGED, legged, LIGHTS, controller=1, environment=1)
    assert len(motion.nodes) == 9 and [node.name for node in motion.nodes[:3]] == ["main", "thigh 0", "thigh 1"]
    bodies = {body.name: body for body in quadruped.LEGGED.tree().bodies}
    for n, node in enumerate(motion.nodes):
        body = bodies[node.name]
        assert motion.translation[0, n] == pytest.approx(np.array(body.position, float), abs=1e-7)
        (solid,) = body.shapes
        if node.name != "main":
            axis = rotate(motion.rotation[0, n], np.array([0.0, 0.0, 1.0]))
            assert axis == pytest.approx(np.array(solid.axis, float), abs=1e-7)
    assert motion.path[-1] == pytest.approx(legged.position[1, 1], abs=0.05)
    assert motion.lights == pytest.approx(np.array([[0.0, 9.0, quadruped.LIGHT_HEIGHT]]))
    names = [channel.name for channel in motion.channels]
    assert names[:5] == [*(f"foot {leg} on ground" for leg in range(1, 5)), "light"] and len(names) == 15


@pytest.mark.kernels
def test_wheels_are_seen():
    result = quadruped.simulate(
        quadruped.WHEELED, np.ones((1, 5, 8)), LIGHTS, steps=5, record_every=1, precision="f32", threads=1
    )
    motion = quadruped_motion(quadruped.WHEELED, result, LIGHTS)
    assert sum(node.solid == BALL for node in motion.nodes) == 4


@pytest.mark.kernels
def test_frames_of_other_robots_are_refused_in_one_line(legged):
    with pytest.raises(ValueError, match=r"^frames: they have 8 hinges, the robot 3; give its own$"):
        rigid_motion(rover.Rover().tree(), legged.rollouts.frames)
    with pytest.raises(ValueError, match=r"^controller: 2 is not allowed; the result has 2$"):
        quadruped_motion(quadruped.LEGGED, legged, LIGHTS, controller=2)
