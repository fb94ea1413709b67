import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymoo.indicators.hv import HV

from optim.measures.pareto import dominates, hypervolume, non_dominated

VALUES = st.one_of(st.integers(-2, 3).map(float), st.floats(-2, 3, allow_subnormal=False))  # integers make ties


@st.composite
def sets_of_points(draw, least=0):
    count, size = draw(st.integers(least, 7)), draw(st.integers(1, 4))
    rows = st.lists(VALUES, min_size=size, max_size=size)
    return np.array(draw(st.lists(rows, min_size=count, max_size=count))).reshape(count, size)


def test_a_point_dominates_what_is_nowhere_better_and_somewhere_worse():
    assert dominates([2, 1], [1, 1]) and dominates([2, 2], [1, 1])
    assert not dominates([1, 1], [1, 1]) and not dominates([2, 0], [1, 1])
    assert not dominates([np.nan, 5], [1, 1]) and not dominates([5, 5], [np.nan, 1])
    assert np.array_equal(dominates([1, 1], [[0, 0], [1, 1], [0, 2]]), [True, False, False])


def test_equal_points_stay_and_failures_go():
    objectives = [[1, 2], [1, 2], [2, 1], [1, 1], [np.nan, 9], [0, 2]]
    assert np.array_equal(non_dominated(objectives), [True, True, True, False, False, False])
    assert non_dominated(np.empty((0, 2))).shape == (0,)


@given(sets_of_points())
def test_non_dominated_points_are_those_that_no_point_dominates(objectives):
    by_hand = [not any(dominates(other, one) for other in objectives) for one in objectives]
    assert np.array_equal(non_dominated(objectives), np.array(by_hand, bool))


def test_hypervolumes_by_hand():
    assert hypervolume([[3.0]], [1.0]) == 2
    assert hypervolume([[1, 3], [2, 2], [3, 1]], [0, 0]) == 6
    assert hypervolume([[-1, -3]], [-2, -4]) == 1
    assert hypervolume([[1, 1, 2], [2, 1, 1], [1, 2, 1]], [0, 0, 0]) == 4  # a cube with a cube on three sides
    assert hypervolume([[2, 2, 2, 2], [1, 1, 1, 3]], [0, 0, 0, 0]) == 17
    assert hypervolume(np.empty((0, 2)), [0, 0]) == 0
    assert hypervolume([[5, -1], [np.nan, 5], [0, 3], [np.inf, 2]], [0, 0]) == 0


@pytest.mark.parametrize("size", [1, 2, 3, 4, 5])
def test_hypervolume_is_that_of_pymoo(size):
    rng = np.random.default_rng(size)
    for count in (1, 6, 40):
        objectives = rng.random((count, size)) * rng.choice([0.5, 1.0], (count, 1)) - 0.2
        reference = np.full(size, -0.1)  # some points lie below
        theirs = float(HV(ref_point=-reference)(-objectives))  # which minimises
        assert hypervolume(objectives, reference) == pytest.approx(theirs, rel=1e-12)


def test_hypervolume_of_a_sphere_with_three_objectives():
    directions = abs(np.random.default_rng(0).standard_normal((300, 3)))
    sphere = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    ours, theirs = hypervolume(sphere, np.zeros(3)), float(HV(ref_point=np.zeros(3))(-sphere))
    assert ours == pytest.approx(theirs, rel=1e-12) and 0.4 < ours < np.pi / 6


@given(sets_of_points(least=1))
def test_a_further_point_never_lowers_the_hypervolume(objectives):
    reference = np.full(objectives.shape[1], -1.0)
    before, after = hypervolume(objectives[:-1], reference), hypervolume(objectives, reference)
    assert after >= before * (1 - 1e-12)
    if dominates(objectives[:-1], objectives[-1]).any():
        assert after == pytest.approx(before, rel=1e-12)


@given(sets_of_points(), st.randoms(use_true_random=False))
def test_hypervolume_knows_neither_order_nor_copies_nor_failures(objectives, random):
    reference = np.full(objectives.shape[1], -1.0)
    failed = np.full((1, objectives.shape[1]), 9.0)
    failed[0, -1] = np.nan
    rows = np.concatenate([objectives, objectives[:2], failed])
    shuffled = rows[random.sample(range(len(rows)), len(rows))]
    assert hypervolume(shuffled, reference) == pytest.approx(hypervolume(objectives, reference), rel=1e-12)


def test_a_reference_of_another_size_is_refused():
    with pytest.raises(ValueError, match=r"reference: shape \(3,\) is not allowed for objectives of shape \(1, 2\)"):
        hypervolume([[1, 2]], [0, 0, 0])
