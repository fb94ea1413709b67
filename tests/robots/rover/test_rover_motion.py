"""Motions of the two-wheel vehicle."""

import numpy as np
import pytest

from robots import rover
from robots.rover.motion import rover_motion


@pytest.mark.kernels
def test_sensors_are_seen():
    driven = rover.simulate(rover.Rover(), (1.0, 1.0), steps=5, record_every=1, precision="f32", threads=1)
    seen = rover_motion(rover.Rover(), driven, rover.LIGHTS, environment=2)
    assert [node.channel for node in seen.nodes[-2:]] == [0, 1] and seen.scale[0, -1] == pytest.approx(0.1 * np.ones(3))
