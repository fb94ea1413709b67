"""Statistics for samples whose values belong together in pairs, such as searches from the same starts.

Sources: Grissom & Kim, Effect Sizes for Research, 2nd ed. 2012 (probability of superiority of dependent samples);
Cohen, Statistical Power Analysis, 2nd ed. 1988 (d of differences, his d_z).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from optim.measures.statistics import difference_of_means
from taichi_sim.base.arrays import Floats

FEW_PAIRS = 10  # with fewer, signed ranks leave no p small enough to be told apart after a correction for several tests


@dataclass(frozen=True)
class PairedEffect:
    """Effect sizes and significance of the differences, b - a, of pairs.

    Attributes:
        difference: their mean, of pairs of finite values.
        low: lower end of its 95 % interval by Student's t.
        high: upper end.
        superiority: share of all pairs in which b is larger, ties counted half.
        cohens_d: the mean in standard deviations of the differences.
        p: two-sided p of the test.
        test: ``"signed-rank"``; ``"paired t"`` of fewer than ten pairs, unless only one value of a pair is known.
    """

    difference: float
    low: float
    high: float
    superiority: float
    cohens_d: float
    p: float
    test: str


def paired_effect(a: ArrayLike, b: ArrayLike) -> PairedEffect | None:
    """Compare value n of a with value n of b, shape (n,) each; NaN is below all other values, in ranks.

    Returns:
        None where differences do not vary, or fewer than two are finite: such tell nothing of their scatter.
    """
    a, b = np.asarray(a, float), np.asarray(b, float)
    known, single = ~np.isnan(a + b), np.isnan(a) != np.isnan(b)
    gains = (b - a)[known]
    if len(gains) < 2 or np.ptp(gains) <= 1e-12 * np.abs([a[known], b[known]]).max():  # they differ by rounding at most
        return None
    lowest_a, lowest_b = (np.where(np.isnan(each), -np.finfo(float).max, each) for each in (a, b))
    share = float(np.mean((lowest_b > lowest_a) + 0.5 * (lowest_b == lowest_a)))
    found, d = difference_of_means(a[known], b[known], paired=True), float(gains.mean() / gains.std(ddof=1))
    ranked = len(a) >= FEW_PAIRS or single.any()
    p, test = (signed_rank(lowest_b - lowest_a), "signed-rank") if ranked else (found.p, "paired t")
    return PairedEffect(found.difference, found.low, found.high, share, d, p, test)


def signed_rank(differences: Floats) -> float:
    """Two-sided p of Wilcoxon's test that differences lie about 0; those of 0 are left out, and 1 without others."""
    from scipy import stats  # slow to import

    others = differences[differences != 0]
    return float(stats.wilcoxon(others, alternative="two-sided").pvalue) if len(others) else 1.0
