"""Gradient ascent: what it reaches, and what does not stop it."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from optim.problem import Evaluation
from optim.search import GradientAscent
from optim.search.step_rules import LBFGS, Adam
from optim.space import Space, Variable

RULES = ["adam", "l-bfgs"]
SQUARE = Space((Variable("x", -2, 2), Variable("y", -1, 3)))


def run(method, judge, slope, generations, failed=None):
    """Evaluate as a problem would, without sharpening."""
    for _ in range(generations):
        points = method.ask()
        (method.space if method.wants == "points" else method.relaxed).validate(points)
        scores = judge(points)
        if failed is not None:
            scores = np.where(failed(points), np.nan, scores)
        gradients = slope(points) if method.wants == "gradients" else None
        method.tell(points, Evaluation(scores, gradients=gradients))
    return method


def rosenbrock(p):
    return -((1 - p[:, 0]) ** 2) - 100 * (p[:, 1] - p[:, 0] ** 2) ** 2


def rosenbrock_slope(p):
    valley = p[:, 1] - p[:, 0] ** 2
    return np.stack([2 * (1 - p[:, 0]) + 400 * p[:, 0] * valley, -200 * valley], axis=1)


class Quadratic:
    """A concave function whose summit in the unit cube lies on some of its bounds, by construction (KKT)."""

    def __init__(self, size=10):
        rng = np.random.default_rng(1)
        factor = rng.normal(size=(size, size))
        self.curvature = factor @ factor.T + np.eye(size)
        self.space = Space(tuple(Variable(f"x{i}", 0, 1) for i in range(size)))
        self.summit = np.concatenate([[0.0, 0.0, 1.0, 1.0], rng.uniform(0.2, 0.8, size - 4)])
        self.push = np.concatenate([[-1.0, -3.0, 2.0, 1.0], np.zeros(size - 4)])  # the gradient at the summit

    def judge(self, p):
        away = p - self.summit
        return away @ self.push - np.einsum("ni,ij,nj->n", away, self.curvature, away) / 2

    def slope(self, p):
        return self.push - (p - self.summit) @ self.curvature


class Mixed:
    """A number and ten bits that interact; the optimum by trying all."""

    space = Space((Variable("x", -2, 2), *(Variable(f"b{i}", 0, 1, "binary") for i in range(10))))

    def __init__(self):
        rng = np.random.default_rng(3)
        self.pairs, self.lever = rng.normal(size=(10, 10)), rng.normal(size=10)
        self.pairs += self.pairs.T
        bits = np.array(list(itertools.product((0.0, 1.0), repeat=10)))
        everything = np.column_stack([np.clip(bits @ self.lever / 4, -2, 2), bits])
        self.best = self.judge(everything).max()

    def judge(self, p):
        x, b = p[:, 0], p[:, 1:]
        return np.einsum("ni,ij,nj->n", b, self.pairs, b) / 2 + x * (b @ self.lever) - 2 * x**2

    def slope(self, p):
        x, b = p[:, :1], p[:, 1:]
        return np.column_stack([b @ self.lever - 4 * p[:, 0], b @ self.pairs + x * self.lever])

    def evaluate(self, method, points):
        if method.wants == "points":
            return Evaluation(self.judge(self.space.validate(points)))
        steep = method.sharpness
        sharp, gain, off = points.copy(), np.ones_like(points), steep * (points[:, 1:] - 0.5)
        sharp[:, 1:] = 0.5 + np.tanh(off) / (2 * np.tanh(steep / 2))
        gain[:, 1:] = steep / (2 * np.tanh(steep / 2) * np.cosh(off) ** 2)
        gradients = self.slope(sharp) * gain if method.wants == "gradients" else None
        return Evaluation(self.judge(sharp), gradients=gradients)


@pytest.mark.parametrize(("rule", "generations", "gap"), [("l-bfgs", 40, 1e-10), ("adam", 60, 0.01)])
def test_a_summit_at_the_bounds(rule, generations, gap):
    problem = Quadratic()
    method = run(GradientAscent(problem.space, climbers=4, rule=rule), problem.judge, problem.slope, generations)
    assert method.result().scores.min() > -gap and method.result().score <= 1e-12
    assert np.abs(method.result().point - problem.summit).max() < np.sqrt(gap)


@pytest.mark.parametrize(("rule", "generations", "gap"), [("l-bfgs", 60, 1e-10), ("adam", 100, 0.02)])
def test_along_a_curved_valley(rule, generations, gap):
    method = run(GradientAscent(SQUARE, climbers=5, rule=rule), rosenbrock, rosenbrock_slope, generations)
    assert method.result().score > -gap
    if rule == "l-bfgs":
        assert method.result().scores.min() > -gap


@pytest.mark.parametrize("rule", RULES)
def test_angles_are_climbed_the_short_way_round(rule):
    space = Space((Variable("a", -180.0, 180.0, "angle"),))
    top = np.radians(170.0)
    judge = lambda p: np.cos(np.radians(p[:, 0]) - top)  # noqa: E731
    slope = lambda p: -np.sin(np.radians(p) - top) * np.pi / 180  # noqa: E731
    method = GradientAscent(space, climbers=2, rule=rule, start={"a": -150.0}, learning_rate=0.02)
    assert run(method, judge, slope, 15).result().scores.min() > 0.99


@pytest.mark.parametrize("rule", RULES)
def test_bits_and_numbers_together(rule):
    problem = Mixed()
    method = GradientAscent(problem.space, climbers=10, rule=rule)
    wanted = []
    for _ in range(81):
        wanted.append((method.wants, method.sharpness))
        points = method.ask()
        method.tell(points, problem.evaluate(method, points))
    problem.space.validate(method.result().points)
    assert method.result().score > problem.best - 0.01
    assert method.result().score == pytest.approx(problem.judge(method.result().point[None])[0], abs=1e-12)
    assert [wants for wants, _ in wanted] == ["points", "gradients"] * 40 + ["points"]
    assert [sharpness for _, sharpness in wanted[1::40]] == [1.0, 2.0]


def test_sharpness_doubles_up_to_the_last():
    method = GradientAscent(Mixed.space, climbers=2, stage=1, sharpest=6.0)
    found = []
    for _ in range(10):
        found.append(method.sharpness)
        points = method.ask()
        method.tell(points, Mixed().evaluate(method, points))
    assert found[1::2] == [1.0, 2.0, 4.0, 6.0, 6.0]


def test_relaxed_points_never_win():
    method = GradientAscent(Mixed.space, climbers=3)
    for _ in range(9):
        points = method.ask()
        reward = 0.0 if method.wants == "points" else 1e6
        method.tell(points, Evaluation(np.full(3, reward), gradients=np.ones(points.shape)))
        assert method.result().score == 0.0


def test_what_moved_is_verified_if_asked():
    problem = Quadratic()
    plain, careful = (GradientAscent(problem.space, climbers=3, verify=verify) for verify in (False, True))
    run(plain, problem.judge, problem.slope, 10)
    wants = []
    for _ in range(20):
        wants.append(careful.wants)
        run(careful, problem.judge, problem.slope, 1)
    assert wants == ["points", "gradients"] * 10
    assert np.array_equal(careful.result().points, plain.result().points)


# Stairs whose steps tilt the wrong way, as friction that sticks before it slips: slopes lead away from the top.
TOP = np.linspace(0.2, 0.8, 5)
STAIRS = Space(tuple(Variable(f"x{i}", 0, 1) for i in range(5)))


def stairs(p):
    height = 10 * np.abs(p - TOP)
    return (height % 1 / 2 - np.floor(height)).sum(axis=1) / 10


def stairs_slope(p):
    return np.sign(p - TOP) / 2


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_smoothed_gradients_climb_stairs_where_exact_ones_do_not(seed):
    smoothed = GradientAscent(STAIRS, climbers=5, seed=seed, gradient="smoothed", samples=4, smoothing=0.1)
    assert smoothed.ask().shape == (40, 5) and smoothed.wants == "relaxed"
    run(smoothed, stairs, None, 60)
    exact = run(GradientAscent(STAIRS, climbers=40, seed=seed), stairs, stairs_slope, 60)  # as many evaluations
    assert smoothed.result().score > 0.15 > 0.05 > exact.result().score
    assert np.array_equal(stairs(smoothed.result().points), smoothed.result().scores)


def test_a_smoothed_gradient_is_that_of_the_mean():
    method = GradientAscent(SQUARE, climbers=1, gradient="smoothed", samples=50_000, start={"x": 0.5, "y": 1.0})
    points = method.ask()
    assert points.reshape(2, -1, 2).mean(axis=(0, 1)) == pytest.approx([0.5, 1.0], abs=1e-12)
    values, slopes = method._smoothed(points @ [3.0, -2.0] + points[:, 0] ** 2)
    assert slopes[0] == pytest.approx([4 * 4.0, 4 * -2.0], rel=0.02)  # per range of 4
    assert values[0] == pytest.approx(1.5 - 2 + 0.25 + 0.2**2, abs=1e-3)
    scores = np.where(np.arange(len(points)) % 3 == 0, np.nan, points @ [3.0, -2.0])
    assert method._smoothed(scores)[1][0] == pytest.approx([12.0, -8.0], rel=0.04)
    assert np.isnan(method._smoothed(np.full(len(points), np.nan))[1]).all()


@pytest.mark.parametrize(("rule", "gradient"), [("adam", "exact"), ("adam", "smoothed"), ("l-bfgs", "exact")])
def test_a_cliff_beside_the_summit_is_no_end(rule, gradient):
    method = GradientAscent(SQUARE, climbers=4, rule=rule, gradient=gradient, start={"x": -1.5})
    judge = lambda p: -((p[:, 0] - 1) ** 2) - p[:, 1] ** 2  # noqa: E731
    slope = lambda p: np.stack([-2 * (p[:, 0] - 1), -2 * p[:, 1]], axis=1)  # noqa: E731
    cliff = lambda p: p[:, 0] > 1.001  # noqa: E731
    result = run(method, judge, slope, 60, failed=cliff).result()
    assert (result.points[:, 0] <= 1.001).all() and np.median(result.scores) > -0.01


def test_a_failed_move_is_taken_back_half_way():
    method = GradientAscent(SQUARE, climbers=1, start={"x": 0.0, "y": 1.0}, learning_rate=0.1)
    method.tell(method.ask(), Evaluation([1.0], gradients=[[1.0, 0.0]]))
    assert method.ask() == pytest.approx(np.array([[0.4, 1.0]]))
    for there in (0.2, 0.1, 0.05):
        broken = [[np.inf, 0.0]] if there == 0.1 else [[1.0, 0.0]]  # a gradient can fail alone
        method.tell(method.ask(), Evaluation([2.0 if there == 0.1 else np.nan], gradients=broken))
        assert method.ask() == pytest.approx(np.array([[there, 1.0]]))
    method.tell(method.ask(), Evaluation([2.0], gradients=[[1.0, 0.0]]))
    assert method.ask()[0, 0] == pytest.approx(0.05 + 0.4 / 4)


def test_failed_starts_are_replaced_at_once():
    method = GradientAscent(SQUARE, climbers=3)
    first = method.ask()
    method.tell(first, Evaluation([np.nan, 0.0, np.nan], gradients=np.ones((3, 2))))
    second = method.ask()
    assert (np.abs(second - first).max(axis=1) > 0).all() and (second[1] - first[1] <= 0.21).all()
    assert np.isnan(method.result().scores).tolist() == [True, False, True]


def test_a_climber_without_progress_restarts_with_what_was_given():
    method = GradientAscent(SQUARE, climbers=2, patience=3, start={"y": 2.5}, learning_rate=1e-3)
    starts = []
    for _ in range(8):
        starts.append(method.ask())
        method.tell(starts[-1], Evaluation([1.0, 1.0], gradients=[[1.0, 0.0], [0.0, 0.0]]))
    x = np.array(starts)[:, :, 0]
    assert (np.abs(np.diff(x[:4, 0])) < 0.01).all() and abs(x[4, 0] - x[3, 0]) > 0.01  # the first value is progress
    assert len(set(x[:, 1])) == 8  # no slope, nowhere to go
    assert (np.array(starts)[:, 1, 1] == 2.5).all()


def test_climbers_start_at_the_best_of_their_candidates_again_and_again():
    method = GradientAscent(SQUARE, climbers=2, candidates=5, patience=2, learning_rate=1e-3, start={"y": 2.5})
    seen = []
    for _ in range(2):
        points = method.ask()
        assert method.wants == "relaxed" and points.shape == (10, 2) and (points[:, 1] == 2.5).all()
        scores = -abs(points[:, 0])
        scores[scores.argmax()] = np.nan
        method.tell(points, Evaluation(scores))
        best = [points[:5][np.nanargmax(scores[:5])], points[5:][np.nanargmax(scores[5:])]]
        assert method.wants == "gradients" and np.array_equal(method.ask(), best)
        assert method.result().score >= np.nanmax(scores)
        seen.append(points)
        while method.wants == "gradients":
            method.tell(method.ask(), Evaluation([-5.0, -5.0], gradients=np.ones((2, 2))))
    assert not np.isin(seen[0][:, 0], seen[1][:, 0]).any()


def test_only_climbers_that_restart_take_candidates_and_the_others_wait():
    method = GradientAscent(SQUARE, climbers=2, candidates=3)
    points = method.ask()
    method.tell(points, Evaluation(np.arange(6.0)))
    method.tell(method.ask(), Evaluation([1.0, 1.0], gradients=[[1.0, 1.0], [0.0, 0.0]]))  # a plateau below the second
    waiting = method.here[0].copy()
    starts = method.ask()
    assert starts.shape == (3, 2)
    method.tell(starts, Evaluation([np.nan, np.nan, np.nan]))
    assert np.array_equal(method.ask(), [waiting, starts[0]])


@pytest.mark.parametrize(
    "settings",
    [{"rule": "l-bfgs"}, {"rule": "adam"}, {"gradient": "smoothed", "samples": 2}, {"candidates": 4}],
)
@pytest.mark.parametrize("stop", [1, 4, 7])
def test_resumes_exactly_whatever_it_does(settings, stop):
    settings = {"climbers": 3, "stage": 2, "patience": 3, **settings}
    problem = Mixed()

    def go(method, generations):
        for _ in range(generations):
            points = method.ask()
            evaluation = problem.evaluate(method, points)
            failed = points[:, 0] > 1.5
            scores = np.where(failed, np.nan, evaluation.objectives[:, 0])
            method.tell(points, Evaluation(scores, gradients=evaluation.gradients))
        return method

    whole = go(GradientAscent(problem.space, **settings), 15).state()
    state = go(GradientAscent(problem.space, **settings), stop).state()
    rest = GradientAscent(problem.space, **settings)
    rest.restore(state)
    again = go(rest, 15 - stop).state()
    assert whole.keys() == again.keys()
    assert all(np.array_equal(whole[name], again[name], equal_nan=True) for name in whole)


@given(st.lists(st.floats(allow_nan=True, allow_infinity=True), min_size=6, max_size=6), st.sampled_from(RULES))
def test_no_number_leads_out_of_the_bounds(numbers, rule):
    method = GradientAscent(SQUARE, climbers=2, rule=rule)
    for shift in range(5):
        points = SQUARE.validate(method.ask())
        rolled = np.roll(numbers, shift)
        method.tell(points, Evaluation(rolled[:2], gradients=rolled[2:].reshape(2, 2)))
    assert np.isfinite(SQUARE.validate(method.ask())).all()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"rule": "newton"}, "rule: 'newton' is unknown; choose one of adam, l-bfgs"),
        ({"gradient": "none"}, "gradient: 'none' is unknown; choose one of exact, smoothed"),
        ({"rule": "l-bfgs", "gradient": "smoothed"}, "rule: 'l-bfgs' is not allowed with smoothed gradients"),
        ({"learning_rate": 0.0}, "learning_rate: 0.0 is not allowed; give a positive number"),
        ({"clip": np.nan}, "clip: nan is not allowed"),
        ({"smoothing": -1.0}, "smoothing: -1.0 is not allowed"),
        ({"sharpest": 0.5}, "sharpest: 0.5 is not allowed"),
        ({"samples": 0}, "samples: 0 is not allowed; give a whole number, at least 1"),
        ({"patience": 1.5}, "patience: 1.5 is not allowed"),
        ({"candidates": 0}, "candidates: 0 is not allowed; give a whole number, at least 1"),
        ({"start": {"z": 1.0}}, "start: z not free to change"),
        ({"start": {"x": 3.0}}, "x: 3 is not allowed"),
    ],
)
def test_settings_without_sense_are_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        GradientAscent(SQUARE, **settings)


def test_what_it_needs_is_said():
    with pytest.raises(ValueError, match="n: an integer has no gradient"):
        GradientAscent(Space((Variable("n", 0, 5, "integer"),)))
    method = GradientAscent(SQUARE, climbers=2)
    with pytest.raises(ValueError, match=r"evaluation: gradients of shape None are not allowed; give \(2, 2\)"):
        method.tell(method.ask(), Evaluation([1.0, 2.0]))
    with pytest.raises(ValueError, match=r"objectives of shape \(3, 1\) are not allowed; give \(2, 1\)"):
        method.tell(method.ask(), Evaluation([1.0, 2.0, 3.0]))


# the rules of steps


def test_the_first_steps_of_adam_are_those_of_the_paper():
    rule, one, free = Adam(1, 2, rate=0.1, clip=10.0), np.array([True]), np.ones((1, 2), bool)
    slopes = np.array([[[3.0, -1.0]], [[1.0, 1.0]]])
    mean, square = np.zeros(2), np.zeros(2)
    for t, slope in enumerate(slopes, 1):
        mean, square = 0.9 * mean + 0.1 * slope[0], 0.999 * square + 0.001 * slope[0] ** 2
        expected = 0.1 * (mean / (1 - 0.9**t)) / (np.sqrt(square / (1 - 0.999**t)) + 1e-8)
        assert rule.steps(one, slope, free)[0] == pytest.approx(expected)
    clipped = Adam(1, 2, rate=0.1, clip=5.0)
    clipped.steps(one, np.array([[3e9, 4e9]]), free)
    assert clipped.arrays["mean"][0] == pytest.approx([0.3, 0.4])


def test_lbfgs_knows_a_quadratic_after_as_many_steps_as_it_has_variables():
    rng = np.random.default_rng(0)
    factor = rng.normal(size=(4, 4))
    curvature = factor @ factor.T / 10 + np.eye(4)
    rule, one, free = LBFGS(1, 4, rate=0.01), np.array([True]), np.ones((1, 4), bool)
    # Conjugate pairs hold all of the curvature.
    _, axes = np.linalg.eigh(curvature)
    for axis in axes.T:
        rule.learn(one, axis[None], -(axis @ curvature)[None])
    away = np.array([[0.02, -0.01, 0.03, 0.01]])
    assert rule.steps(one, -away @ curvature, free) == pytest.approx(-away, abs=1e-12)
    rule.forget(one)
    assert rule.steps(one, np.array([[2.0, -4.0, 0.0, 0.0]]), free)[0] == pytest.approx([0.005, -0.01, 0, 0])
