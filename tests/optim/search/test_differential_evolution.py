"""Differential evolution: its formulas, what it keeps, and what it reaches."""

import numpy as np
import pytest
from searching import run
from standard_functions import mixed_space, rosenbrock, sphere

from optim.problem import Evaluation
from optim.search import DifferentialEvolution
from optim.search.differential_evolution import OTHERS, distinct_others
from optim.space import Space, Variable

LINE = Space(tuple(Variable(f"x{i}", -100.0, 100.0) for i in range(3)))

FORMULAS = {
    "rand/1/bin": lambda x, r, best, p, f: r[0] + f * (r[1] - r[2]),
    "rand/2/bin": lambda x, r, best, p, f: r[0] + f * (r[1] - r[2]) + f * (r[3] - r[4]),
    "best/1/bin": lambda x, r, best, p, f: best + f * (r[1] - r[2]),
    "current-to-pbest/1/bin": lambda x, r, best, p, f: x + f * (p - x) + f * (r[1] - r[2]),
}


def scores(space, judge, generations, **settings):
    return [run(DifferentialEvolution(space, seed=s, **settings), judge, generations).result().score for s in range(5)]


@pytest.mark.long
@pytest.mark.parametrize(
    ("strategy", "gap"),
    [("current-to-pbest/1/bin", 1e-8), ("best/1/bin", 1e-6), ("rand/1/bin", 1e-4), ("rand/2/bin", 0.02)],
)
def test_a_mixed_sphere_in_6000_evaluations(strategy, gap):
    assert min(scores(mixed_space(10), sphere, 100, strategy=strategy)) > -gap


@pytest.mark.long
def test_a_mixed_rosenbrock_in_24000_evaluations():
    """The worst of five is in the valley, next to a local optimum at -5.25; most cross it with rare crossover."""
    assert min(scores(mixed_space(10), rosenbrock, 400)) > -5.3
    assert np.median(scores(mixed_space(10), rosenbrock, 400, strategy="rand/1/bin", crossover=0.2)) > -0.05


def test_forty_bits_in_3000_evaluations():
    space = Space(tuple(Variable(f"b{i}", 0, 1, "binary") for i in range(40)))
    target = np.arange(40) % 3 == 0
    assert scores(space, lambda p: -np.abs(p - target).sum(axis=1), 50) == [0.0] * 5


@pytest.mark.parametrize("strategy", FORMULAS)
def test_mutants_are_those_of_the_papers(strategy):
    """By hand, from the same random numbers: the partners first, then for p-best its choice."""
    method = DifferentialEvolution(LINE, population=20, strategy=strategy)
    run(method, sphere, 3)
    x, weights = method.values, np.linspace(0.1, 0.9, 20)[:, None]
    mutants = method._mutants(np.random.default_rng(7), weights, np.arange(20))
    rng = np.random.default_rng(7)
    others = distinct_others(rng, np.arange(20), 20, OTHERS[strategy])
    order = sorted(range(20), key=lambda n: -method.objectives[n, 0])
    pbest = rng.choice(np.array(order[:2]), 20)
    for n in range(20):
        expected = FORMULAS[strategy](x[n], x[others[:, n]], x[order[0]], x[pbest[n]], weights[n])
        assert mutants[n] == pytest.approx(expected, rel=1e-12, abs=1e-12)


def test_partners_are_distinct_and_evenly_drawn():
    rng = np.random.default_rng(0)
    drawn = np.stack([distinct_others(rng, np.arange(6), 6, 5) for _ in range(4000)])
    assert all(set(drawn[i, :, n]) == set(range(6)) - {n} for i in range(50) for n in range(6))
    for place in range(5):
        shares = np.bincount(drawn[:, place, 2], minlength=6) / 4000
        assert shares[2] == 0 and np.delete(shares, 2) == pytest.approx(0.2, abs=0.03)


def test_a_trial_has_one_variable_of_its_mutant_and_others_by_chance():
    shares = []
    for crossover in (0.0, 0.5):
        method = DifferentialEvolution(LINE, population=600, crossover=crossover)
        method = run(method, sphere, 1)
        changed = (method.ask() != method.points).sum(axis=1)
        assert changed.min() == 1
        shares.append(changed.mean())
    assert shares[0] == 1 and shares[1] == pytest.approx(1 + 2 * 0.5, abs=0.1)


def test_the_weight_is_dithered_evenly():
    space = Space((Variable("x", -1e6, 1e6),))
    method = DifferentialEvolution(space, population=400, strategy="best/1/bin", weight=0.6, dither=0.2, crossover=1.0)
    run(method, lambda p: p[:, 0] * 0, 1)
    rng = method._generator()
    weights = 0.6 + 0.2 * rng.uniform(-1, 1, (400, 1))
    expected = space.reflect(method._mutants(rng, weights, np.arange(400)))
    assert np.array_equal(method.ask(), expected)
    assert weights.min() < 0.42 and weights.max() > 0.78


def test_differences_of_angles_go_the_short_way():
    space = Space((Variable("a", -180.0, 180.0, "angle"),))
    method = DifferentialEvolution(space, population=4, weight=1.0, dither=0.0, crossover=1.0, strategy="rand/1/bin")
    run(method, lambda p: p[:, 0] * 0, 1)
    method.values[:] = method.points[:] = [[170.0], [-170.0], [175.0], [-175.0]]
    for _ in range(20):
        assert (abs(method.ask()) > 130).all()  # at most 20 + 20 degrees from the cut
        method.generation += 1


def test_equals_move_on_a_plateau():
    method = run(DifferentialEvolution(mixed_space(4), population=8), lambda p: np.zeros(len(p)), 1)
    before, trials = method.points.copy(), method.ask()
    run(method, lambda p: np.zeros(len(p)), 1)
    assert np.array_equal(method.points, trials) and not np.array_equal(before, trials)


def test_a_failure_gives_way_to_any_success_and_never_replaces_one():
    method = DifferentialEvolution(mixed_space(4), population=4)
    starts = method.ask()
    method.tell(starts, Evaluation([np.nan, np.nan, 1.0, 1.0]))
    trials = method.ask()
    method.tell(trials, Evaluation([-1e9, np.nan, np.nan, 2.0]))
    assert np.array_equal(method.points, [trials[0], trials[1], starts[2], trials[3]])
    assert np.array_equal(method.result().scores, [-1e9, np.nan, 1.0, 2.0], equal_nan=True)


def test_asking_changes_nothing():
    method = run(DifferentialEvolution(mixed_space(6), population=8), sphere, 3)
    before = method.state()
    method.ask()
    assert all(np.array_equal(before[name], value) for name, value in method.state().items())


@pytest.mark.parametrize("trials", [0, 1, 3])
@pytest.mark.parametrize("strategy", FORMULAS)
def test_resumes_exactly(strategy, trials):
    def judge(points):
        return np.where(points[:, 0] > 2, np.nan, sphere(points))

    settings = {"population": 8, "strategy": strategy, "trials": trials, "bounds": "random" if trials else "reflect"}
    whole = run(DifferentialEvolution(mixed_space(6), **settings), judge, 12).state()
    state = run(DifferentialEvolution(mixed_space(6), **settings), judge, 5).state()
    rest = DifferentialEvolution(mixed_space(6), **settings)
    rest.restore(state)
    again = run(rest, judge, 7).state()
    assert all(np.array_equal(whole[name], again[name], equal_nan=True) for name in whole)


def test_without_generations_a_start_is_judged_beside_its_trials_until_one_replaces_it():
    method = DifferentialEvolution(mixed_space(4), population=4, strategy="rand/1/bin", trials=1)
    judged, scores = method.points.copy(), np.full(4, np.nan)
    for number in range(40):
        trial, *start = method.ask()
        member = int(method._targets()[0])
        assert len(start) == np.isnan(scores[member])
        score = 1.0 + number if number % 2 else -1.0
        method.tell(method.ask(), Evaluation([score, 0.5][: 1 + len(start)]))
        if number % 2:
            judged[member], scores[member] = trial, score
        assert np.array_equal(method.points, judged)
        assert np.array_equal(method.result().scores, scores, equal_nan=True)
    assert not np.isnan(scores).any()


def test_several_trials_are_those_of_different_members_drawn_evenly():
    method = DifferentialEvolution(mixed_space(4), population=6, trials=3)
    counts = np.zeros(6)
    for _ in range(600):
        members = method._targets()
        assert len(set(members.tolist())) == 3
        counts[members] += 1 / 600
        method.generation += 1
    assert counts == pytest.approx(0.5, abs=0.06)
    method = run(DifferentialEvolution(mixed_space(4), population=6, trials=6), sphere, 30)
    assert method.ask().shape == (6, 4) and method.result().score > -1.0


@pytest.mark.long
def test_a_sphere_by_one_trial_at_a_time():
    method = DifferentialEvolution(mixed_space(6), population=12, trials=1, strategy="rand/1/bin", bounds="random")
    assert run(method, sphere, 1500).result().score > -1e-3


def test_what_lies_beyond_a_bound_may_be_drawn_between_it_and_the_member():
    space = Space((Variable("x", -1.0, 1.0),))
    settings = {"population": 400, "strategy": "rand/2/bin", "weight": 2.0, "dither": 0.0, "crossover": 1.0}
    method = run(DifferentialEvolution(space, **settings, bounds="random"), lambda p: p[:, 0] * 0, 1)
    rng, everyone = method._generator(), np.arange(400)
    rng.uniform(-1, 1, (400, 1))
    mutants, members = method._mutants(rng, np.full((400, 1), 2.0), everyone)[:, 0], method.values[:, 0]
    trials, beyond = method.ask()[:, 0], abs(mutants) > 1
    assert np.array_equal(trials[~beyond], mutants[~beyond]) and beyond.mean() > 0.3
    share = (trials - members)[beyond] / (np.sign(mutants) - members)[beyond]
    assert np.quantile(share, [0.0, 0.5, 1.0]) == pytest.approx([0.0, 0.5, 1.0], abs=0.1)
    assert share.min() >= 0 and share.max() <= 1


def test_every_whole_number_starts_equally_often():
    space = Space((Variable("n", -2, 2, "integer"), Variable("b", 0, 1, "binary")))
    starts = DifferentialEvolution(space, population=10_000).ask()
    assert np.unique(starts[:, 0], return_counts=True)[1] / 10_000 == pytest.approx(0.2, abs=0.02)
    assert starts[:, 1].mean() == pytest.approx(0.5, abs=0.02)


def test_given_starts_belong_to_the_first_and_vary_around():
    space = Space((*mixed_space(4).variables, Variable("free", 0.0, 1.0)))
    start = {"x0": 2.0, "x1": -5.0, "x3": 3.0}
    points = DifferentialEvolution(space, population=2000, start=start).ask()
    assert points[0, [0, 1, 3]].tolist() == [2.0, -5.0, 3.0]
    assert points[:, 0].mean() == pytest.approx(2, abs=0.1) and points[:, 0].std() == pytest.approx(1, abs=0.1)
    assert points[:, 3].mean() == pytest.approx(3, abs=0.1) and (points[:, 1] >= -5).all()
    assert len(np.unique(points[:, 4])) == 2000


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"strategy": "rand/3/exp"}, "strategy: 'rand/3/exp' is unknown; choose one of rand/1/bin"),
        ({"population": 3, "strategy": "rand/1/bin"}, "population: 3 is not allowed; give a whole number, at least 4"),
        ({"population": 5, "strategy": "rand/2/bin"}, "population: 5 is not allowed; give a whole number, at least 6"),
        ({"weight": 2.5}, "weight: 2.5 is not allowed; give a number from 0 to 2"),
        ({"weight": 0.1}, "weight: 0.1 is not allowed with a dither of 0.3; give dither from 0 to 0.1, too"),
        ({"dither": 0.6}, "dither: 0.6 is not allowed; give a number from 0 to 0.5"),
        ({"crossover": np.nan}, "crossover: nan is not allowed"),
        ({"trials": 61}, "trials: 61 is not allowed; give a whole number, at most 60"),
        ({"bounds": "clip"}, "bounds: 'clip' is unknown; choose one of reflect, random"),
        ({"start": {"z": 1.0}}, "start: z not free to change"),
        ({"start": {"x3": 0.5}}, "x3: 0.5 is not allowed; give a whole number"),
    ],
)
def test_settings_without_sense_are_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        DifferentialEvolution(mixed_space(4), **settings)
