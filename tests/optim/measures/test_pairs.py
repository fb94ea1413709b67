"""Statistics of pairs against closed forms and SciPy."""

import numpy as np
import pytest
from scipy import stats

from optim.measures.pairs import FEW_PAIRS, paired_effect, signed_rank
from optim.measures.statistics import effect


def test_effects_of_pairs_by_hand():
    found = paired_effect([1.0, 2.0, 3.0, 4.0], [2.0, 2.0, 6.0, 4.0 - 1.0])
    gains = np.array([1.0, 0.0, 3.0, -1.0])
    assert (found.difference, found.superiority, found.test) == (0.75, (2 + 0.5) / 4, "paired t")
    assert found.cohens_d == pytest.approx(0.75 / gains.std(ddof=1))
    known = stats.ttest_1samp(gains, 0.0)
    assert found.p == pytest.approx(known.pvalue)
    assert (found.low, found.high) == pytest.approx(tuple(known.confidence_interval(0.95)))


def test_many_pairs_are_tested_by_ranks():
    a = np.linspace(0.0, 1.0, FEW_PAIRS)
    found = paired_effect(a, a + 10.0 ** np.arange(FEW_PAIRS))  # one is far out, all are above
    assert found.test == "signed-rank" and found.p == pytest.approx(2 / 2**FEW_PAIRS) and found.low < 0


def test_what_is_not_known_is_below_all_else():
    nan = np.nan
    found = paired_effect([1.0, 2.0, 3.0, nan, nan], [1.5, 2.4, nan, -9.0, nan])
    assert found.difference == pytest.approx(0.45) and found.superiority == pytest.approx((3 + 0.5) / 5)
    assert found.test == "signed-rank" and found.p == pytest.approx(signed_rank(np.array([1.0, 0.8, -9.0, 9.0])))
    both = paired_effect([1.0, 2.0, nan], [1.5, 2.4, nan])
    assert both.test == "paired t" and both.superiority == pytest.approx((2 + 0.5) / 3)


@pytest.mark.parametrize("b", [[1.0, 2.0, 3.0], [1.1, 2.1, 3.1], [np.nan, np.nan, 4.0]])
def test_differences_that_do_not_vary_have_no_scatter(b):
    assert paired_effect([1.0, 2.0, 3.0], b) is None
    assert signed_rank(np.zeros(3)) == 1.0


@pytest.mark.parametrize("count", [4, 12])
def test_pairs_find_what_independent_samples_hide(count):
    """Of pairs that share most of their scatter, intervals hold the truth in 95 of 100, and p is below 0.05 in 5."""
    rng, trials, few = np.random.default_rng(0), 1500, 200
    shared, (a, b) = rng.normal(size=(trials, count)), 0.4 * rng.normal(size=(2, trials, count))
    a, b = a + shared, b + shared
    nothing = [paired_effect(*pair) for pair in zip(a, b, strict=True)]
    something = [paired_effect(*pair) for pair in zip(a[:few], b[:few] + 0.6, strict=True)]
    apart = [effect(*pair, interval="student") for pair in zip(a[:few], b[:few] + 0.6, strict=True)]
    assert 0.935 <= np.mean([found.low <= 0.0 <= found.high for found in nothing]) <= 0.965
    assert 0.035 <= np.mean([found.p < 0.05 for found in nothing]) <= 0.065
    assert np.mean([found.low <= 0.6 <= found.high for found in apart]) > 0.98
    assert np.mean([found.p < 0.05 for found in something]) > 3 * np.mean([found.p < 0.05 for found in apart])
