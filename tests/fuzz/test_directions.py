"""What explains central differences that disagree with a derivative, and what may not."""

import numpy as np
import pytest
from physics_directions import Direction, judge, noise_of

STEEPNESS = 300.0  # of a cost about 1: of a chaotic motion


def direction(slope):
    return Direction("made up", lambda step: step, slope, STEEPNESS)


def costs_of(noise):
    """A steep and strongly curved cost at moves, with a deterministic noise as of rounding."""

    def costs(moves):
        moves = np.array(moves, dtype=np.float64)
        smooth = np.sin(STEEPNESS * moves) + (STEEPNESS * moves) ** 3 * 1e4
        return smooth + noise * np.array([np.random.default_rng(int(bits)).normal() for bits in moves.view(np.uint64)])

    return costs


def because(slope, noise):
    (line,) = judge([direction(slope)], costs_of(noise), lambda one, step: set())
    return line.get("because", "agrees")


def test_noise_is_measured():
    measured = [noise_of(direction(STEEPNESS), costs_of(noise)) for noise in (1e-9, 1e-6)]
    assert measured == pytest.approx([1e-9, 1e-6], rel=0.6)


def test_noise_and_curvature_explain_differences_that_are_off_by_as_much():
    assert because(STEEPNESS, 0.0) == "agrees"
    assert "within the error of differences" in because(STEEPNESS, 1e-7)


@pytest.mark.parametrize("wrong", [1.003, 0.99, -1.0])
def test_noise_does_not_explain_a_wrong_derivative(wrong):
    """By 0.3 %, which is thirty times what differences of this cost are off by."""
    for noise in (0.0, 1e-9, 1e-8):
        assert because(wrong * STEEPNESS, noise).startswith("unexplained")


@pytest.mark.parametrize("noise", [1e-7, 1e-6, 1e-5])
def test_no_noise_explains_a_derivative_that_is_far_off(noise):
    assert because(1.01 * STEEPNESS, noise).startswith("unexplained")
