"""The separable natural evolution strategy: the paper's update, what it reaches, and exact resume."""

import math

import numpy as np
import pytest
from searching import EVERYTHING, run_up_to
from standard_functions import continuous_space, mixed_space, rosenbrock, sphere

from optim.problem import Evaluation
from optim.search import SeparableNES
from optim.search.nes import OFF, _utilities
from optim.space import Space, Variable

SEEDS = range(3)


def ellipsoid(points):
    return -np.sum((points - 1) ** 2 * 10 ** np.linspace(0, 6, points.shape[1]), axis=1)


def corner(points):
    away = points - np.array([-5.0, 5.0] * 5)
    return -np.sum(away**2 + np.abs(away) / 2, axis=1)


# Generations of 60 points to a gap of 1e-8 were at most 126, 137, 439 and 270 with these seeds.
@pytest.mark.long
@pytest.mark.parametrize(
    ("space", "judge", "generations"),
    [
        (mixed_space(10), sphere, 160),
        (mixed_space(10), lambda p: rosenbrock(p, curvature=1.0), 180),
        (continuous_space(20), ellipsoid, 550),
        (continuous_space(10), corner, 340),
    ],
    ids=["mixed sphere", "mixed valley", "ellipsoid", "corner"],
)
@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("seed", SEEDS)
def test_converges(space, judge, generations, mirrored, seed):
    method = run_up_to(SeparableNES(space, seed=seed, mirrored=mirrored), judge, generations, target=-1e-8)
    assert method.result().score > -1e-8
    assert 0 < method.result().numbers["sigma"] < 0.1


@pytest.mark.long
@pytest.mark.parametrize("seed", SEEDS)
def test_a_narrow_valley_is_entered_though_not_followed_to_its_end(seed):
    method = run_up_to(SeparableNES(continuous_space(10), seed=seed), rosenbrock, 1500)
    assert -3 < method.result().score < -1e-3  # its axes are not those of the coordinates


@pytest.mark.parametrize("seed", SEEDS)
def test_angles_wrap_round_and_all_kinds_go_together(seed):
    def judge(points):
        x, a, n, b = points.T
        return np.cos(np.radians(a - 175)) - (x - 1.3 * b) ** 2 - (n - 2 * b) ** 2 / 4 + b

    result = run_up_to(SeparableNES(EVERYTHING, population=20, seed=seed), judge, 120).result()
    assert result.score > 2 - 1e-4 and result.point == pytest.approx([1.3, 175, 2, 1], abs=1.0)


def test_an_update_is_that_of_the_paper():
    space = continuous_space(3)
    method = SeparableNES(space, population=6, seed=4, sigma=0.05)
    points = method.ask()
    deviates = ((points - space.low) / space.span - 0.5) / 0.05
    assert np.abs(deviates).max() < 6  # none can have been reflected
    scores = np.array([3.0, -1.0, 7.0, 2.0, 0.0, 5.0])
    method.tell(points, Evaluation(scores))
    order = np.argsort(-scores)
    raw = [max(0.0, math.log(6 / 2 + 1) - math.log(k)) for k in range(1, 7)]
    utilities = np.array(raw) / sum(raw) - 1 / 6
    gradient = utilities @ deviates[order]
    curvature = utilities @ (deviates[order] ** 2 - 1)
    rate = (3 + math.log(3)) / (5 * math.sqrt(3))
    assert method.mean == pytest.approx(0.5 + 0.05 * gradient, abs=1e-12)
    assert method.deviation == pytest.approx(0.05 * np.exp(rate / 2 * curvature), abs=1e-12)


def test_equal_scores_share_their_utilities():
    plain = _utilities(np.array([4.0, 3.0, 2.0, 1.0]))
    shared = _utilities(np.array([2.0, -np.inf, 2.0, -np.inf]))
    assert shared == pytest.approx([plain[:2].mean(), plain[2:].mean()] * 2)
    assert plain.sum() == pytest.approx(0, abs=1e-15) and (np.diff(plain) <= 0).all()
    assert _utilities(np.full(5, -np.inf)) == pytest.approx(np.zeros(5), abs=1e-15)


def test_mirrored_points_lie_opposite():
    method = SeparableNES(continuous_space(4), population=7, sigma=0.05, mirrored=True)
    points = method.ask()
    assert points.shape == (7, 4) and np.abs(points[0:6:2] + points[1:6:2]).max() < 1e-12
    assert np.ptp(points[0::2], axis=0).min() > 0


def test_reflecting_the_mean_changes_no_probability():
    space = Space((Variable("x", 0.0, 1.0), Variable("a", 0.0, 360.0, "angle")))
    inside, outside = (SeparableNES(space, population=20_000, sigma=0.2, seed=seed) for seed in (1, 2))
    inside.mean, outside.mean = np.array([0.1, 0.9]), np.array([-0.1, -0.1])
    quantiles = np.linspace(0.05, 0.95, 10)
    a, b = (np.quantile(method.ask() / space.span, quantiles, axis=0) for method in (inside, outside))
    assert a == pytest.approx(b, abs=0.03)


def test_the_mean_may_begin_anywhere():
    means = np.array([SeparableNES(EVERYTHING, seed=seed, random_mean=True).mean for seed in range(400)])
    assert np.quantile(means[:, 0], [0.1, 0.5, 0.9]) == pytest.approx([0.1, 0.5, 0.9], abs=0.1)
    assert np.unique(means[:, 3]).tolist() == [0.0, 1.0]
    method = SeparableNES(EVERYTHING, start={"x": 6.0}, random_mean=True)
    assert method.mean[0] == 1.0


def test_what_lies_beyond_a_bound_may_be_drawn_between_it_and_the_mean():
    space = Space((Variable("x", 0.0, 10.0), Variable("a", 0.0, 360.0, "angle")))
    settings = {"population": 4000, "sigma": 0.2, "start": {"x": 8.0}}
    reflected, drawn = (SeparableNES(space, **settings, bounds=bounds) for bounds in ("reflect", "random"))
    above = (0.8 + 0.2 * drawn._deviates()[:, 0]) > 1
    points, others = drawn.ask(), reflected.ask()
    assert np.array_equal(points[~above], others[~above]) and np.array_equal(points[:, 1], others[:, 1])
    assert np.quantile(points[above, 0], [0.0, 0.5, 1.0]) == pytest.approx([8.0, 9.0, 10.0], abs=0.1)
    method = SeparableNES(space, population=4, sigma=1.0, bounds="random", start={"x": 8.0}, seed=2)
    while method.generation < 40:  # the mean follows points far outside, and stays inside
        method.tell(method.ask(), Evaluation(method._deviates()[:, 0]))
        assert 0.0 <= method.mean[0] <= 1.0


def test_the_deviation_grows_to_its_limit_only():
    def edges(method):
        while method.generation < 60:
            method.tell(method.ask(), Evaluation(np.abs(method._deviates()[:, 0])))
        return method.deviation[0]

    space = continuous_space(2)
    assert edges(SeparableNES(space, population=6)) == 1.0
    assert edges(SeparableNES(space, population=6, max_sigma=0.4)) == 0.4
    assert edges(SeparableNES(space, population=6, max_sigma=1e9, bounds="random")) > 100


@pytest.mark.parametrize("count", [1, 5, 40])
def test_integers_keep_moving(count):
    space = Space(tuple(Variable(f"n{i}", -3, 3, "integer") for i in range(count)))
    method = SeparableNES(space, population=5000)
    method.deviation[:] = 0
    method.tell(method.ask(), Evaluation(np.zeros(5000)))
    moved = (method.ask() != 0).any(axis=1).mean()
    assert moved == pytest.approx(OFF, abs=0.02)


def test_a_region_of_failures_is_left():
    judge = lambda p: np.where(p[:, 0] < 0, np.nan, sphere(p))  # noqa: E731
    result = run_up_to(SeparableNES(mixed_space(6), seed=1, start={"x0": -0.5}), judge, 150).result()
    assert result.score > -1e-8 and result.point[0] > 0


def test_only_failures_teach_nothing():
    method = run_up_to(SeparableNES(EVERYTHING), lambda p: np.full(len(p), np.nan), 5)
    assert method.mean == pytest.approx(np.full(4, 0.5), abs=1e-12) and np.isnan(method.result().score)
    assert method.deviation == pytest.approx(SeparableNES(EVERYTHING).deviation, rel=1e-12)


@pytest.mark.parametrize("more", [{}, {"mirrored": True}, {"random_mean": True, "bounds": "random", "max_sigma": 9.0}])
def test_resumes_exactly_at_every_generation(more):
    settings = {"population": 7, "seed": 3, **more}
    judge = lambda p: np.where(p[:, 0] > 4, np.nan, -np.abs(p @ [1.0, 0.01, 1.0, 2.0] - 3))  # noqa: E731
    whole = SeparableNES(EVERYTHING, **settings)
    states = [whole.state()]
    for generation in range(15):
        states.append(run_up_to(whole, judge, generation + 1).state())
    for stop in range(15):
        rest = SeparableNES(EVERYTHING, **settings)
        rest.restore(states[stop])
        again = run_up_to(rest, judge, 15).state()
        assert all(np.array_equal(again[name], states[-1][name], equal_nan=True) for name in states[-1])


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"population": 3}, "population: 3 is not allowed; give a whole number, at least 4"),
        ({"sigma": 2.0}, "sigma: 2.0 is not allowed; give a number from 0.001 to 1"),
        ({"mirrored": 1}, "mirrored: 1 is not allowed; give true or false"),
        ({"random_mean": "yes"}, "random_mean: 'yes' is not allowed; give true or false"),
        ({"max_sigma": 0.1}, r"max_sigma: 0.1 is not allowed; give a number from 0.3 to 1e\+300"),
        ({"bounds": "clip"}, "bounds: 'clip' is unknown; choose one of reflect, random"),
        ({"start": {"x": 7.0}}, "x: 7 is not allowed; give a number from -2 to 6"),
    ],
)
def test_settings_without_sense_are_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        SeparableNES(EVERYTHING, **settings)
