"""Generating set search: its polls, steps and restarts, what it reaches, and exact resume."""

import itertools

import numpy as np
import pytest
from searching import EVERYTHING
from standard_functions import continuous_space, mixed_space, rosenbrock, sphere

from optim.problem import Evaluation
from optim.search import GeneratingSetSearch
from optim.search.variation import draw_inside
from optim.space import Space, Variable

PLANE = continuous_space(2)  # ranges of 10


def run(method, judge, evaluations):
    """Until at least so many evaluations; all points asked for."""
    asked = []
    while len(asked) < evaluations:
        points = method.space.validate(method.ask())
        method.tell(points, Evaluation(judge(points)))
        asked.extend(points)
    return np.array(asked)


def tell_each(method, scores):
    """One evaluation after the other; the points that got these scores."""
    points = []
    for score in scores:
        points.append(method.ask()[0])
        method.tell(method.ask(), Evaluation([score]))
    return np.array(points)


def median_score(space, judge, evaluations, **settings):
    scores = []
    for seed in range(5):
        method = GeneratingSetSearch(space, seed=seed, **{"climbers": 1, **settings})
        run(method, judge, evaluations)
        scores.append(method.result().score)
    return np.median(scores)


def corner(points):
    return -np.abs(points - np.resize([-5.0, 5.0], points.shape[1])).sum(axis=1)


def plateau(points):
    return np.zeros(len(points))


# Medians of the five seeds were -1e-12 and -7e-19, -5e-5 and -1e-2 (rotated and not), 0 and 0.
@pytest.mark.long
def test_a_sphere_in_3000_evaluations_whether_mixed_or_not():
    assert median_score(continuous_space(10), sphere, 3000) > -1e-9
    assert median_score(mixed_space(10), sphere, 3000) > -1e-15


@pytest.mark.long
def test_a_valley_is_followed_along_turning_directions():
    assert median_score(PLANE, rosenbrock, 3000, directions="rotated") > -1e-3
    assert median_score(PLANE, rosenbrock, 3000) < -1e-3  # the valley is not along an axis


@pytest.mark.long
def test_a_corner_and_forty_bits_are_reached_exactly():
    assert median_score(continuous_space(6), corner, 2000) > -1e-9
    space = Space(tuple(Variable(f"b{i}", 0, 1, "binary") for i in range(40)))
    target = np.arange(40) % 3 == 0
    assert median_score(space, lambda p: -np.abs(p - target).sum(axis=1), 200) == 0


@pytest.mark.parametrize("directions", ["axes", "rotated"])
def test_all_kinds_go_together(directions):
    def judge(points):
        x, a, n, b = points.T
        return np.cos(np.radians(a - 175)) - (x - 1.3 * b) ** 2 - (n - 2 * b) ** 2 / 4 + b

    method = GeneratingSetSearch(EVERYTHING, climbers=3, directions=directions, start={"a": -170.0})
    run(method, judge, 1500)
    result = method.result()
    assert result.score > 2 - 1e-6 and result.point == pytest.approx([1.3, 175, 2, 1], abs=0.1)


def test_a_poll_is_one_step_up_and_down_every_axis():
    method = GeneratingSetSearch(PLANE, climbers=1, step=0.1, start={"x0": 1.0, "x1": -2.0})
    points = tell_each(method, [5.0, 4.0, 4.0, 4.0, 4.0])
    assert points[0].tolist() == [1.0, -2.0]
    around = {(2.0, -2.0), (0.0, -2.0), (1.0, -1.0), (1.0, -3.0)}
    assert {tuple(point) for point in points[1:].tolist()} == around
    assert np.abs(method.ask()[0] - [1.0, -2.0]).max() == 0.5  # none was better: half the step


def test_the_first_success_ends_the_poll_and_doubles_the_step():
    method = GeneratingSetSearch(PLANE, climbers=1, step=0.1, start={"x0": 0.0, "x1": 0.0})
    points = tell_each(method, [5.0, 5.0, 6.0, 5.0])  # an equal is no success
    assert np.abs(points[3] - points[2]).sum() == pytest.approx(2.0)
    assert method.result().point.tolist() == points[2].tolist()


def test_the_step_grows_to_its_limit_only():
    method = GeneratingSetSearch(PLANE, climbers=1, step=0.1, expansion=1.5, max_step=0.2, start={"x0": 0.0, "x1": 0.0})
    tell_each(method, [1.0])
    steps = []
    for score in (2.0, 3.0, 4.0):
        tell_each(method, [score])
        steps.append(float(method.steps[0]))
    assert steps == pytest.approx([0.15, 0.2, 0.2])


def test_every_direction_comes_first_equally_often():
    method = GeneratingSetSearch(PLANE, climbers=2000, step=0.1, start={"x0": 0.0, "x1": 0.0})
    method.tell(method.ask(), Evaluation(np.zeros(2000)))
    _, counts = np.unique(method.ask(), axis=0, return_counts=True)
    assert len(counts) == 4 and counts / 2000 == pytest.approx(0.25, abs=0.03)


def test_rotated_directions_are_an_orthonormal_basis_and_its_opposite():
    space = Space((*continuous_space(3).variables, Variable("n", -5, 5, "integer")))
    start = {name: 0.0 for name in space.names}
    method = GeneratingSetSearch(space, climbers=1, polled=8, step=0.2, directions="rotated", start=start)
    tell_each(method, [0.0])
    away = method.ask() / 2.0  # a step of 0.2 ranges of 10
    assert away @ away.T == pytest.approx(np.where(np.eye(8), 1.0, away @ away.T), abs=1e-12)
    products = np.sort(away @ away.T, axis=1)
    assert products[:, 0] == pytest.approx(-1) and products[:, 1:7] == pytest.approx(np.zeros((8, 6)), abs=1e-12)
    assert np.sort(away[away[:, 3] != 0].tolist(), axis=0)[:, 3].tolist() == [-1.0, 1.0]
    assert (away[away[:, 3] == 0][:, :3] != 0).all()


def test_points_polled_at_once_are_all_judged_before_the_best_is_taken():
    settings = {"climbers": 1, "step": 0.1, "start": {"x0": 0.0, "x1": 0.0}}
    method = GeneratingSetSearch(PLANE, polled=3, **settings)
    tell_each(method, [1.0])
    sequential = GeneratingSetSearch(PLANE, **settings)
    order = tell_each(sequential, [1.0, 0.0, 0.0, 0.0, 0.0])[1:]
    assert np.array_equal(method.ask(), order[:3])
    method.tell(method.ask(), Evaluation([0.5, 0.4, 0.3]))
    assert np.array_equal(method.ask(), order[3:])
    method = GeneratingSetSearch(PLANE, polled=4, **settings)
    tell_each(method, [1.0])
    points = method.ask()
    method.tell(points, Evaluation([2.0, np.nan, 3.0, 0.0]))
    assert np.array_equal(method.centres[0], points[2]) and method.result().score == 3.0


def test_a_search_begins_anew_when_its_step_is_below_the_tolerance():
    method = GeneratingSetSearch(PLANE, climbers=1, step=0.4, tolerance=0.1, start={"x1": 3.0})
    points = run(method, plateau, 27)  # 1 start and 4 points for each of the steps 0.4, 0.2 and 0.1
    restarts = points[[0, 13, 26]]
    assert (restarts[:, 1] == 3.0).all() and len(np.unique(restarts[:, 0])) == 3
    assert np.abs(points[1:13] - points[0]).max(axis=0) == pytest.approx([4.0, 4.0], abs=2.5)
    assert np.abs(points[9:13] - points[0]).max() == pytest.approx(1.0)
    assert np.array_equal(method.result().point, points[0])  # the best is kept, the first of equals


def test_a_start_that_failed_gives_way_to_another_at_once():
    method = GeneratingSetSearch(PLANE, climbers=1)
    points = tell_each(method, [np.nan, np.nan, -7.0, np.nan])
    assert (points[0] != points[1]).all() and (points[1] != points[2]).all()
    assert (points[3] != points[2]).sum() == 1  # the third has succeeded, and is polled around
    assert method.result().score == -7.0


def test_whole_numbers_move_by_at_least_one_and_no_neighbour_is_judged_twice():
    space = Space((Variable("m", 0, 8, "integer"), Variable("n", 0, 8, "integer"), Variable("b", 0, 1, "binary")))
    method = GeneratingSetSearch(space, climbers=1, start={"m": 4, "n": 4, "b": 1})
    points = run(method, plateau, 15)  # the start, steps of 4, 2 and 1, the bit once, a restart
    assert points[0].tolist() == points[14].tolist() == [4, 4, 1]
    assert len(np.unique(points[:14], axis=0)) == 14 and [4, 4, 0] in points[1:6].tolist()
    assert {tuple(point) for point in points[10:14].tolist()} == {(3, 4, 1), (5, 4, 1), (4, 3, 1), (4, 5, 1)}


def test_while_others_contract_a_neighbour_in_whole_numbers_is_not_judged_again():
    space = Space((Variable("x", 0.0, 1.0), Variable("b", 0, 1, "binary")))
    method = GeneratingSetSearch(space, climbers=1, start={"x": 0.5, "b": 0}, tolerance=1e-3)
    points = run(method, plateau, 20)
    assert (points[:20, 1] == 1).sum() == 1


def test_what_lies_beyond_a_bound_is_drawn_between_origin_and_bound():
    space = Space((Variable("x", 0.0, 10.0), Variable("a", -180.0, 180.0, "angle")))
    origin = np.array([7.0, 170.0])
    points = np.tile([[12.0, 200.0], [-5.0, 10.0], [9.0, 0.0]], (4000, 1, 1))
    inside = draw_inside(space, points, origin, np.random.default_rng(0))
    above, below, within = np.moveaxis(inside[..., 0], 1, 0)
    assert np.quantile(above, [0.0, 0.5, 1.0]) == pytest.approx([7.0, 8.5, 10.0], abs=0.1)
    assert np.quantile(below, [0.0, 0.5, 1.0]) == pytest.approx([0.0, 3.5, 7.0], abs=0.15)
    assert (within == 9.0).all() and (inside[:, 0, 1] == -160.0).all() and (inside[:, 1, 1] == 10.0).all()


def test_steps_longer_than_a_range_stay_inside_and_are_numbers():
    method = GeneratingSetSearch(EVERYTHING, climbers=1, expansion=10.0, max_step=1e300)
    scores = itertools.count()
    points = run(method, lambda p: np.array([float(next(scores)) for _ in p]), 400)  # every point is better
    assert method.steps[0] == 1e300 and np.isfinite(points).all()
    assert np.ptp(points, axis=0) == pytest.approx(EVERYTHING.span, rel=0.3)


@pytest.mark.parametrize("settings", [{}, {"directions": "rotated"}, {"polled": 3}, {"tolerance": 0.1}])
def test_resumes_exactly_at_every_generation(settings):
    def judge(points):
        return np.where(points[:, 0] > 4, np.nan, -np.abs(points @ [1.0, 0.01, 1.0, 2.0] - 3))

    def build():
        return GeneratingSetSearch(EVERYTHING, climbers=4, seed=3, **settings)

    def generations(method, count):
        for _ in range(count):
            points = method.ask()
            method.tell(points, Evaluation(judge(points)))
        return method.state()

    whole = build()
    states = [whole.state(), *(generations(whole, 1) for _ in range(40))]
    for stop in range(0, 40, 3):
        rest = build()
        rest.restore(states[stop])
        again = generations(rest, 40 - stop)
        assert all(np.array_equal(again[name], states[-1][name], equal_nan=True) for name in states[-1])
        assert np.array_equal(rest.ask(), whole.ask())


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"directions": "simplex"}, "directions: 'simplex' is unknown; choose one of axes, rotated"),
        ({"step": 0.0}, "step: 0.0 is not allowed; give a number from 1e-12 to 1"),
        ({"expansion": 0.9}, "expansion: 0.9 is not allowed; give a number from 1 to 10"),
        ({"contraction": 1.0}, "contraction: 1.0 is not allowed; give a number from 0.01 to 0.99"),
        ({"tolerance": 0.6}, "tolerance: 0.6 is not allowed; give a number from 1e-15 to 0.5"),
        ({"max_step": 0.4}, r"max_step: 0.4 is not allowed; give a number from 0.5 to 1e\+300"),
        ({"polled": 0}, "polled: 0 is not allowed; give a whole number, at least 1"),
        ({"start": {"x": 7.0}}, "x: 7 is not allowed; give a number from -2 to 6"),
    ],
)
def test_settings_without_sense_are_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        GeneratingSetSearch(EVERYTHING, **settings)
