"""Maps of elites that covariance-matrix adaptation fills, through pyribs."""

import os

os.environ.setdefault("NUMBA_DISABLE_JIT", "1")  # compiling takes longer than all tests here

import sys

import numpy as np
import pytest

from optim.problem import Evaluation
from optim.search import build_method
from optim.space import Space, Variable

SPACE = Space(
    (
        *(Variable(f"x{i}", -2.0, 2.0, step=0.2) for i in range(4)),
        Variable("turn", 0.0, 360.0, "angle"),
        Variable("fins", 0, 3, "integer"),
    )
)
SETTINGS = {"population": 24, "descriptors": ["x0", "x1"], "bins": 16, "offset": -30.0, "seed": 3}
METHODS = {"cma-me": {}, "cma-mae": {"lowest": -30.0}}


def bowl(points) -> Evaluation:
    """Best at the origin, with one fin, heading to 90 degrees; a part of the space fails."""
    scores = -(points[:, :4] ** 2).sum(axis=1) - abs(points[:, 5] - 1) + np.sin(np.radians(points[:, 4]))
    return Evaluation(np.where(points[:, 2] > 1.5, np.nan, scores)[:, None], {})


def searched(name, generations, **settings):
    search = build_method(name, SPACE, {**SETTINGS, **METHODS.get(name, {}), **settings})
    for _ in range(generations):
        points = search.ask()
        assert np.array_equal(points, search.ask()) and SPACE.contains(points).all()
        search.tell(points, bowl(points))
    return search


@pytest.mark.parametrize("name", METHODS)
def test_a_search_goes_on_exactly_from_its_state(name):
    search, other = searched(name, 12), build_method(name, SPACE, {**SETTINGS, **METHODS[name]})
    other.restore(search.state())
    for _ in range(4):
        assert np.array_equal(search.ask(), other.ask())
        for each in (search, other):
            each.tell(each.ask(), bowl(each.ask()))
    assert search.result().numbers == other.result().numbers
    assert all(np.array_equal(values, other.state()[key], equal_nan=True) for key, values in search.state().items())


def test_maps_are_better_than_those_of_mutations():
    """By the QD score, in the median of three seeds."""
    scores = {
        name: np.median([searched(name, 40, seed=seed).result().numbers["qd_score"] for seed in range(3)])
        for name in ("cma-me", "map-elites")
    }
    assert scores["cma-me"] > scores["map-elites"]
    result = searched("cma-me", 40).result()
    assert result.kind == "elites" and result.score == result.scores.max() > -1.0


@pytest.mark.parametrize("name", METHODS)
def test_failures_never_enter_the_map(name):
    """Neither where all fail at first, nor later."""
    search = build_method(name, SPACE, {**SETTINGS, **METHODS[name]})
    for generation in range(6):
        points = search.ask()
        found = bowl(points)
        if generation < 2:
            found = Evaluation(np.full((len(points), 1), np.nan), {})
        search.tell(points, found)
        assert not np.isnan(search.result().objectives).any() and (search.result().points[:, 2] <= 1.5).all()
        assert len(search.result().points) > 0 or generation < 2


@pytest.mark.parametrize("settings", [{"emitters": 5}, {"population": 3}, {"lowest": 1e6}])
def test_emitters_share_any_population_and_wait_for_what_is_good_enough(settings):
    result = searched("cma-mae", 8, **settings).result()
    assert len(result.points) and not np.isnan(result.score)


def test_bad_settings(monkeypatch):
    for settings, message in (
        ({"emitters": 0}, "emitters: 0"),
        ({"step": 0.0}, "step: 0.0"),
        ({"variation": "line"}, "variation: is no setting|variation"),
    ):
        with pytest.raises(ValueError, match=message):
            build_method("cma-me", SPACE, {**SETTINGS, **settings})
    monkeypatch.setitem(sys.modules, "ribs", None)
    with pytest.raises(ValueError, match="method: pyribs is missing; install the extra qd"):
        build_method("cma-me", SPACE, SETTINGS)
