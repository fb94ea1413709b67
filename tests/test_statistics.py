"""Statistics against closed forms and SciPy."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from optim.measures.statistics import bootstrap_means, cohens_d, effect, holm, mann_whitney, mean_band, superiority

samples = st.lists(st.integers(-5, 5).map(float), min_size=2, max_size=8)


def test_effects_of_two_samples_by_hand():
    found = effect([1.0, 2.0, 3.0], [2.0, 3.0, 7.0])
    assert found.difference == 2.0
    assert found.superiority == (1 + 0.5 + 0 + 1 + 1 + 0.5 + 1 + 1 + 1) / 9
    assert found.cohens_d == pytest.approx(2.0 / np.sqrt((2 * 1.0 + 2 * 7.0) / 4))
    assert found.low < 2.0 < found.high


@given(samples, samples)
def test_superiority_is_the_u_statistic(a, b):
    u = stats.mannwhitneyu(b, a, alternative="two-sided", method="asymptotic").statistic
    assert superiority(a, b) == pytest.approx(u / (len(a) * len(b)))
    assert superiority(a, b) + superiority(b, a) == pytest.approx(1.0)


def test_p_values_are_those_of_the_test_asked_for():
    a, b = [1.0, 2.0, 3.0, 4.0], [5.0, 6.0, 7.0, 8.0]
    assert mann_whitney(a, b, "two-sided", "exact") == pytest.approx(2 / 70)  # all 4 of 8 above: 1 of 70 orders
    assert mann_whitney(a, b, "less", "exact") == pytest.approx(1 / 70)
    assert mann_whitney(a, b, "greater", "exact") == 1.0
    assert effect(a, b).p == pytest.approx(2 / 70)


def test_without_variation_nothing_is_standardised():
    found = effect([2.0, 2.0], [2.0, 2.0])
    assert (found.difference, found.superiority, found.cohens_d, found.p) == (0.0, 0.5, None, 1.0)
    assert cohens_d([1.0], [2.0]) is None


def test_bands_of_the_mean_are_as_wide_as_theory_says():
    sample = np.random.default_rng(0).standard_normal((400, 3)) * [1.0, 2.0, 0.0]
    low, high = mean_band(sample)
    assert (high - low) / 2 == pytest.approx(1.96 * sample.std(axis=0) / 20, rel=0.06)
    assert bootstrap_means(sample).shape == (2000, 3) and np.array_equal(*(mean_band(sample)[0] for _ in range(2)))


def test_holm_by_hand():
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.6, 0.9]) == [1.0, 1.0]
