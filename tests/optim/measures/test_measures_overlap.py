import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from optim.measures import learnability, resistance

OVERLAPS = arrays(
    np.int8, st.tuples(st.integers(1, 3), st.integers(1, 4), st.integers(1, 4)), elements=st.integers(0, 4)
)


def test_measures_by_hand():
    overlap = [[0, 4, 1], [4, 3, 0], [2, 0, 4]]
    assert learnability(overlap) == 3 / 9 and resistance(overlap) == 3 / 6
    assert learnability(overlap, environments=5) == resistance(overlap, environments=5) == 0


def test_published_numbers_of_the_baseline():
    """Chapter 4 of Powers' dissertation: 26 controllers of 121 x 121 solve all, 1830 at least one."""
    overlap = np.zeros(121 * 121, np.uint8)
    overlap[:26], overlap[26:1830] = 4, 2
    overlap = overlap.reshape(121, 121)
    assert round(float(learnability(overlap)), 4) == 0.0018
    assert round(float(resistance(overlap)), 4) == 0.0142


def test_bodies_whose_controllers_all_fail_score_zero():
    assert learnability(np.zeros((3, 3), int)) == resistance(np.zeros((3, 3), int)) == 0


@given(OVERLAPS)
def test_each_matrix_is_measured_alone(overlap):
    for measure in (learnability, resistance):
        found = measure(overlap)
        assert found.shape == overlap.shape[:1]
        assert np.array_equal(found, [measure(matrix) for matrix in overlap])
        assert np.array_equal(found, measure(overlap[None])[0])


@given(OVERLAPS)
def test_interference_is_learnability_among_those_that_solve_any(overlap):
    some = (overlap >= 1).mean(axis=(1, 2))
    assert np.all((learnability(overlap) >= 0) & (learnability(overlap) <= resistance(overlap)))
    assert resistance(overlap).max() <= 1
    assert resistance(overlap) * some == pytest.approx(learnability(overlap), rel=1e-15)


@given(OVERLAPS, st.integers(0, 4))
def test_one_more_controller_that_solves_all_raises_both(overlap, value):
    overlap[:, 0, 0] = min(value, 3)
    better = overlap.copy()
    better[:, 0, 0] = 4
    assert np.all(learnability(better) > learnability(overlap))
    assert np.all(resistance(better) >= resistance(overlap))


@pytest.mark.parametrize("measure", [learnability, resistance])
@pytest.mark.parametrize(
    ("overlap", "environments", "message"),
    [
        ([4, 4], 4, r"overlap: shape \(2,\) is not allowed; give matrices, shape \(\.\.\., W, W\)"),
        (np.empty((0, 0), int), 4, r"overlap: shape \(0, 0\) is not allowed"),
        ([[0, 5]], 4, "overlap: values from 0 to 5 are not allowed; give whole numbers from 0 to 4"),
        ([[-1, 4]], 4, "overlap: values from -1 to 4 are not allowed"),
        ([[1.0, 4.0]], 4, "overlap: values of type float64 are not allowed"),
        ([[0, 1]], 0, "environments: 0 is not allowed; give a whole number of at least 1"),
        ([[0, 1]], 1.5, "environments: 1.5 is not allowed"),
        ([[0, 1]], True, "environments: True is not allowed"),
    ],
)
def test_what_is_no_overlap_is_refused(measure, overlap, environments, message):
    with pytest.raises(ValueError, match=message):
        measure(overlap, environments)
