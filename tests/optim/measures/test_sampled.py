"""Metrics of sampled controllers."""

import numpy as np
import pytest

from optim.measures import learnability, resistance
from optim.measures.sampled import Share, sampled_metrics


def test_they_are_those_of_a_sweep():
    """Of the same controllers, whichever way they are told."""
    solved = np.random.default_rng(0).random((11 * 11, 4)) < 0.4
    overlap = solved.sum(axis=1).reshape(11, 11)
    found = sampled_metrics(solved)
    assert found.learnability.value == learnability(overlap)
    assert found.resistance.value == resistance(overlap)
    assert [each.count for each in found.each] == solved.sum(axis=0).tolist()


def test_what_chance_would_give():
    """Two environments solved by halves that have nothing to do with each other share a quarter of three."""
    solved = np.array([[a, b] for a in (True, False) for b in (True, False)])
    found = sampled_metrics(solved)
    assert found.alone == pytest.approx(1 / 3) == found.resistance.value


def test_shares_of_nothing():
    """They are zero, and might be anything."""
    assert Share.counted(0, 0) == Share(0, 0, 0.0, 0.0, 1.0)
    found = sampled_metrics(np.zeros((5, 2), bool))
    assert found.resistance.of == 0 and found.alone == 0.0
    assert found.learnability.low == 0 and 0.3 < found.learnability.high < 0.6


@pytest.mark.parametrize("shape", [(3,), (0, 2), (2, 0), (2, 2, 2)])
def test_other_shapes_are_refused(shape):
    """In one line."""
    with pytest.raises(ValueError, match="succeeded: shape"):
        sampled_metrics(np.zeros(shape))
