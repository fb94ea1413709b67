"""Numbers read off shapes, over pressure."""

import dataclasses

import motions
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robots.frames import Frames
from robots.inflatable import InflatableActuation, InflatableResult
from robots.inflatable.view import shape
from robots.inflatable.view.read_outs import shape_curves, shape_picture


def bent(radius: float, geometry=motions.TINY, turn: float = 0.0) -> InflatableResult:
    """A robot whose skins are arcs of a radius, the upper one bulging up and the lower one down; turned about y."""
    body = geometry.body
    places = body.start_positions.copy()
    middle = (geometry.columns + 1) / 2 * geometry.voxel_size
    angle = (places[:, 0] - middle) / radius
    upper = np.where(body.voxels[:, 2] > geometry.bladder_layers, 1.0, -1.0)
    places[:, 0] = middle + radius * np.sin(angle)
    places[:, 2] = upper * radius * np.cos(angle)
    c, s = np.cos(turn), np.sin(turn)
    places = places @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])
    orientation = np.array([np.cos(turn / 2), 0, np.sin(turn / 2), 0])
    count, one = body.voxel_count, np.ones(1)
    extents = np.full((1, 1, count, 6), geometry.voxel_size / 2)
    frames = Frames(
        places[None, None], np.broadcast_to(orientation, (1, 1, count, 4)), np.zeros(1), extents, 2 * extents[..., ::2]
    )
    return InflatableResult(
        one, one, one, np.array(["ok"]), one[:, None], np.array([1]), 1e-4, frames, body, np.zeros((1, 2))
    )


@given(st.floats(0.06, 2.0), st.floats(-3.0, 3.0))
def test_the_curvature_of_arcs_is_one_by_their_radius(radius, turn):
    assert shape.curvature(bent(radius, turn=turn)) == pytest.approx(1 / radius, rel=1e-6)


def test_flat_skins_have_no_curvature_and_hollow_ones_a_negative_one():
    flat = bent(1e6)
    assert shape.curvature(flat) == pytest.approx(0, abs=1e-5)
    hollow = bent(0.3)
    places = hollow.frames.positions.copy()
    places[..., 2] *= -1
    hollow = dataclasses.replace(hollow, frames=dataclasses.replace(hollow.frames, positions=places))
    assert shape.curvature(hollow) == pytest.approx(-1 / 0.3)


@pytest.mark.kernels
def test_pressure_makes_robots_higher_and_rounder():
    quick = InflatableActuation(pressure_ramp=10.0, hold_steps=1500)
    curves = shape_curves([0.0, 4e3, 12e3], geometry=motions.TINY, actuation=quick, threads=1)
    assert curves.pressures.tolist() == [0, 4e3, 12e3]
    assert (np.diff(curves.height) > 0).all() and (np.diff(curves.ratio) < 0).all()
    assert curves.curvature[0] < 1.0 < 3.0 < curves.curvature[-1]
    assert curves.ratio == pytest.approx(curves.width / curves.height)
    figure = shape_picture(curves)
    assert [axes.get_title(loc="left") for axes in figure.axes][1] == "width per height"


def test_no_pressures_are_refused():
    with pytest.raises(ValueError, match=r"^pressures: there are none; give at least one$"):
        shape_curves([])
    with pytest.raises(ValueError, match=r"^pressure: -1.0 is not allowed"):
        shape_curves([-1.0])
