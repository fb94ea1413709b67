"""Whole evaluations against the published speeds (minutes each: ``make validate``).

Contact makes long runs chaotic; the bands are those that the original program shows between its own builds.
"""

import numpy as np
import pytest

from robots.inflatable import INCHING, ROLLING, InflatableDesign, simulate
from robots.inflatable.schedule import GaitSchedule
from robots.world import Terrain

NOTHING = GaitSchedule(np.zeros((10, 8)))

pytestmark = pytest.mark.slow


def test_flat_ground():
    idle = [InflatableDesign(12e3, 0.0, NOTHING), InflatableDesign(0.0, 0.0, NOTHING)]
    result = simulate([ROLLING, INCHING, *idle], Terrain(), precision="f64")
    assert result.status.tolist() == ["ok"] * 4
    assert result.steps.tolist() == [186_719, 186_719, 64_032, 64_032]
    assert result.speed[0] == pytest.approx(0.174, abs=0.003)
    assert result.speed[1] == pytest.approx(0.0597, abs=0.002)
    assert np.abs(result.speed[2:]).max() < 0.0006


def test_rolling_back_down_the_hill():
    result = simulate([ROLLING, InflatableDesign(12e3, 90.0, NOTHING)], Terrain(slope=15.0), precision="f64")
    assert result.speed[0] == pytest.approx(-0.573, abs=0.006)
    assert result.speed[1] == pytest.approx(-0.0270, abs=0.003)
