"""Random robots have the same bits in every driver, batch and part of a run, and gradients as differences have them."""

import subprocess
import sys
from collections import Counter

import fuzz_physics as fuzzing
import numpy as np
import pytest
from physics_bits import differences
from physics_cases import make_case
from physics_directions import agree
from physics_gradients import check_gradients

pytestmark = pytest.mark.kernels

# On the level floor and off it, whose kernels other tests have compiled: contact, skins, feedback, a divergence.
FORWARDS = (0, 9, 18, 38, 41, 52, 75)
# The second has a voxel on sand that is held along one axis.
BACKWARDS = (1, pytest.param(1_000_065, marks=pytest.mark.slow))


def test_cases_are_what_they_were_and_have_everything():
    """A number means the same robot anywhere, and a hundred of them leave nothing out."""
    features = Counter(feature for number in range(100) for feature in make_case(number).features)
    assert (
        min(features[name] for name in ("sand", "water", "fluid", "feedback", "held", "islands", "pressed faces")) > 0
    )
    one, again = make_case(7), make_case(7)
    assert np.array_equal(one.state.positions, again.state.positions)
    assert np.array_equal(one.program.events, again.program.events)
    assert not np.array_equal(make_case(8).program.events, one.program.events)


@pytest.mark.parametrize("number", FORWARDS)
def test_every_way_to_compute_a_robot_has_the_same_bits(number):
    found, packed = differences(make_case(number))
    assert not found
    case = make_case(number)
    moved = packed["last positions"] - case.state.positions
    assert not np.nanmax(np.abs(moved), initial=1.0) < 1e-7  # something happened, or it diverged


@pytest.mark.parametrize("number", BACKWARDS)
def test_gradients_are_what_differences_say(number):
    agree(check_gradients(make_case(number)), least=10)


@pytest.mark.slow
def test_hundreds_of_robots():
    """As ``make fuzz-physics``; what is there already is not done again."""
    command = [sys.executable, fuzzing.__file__, "--cases", "400", "--gradients", "40"]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stdout[-3000:]
