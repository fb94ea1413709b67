"""The 95 % interval of the mean of the worst share of scores, the conditional value at risk (CVaR)."""

import math

import numpy as np

from taichi_sim.base.arrays import Floats

RESAMPLES = 2000  # from which quantiles are taken
FULL = 8  # draws in a tail; resamples of fewer often have all but the same ones, and no deviation


def has_interval(share: float, draws: int) -> bool:
    """Whether more than one of these draws is in the tail; one alone tells nothing of how far others would differ."""
    return share * draws > 1 and draws > 1


def tail_interval(scores: Floats, share: float) -> tuple[float, float] | None:
    """Both ends of the 95 % interval of the mean of the worst share of K finite scores; None of the worst draw alone.

    Ends are as many deviations off as quantiles of t say. In a full tail these are of t in resamples (the studentised
    bootstrap: Efron & Tibshirani, An introduction to the bootstrap, 1993, ch. 12), as tails are skewed whatever the
    scores. In a shorter one, one in which resamples may be all alike, and of all scores, they are Student's, with one
    degree of freedom less than draws in the tail, but at least one: so the mean has its usual interval, and the mean of
    a few draws a wide one.
    """
    from scipy.special import stdtrit  # slow to import

    if not has_interval(share, len(scores)):
        return None
    (mean,), (deviation,) = _mean_and_deviation(scores[None], share)
    tail = share * len(scores)
    high = float(stdtrit(max(tail - 1, 1.0), 0.975))
    low = -high
    if share < 1 and tail >= FULL and deviation > 0:
        picked = np.random.default_rng(0).integers(0, len(scores), (RESAMPLES, len(scores)))
        means, deviations = _mean_and_deviation(scores[picked], share)
        varied = deviations > 0
        if varied.mean() > 0.975:  # else a quantile may be infinite
            low, high = np.percentile((means[varied] - mean) / deviations[varied], [2.5, 97.5])
    return float(mean - high * deviation), float(mean - low * deviation)


def _mean_and_deviation(scores: Floats, share: float) -> tuple[Floats, Floats]:
    """Means of the worst share of samples of scores, shape (N, K), and their standard deviations, shape (N,) each.

    A score counts by how far it lies below the tail's end, over the share (Trindade, Uryasev, Shapiro, Zrazhevsky,
    Journal of Banking & Finance 31, 3524, 2007); in the whole these are the mean's own.
    """
    ordered, count = np.sort(scores, axis=1), scores.shape[1]
    end = ordered[:, math.ceil(round(share * count, 9)) - 1]  # rounded: 0.2 times 15 is a little more than 3
    below = np.minimum(ordered - end[:, None], 0.0)
    return end + below.mean(axis=1) / share, below.std(axis=1, ddof=1) / (share * math.sqrt(count))
