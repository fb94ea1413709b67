"""Statistics for comparing searches; SciPy computes those that it has.

Sources of the others: Vargha & Delaney, J. Educational and Behavioral Statistics 25(2), 2000 (A12); Cohen, Statistical
Power Analysis, 2nd ed. 1988 (d); Holm, Scandinavian J. of Statistics 6, 1979; Fisher, Metron 1, 1921 (interval of a
correlation); Fieller, Hartley & Pearson, Biometrika 44, 1957 (of ranks); Fieller, J. Royal Stat. Soc. B 16, 1954 (of a
ratio).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from taichi_sim.base.arrays import Floats

Alternative = Literal["two-sided", "less", "greater"]
MOST_AT_ONCE = 10_000_000  # numbers of bootstrap resamples in memory


@dataclass(frozen=True)
class Effect:
    """Effect sizes and significance of the difference between a sample ``b`` and a sample ``a``.

    Attributes:
        difference: difference of the means, b - a.
        low: lower end of its 95 % interval.
        high: upper end.
        superiority: A12, the probability that one of b exceeds one of a, ties counted half.
        cohens_d: the difference in pooled standard deviations; None where nothing varies.
        p: p of the two-sided Mann-Whitney test.
    """

    difference: float
    low: float
    high: float
    superiority: float
    cohens_d: float | None
    p: float


@dataclass(frozen=True)
class Correlation:
    """Correlation of two quantities over n items.

    Attributes:
        n: pairs.
        r: the coefficient, from -1 to 1; None where one of the two does not vary.
        low: lower end of its two-sided 95 % interval by Fisher's transformation; -1 with less than 4 pairs, None
            without a coefficient.
        high: upper end; 1 with less than 4 pairs.
        p: p of the t-test of no correlation, against the alternative asked for; 1 where r is None, or with 2 pairs.
    """

    n: int
    r: float | None
    low: float | None
    high: float | None
    p: float


@dataclass(frozen=True)
class Reliability:
    """Reliability of repeated measurements: which share of their variance lies between the measured items.

    Attributes:
        n: number of items, such as bodies.
        repetitions: k, the number of measurements of each item.
        within: standard deviation within an item.
        single: intraclass correlation ICC(1), the share of the variance of one measurement that lies between items;
            None where nothing varies.
        low: lower end of its 95 % interval.
        high: upper end.
        mean: ICC(1, k), the same share for the mean of k measurements; 0 where items differ less than by chance.
    """

    n: int
    repetitions: int
    within: float
    single: float | None
    low: float | None
    high: float | None
    mean: float | None


@dataclass(frozen=True)
class WelchTest:
    """Welch's t-test of whether the means of two samples differ; their variances may differ.

    Attributes:
        t: the statistic, positive where the second mean is larger; None where nothing varies.
        freedom: degrees of freedom by Welch and Satterthwaite; None where nothing varies.
        p: two-sided; 1 where nothing varies and the means are equal, 0 where they are not.
    """

    t: float | None
    freedom: float | None
    p: float


@dataclass(frozen=True)
class Difference:
    """Difference of the means of two samples, with an interval by Student's t that suits small samples.

    Attributes:
        difference: difference of the means, b - a.
        low: lower end of its 95 % interval by Student's t.
        high: upper end.
        p: p of the two-sided t-test; 1 where nothing varies and the means are equal, 0 where they are not.
    """

    difference: float
    low: float
    high: float
    p: float


def superiority(a: ArrayLike, b: ArrayLike) -> float:
    """A12: the probability that a value of b exceeds one of a, ties counted half."""
    pairs = np.asarray(b, float)[:, None] - np.asarray(a, float)[None, :]
    return float(np.mean((pairs > 0) + 0.5 * (pairs == 0)))


def cohens_d(a: ArrayLike, b: ArrayLike) -> float | None:
    """Difference of the means, b - a, in pooled standard deviations; None where nothing varies."""
    a, b = np.asarray(a, float), np.asarray(b, float)
    freedom = len(a) + len(b) - 2
    pooled = (a.var() * len(a) + b.var() * len(b)) / freedom if freedom > 0 else 0.0
    return float((b.mean() - a.mean()) / np.sqrt(pooled)) if pooled > 0 else None


def mann_whitney(a: ArrayLike, b: ArrayLike, alternative: Alternative, method: Literal["exact", "asymptotic"]) -> float:
    """p of the Mann-Whitney U test, 1 where nothing varies; ``"less"``: a tends to be less than b."""
    if not np.ptp(np.concatenate([a, b])):
        return 1.0
    return float(_scipy().mannwhitneyu(a, b, alternative=alternative, method=method).pvalue)


def welch(a: ArrayLike, b: ArrayLike) -> WelchTest:
    """Welch's t-test of samples a and b, each with at least two finite values.

    Raises:
        ValueError: if there are fewer values.
    """
    a, b = _sample("a", a), _sample("b", b)
    if not (np.ptp(a) or np.ptp(b)):
        return WelchTest(None, None, float(a[0] == b[0]))
    found = _scipy().ttest_ind(b, a, equal_var=False, alternative="two-sided")
    return WelchTest(float(found.statistic), float(found.df), float(found.pvalue))


def difference_of_means(a: ArrayLike, b: ArrayLike, paired: bool = False) -> Difference:
    """Difference of the means of samples a and b by Welch's t-test, or by the paired t-test.

    Args:
        a: at least two finite values.
        b: at least two finite values; as many as a if ``paired``.
        paired: whether value n of a belongs to value n of b.

    Raises:
        ValueError: if there are fewer values, or paired samples differ in length.
    """
    if paired:
        a, b = _pairs(a, b)
        mean, interval, varies = float((b - a).mean()), mean_interval(b - a), np.ptp(b - a) > 0
        p = float(_scipy().ttest_rel(b, a, alternative="two-sided").pvalue) if varies else float(mean == 0.0)
        return Difference(mean, *interval, p)
    known, a, b = welch(a, b), np.asarray(a, float), np.asarray(b, float)
    mean = float(b.mean() - a.mean())
    if known.t is None:
        return Difference(mean, mean, mean, known.p)
    found = _scipy().ttest_ind(b, a, equal_var=False, alternative="two-sided").confidence_interval(0.95)
    return Difference(mean, float(found.low), float(found.high), known.p)


def ratio_of_means(a: ArrayLike, b: ArrayLike, level: float = 0.95) -> tuple[float, float | None, float | None]:
    """Mean of sample a divided by that of sample b, with both ends of its confidence interval by Fieller's theorem.

    Both ends are None where no interval holds the ratio: where the mean of b may be 0. Variances may differ: degrees of
    freedom are Satterthwaite's, at the ratio found (Hasler, Vonk & Hothorn, Statistics in Medicine 27, 2008).

    Raises:
        ValueError: for fewer than two values, or a mean of b that is not positive.
    """
    a, b = _sample("a", a), _sample("b", b)
    above, below = float(a.mean()), float(b.mean())
    if not below > 0:
        raise ValueError(f"b: a mean of {below:g} is not allowed; it must be positive")
    ratio, varies = above / below, (float(a.var(ddof=1)) / len(a), float(b.var(ddof=1)) / len(b))
    parts = varies[0], ratio**2 * varies[1]  # of the variance of above - ratio * below
    freedom = float(len(b) - 1)  # where only b varies
    if sum(parts) > 0:
        freedom = sum(parts) ** 2 / (parts[0] ** 2 / (len(a) - 1) + parts[1] ** 2 / (len(b) - 1))
    return (ratio, *_fieller((above, below), varies, freedom, level))


def _fieller(
    means: tuple[float, float], variances: tuple[float, float], freedom: float, level: float
) -> tuple[float | None, float | None]:
    """Ratios r for which means[0] - r * means[1] may be 0, given variances of the means; None if these have no ends."""
    (above, below), square = means, float(_scipy().t.isf((1 - level) / 2, freedom)) ** 2
    leading = below**2 - square * variances[1]
    if not leading > 0:
        return None, None
    middle, last = above * below, above**2 - square * variances[0]
    half = max(0.0, middle**2 - leading * last) ** 0.5
    return (middle - half) / leading, (middle + half) / leading


def mean_interval(sample: ArrayLike, level: float = 0.95) -> tuple[float, float]:
    """Confidence interval of the mean by Student's t, for small samples that are nearly normal.

    Raises:
        ValueError: if there are fewer than two values, or one is not finite.
    """
    low, high = student_band(_sample("sample", sample), level)
    return float(low), float(high)


def student_band(sample: ArrayLike, level: float = 0.95) -> tuple[Floats, Floats]:
    """:func:`mean_interval` over the first axis of (n, ...), n at least 2: both ends, shape (...); NaN where one is."""
    values = np.asarray(sample, float)
    mean = values.mean(axis=0)
    half = _scipy().t.isf((1 - level) / 2, len(values) - 1) * values.std(axis=0, ddof=1) / np.sqrt(len(values))
    return mean - half, mean + half


def known_interval(sample: ArrayLike) -> tuple[float | None, float | None]:
    """The 95 % interval of :func:`mean_interval`, or ``(None, None)`` with fewer than two values."""
    return mean_interval(sample) if np.size(sample) > 1 else (None, None)


def known_mean(sample: ArrayLike, name: str = "mean") -> dict[str, float | None]:
    """The mean of a sample under the key ``name``, and its 95 % interval as ``low`` and ``high``; None if unknown."""
    values = np.asarray(sample, float)
    low, high = known_interval(values)
    return {name: float(values.mean()) if values.size else None, "low": low, "high": high}


def wilson(successes: int, trials: int) -> tuple[float, float]:
    """Two-sided 95 % score interval (Wilson) of the share ``successes / trials``; ``trials`` is at least 1."""
    interval = _scipy().binomtest(successes, trials, alternative="two-sided").proportion_ci(0.95, method="wilson")
    return float(interval.low), float(interval.high)


def pearson(x: ArrayLike, y: ArrayLike, alternative: Alternative) -> Correlation:
    """Product-moment correlation of pairs, both of shape (n,); ``"less"`` tests for a negative one.

    Raises:
        ValueError: if the shapes differ, or a value is not finite.
    """
    return _correlation(_scipy().pearsonr, *_pairs(x, y), alternative, variance=1.0)


def spearman(x: ArrayLike, y: ArrayLike, alternative: Alternative) -> Correlation:
    """Rank correlation of pairs, both of shape (n,), in which equal values share a rank.

    The interval uses the wider variance 1.06 / (n - 3) of the transformed coefficient (Fieller et al. 1957); it is
    good for n of 10 or more.
    """
    return _correlation(_scipy().spearmanr, *_pairs(x, y), alternative, variance=1.06)


def _correlation(test: Any, x: Floats, y: Floats, alternative: Alternative, variance: float) -> Correlation:
    """Test for a correlation; ``variance`` is n - 3 times the variance of the transformed coefficient."""
    n = len(x)
    if n < 2 or not (np.ptp(x) and np.ptp(y)):
        return Correlation(n, None, None, None, 1.0)
    found = test(x, y, alternative=alternative)
    r, low, high = float(found.statistic), -1.0, 1.0
    if n > 3:
        with np.errstate(divide="ignore"):  # arctanh of a perfect correlation is infinite; its interval is one point
            centre, half = np.arctanh(r), _scipy().norm.isf(0.025) * np.sqrt(variance / (n - 3))
        low, high = float(np.tanh(centre - half)), float(np.tanh(centre + half))
    return Correlation(n, r, low, high, float(found.pvalue) if n > 2 else 1.0)


def reliability(values: ArrayLike) -> Reliability:
    """Intraclass correlation of n >= 2 items, each measured k >= 2 times, shape (n, k).

    The interval assumes normally distributed measurements.

    Source: one-way random effects, ICC(1, 1) and ICC(1, k): Shrout & Fleiss, Psychological Bulletin 86, 1979.

    Raises:
        ValueError: for fewer items or measurements, or one that is not finite.
    """
    found = np.asarray(values, float)
    if found.ndim != 2 or min(found.shape) < 2 or not np.isfinite(found).all():
        raise ValueError(f"values: shape {found.shape} is not allowed; give finite ones of shape (n, k), both >= 2")
    n, k = found.shape
    between = k * float(found.mean(axis=1).var(ddof=1))
    within = float(found.var(axis=1, ddof=1).mean())
    if np.ptp(found) <= 1e-12 * np.abs(found).max():  # the values differ by rounding at most
        return Reliability(n, k, 0.0, None, None, None, None)

    def share(low: float, high: float) -> float:
        return (low - high) / (low + (k - 1) * high)

    freedom, fisher = (n - 1, n * (k - 1)), _scipy().f
    low, high = (share(between, within * float(fisher.ppf(level, *freedom))) for level in (0.975, 0.025))
    mean = max(0.0, 1 - within / between) if between else 0.0
    return Reliability(n, k, within**0.5, share(between, within), low, high, mean)


def bootstrap_means(sample: ArrayLike, resamples: int = 2000, seed: int = 0) -> Floats:
    """Means of resamples, shape (resamples, ...), of the rows of ``sample``, (n, ...), drawn with replacement."""
    values = np.asarray(sample, float)
    if len(values) < 2:  # SciPy needs at least two
        return np.repeat(values.mean(axis=0)[None], resamples, axis=0)
    found = _scipy().bootstrap(
        (values,),
        np.mean,
        n_resamples=resamples,
        batch=max(1, MOST_AT_ONCE // values.size),
        vectorized=True,
        axis=0,
        method="percentile",
        rng=np.random.default_rng(seed),
    )
    return np.moveaxis(found.bootstrap_distribution, -1, 0)


def mean_band(sample: ArrayLike, level: float = 0.95) -> tuple[Floats, Floats]:
    """Percentile bootstrap interval of the mean over the first axis of (n, ...): lower and upper end, shape (...).

    Of few values it is too narrow: of normal ones it covers the mean in 50 % of samples of two, 76 % of three, 84 % of
    five and 90 % of ten, not 95 %. :func:`student_band` does; this is for studies whose tables have it.
    """
    tail = 50 * (1 - level)
    low, high = np.percentile(bootstrap_means(sample), [tail, 100 - tail], axis=0)
    return low, high


def effect(a: ArrayLike, b: ArrayLike, interval: Literal["bootstrap", "student"] = "bootstrap") -> Effect:
    """Compare samples a and b, each of shape (n,) with at least two values.

    The interval of the difference is Welch's, by Student's t, or of bootstrap percentiles, which studies have in their
    tables; these are too narrow for few values: of normal ones they cover it in 68 % of samples of two and two.
    """
    a, b = np.asarray(a, float), np.asarray(b, float)
    if interval == "student":
        by_welch = difference_of_means(a, b, paired=False)
        low, high = by_welch.low, by_welch.high
    else:
        low, high = np.percentile(bootstrap_means(b, seed=1) - bootstrap_means(a, seed=0), [2.5, 97.5])
    difference, sizes = float(b.mean() - a.mean()), (superiority(a, b), cohens_d(a, b))
    return Effect(difference, float(low), float(high), *sizes, rank_test(a, b))


def rank_test(a: ArrayLike, b: ArrayLike) -> float:
    """p that ranks of samples a and b, shape (n,) each, tell them apart: Mann-Whitney, exact for few without ties."""
    a, b = np.asarray(a, float), np.asarray(b, float)
    tied = len(np.unique(np.concatenate([a, b]))) < len(a) + len(b)
    exact = not tied and max(len(a), len(b)) <= 20
    return mann_whitney(a, b, "two-sided", "exact" if exact else "asymptotic")


def bonferroni(p_values: Sequence[float]) -> list[float]:
    """Bonferroni-adjusted p-values: each multiplied by their number, at most 1; in the given order."""
    return [min(1.0, float(p) * len(p_values)) for p in p_values]


def holm(p_values: Sequence[float]) -> list[float]:
    """p-values adjusted for multiple tests by Holm's step-down method, in the given order."""
    p = np.asarray(p_values, float)
    order = np.argsort(p, kind="stable")
    adjusted = np.maximum.accumulate(p[order] * (len(p) - np.arange(len(p))))
    result = np.empty_like(p)
    result[order] = np.minimum(adjusted, 1.0)
    return result.tolist()


def _scipy() -> Any:
    from scipy import stats  # slow to import

    return stats


def _sample(name: str, values: ArrayLike) -> Floats:
    sample = np.asarray(values, float)
    if sample.ndim != 1 or len(sample) < 2 or not np.isfinite(sample).all():
        raise ValueError(f"{name}: {len(sample)} values are not allowed; give at least 2 finite ones")
    return sample


def _pairs(x: ArrayLike, y: ArrayLike) -> tuple[Floats, Floats]:
    x, y = np.asarray(x, float), np.asarray(y, float)
    if x.ndim != 1 or x.shape != y.shape:
        raise ValueError(f"y: shape {y.shape} beside {x.shape} is not allowed; give two samples of the same length")
    for name, sample in (("x", x), ("y", y)):
        if not np.isfinite(sample).all():
            raise ValueError(f"{name}: {sample[~np.isfinite(sample)][0]} is not allowed; give finite numbers")
    return x, y
