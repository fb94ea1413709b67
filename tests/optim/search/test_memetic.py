"""The memetic search: what gradients bring it, and what they cannot spoil."""

import numpy as np
import pytest
from standard_functions import OPTIMUM, mixed_space, sphere

from optim.problem import Evaluation
from optim.search import DifferentialEvolution, MemeticSearch
from optim.space import Space, Variable

BITS = Space(tuple(Variable(f"b{i}", 0, 1, "binary") for i in range(40)))
GRADIENT_COST = 5  # evaluations
LINE = Space((Variable("x", -1.0, 1.0), Variable("n", -3, 3, "integer"), Variable("b", 0, 1, "binary")))


class Ellipsoid:
    """Ill-conditioned (1 to 100), with axes that are not the coordinates', two of ten variables whole."""

    space = Space(
        (*(Variable(f"x{i}", -5, 5) for i in range(8)), *(Variable(f"n{i}", -5, 5, "integer") for i in (0, 1)))
    )

    def __init__(self):
        axes = np.linalg.qr(np.random.default_rng(5).normal(size=(10, 10)))[0]
        self.curvature = axes @ np.diag(100 ** np.linspace(0, 1, 10)) @ axes.T

    def judge(self, p):
        return -np.einsum("ni,ij,nj->n", p - OPTIMUM, self.curvature, p - OPTIMUM)

    def slope(self, p):
        return np.where(np.arange(10) < 8, -2 * (p - OPTIMUM) @ self.curvature, 0.0)


class Pairs:
    """Bits that interact in pairs."""

    space = BITS

    def __init__(self):
        rng = np.random.default_rng(3)
        self.pairs, self.single = np.triu(rng.normal(size=(40, 40)), 1), rng.normal(size=40)
        self.pairs += self.pairs.T

    def judge(self, p):
        return np.einsum("ni,ij,nj->n", p, self.pairs, p) / 2 + p @ self.single

    def slope(self, p):
        return p @ self.pairs + self.single


def step(method, judge, slope):
    points = method.ask()
    wanted = method.wants == "gradients"
    (method.space.relaxed() if wanted else method.space).validate(points)
    method.tell(points, Evaluation(judge(points), gradients=slope(points) if wanted else None))
    return len(points) * (GRADIENT_COST if wanted else 1)


def run(method, judge, slope, generations):
    for _ in range(generations):
        step(method, judge, slope)
    return method


def cost(method, problem, target, limit=20_000):
    """Evaluations until a score is reached, with gradients by their cost."""
    total = 0
    while total < limit and not method.result().score > target:
        total += step(method, problem.judge, problem.slope)
    return total


def test_an_ill_conditioned_function_takes_fewer_evaluations_than_without_gradients():
    costs = [
        [cost(method(Ellipsoid.space, seed=seed), Ellipsoid(), -0.01) for seed in range(5)]
        for method in (MemeticSearch, DifferentialEvolution)
    ]
    assert max(costs[0]) < 6000 and np.median(costs[0]) < 0.75 * np.median(costs[1])


@pytest.mark.long
def test_bits_that_interact_take_fewer_evaluations_than_without_gradients():
    problem = Pairs()
    long = [DifferentialEvolution(BITS, seed=seed, population=100) for seed in range(3)]
    best = max(run(method, problem.judge, None, 200).result().score for method in long)
    costs = [
        [cost(method(BITS, seed=seed), problem, best - 1e-9) for seed in range(5)]
        for method in (MemeticSearch, DifferentialEvolution)
    ]
    assert np.median(costs[0]) < 0.6 * np.median(costs[1]) and max(costs[0]) < 20_000


@pytest.mark.long
@pytest.mark.parametrize("mislead", [lambda p: np.full(p.shape, -1.0), lambda p: np.sin(37 * p + np.arange(40))])
def test_a_misleading_gradient_only_costs_its_evaluations(mislead):
    for seed in range(5):
        method = MemeticSearch(BITS, seed=seed)
        assert run(method, lambda p: p.sum(axis=1), mislead, 80).result().score == 40


def test_every_fourth_generation_asks_for_gradients_at_the_best():
    method = MemeticSearch(mixed_space(4), population=20, refine=6)
    wanted = []
    for _ in range(8):
        wanted.append(method.wants)
        if method.wants == "gradients":
            best = method.points[np.argsort(-method.objectives[:, 0], kind="stable")[:6]]
            assert np.array_equal(method.space.round(method.ask()), best)
        step(method, sphere, lambda p: -2 * (p - OPTIMUM))
    assert wanted == ["points", "points", "points", "gradients"] * 2


def known(gradients, **settings):
    """A search of four members at known places, that has just been told the gradients of all."""
    method = MemeticSearch(LINE, population=4, every=2, refine=4, **{"learning_rate": 0.1, **settings})
    method.tell(method.ask(), Evaluation([4.0, 3.0, 2.0, 1.0]))
    method.values[:] = [[0.0, 1.2, 0.45], [0.5, -2.0, 0.9], [-0.5, 0.0, 0.0], [0.0, 0.0, 0.2]]
    method.points[:] = method.space.round(method.values)
    relaxed = method.ask()
    assert relaxed[0] == pytest.approx([0.0, 1.0, 0.45])  # whole numbers stay whole
    method.tell(relaxed, Evaluation(np.full(4, 1e9), gradients=gradients))
    return method


def test_where_gradients_lead_is_the_next_trial():
    gradients = [[2.0, 0.0, 1.0], [-1.0, 5.0, 0.0], [0.0, 0.0, -1.0], [np.nan, 0.0, 1.0]]
    method = known(gradients)
    assert method.result().score == 4.0  # relaxed points never win
    trials = method.ask()
    assert trials[0] == pytest.approx([0.2, 1.0, 1.0])  # a tenth of the range of 2; the bit from 0.45 to 0.55
    assert trials[1] == pytest.approx([1 / 3, -2.0, 1.0])  # where the slopes of the first two say that it is level
    assert np.isnan(method.refined[[2, 3]]).all()  # at a bound; without a gradient: trials as ever
    method.tell(trials, Evaluation([3.0, 3.0, np.nan, np.nan]))
    assert method.points[0] == pytest.approx([0.0, 1.0, 0.0])  # worse: the old one stays
    assert method.values[1] == pytest.approx([1 / 3, -2.0, 0.9])  # as good: moves
    assert method.scale.tolist() == [0.5, 1.0, 1.0, 1.0] and method.objectives[:, 0].tolist() == [4, 3, 2, 1]


def test_small_steps_add_up_until_a_bit_flips():
    method = known(np.zeros((4, 3)), learning_rate=0.15)
    bits, up = [], np.array([[0.0, 0.0, 1.0]])
    for _ in range(4):
        step(method, lambda p: np.array([4.0, np.nan, np.nan, np.nan]), None)
        method.values[0, 2] = 0.2 if not bits else method.values[0, 2]
        step(method, lambda p: np.zeros(4), lambda p: np.repeat(up, 4, axis=0))
        bits.append(method.ask()[0, 2])
    assert bits == [0, 0, 1, 1]


def test_a_failed_gradient_or_one_beyond_all_bounds_is_no_step():
    for broken in (np.nan, np.inf, 1e200):
        method = known(np.full((4, 3), broken))
        assert np.isnan(method.refined).all() and np.isfinite(method.space.validate(method.ask())).all()


def test_failures_on_half_of_the_space_do_not_stop_it():
    def judge(points):
        return np.where(points[:, 0] < 0.99, np.nan, sphere(points))

    for seed in range(3):
        method = run(MemeticSearch(mixed_space(6), seed=seed), judge, lambda p: -2 * (p - OPTIMUM), 80)
        assert method.result().score > -1e-4 and method.result().point[0] >= 0.99


@pytest.mark.parametrize("stop", [1, 3, 4, 6])
def test_resumes_exactly_before_and_after_gradients(stop):
    problem, settings = Pairs(), {"population": 8, "every": 3, "refine": 4}
    whole = run(MemeticSearch(BITS, **settings), problem.judge, problem.slope, 13).state()
    part = run(MemeticSearch(BITS, **settings), problem.judge, problem.slope, stop)
    before = part.state()
    part.ask()
    assert all(np.array_equal(before[name], value, equal_nan=True) for name, value in part.state().items())
    rest = MemeticSearch(BITS, **settings)
    rest.restore(before)
    again = run(rest, problem.judge, problem.slope, 13 - stop).state()
    assert whole.keys() == again.keys()
    assert all(np.array_equal(whole[name], again[name], equal_nan=True) for name in whole)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"every": 1}, "every: 1 is not allowed; give a whole number, at least 2"),
        ({"refine": 0}, "refine: 0 is not allowed; give a whole number, at least 1"),
        ({"learning_rate": 0.0}, "learning_rate: 0.0 is not allowed; give a number from 1e-06 to 1"),
        ({"population": 3}, "population: 3 is not allowed; give a whole number, at least 4"),
    ],
)
def test_settings_without_sense_are_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        MemeticSearch(LINE, **settings)


def test_gradients_that_are_missing_are_missed():
    method = MemeticSearch(LINE, population=4, every=2, refine=2)
    method.tell(method.ask(), Evaluation(np.zeros(4)))
    with pytest.raises(ValueError, match=r"evaluation: gradients of shape None are not allowed; give \(2, 3\)"):
        method.tell(method.ask(), Evaluation(np.zeros(2)))
    with pytest.raises(ValueError, match=r"objectives of shape \(4, 1\) are not allowed; give \(2, 1\)"):
        method.tell(method.ask(), Evaluation(np.zeros(4), gradients=np.zeros((4, 3))))
