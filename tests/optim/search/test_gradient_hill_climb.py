"""Hill climbers that step along gradients: what steps do with variables of no slope."""

import numpy as np
import pytest

from optim.problem import Evaluation
from optim.search import build_method
from optim.space import Space, Variable

SPACE = Space((Variable("level", 0.0, 1.0, step=0.1), Variable("time", 0.0, 1.0, step=0.1)))


def turned(method):
    """The objective rises with both; only that of the level is known."""
    points = method.ask()
    known = method.wants == "gradients"
    slopes = np.tile([1.0, 0.0], (len(points), 1)) if known else None
    method.tell(points, Evaluation(points.sum(axis=1), gradients=slopes))
    return points, known


@pytest.mark.parametrize("blind", ["keep", "mutate"])
def test_variables_without_a_slope_are_kept_or_mutated(blind):
    method = build_method("gradient-hill-climb", SPACE, {"climbers": 3, "blind": blind, "seed": 1})
    starts, _ = turned(method)
    _, known = turned(method)
    assert known
    stepped, known = turned(method)
    assert not known and stepped[:, 0] == pytest.approx(np.minimum(starts[:, 0] + 0.05, 1.0), abs=0.1)
    assert (stepped[:, 1] == starts[:, 1]).all() == (blind == "keep")
    for _ in range(60):
        turned(method)
    assert method.result().score > (1.9 if blind == "mutate" else 1.5)


def test_another_way_is_refused():
    with pytest.raises(ValueError, match=r"^blind: 'guess' is unknown; choose one of keep, mutate$"):
        build_method("gradient-hill-climb", SPACE, {"blind": "guess"})
