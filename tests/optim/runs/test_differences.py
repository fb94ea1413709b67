"""Whether groups are compared in pairs, which takes starts that are the same beyond doubt."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from optim.problem import Evaluation
from optim.runs.comparison import Curve, Start
from optim.runs.differences import differences_at, shared_starts
from optim.search import build_method
from optim.space import Space, Variable

SCORES = (0.3, None, 0.1, 0.5, None, 0.2)


def climbers(label, first, seed=0):
    """Curve of climbers with these scores in generation 0."""
    starts = tuple(Start(seed, number, score) for number, score in enumerate(first))
    return Curve(label, (label,), "climbers", np.zeros(1), np.array(first, float)[:, None], starts)


def runs(label, first, seeds):
    """Curve of runs whose best design in generation 0 has a score and one value."""
    found = [known and (known[0], (("x", known[1]),)) for known in first]
    starts = tuple(Start(seed, None, each) for seed, each in zip(seeds, found, strict=True))
    return Curve(label, (label,), "runs", np.zeros(1), np.zeros((len(starts), 1)), starts)


def test_climbers_are_paired_by_seed_number_and_score():
    a = climbers("a", SCORES)
    assert shared_starts(a, climbers("b", SCORES)) == [(number, number) for number in range(6)]
    assert shared_starts(a, climbers("b", (*SCORES, 0.7, 0.8))) == [(number, number) for number in range(6)]
    assert shared_starts(a, climbers("b", SCORES, seed=1)) == []
    assert shared_starts(a, climbers("b", (0.3, None, 0.1, 0.5, None, 0.4))) == []
    assert shared_starts(a, replace(a, starts=())) == []


@pytest.mark.parametrize("first", [(0.0,) * 6, (None,) * 6, (0.0, 1.0, 0.0, 1.0, 0.0, 2.0)])
def test_scores_that_are_equal_by_chance_are_no_proof(first):
    """Where a task counts successes, most first scores are the same number."""
    assert shared_starts(climbers("a", first), climbers("b", first)) == []


def test_runs_are_paired_by_seed_and_first_best_design():
    first = [(0.3, 1.0), (0.1, 2.0), None]
    a = runs("a", first, (4, 5, 6))
    assert shared_starts(a, runs("b", first[::-1], (6, 5, 4))) == [(0, 2), (1, 1), (2, 0)]
    assert shared_starts(a, runs("b", first, (5, 4, 6))) == []  # only the failure is alike
    assert shared_starts(a, runs("b", [(0.3, 1.0), (0.1, 7.0)], (4, 5))) == [(0, 0)]
    same = runs("a", [(0.0, 1.0)] * 3, (4, 5, 6))  # all begin with a given design
    assert shared_starts(same, same) == []


def test_pairs_are_of_units_that_belong_together():
    """Scores of the same seed are subtracted, in whatever order the runs are."""
    scores = np.array([[1.0], [2.0], [4.0]])
    first = [(0.3, 1.0), (0.1, 2.0), (0.2, 3.0)]
    a = replace(runs("a", first, (0, 1, 2)), scores=scores)
    b = replace(runs("b", first[::-1], (2, 1, 0)), scores=scores[::-1] + np.array([[0.3], [0.2], [0.1]]))
    (found,) = differences_at([a, b], 0.0)
    assert found.effect.superiority == 1.0 and found.effect.pairs == found.shared_starts == 3
    assert found.effect.cohens_d == pytest.approx(2.0)
    (same,) = differences_at([a, replace(a, label="b")], 0.0)  # without scatter, as independent samples
    assert (same.effect.test, same.effect.pairs, same.shared_starts) == ("Mann-Whitney", None, 3)
    assert same.effect.low < 0.0 < same.effect.high


def climbed(label, count, seed, step=0.1):
    """Curve of hill climbers of a seed on a sphere, whose scores are those after three steps."""
    method = build_method(
        "hill-climb",
        Space(tuple(Variable(name, -1.0, 1.0, step=step) for name in "abc")),
        {"climbers": count, "seed": seed},
    )
    scores = []
    for _ in range(4):
        points = method.ask()
        method.tell(points, Evaluation(-(points**2).sum(axis=1)))
        scores.append(method.scores)
    return replace(climbers(label, scores[0].tolist(), seed), scores=scores[-1][:, None])


def test_climbers_of_one_seed_are_told_apart_far_better_in_pairs():
    """Larger steps gain more; equal seeds find it in most trials, and other seeds hold no difference as they should."""
    paired, apart, nothing, alike = [], [], [], []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the last
        for seed in range(60):
            a, b = climbed("a", 12, seed), climbed("b", 12, seed, step=0.3)
            far = climbed("b", 12, 1000 + seed, step=0.3), climbed("b", 24, 1000 + seed), climbed("b", 24, seed)
            found = [differences_at([a, other], 0.0)[0].effect for other in (b, *far)]
            assert [each.pairs for each in found] == [12, None, None, None]
            for each, kept in zip(found, (paired, apart, nothing, alike), strict=True):
                kept.append(each)
    significant = [np.mean([each.p < 0.05 for each in kept]) for kept in (paired, apart, nothing, alike)]
    assert significant[0] > 0.7 and significant[0] > 3 * significant[1]
    assert significant[2] < 0.12 and significant[3] == 0.0
    assert np.mean([each.low <= 0.0 <= each.high for each in nothing]) > 0.88


def test_a_warning_tells_of_starts_that_are_shared_in_part():
    few, many = climbers("few", SCORES), climbers("many", (*SCORES, 0.7, 0.8))
    with pytest.warns(UserWarning, match="^few and many share 6 of 8 starts, so the test of the difference finds less"):
        (found,) = differences_at([few, many], 0.0)
    assert (found.shared_starts, found.effect.pairs, found.effect.test) == (6, None, "Mann-Whitney")
