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


@pytest.mark.kernels
@pytest.mark.parametrize("every", [3, 60])
def test_distance_is_that_from_the_start_however_many_frames_there_are(every):
    driven = rover.simulate(rover.Rover(), (3.0, -1.0), steps=600, record_every=every, precision="f64", threads=1)
    seen = rover_motion(rover.Rover(), driven, rover.LIGHTS)
    distance = {channel.name: channel for channel in seen.channels}["distance"].values
    np.testing.assert_allclose(distance, np.hypot(*(seen.path - seen.path[0])[:, :2].T), atol=1e-12)
    assert distance[-1] < 0.95 * np.hypot(*np.diff(seen.path[:, :2], axis=0).T).sum()  # it turns
