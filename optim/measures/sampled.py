"""Learnability and resistance to interference of a body, estimated from sampled controllers, with intervals.

They estimate M_L and M_CI of ``optim.measures.overlap``, which names the sources, where controllers have too many
weights for a grid.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from optim.measures.statistics import wilson
from taichi_sim.base.arrays import Bools
from taichi_sim.base.short_text import ShortText


@dataclass(frozen=True)
class Share:
    """Share of controllers that have a property, with its confidence interval.

    Attributes:
        count: number of controllers that have it.
        of: number of controllers in all.
        value: the share, from 0 to 1; 0 if ``of`` is 0.
        low, high: its 95 % interval (Wilson); 0 and 1 if ``of`` is 0.
    """

    count: int
    of: int
    value: float
    low: float
    high: float

    @classmethod
    def counted(cls, count: int, of: int) -> "Share":
        """Compute the share and its interval from two counts."""
        return cls(count, of, count / of, *wilson(count, of)) if of else cls(count, of, 0.0, 0.0, 1.0)


@dataclass(frozen=True, repr=False)
class SampledMetrics(ShortText):
    """Measures of learning of a body, estimated from sampled controllers.

    Attributes:
        learnability: M_L, the share of controllers that succeed in all environments.
        resistance: M_CI, the share of controllers that succeed in all environments among those that succeed in any;
            at 1, a controller that has learned one environment has learned all.
        each: for each environment, the share of controllers that succeed in it.
        alone: M_CI that the shares ``each`` would give if successes in different environments were independent.
    """

    learnability: Share
    resistance: Share
    each: tuple[Share, ...]
    alone: float


def sampled_metrics(succeeded: ArrayLike) -> SampledMetrics:
    """Compute the metrics of a body from whether each of N controllers succeeded in each of E environments, (N, E).

    Raises:
        ValueError: for another shape.
    """
    solved: Bools = np.asarray(succeeded, bool)
    if solved.ndim != 2 or 0 in solved.shape:
        raise ValueError(f"succeeded: shape {solved.shape} is not allowed; give (controllers, environments)")
    count, every, some = len(solved), int(solved.all(axis=1).sum()), int(solved.any(axis=1).sum())
    shares = solved.mean(axis=0)
    by_chance = float(1 - np.prod(1 - shares))
    return SampledMetrics(
        Share.counted(every, count),
        Share.counted(every, some),
        tuple(Share.counted(int(each), count) for each in solved.sum(axis=0)),
        float(np.prod(shares)) / by_chance if by_chance else 0.0,
    )
