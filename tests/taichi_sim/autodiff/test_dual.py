"""Dual numbers: values of plain arithmetic, to the bit, and derivatives by differences."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from taichi_sim.autodiff.dual import Dual, cosine, sine, slope_of, value_of, variables, where

PLAIN = np.array([1.5, -0.7, 2.0])
FORMULAS = {
    "sum": lambda x, y: 0.1 + x + y + PLAIN,
    "difference": lambda x, y: (0.1 - x) - (y - PLAIN) - 2.0,
    "product": lambda x, y: 3.0 * x * y * PLAIN,
    "quotient": lambda x, y: PLAIN / (x * x + 1.0) / (y + 9.0) + x / y,
    "sign": lambda x, y: -x * y,
    "angles": lambda x, y: sine(x) * cosine(y) + cosine(0.3) * sine(x * y),
    "choice": lambda x, y: where(np.array([True, False, True]), x * x, y) + where(np.array([True]), 1.0, 2.0),
    "parts": lambda x, y: (x * PLAIN)[[2, 0]] * (y + PLAIN)[np.array([0, 2])] + x[1],
}


@pytest.mark.parametrize("name", FORMULAS)
@given(st.integers(0, 10_000))
def test_values_are_those_of_arrays_and_slopes_those_of_differences(name, seed):
    generator = np.random.default_rng(seed)
    x, y = generator.uniform(0.5, 2.0, 3), generator.uniform(0.5, 2.0)
    formula = FORMULAS[name]
    found = formula(variables(x, 0, 4), variables(np.array(y), 3, 4))
    assert isinstance(found, Dual)
    assert np.array_equal(found.value, formula(x, y))
    assert found.slope.shape == (*found.value.shape, 4)
    h = 1e-6
    for parameter in range(4):
        step = np.zeros(4)
        step[parameter] = h
        change = formula(x + step[:3], y + step[3]) - formula(x - step[:3], y - step[3])
        assert found.slope[..., parameter] == pytest.approx(change / (2 * h), rel=1e-7, abs=1e-8)


def test_arrays_leave_arithmetic_to_dual_numbers():
    assert isinstance(PLAIN * variables(PLAIN, 0, 3), Dual)
    assert isinstance(np.float64(2.0) - variables(PLAIN, 0, 3), Dual)


def test_plain_numbers_have_no_slope():
    assert value_of(2.0) == 2.0 and slope_of(2.0) == 0.0
    assert not isinstance(sine(0.5), Dual) and sine(0.5) == np.sin(0.5)
