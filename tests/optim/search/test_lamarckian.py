"""Evolution and learning: lives by gradients, what they hand down, and what that is good for."""

import numpy as np
import pytest
from searching import CELL_GRID, PLACES

from optim.problem import Evaluation
from optim.search import GeneticSearch, LamarckianSearch
from optim.space import Space, Variable

MIXED = Space(
    (
        Variable("b", 0, 1, "binary"),
        Variable("n", 0, 9, "integer"),
        Variable("x", -1.0, 3.0),
        Variable("a", 0.0, 1.0, "angle"),
    )
)
BODIES = Space(
    (
        *(Variable(f"there{n}", 0, 1, "binary") for n in range(8)),
        *(Variable(f"tuned{n}_{m}", 0.0, 1.0) for n in range(8) for m in range(12)),
    )
)
TUNED = np.linspace(0.1, 0.9, 96)
GRADIENT_COST = 5  # evaluations


def run(method, judge, slope, generations):
    """So many generations more; asking changes nothing, and all points are true ones."""
    for _ in range(generations):
        points = method.ask()
        assert np.array_equal(points, method.ask())
        method.space.validate(points)
        assert method.wants != "gradients" or method.sharpness == np.inf
        method.tell(points, Evaluation(judge(points), gradients=slope(points) if method.wants == "gradients" else None))
    return method


def hill(points):
    return -((points[:, 2] - 1.0) ** 2) - (points[:, 1] - 4) ** 2 + points[:, 0]


def hill_slope(points):
    slopes = np.full(points.shape, 100.0)  # of whole numbers they say nothing
    slopes[:, 2], slopes[:, 3] = -2 * (points[:, 2] - 1.0), 0.0
    return slopes


def bodies(points):
    """A part is worth something only if it is well tuned, by twelve numbers; untuned it is a burden."""
    away = points[:, 8:] - TUNED
    return (points[:, :8] * (1 - (away**2).reshape(-1, 8, 12).sum(axis=2))).sum(axis=1)


def bodies_slope(points):
    there = points[:, :8]
    return np.hstack([np.zeros(there.shape), -2 * there.repeat(12, axis=1) * (points[:, 8:] - TUNED)])


def test_whole_numbers_stay_for_a_life_and_the_rest_climbs():
    method = LamarckianSearch(MIXED, population=12, learning=6, seed=2)
    born = method.ask()
    run(method, hill, hill_slope, 6)
    grown = method.ask()
    assert method.wants == "points"
    np.testing.assert_array_equal(grown[:, [0, 1, 3]], born[:, [0, 1, 3]])
    away = np.abs(born[:, 2] - 1)
    assert (np.abs(grown[:, 2] - 1) < away)[away > 0.5].all()
    run(method, hill, hill_slope, 1)
    assert method.wants == "gradients" and method.result().numbers == {"lives": 1}


def test_steps_lie_between_the_most_cautious_and_the_boldest():
    method = LamarckianSearch(MIXED, population=500, learning_rate=0.1, caution=0.1)
    born = method.ask()
    run(method, hill, hill_slope, 1)
    steps = np.abs(method.ask() - born)[:, 2] / 4
    free = steps > 0
    assert steps.max() == pytest.approx(0.1, rel=0.05) and steps[free].min() == pytest.approx(0.01, rel=0.05)


def test_a_member_is_the_best_point_of_its_life():
    scores = iter([[1.0, np.nan], [3.0, 2.0], [2.0, 5.0], [np.nan, 1.0]])
    method, met = LamarckianSearch(MIXED, population=2, learning=3, seed=1), []
    for row in scores:
        met.append(method.ask())
        method.tell(met[-1], Evaluation(row, gradients=np.ones((2, 4)) if method.wants == "gradients" else None))
    np.testing.assert_array_equal(method.points, [met[1][0], met[2][1]])
    np.testing.assert_array_equal(method.objectives[:, 0], [3.0, 5.0])
    assert method.result().score == 5.0
    np.testing.assert_array_equal(method.result().point, met[2][1])


def test_what_is_learnt_is_inherited():
    method = run(LamarckianSearch(MIXED, population=30, learning=4, mutation=0.0), hill, hill_slope, 5)
    learnt = {tuple(point[2:]) for point in method.points}
    children = method.ask()
    handed_down = [tuple(child[2:]) in learnt for child in children]
    assert np.mean(handed_down) > 0.7  # the others are clones, one variable of which mutated
    parents = {tuple(point[:2]) for point in method.points}
    assert not all(tuple(child[:2]) in parents for child in children)


def test_what_is_learnt_may_only_tell_what_a_body_is_worth():
    """Baldwin's effect: children begin with what their parents were born with; the best point is the learnt one."""
    method = LamarckianSearch(MIXED, population=30, learning=4, mutation=0.0, inherit=False)
    born = {tuple(point[2:]) for point in method.ask()}
    run(method, hill, hill_slope, 5)
    assert all(tuple(point[2:]) in born for point in method.points)
    assert tuple(method.result().point[2:]) not in born
    assert method.result().score == hill(method.result().point[None])[0] > hill(method.points).max()


def test_patches_are_crossed_with_all_that_they_have_learnt():
    method = LamarckianSearch(CELL_GRID, population=400, patches=1.0)
    first, second = np.zeros((400, CELL_GRID.size)), np.ones((400, CELL_GRID.size))
    crossed = method._crossed(np.random.default_rng(0), first, second)
    assert (crossed[:, 0] == 0).all()
    there, sizes, turns = crossed[:, 1:].reshape(400, 3, len(PLACES)).swapaxes(0, 1)
    assert (there == sizes).all() and (there == turns).all()
    assert (there.mean(axis=1) > 0).all() and there.mean() < 0.7


def test_failures_go_back_half_way_to_where_there_were_none():
    def judge(points):
        return np.where(points[:, 2] > 0.9, np.nan, hill(points))

    def slope(points):
        return np.where((points[:, 2] > 0.9)[:, None], np.nan, [[0.0, 0.0, 1.0, 0.0]])

    method = LamarckianSearch(MIXED, population=100, learning=8, learning_rate=0.2, seed=3)
    before = method.ask()
    backed = 0
    for _ in range(8):
        run(method, judge, slope, 1)
        here = method.ask()
        failed = np.isnan(judge(before))
        known = failed & ~np.isnan(method.anchor[:, 2])
        np.testing.assert_allclose(here[known, 2], (before[known, 2] + method.anchor[known, 2]) / 2)
        np.testing.assert_array_equal(here[failed & ~known], before[failed & ~known])
        backed += known.sum()
        before = here
    assert backed > 20
    found = run(method, judge, slope, 1).result()
    assert found.point[2] <= 0.9 and np.isfinite(found.score)


@pytest.mark.long
def test_bodies_that_must_learn_before_they_are_worth_anything():
    """At the same cost, a gradient counted as five evaluations, evolution alone leaves many parts out."""
    lamarckian, genetic = [], []
    for seed in range(5):
        learner = run(LamarckianSearch(BODIES, population=10, seed=seed), bodies, bodies_slope, 9 * 12)
        lamarckian.append(learner.result().score)
        cost = 12 * (8 * GRADIENT_COST + 1)
        genetic.append(run(GeneticSearch(BODIES, population=10, seed=seed), bodies, None, cost).result().score)
    assert min(lamarckian) > 7.9 > 7 > max(genetic) and np.median(genetic) < 5, (lamarckian, genetic)


@pytest.mark.parametrize("inherit", [True, False])
@pytest.mark.parametrize("stop", [1, 3, 4, 6])
def test_resumes_exactly_within_and_between_lives(stop, inherit):
    settings = {"population": 6, "learning": 3, "seed": 4, "inherit": inherit}

    def judge(points):
        return np.where(points[:, 8] > 0.8, np.nan, bodies(points))

    whole = run(LamarckianSearch(BODIES, **settings), judge, bodies_slope, 13).state()
    rest = LamarckianSearch(BODIES, **settings)
    rest.restore(run(LamarckianSearch(BODIES, **settings), judge, bodies_slope, stop).state())
    again = run(rest, judge, bodies_slope, 13 - stop).state()
    assert whole.keys() == again.keys()
    assert all(np.array_equal(whole[name], again[name], equal_nan=True) for name in whole)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"learning": 0}, "learning: 0 is not allowed; give a whole number, at least 1"),
        ({"learning_rate": 0.0}, "learning_rate: 0.0 is not allowed"),
        ({"caution": 0}, "caution: 0 is not allowed; give a number from 1e-06 to 1"),
        ({"patches": 0.5}, "patches: only allowed where variables have places"),
    ],
)
def test_settings_without_sense_are_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        LamarckianSearch(MIXED, **settings)


def test_gradients_that_are_missing_are_missed():
    method = LamarckianSearch(MIXED, population=4)
    with pytest.raises(ValueError, match=r"evaluation: gradients of shape None are not allowed; give \(4, 4\)"):
        method.tell(method.ask(), Evaluation(np.zeros(4)))
