"""Numbers read off poses of the inflatable robot."""

from collections import Counter
from itertools import pairwise

import pytest
from motions import QUICK, STILL, TINY, posed

from robots.inflatable import PUBLISHED, InflatableActuation, InflatableDesign, simulate
from robots.inflatable.view import shape


@pytest.mark.parametrize("geometry", [TINY, PUBLISHED])
def test_read_outs_of_the_robot_as_built(geometry):
    result = posed([(0, 0, 0), (0.3, 0, 0)], geometry)
    assert shape.width(result) == pytest.approx(geometry.columns * geometry.voxel_size)
    assert shape.height(result) == pytest.approx(2 * geometry.voxel_size)
    assert shape.ratio(result) == pytest.approx(geometry.columns / 2)


@pytest.mark.kernels
def test_the_surface_has_no_gaps():
    simulated = simulate(
        InflatableDesign(6e3, 0.0, STILL), geometry=TINY, actuation=QUICK, precision="f32", record_every=40
    )
    quads, _ = shape.surface(simulated)
    corners = [[tuple(corner) for corner in quad] for quad in quads.tolist()]
    edges = Counter(tuple(sorted(pair)) for quad in corners for pair in pairwise([*quad, quad[0]]))
    assert all(count % 2 == 0 for count in edges.values())


@pytest.mark.kernels
def test_pressure_makes_the_robot_round():
    slow = InflatableActuation(inflation_rate=0.05, pressure_ramp=10.0, hold_steps=1500, settle_steps=30)
    designs = [InflatableDesign(pressure, 0.0, STILL) for pressure in (0.0, 6e3, 12e3)]
    result = simulate(designs, geometry=TINY, actuation=slow, precision="f32", record_every=30)
    flat, middle, round_ = (shape.ratio(result, robot) for robot in range(3))
    assert flat > middle + 0.4 > round_ + 0.8
    assert shape.height(result, robot=2) > 1.5 * shape.height(result, robot=0)


@pytest.mark.kernels
def test_read_outs_need_frames():
    result = simulate(InflatableDesign(0.0, 0.0, STILL), geometry=TINY, actuation=QUICK, precision="f32")
    with pytest.raises(ValueError, match=r"^frames: nothing was recorded; simulate with record_every$"):
        shape.width(result)
