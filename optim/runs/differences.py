"""How groups of runs differ: in pairs where all their units began alike, otherwise as independent samples.

Starts, and what methods draw later, depend on the seed and the climber only, and seeds are 0 unless they are given. So
groups often share them, and units that share them are no independent samples: a test that takes them for such finds
too little.
"""

import itertools
import warnings
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from optim.measures.pairs import paired_effect
from optim.measures.statistics import effect, holm, rank_test, superiority
from optim.runs.comparison import Curve
from taichi_sim.base.arrays import Floats
from taichi_sim.base.short_text import counted


@dataclass(frozen=True)
class GroupEffect:
    """How two groups differ, second minus first: means of those with success, ranks of all.

    Attributes:
        difference: difference of the means; this and its interval are None unless both groups have two successes. In
            pairs, it is the mean difference of those in which both have success.
        low: lower end of its 95 % interval.
        high: upper end.
        superiority: A12, the probability that one of the second exceeds one of the first, ties counted half; in pairs
            the share of them in which the second does.
        cohens_d: the difference in pooled standard deviations, in pairs in those of the differences; None where
            nothing varies, or there is no difference.
        p: two-sided p of the test.
        test: ``"Mann-Whitney"``; in pairs ``"signed-rank"``, or ``"paired t"`` of fewer than ten, unless only one of
            a pair has success.
        pairs: number of pairs of units that began alike; None where groups are compared as independent samples, also
            because all pairs differ by one number, or fewer than two have success.
    """

    difference: float | None
    low: float | None
    high: float | None
    superiority: float
    cohens_d: float | None
    p: float
    test: str
    pairs: int | None


@dataclass(frozen=True)
class Difference:
    """Difference between two groups, second minus first: effect sizes, and p adjusted for all pairs of groups (Holm).

    ``shared_starts`` is the number of units of one group that began like one of the other.
    """

    first: str
    second: str
    effect: GroupEffect
    adjusted_p: float
    shared_starts: int


def differences_at(compared: Sequence[Curve], x: float) -> list[Difference]:
    """Compare groups at x, each two in which both have at least two units.

    Groups that began alike, each unit as one of the other, are compared in pairs. A warning tells of others that share
    some starts. Means are of units with success; the rest is of all, those without any success below all others.
    """
    found = []
    for a, b in itertools.combinations(compared, 2):
        if min(len(a.all_at(x)), len(b.all_at(x))) >= 2:
            twins = shared_starts(a, b)
            found.append((a, b, len(twins), _effect(a.all_at(x), b.all_at(x), twins)))
    _warn_of_shared_starts(
        [
            f"{a.label} and {b.label} share {shared} of {max(len(a.starts), len(b.starts))} starts"
            for a, b, shared, _ in found
            if 0 < shared < max(len(a.starts), len(b.starts))
        ]
    )
    adjusted = holm([effect.p for *_, effect in found])
    return [
        Difference(a.label, b.label, effect, p, shared)
        for (a, b, shared, effect), p in zip(found, adjusted, strict=True)
    ]


def shared_starts(a: Curve, b: Curve) -> list[tuple[int, int]]:
    """Numbers of the units of groups a and b that began alike, in pairs: by equal seeds and equal generations 0.

    Equal scores alone are no proof: where scores are few numbers, they are equal by chance. So most of them must occur
    once in a group, and climbers of a seed begin alike either all, as far as both groups have them, or not at all.
    """
    there = {start: number for number, start in enumerate(b.starts)}
    alike = [(number, there[start]) for number, start in enumerate(a.starts) if start in there]
    if a.unit == "climbers" and len(alike) < min(len(a.starts), len(b.starts)):
        return []
    often = [Counter(start.found for start in curve.starts) for curve in (a, b)]
    successes = [found for number, _ in alike if (found := a.starts[number].found) is not None]
    telling = [found for found in successes if max(counts[found] for counts in often) == 1]
    return alike if 2 * len(telling) > len(successes) else []


def _warn_of_shared_starts(sharing: Sequence[str]) -> None:
    """Warn once of groups that share some starts, each two as words that say so."""
    if sharing:
        others = len(sharing) - 1
        more = f", and so {'does' if others == 1 else 'do'} {counted(others, 'more pair')} of groups" if others else ""
        warnings.warn(
            f"{sharing[0]}{more}, so the test of the difference finds less than it could: search with other seeds in "
            "each group, or with the same seeds and equal numbers of climbers",
            stacklevel=3,
        )


def _effect(a: Floats, b: Floats, twins: Sequence[tuple[int, int]]) -> GroupEffect:
    """Compare all units of two groups, in pairs if the twins are all of both and differ by more than one number."""
    if len(a) == len(b) == len(twins):
        first, second = (list(numbers) for numbers in zip(*twins, strict=True))
        if paired := paired_effect(a[first], b[second]):
            return GroupEffect(**vars(paired), pairs=len(twins))
    known = a[~np.isnan(a)], b[~np.isnan(b)]
    a, b = (np.where(np.isnan(each), -np.finfo(float).max, each) for each in (a, b))
    ranked, test = (superiority(a, b), rank_test(a, b)), "Mann-Whitney"
    if min(map(len, known)) < 2:
        return GroupEffect(None, None, None, ranked[0], None, ranked[1], test, None)
    found = effect(*known, interval="student")
    return GroupEffect(found.difference, found.low, found.high, ranked[0], found.cohens_d, ranked[1], test, None)
