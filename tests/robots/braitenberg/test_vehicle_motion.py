"""Motions of Braitenberg vehicles."""

import numpy as np
import pytest

from robots.braitenberg import BASELINE, PUBLISHED, VehicleBody, contralateral, trace
from robots.braitenberg.motion import vehicle_motion


@pytest.mark.kernels
def test_a_vehicle_is_shown_up_to_the_light():
    traces = trace([BASELINE], contralateral([[[1.0, 1.0]]]), threads=1)
    motion = vehicle_motion(traces, BASELINE, environment=2)
    away = np.hypot(*motion.path[:, :2].T)
    assert away[-1] < PUBLISHED.radius <= away[:-1].min()
    sensors = [n for n, node in enumerate(motion.nodes) if node.name.startswith("sensor")]
    x, y, heading = traces.poses[0, 0, 2, 50]
    cosine, sine = np.cos(heading), np.sin(heading)
    for n, (ahead, left) in zip(sensors, BASELINE.sensors, strict=True):
        expected = [x + cosine * ahead - sine * left, y + sine * ahead + cosine * left]
        assert motion.translation[50, n, :2] == pytest.approx(expected)
    with pytest.raises(ValueError, match=r"^traces: they have 2 sensors, the body 1; give its own$"):
        vehicle_motion(traces, VehicleBody(((0.0, 0.0),)))
    with pytest.raises(ValueError, match=r"^environment: 4 is not allowed; the traces have 4$"):
        vehicle_motion(traces, BASELINE, environment=4)
