"""Measures of a body by sampled controllers: how many succeed in every environment, with intervals.

Source: as of ``optim.measures.overlap``, whose M_L and M_CI these estimate where no grid holds all controllers.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from optim.measures.statistics import wilson
from taichi_sim.base.arrays import Bools


@dataclass(frozen=True)
class Share:
    """A share of controllers.

    Attributes:
        count: that are in it.
        of: all that could be.
        value: the share, from 0 to 1; 0 of none.
        low, high: its 95 % interval (Wilson), 0 to 1 of none.
    """

    count: int
    of: int
    value: float
    low: float
    high: float

    @classmethod
    def counted(cls, count: int, of: int) -> "Share":
        """The share of a count."""
        return cls(count, of, count / of, *wilson(count, of)) if of else cls(count, of, 0.0, 0.0, 1.0)


@dataclass(frozen=True)
class SampledMetrics:
    """How easily controllers are found that succeed in every environment.

    Attributes:
        learnability: M_L, controllers that succeed in all environments among all.
        resistance: M_CI, controllers that succeed in all environments among those that succeed in any; at 1, whoever
            learns one environment has learned all.
        each: controllers that succeed in each environment among all.
        alone: M_CI if successes in different environments had nothing to do with each other, at the shares ``each``.
    """

    learnability: Share
    resistance: Share
    each: tuple[Share, ...]
    alone: float


def sampled_metrics(succeeded: ArrayLike) -> SampledMetrics:
    """The metrics of a body from which of its controllers succeed where, shape (N, E).

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
