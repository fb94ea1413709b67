"""Statistics that comparisons of searches need.

Sources: Vargha & Delaney, J. Educational and Behavioral Statistics 25(2), 2000 (A12); Cohen, Statistical Power
Analysis, 2nd ed. 1988 (d); Mann & Whitney, Annals of Mathematical Statistics 18, 1947; Efron & Tibshirani, An
Introduction to the Bootstrap, 1993, ch. 13 (percentile intervals); Holm, Scandinavian J. of Statistics 6, 1979.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Effect:
    """How a sample ``b`` differs from a sample ``a``.

    Attributes:
        difference: of the means, b - a.
        low: lower end of its 95 % bootstrap interval.
        high: upper end.
        superiority: A12, the probability that one of b exceeds one of a, ties counted half.
        cohens_d: the difference in pooled standard deviations; None where nothing varies.
        p: of the two-sided Mann-Whitney test.
    """

    difference: float
    low: float
    high: float
    superiority: float
    cohens_d: float | None
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


def mann_whitney(
    a: ArrayLike,
    b: ArrayLike,
    alternative: Literal["two-sided", "less", "greater"],
    method: Literal["exact", "asymptotic"],
) -> float:
    """p of the Mann-Whitney U test; ``"less"``: a tends to be less than b."""
    from scipy.stats import mannwhitneyu  # slow to import

    return float(mannwhitneyu(a, b, alternative=alternative, method=method).pvalue)


def bootstrap_means(sample: ArrayLike, resamples: int = 2000, seed: int = 0) -> Floats:
    """Means of samples drawn with replacement from the rows of ``sample``, shape (n, ...): (resamples, ...)."""
    values = np.asarray(sample, float)
    rows = np.random.default_rng(seed).integers(len(values), size=(resamples, len(values)))
    weights = np.zeros((resamples, len(values)))
    np.add.at(weights, (np.arange(resamples)[:, None], rows), 1 / len(values))
    return np.tensordot(weights, values, axes=1)


def mean_band(sample: ArrayLike, level: float = 0.95) -> tuple[Floats, Floats]:
    """Percentile bootstrap interval of the mean over the first axis, shape (n, ...): two arrays of shape (...)."""
    tail = 50 * (1 - level)
    low, high = np.percentile(bootstrap_means(sample), [tail, 100 - tail], axis=0)
    return low, high


def effect(a: ArrayLike, b: ArrayLike) -> Effect:
    """How b differs from a, each of shape (n,) with at least two values."""
    a, b = np.asarray(a, float), np.asarray(b, float)
    tied = len(np.unique(np.concatenate([a, b]))) < len(a) + len(b)
    exact = not tied and max(len(a), len(b)) <= 20
    low, high = np.percentile(bootstrap_means(b, seed=1) - bootstrap_means(a, seed=0), [2.5, 97.5])
    p = mann_whitney(a, b, "two-sided", "exact" if exact else "asymptotic") if np.ptp(np.concatenate([a, b])) else 1.0
    return Effect(float(b.mean() - a.mean()), float(low), float(high), superiority(a, b), cohens_d(a, b), p)


def holm(p_values: Sequence[float]) -> list[float]:
    """p-values adjusted for their number (Holm's step-down method), in the order given."""
    p = np.asarray(p_values, float)
    order = np.argsort(p, kind="stable")
    adjusted = np.maximum.accumulate(p[order] * (len(p) - np.arange(len(p))))
    result = np.empty_like(p)
    result[order] = np.minimum(adjusted, 1.0)
    return result.tolist()
