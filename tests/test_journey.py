"""Journeys: one leg is a gait, legs go on where others ended, the ground changes between them."""

import numpy as np
import pytest
from graded import QUICK, TINY, settling

from robots.inflatable_gradient import simulate_relaxed
from robots.journey import Leg, simulate_journey
from robots.relaxed_schedule import RelaxedDesign
from robots.terrain import Terrain

HILL = Terrain(10.0)
OPTIONS = {"geometry": TINY, "actuation": QUICK, "threads": 1}
RNG = np.random.default_rng(3)
LEVELS = RNG.random((10, 4)).round(2)
WALK = RelaxedDesign(1000.0, 60.0, settling(LEVELS, np.array([50, 80, 20, 60])))


def part(columns: slice) -> RelaxedDesign:
    return RelaxedDesign(1000.0, 60.0, settling(LEVELS[:, columns], np.array([50, 80, 20, 60])[columns]))


@pytest.mark.parametrize("precision", ["f32", "f64"])
def test_a_journey_of_one_leg_is_the_gait(precision):
    alone = simulate_relaxed(WALK, HILL, precision=precision, record_every=100, **OPTIONS)
    found = simulate_journey([Leg(WALK, HILL)], precision=precision, record_every=100, **OPTIONS)
    assert found.distances[0, 0] == pytest.approx(alone.distance[0], rel=1e-6)
    assert found.steps[0] == alone.steps[0]
    np.testing.assert_array_equal(found.frames.positions, alone.frames.positions)


def test_a_gait_in_two_legs_goes_on_as_if_it_were_one():
    """Nothing is put back between legs: not even by a bit."""
    whole = simulate_journey([Leg(WALK, HILL)], record_every=50, **OPTIONS)
    parts = simulate_journey([Leg(part(slice(0, 2)), HILL), Leg(part(slice(2, 4)), HILL)], record_every=50, **OPTIONS)
    np.testing.assert_array_equal(parts.frames.positions, whole.frames.positions)
    assert parts.distances.sum() == pytest.approx(whole.distances.sum())
    assert parts.steps.sum() == whole.steps.sum()
