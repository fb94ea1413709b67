"""Statistics against closed forms and SciPy."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from optim.measures.statistics import (
    Correlation,
    Difference,
    WelchTest,
    bonferroni,
    bootstrap_means,
    cohens_d,
    difference_of_means,
    effect,
    holm,
    known_mean,
    mann_whitney,
    mean_band,
    mean_interval,
    pearson,
    ratio_of_means,
    reliability,
    spearman,
    student_band,
    superiority,
    welch,
    wilson,
)

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


def test_bonferroni_by_hand():
    assert bonferroni([0.01, 0.04, 0.5]) == pytest.approx([0.03, 0.12, 1.0])
    assert bonferroni([]) == []


def test_a_correlation_by_hand():
    """Five ranks of which two pairs are swapped: 1 - 6 * 4 / (5 * 24)."""
    x, y = [1.0, 2.0, 3.0, 4.0, 5.0], [2.0, 1.0, 4.0, 3.0, 5.0]
    for found, spread in ((pearson(x, y, "two-sided"), 1.0), (spearman(x, y, "two-sided"), np.sqrt(1.06))):
        assert found.n == 5 and found.r == pytest.approx(0.8)
        half = 1.959964 * spread / np.sqrt(2)
        assert found.low == pytest.approx(np.tanh(np.log(3) - half))  # artanh 0.8 = ln 3
        assert found.high == pytest.approx(np.tanh(np.log(3) + half))
        assert found.p == pytest.approx(0.104088, abs=1e-6)  # t = 0.8 sqrt(3 / 0.36), 3 degrees of freedom
    assert pearson(x, y, "greater").p == pytest.approx(0.052044, abs=1e-6)
    assert pearson(x, y, "less").p == pytest.approx(1 - 0.052044, abs=1e-6)


@pytest.mark.parametrize("alternative", ["two-sided", "less", "greater"])
@pytest.mark.parametrize("n", [3, 4, 7, 30, 500])
def test_correlations_are_those_of_scipy(n, alternative):
    rng = np.random.default_rng(n)
    for slope in (-1.0, 0.0, 0.3):
        x = rng.integers(0, 2 * n, n).astype(float)  # with ties
        y = slope * x + n * rng.standard_normal(n) ** 3
        expected = stats.pearsonr(x, y, alternative=alternative)
        found = pearson(x, y, alternative)
        assert (found.r, found.p) == pytest.approx((expected.statistic, expected.pvalue), rel=1e-9, abs=1e-14)
        if n > 3:
            interval = stats.pearsonr(x, y).confidence_interval(0.95)
            assert (found.low, found.high) == pytest.approx((interval.low, interval.high), rel=1e-9)
        expected = stats.spearmanr(x, y, alternative=alternative)
        found = spearman(x, y, alternative)
        assert (found.r, found.p) == pytest.approx((expected.statistic, expected.pvalue), rel=1e-9, abs=1e-14)


def test_ranks_know_no_scale():
    x = np.random.default_rng(0).standard_normal(20)
    assert spearman(x, np.exp(3 * x), "greater") == spearman(x, x, "greater")
    assert spearman(x, -(x**3), "less").r == pytest.approx(-1.0)
    for scale in (1e300, 1e-300):
        assert pearson(scale * x, np.exp(x), "two-sided").r == pytest.approx(pearson(x, np.exp(x), "two-sided").r)


def test_without_variation_there_is_no_correlation():
    for constant in ([3.0, 3.0, 3.0], [0.0, 0.0, 0.0]):
        for correlate in (pearson, spearman):
            assert correlate(constant, [1.0, 2.0, 4.0], "less") == Correlation(3, None, None, None, 1.0)
            assert correlate([1.0, 2.0, 4.0], constant, "two-sided") == Correlation(3, None, None, None, 1.0)
    assert pearson([], [], "less") == Correlation(0, None, None, None, 1.0)


def test_few_pairs_say_little_and_perfect_ones_all():
    assert pearson([1.0, 2.0], [5.0, 4.0], "less") == Correlation(2, -1.0, -1.0, 1.0, 1.0)
    three = pearson([1.0, 2.0, 3.0], [1.0, 2.0, 4.0], "two-sided")
    assert (three.low, three.high) == (-1.0, 1.0) and 0.05 < three.p < 0.5
    perfect = pearson(np.arange(5.0), -np.arange(5.0), "less")
    assert (perfect.r, perfect.low, perfect.high) == pytest.approx((-1.0, -1.0, -1.0)) and perfect.p < 1e-9
    assert pearson(np.arange(5.0), -np.arange(5.0), "greater").p == pytest.approx(1.0)


@pytest.mark.parametrize(("correlate", "true"), [(pearson, 0.6), (spearman, 6 / np.pi * np.arcsin(0.3))])
def test_intervals_hold_the_true_correlation_95_times_in_100(correlate, true):
    rng = np.random.default_rng(1)
    held = 0
    for _ in range(1000):
        x, noise = rng.standard_normal((2, 25))
        found = correlate(x, 0.6 * x + 0.8 * noise, "two-sided")
        held += found.low <= true <= found.high
    assert held / 1000 == pytest.approx(0.95, abs=0.02)


@pytest.mark.parametrize("correlate", [pearson, spearman])
def test_samples_that_are_no_pairs_of_numbers_are_refused(correlate):
    with pytest.raises(ValueError, match=r"y: shape \(2,\) beside \(3,\) is not allowed; give two samples of the same"):
        correlate([1.0, 2.0, 3.0], [1.0, 2.0], "less")
    with pytest.raises(ValueError, match="y: nan is not allowed; give finite numbers"):
        correlate([1.0, 2.0, 3.0], [1.0, np.nan, 2.0], "less")


def test_welch_by_hand():
    """Means 2 and 4.5, variances 1 and 1.6667, of 3 and 4 values."""
    found = welch([1.0, 2.0, 3.0], [3.0, 4.0, 5.0, 6.0])
    variance = 1 / 3 + (5 / 3) / 4
    assert found.t == pytest.approx(2.5 / np.sqrt(variance))
    assert found.freedom == pytest.approx(variance**2 / ((1 / 3) ** 2 / 2 + ((5 / 3) / 4) ** 2 / 3))
    assert found.p == pytest.approx(2 * stats.t.sf(found.t, found.freedom))
    assert welch([1.0, 1.0], [1.0, 1.0]) == WelchTest(None, None, 1.0)
    assert welch([1.0, 1.0], [2.0, 2.0]).p == 0.0
    with pytest.raises(ValueError, match="a: 1 values are not allowed; give at least 2 finite ones"):
        welch([1.0], [1.0, 2.0])


@pytest.mark.parametrize("paired", [False, True])
def test_differences_of_small_samples_against_scipy(paired):
    a, b = [1.0, 2.0, 3.5, 2.5], [3.0, 4.0, 5.0, 7.0]
    found = difference_of_means(a, b, paired)
    expected = stats.ttest_rel(b, a) if paired else stats.ttest_ind(b, a, equal_var=False)
    assert found.p == pytest.approx(expected.pvalue) and found.difference == 2.5
    assert (found.low, found.high) == pytest.approx(tuple(expected.confidence_interval(0.95)))
    back = difference_of_means(b, a, paired)
    assert (back.low, back.high, back.p) == pytest.approx((-found.high, -found.low, found.p))


def test_differences_of_samples_that_do_not_vary():
    for paired in (False, True):
        assert difference_of_means([1.0, 1.0], [1.0, 1.0], paired) == Difference(0.0, 0.0, 0.0, 1.0)
        assert difference_of_means([1.0, 1.0], [2.0, 2.0], paired) == Difference(1.0, 1.0, 1.0, 0.0)


def test_samples_too_small_for_a_difference_are_refused():
    with pytest.raises(ValueError, match="a: 1 values are not allowed; give at least 2 finite ones"):
        difference_of_means([1.0], [1.0, 2.0])
    with pytest.raises(ValueError, match=r"y: shape \(3,\) beside \(2,\) is not allowed"):
        difference_of_means([1.0, 2.0], [1.0, 2.0, 3.0], paired=True)
    for sample in ([1.0], [1.0, np.nan]):
        with pytest.raises(ValueError, match=f"sample: {len(sample)} values are not allowed; give at least 2 finite"):
            mean_interval(sample)


def test_the_interval_of_a_mean_holds_it_as_often_as_it_says():
    """Of five normal values; a percentile bootstrap's would hold it in 84 % of samples."""
    samples = np.random.default_rng(0).normal(size=(2000, 5))
    ends = np.array([mean_interval(sample) for sample in samples])
    assert np.mean((ends[:, 0] < 0) & (ends[:, 1] > 0)) == pytest.approx(0.95, abs=0.015)
    assert np.array_equal(np.transpose(student_band(samples.T)), ends)


@pytest.mark.parametrize("count", [2, 3, 5])
def test_the_interval_of_a_difference_holds_it_as_often_as_it_says(count):
    """Welch's has at least 95 % of so few; of bootstrap percentiles two and two have 68 %."""
    samples = np.random.default_rng(0).normal(size=(400, 2, count))
    ends = [effect(a, b, interval="student") for a, b in samples]
    assert np.mean([one.low <= 0 <= one.high for one in ends]) > 0.93


def test_the_interval_of_a_difference_by_hand():
    """Welch's: deviation sqrt(1/3 + 7/3), degrees of freedom its fourth power over (1/9 + 49/9) / 2."""
    found, half = effect([1.0, 2.0, 3.0], [2.0, 3.0, 7.0], interval="student"), np.sqrt(8 / 3)
    half *= stats.t.isf(0.025, (8 / 3) ** 2 / (25 / 9))
    assert (found.low, found.high) == pytest.approx((2 - half, 2 + half))


def test_the_mean_of_a_few_runs_says_what_is_unknown():
    assert known_mean([], "speed") == {"speed": None, "low": None, "high": None}
    assert known_mean([2.0]) == {"mean": 2.0, "low": None, "high": None}
    found = known_mean([1.0, 2.0, 3.0])
    assert (found["low"], found["high"]) == mean_interval([1.0, 2.0, 3.0])


def test_score_intervals_of_shares():
    """Against SciPy, and a published case: 0 of 10."""
    for successes, trials in ((0, 10), (3, 10), (10, 10), (57, 128)):
        expected = stats.binomtest(successes, trials).proportion_ci(method="wilson")
        assert wilson(successes, trials) == pytest.approx((expected.low, expected.high), abs=1e-12)
    assert wilson(0, 10)[1] == pytest.approx(0.2775, abs=1e-4)


def test_a_ratio_of_means_and_its_interval():
    rng = np.random.default_rng(4)
    a, b = rng.normal(6.0, 1.0, 30), rng.normal(2.0, 0.5, 30)
    ratio, low, high = ratio_of_means(a, b)
    assert ratio == pytest.approx(a.mean() / b.mean()) and low < ratio < high and 2.4 < low < high < 3.8
    # By the delta method, the relative variances of both means add up.
    deviation = ratio * np.hypot(a.std(ddof=1) / a.mean(), b.std(ddof=1) / b.mean()) / np.sqrt(30)
    assert high - low == pytest.approx(2 * 1.96 * deviation, rel=0.15)
    assert ratio_of_means(10 * a, b) == pytest.approx((10 * ratio, 10 * low, 10 * high))
    assert ratio_of_means([2.0, 2.0], [1.0, 1.0]) == (2.0, 2.0, 2.0)
    with pytest.raises(ValueError, match="b: a mean of 0 is not allowed; it must be positive"):
        ratio_of_means([1.0, 2.0], [-1.0, 1.0])


@pytest.mark.parametrize("spreads", [(0.5, 0.2), (1.5, 0.1), (0.2, 0.4)])
def test_the_interval_of_a_ratio_of_few_values_holds_it_as_often_as_it_says(spreads):
    """Percentiles of a bootstrap hold it in 83 to 89 %; there is no interval where the second mean may be 0."""
    rng, trials, held = np.random.default_rng(1), 800, 0
    for _ in range(trials):
        _, low, high = ratio_of_means(rng.normal(3.0, spreads[0], 5), rng.normal(1.0, spreads[1], 5))
        held += low is None or low <= 3.0 <= high
    assert 0.93 <= held / trials <= 0.98


def test_the_interval_of_a_ratio_ends_where_welch_finds_no_difference():
    a, b = np.array([3.1, 2.2, 4.0, 3.3]), np.array([1.0, 1.4, 0.7, 1.1, 0.9])
    ratio, low, high = ratio_of_means(a, b, 0.9)
    for end in (low, high):
        test = stats.ttest_ind(a, end * b, equal_var=False)
        freedom = stats.ttest_ind(a, ratio * b, equal_var=False).df  # at the ratio found
        assert 2 * stats.t.sf(abs(test.statistic), freedom) == pytest.approx(0.1)


def test_a_ratio_has_no_interval_where_the_second_mean_may_be_0():
    assert ratio_of_means([1.0, 1.5], [1.0, 9.0]) == (0.25, None, None)
    assert ratio_of_means([0.0, 0.0], [1.0, 2.0]) == (0.0, None, None)
    assert ratio_of_means([0.0, 0.0], [1.0, 1.01]) == pytest.approx((0.0, 0.0, 0.0))


def test_reliability_of_the_published_example():
    """Six targets and four judges of Shrout & Fleiss 1979, tables 2 and 4; the interval as R's psych gives it."""
    judged = [[9, 2, 5, 8], [6, 1, 3, 2], [8, 4, 6, 8], [7, 1, 2, 6], [10, 5, 6, 9], [6, 2, 4, 7]]
    found = reliability(judged)
    assert (found.n, found.repetitions) == (6, 4)
    assert found.within**2 == pytest.approx(6.26, abs=0.005)
    assert (found.single, found.mean) == (pytest.approx(0.17, abs=0.005), pytest.approx(0.44, abs=0.005))
    assert (found.low, found.high) == (pytest.approx(-0.13, abs=0.005), pytest.approx(0.72, abs=0.005))


def test_reliability_at_its_ends():
    """All of the variance between things, none, and nothing that varies; one measurement tells nothing of it."""
    apart = reliability([[1, 1], [2, 2], [5, 5]])
    assert (apart.single, apart.low, apart.high, apart.mean, apart.within) == (1, 1, 1, 1, 0)
    alike = reliability([[1, 3], [3, 1]])
    assert alike.single == -1 and alike.mean == 0
    assert reliability([[2, 2], [2, 2]]).single is None
    assert reliability(np.full((7, 3), 33.3)).single is None  # whose means are rounded
    for wrong in ([[1], [2]], [[1, 2]], [[1, 2], [np.nan, 1]]):
        with pytest.raises(ValueError, match="give finite ones of shape"):
            reliability(wrong)


def test_intervals_of_reliability_hold_what_they_say():
    """Of 400 samples of known shares, some 95 % of intervals have the share in them."""
    rng = np.random.default_rng(0)
    share, held = 0.4, 0
    for _ in range(400):
        things, runs = rng.normal(size=(24, 1)), rng.normal(size=(24, 5))
        found = reliability(share**0.5 * things + (1 - share) ** 0.5 * runs)
        held += found.low <= share <= found.high
    assert 0.92 <= held / 400 <= 0.98
