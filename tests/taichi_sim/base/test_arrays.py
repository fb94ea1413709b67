"""Means and medians that stay finite, and numbers that are refused."""

import warnings

import numpy as np
import pytest

from taichi_sim.base.arrays import mean_of, median_of

LARGEST = np.finfo(float).max


@pytest.fixture(autouse=True)
def no_warnings():
    """What NumPy warns of fails a test."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


@pytest.mark.parametrize("shape", [(1,), (7,), (1000,), (5, 1), (40, 3), (0, 2)])
def test_means_and_medians_of_usual_values_have_the_bits_of_numpy(shape):
    values = np.random.default_rng(0).normal(size=shape) * 1e5
    if values.ndim == 2:
        assert mean_of(values, axis=1).tobytes() == values.mean(axis=1).tobytes()
        values[::2] = np.nan
        assert mean_of(values, axis=1).tobytes() == values.mean(axis=1).tobytes()
        return
    assert float(mean_of(values)) == values.mean() and median_of(values) == np.median(values)


def test_means_and_medians_of_the_largest_values_are_finite():
    same = np.full(999, LARGEST)
    assert mean_of(same) == median_of(same[:-1]) == LARGEST
    signs = np.repeat([LARGEST, -LARGEST], 500)
    assert mean_of(signs) == median_of(signs) == 0.0
    assert mean_of(np.array([1e308, 1.5e308])) == pytest.approx(1.25e308)
    assert median_of(np.array([1.5e308, 1e308, 1.7e308, -3.0])) == pytest.approx(1.25e308)
    rows = np.array([[1e308, 1.5e308], [1.0, 2.0], [np.nan, np.nan], [0.0, 0.0], [np.inf, 1.0]])
    assert mean_of(rows, axis=1) == pytest.approx(np.array([1.25e308, 1.5, np.nan, 0.0, np.inf]), nan_ok=True)
