"""A race of gradient climbers: who goes on, through which designs, and what counts."""

import numpy as np
import pytest

from optim.problem import Evaluation
from optim.search import GradientRace, build_method
from optim.search.race import NEAR
from optim.space import Space, Variable

CUBE = Space(tuple(Variable(f"x{i}", -1.0, 3.0) for i in range(6)))
MIXED = Space(
    (
        Variable("x", -2.0, 2.0),
        Variable("turn", 0.0, 1.0, "angle"),
        *(Variable(f"b{i}", 0, 1, "binary") for i in range(8)),
    )
)


def hill(points):
    """A hill whose top is at 1 in every variable."""
    return -((points - 1.0) ** 2).sum(axis=1)


def bits(points):
    """A hill in x and the angle; half of the bits help, half of them harm."""
    x, turn, b = points[:, 0], points[:, 1], points[:, 2:]
    return -((x - 0.5) ** 2) + np.cos(2 * np.pi * (turn - 0.3)) + b @ np.array([1.0, -1.0] * 4)


def slopes(judge, points, step=1e-6):
    columns = np.eye(points.shape[1]) * step
    return np.stack([(judge(points + c) - judge(points - c)) / (2 * step) for c in columns], axis=1)


def run(method, judge, turns, fails=lambda points: np.zeros(len(points), bool)):
    """What a problem does: true points are rounded, and bits have no gradient among them."""
    asked = []
    for _ in range(turns):
        points = method.ask()
        method.relaxed.validate(points)
        true = method.wants == "points" or method.sharpness == np.inf
        where = method.space.round(points) if true else points
        gradients = slopes(judge, where) if method.wants == "gradients" else None
        if gradients is not None and true:
            gradients[:, method.space.integers] = 0.0
        scores = np.where(fails(points), np.nan, judge(where))
        asked.append((method.wants, method.sharpness, len(points)))
        method.tell(points, Evaluation(scores, gradients=gradients))
    return asked


def test_the_top_of_a_hill_is_found():
    method = GradientRace(CUBE, climbers=4, moves=120, halving=5, settling=0.01, clip=100.0)
    run(method, hill, 120)
    assert method.result().score > -1e-2


def test_the_worse_half_gives_up_until_one_is_left():
    method = GradientRace(CUBE, climbers=8, moves=20, halving=3)
    best = hill(method.ask()).argmax()
    asked = run(method, hill, 20)
    assert [count for _, _, count in asked] == [8] * 3 + [4] * 3 + [2] * 3 + [1] * 11
    assert len(method.ask()) == 8  # the next round begins
    method = GradientRace(CUBE, climbers=8, moves=20, halving=1)
    run(method, hill, 3)
    assert method.racing[best]


def test_later_rounds_may_return_to_the_best_design():
    """The first climber to it, a share of the others about it, the rest anywhere; what is given stays."""
    method = GradientRace(CUBE, climbers=8, moves=6, halving=2, returning=0.5, start={"x1": 0.25})
    first = method.ask()
    run(method, hill, 6)
    best, places = method.result().point, method.ask()
    assert method.round == 1 and len(places) == 8
    best[1] = 0.25
    np.testing.assert_array_equal(places[0], best)
    away = np.abs(places - best).max(axis=1)
    assert (away[1:4] > 0).all() and (away[1:4] < 4 * 5 * NEAR).all() and away[4:].min() > 4 * 5 * NEAR
    assert (places[:, 1] == 0.25).all() and (first[:, 1] == 0.25).all()
    usual = GradientRace(CUBE, climbers=8, moves=6, halving=2, start={"x1": 0.25})
    run(usual, hill, 6)
    np.testing.assert_array_equal(usual.ask()[4:], places[4:])
    mixed = GradientRace(MIXED, climbers=2, moves=4, halving=2, returning=1.0)
    while mixed.round == 0:
        run(mixed, bits, 1)
    assert np.array_equal(mixed.result().point, mixed.here[0]) and mixed.wants == "points"
    lost = GradientRace(CUBE, climbers=2, moves=2, halving=2, returning=1.0)
    run(lost, hill, 2, fails=lambda p: np.ones(len(p), bool))  # there is no best
    assert np.isfinite(lost.ask()).all()


def test_designs_become_sharper_and_then_true():
    method = GradientRace(MIXED, climbers=4, moves=20, halving=4, mixed=0.5, sharpest=16.0)
    asked = run(method, bits, 23)
    mixtures = [sharp for wants, sharp, _ in asked if wants == "gradients" and sharp < np.inf]
    assert mixtures[0] == 1 and mixtures[-1] == 16 and (np.diff(mixtures) > 0).all() and len(mixtures) == 10
    assert [wants for wants, _, _ in asked].count("points") == 3  # at the start, after 4 and after 8 moves
    point = method.result().point
    assert (method.space.round(point) == point).all()
    np.testing.assert_array_equal(point[2:], [1, 0] * 4)
    assert method.result().score == bits(point[None])[0] > 4.5


def test_continuous_variables_may_mix_designs():
    assert GradientRace(CUBE).sharpness == np.inf
    mixing = Space((Variable("x", 0, 1, mixes=True), Variable("y", 0, 1)))
    assert mixing.mixes and mixing.relaxed().mixes and not CUBE.mixes
    method = GradientRace(mixing, moves=10)
    assert method.sharpness == 1 and np.isnan(method.result().score)


def test_failures_are_taken_back_and_never_win():
    method = GradientRace(CUBE, climbers=1, moves=60, halving=60, learning_rate=0.2)
    run(method, hill, 60, fails=lambda p: p.max(axis=1) > 1.5)
    result = method.result()
    assert np.isfinite(result.score) and result.point.max() <= 1.5
    lost = GradientRace(CUBE, climbers=2, moves=6, halving=2)
    run(lost, hill, 6, fails=lambda p: np.ones(len(p), bool))
    assert np.isnan(lost.result().score)


def test_a_round_goes_on_exactly_where_it_was_interrupted():
    whole, first = (
        build_method("race", MIXED, {"moves": 14, "halving": 3, "climbers": 4, "seed": 5, "returning": 0.5})
        for _ in "ab"
    )
    run(whole, bits, 25)
    run(first, bits, 11)
    again = build_method("race", MIXED, {"moves": 14, "halving": 3, "climbers": 4, "seed": 5, "returning": 0.5})
    again.restore({name: array.copy() for name, array in first.state().items()})
    run(again, bits, 14)
    for name, array in whole.state().items():
        np.testing.assert_array_equal(array, again.state()[name], err_msg=name)


def test_whole_numbers_are_refused():
    with pytest.raises(ValueError, match="n: an integer has no gradient; leave it to another method"):
        GradientRace(Space((Variable("n", 0, 5, "integer"), Variable("x", 0, 1))))
