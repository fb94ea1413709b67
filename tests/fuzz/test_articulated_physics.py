"""Random articulated robots have the same bits in every driver and batch, and gradients as differences have them."""

from collections import Counter

import numpy as np
import pytest
import rigid_bits
import rigid_cases
import rigid_gradients
from physics_directions import agree

pytestmark = pytest.mark.kernels

# On the level floor, whose kernels other tests have compiled: both ways to integrate, a cone of friction that neurons
# push against, decided commands; then derivatives through decisions of a robot in motion, and by a design.
ARTICULATED = (2_000_005, 2_000_007, 2_000_010)
ARTICULATED_BACKWARDS = (3_000_011, 3_000_024)


def test_cases_of_articulated_robots_are_what_they_were_and_have_everything():
    features = Counter(feature for number in range(60) for feature in rigid_cases.make_case(number).features)
    wanted = ("sand", "wet sand", "water", "relief", "floor", "feedback", "neurons", "fixed base", "stops", "velocity")
    assert min(features[name] for name in wanted) > 0
    one, again = rigid_cases.make_case(7), rigid_cases.make_case(7)
    assert np.array_equal(one.state.angles, again.state.angles)
    assert all(np.array_equal(one.given[name], again.given[name]) for name in one.given)


@pytest.mark.parametrize("number", ARTICULATED)
def test_every_way_to_compute_an_articulated_robot_has_the_same_bits(number):
    found, wide = rigid_bits.differences(rigid_cases.make_case(number))
    assert not found
    assert np.ptp(wide["recorded position"], axis=1).max() > 1e-3


@pytest.mark.parametrize("number", ARTICULATED_BACKWARDS)
def test_gradients_of_articulated_robots_are_what_differences_say(number):
    agree(rigid_gradients.check_gradients(rigid_gradients.make_smooth_case(number)), least=6)
