"""The genetic algorithm: its variation, who survives, and what it reaches."""

import numpy as np
import pytest
from searching import run
from standard_functions import mixed_space, rosenbrock, sphere

from optim.problem import Evaluation
from optim.search import GeneticSearch
from optim.space import Space, Variable

BITS = Space(tuple(Variable(f"b{i}", 0, 1, "binary") for i in range(40)))


def scores(space, judge, generations, **settings):
    return [run(GeneticSearch(space, seed=s, **settings), judge, generations).result().score for s in range(5)]


def one_family(space, parents, **settings):
    """A search of many children whose members are copies of two parents, as they were told."""
    method = GeneticSearch(space, population=2000, **settings)
    points = np.tile(np.asarray(parents, float), (1000, 1))
    method.tell(points, Evaluation(np.zeros(2000)))
    return method


@pytest.mark.long
@pytest.mark.parametrize(("settings", "gap"), [({}, 2e-3), ({"elites": 60}, 1e-6)])
def test_a_mixed_sphere_in_6000_evaluations(settings, gap):
    assert min(scores(mixed_space(10), sphere, 100, **settings)) > -gap


@pytest.mark.long
def test_a_mixed_rosenbrock_in_24000_evaluations():
    """There are local optima at -5.25 and below, where most runs end; random points are worse than -10,000."""
    found = scores(mixed_space(10), rosenbrock, 400)
    assert min(found) > -10 and np.median(found) > -7


def test_forty_bits_in_3000_evaluations():
    target = np.arange(40) % 3 == 0
    assert scores(BITS, lambda p: -np.abs(p - target).sum(axis=1), 50) == [0.0] * 5


def test_a_tournament_is_won_by_the_best_of_those_drawn():
    for tournament in (1, 2, 4):
        method = GeneticSearch(mixed_space(2), population=50, tournament=tournament)
        method.tell(method.ask(), Evaluation(np.where(np.arange(50) < 10, np.nan, np.arange(50))))
        rng = np.random.default_rng(0)
        winners = np.concatenate([method._parents(rng) for _ in range(400)])
        assert (winners == 49).mean() == pytest.approx(1 - (49 / 50) ** tournament, rel=0.1)
        assert (winners < 10).mean() == pytest.approx(0.2**tournament, rel=0.25)


def test_whole_numbers_come_from_either_parent_and_others_from_around_both():
    space = Space((Variable("x", -100, 100), Variable("n", 0, 9, "integer"), Variable("a", -180.0, 180.0, "angle")))
    method = GeneticSearch(space, population=2000)
    first, second = np.tile([2.0, 3, 170.0], (2000, 1)), np.tile([4.0, 8, -170.0], (2000, 1))
    x, n, angle = method._crossed(np.random.default_rng(0), first, second).T
    assert x.min() == pytest.approx(1, abs=0.02) and x.max() == pytest.approx(5, abs=0.02)  # BLX-0.5
    assert x.mean() == pytest.approx(3, abs=0.1) and x.std() == pytest.approx(4 / np.sqrt(12), rel=0.05)
    assert set(n) == {3, 8} and (n == 3).mean() == pytest.approx(0.5, abs=0.05)
    assert abs(angle).min() == pytest.approx(160, abs=0.5) and (angle < 0).mean() == pytest.approx(0.5, abs=0.05)


def test_a_mutation_changes_what_it_meets_by_the_steps_of_the_space():
    space = Space(
        (
            Variable("x", -100, 100, step=2.0),
            Variable("no_step", -100, 100),
            Variable("n", -50, 50, "integer", step=0.9),
            Variable("b", 0, 1, "binary", step=0.2),
        )
    )
    parent = [0.0, 0.0, 0, 1]
    children = one_family(space, [parent, parent], mutation=1.0).ask()
    assert (children != parent).all()
    assert children[:, 0].std() == pytest.approx(2, rel=0.1) and children[:, 1].std() == pytest.approx(20, rel=0.1)
    assert (children[:, 2] > 0).mean() == pytest.approx(0.5, abs=0.05) and abs(children[:, 2]).max() <= 4
    assert (children[:, 3] == 0).all()


def test_what_is_reset_is_drawn_from_all_of_its_range():
    """Of a range of ten steps, a child is as likely to be anywhere; without resetting it stays near its parent."""
    space = Space((Variable("a", 0.0, 10.0, step=0.1), Variable("b", 0, 9, "integer", step=0.1)))
    parents = [[0.0, 0.0], [0.0, 0.0]]
    for resetting, mean in ((1.0, 5.0), (0.5, 2.5), (0.0, 0.08)):
        children = one_family(space, parents, crossover=0.0, mutation=1.0, resetting=resetting).ask()
        assert children[:, 0].mean() == pytest.approx(mean, abs=0.3)
    assert set(one_family(space, parents, crossover=0.0, mutation=1.0, resetting=1.0).ask()[:, 1]) == set(range(10))


def test_one_variable_in_d_mutates_and_clones_change_in_one():
    parent = np.zeros(40)
    flips = one_family(BITS, [parent, parent]).ask().sum(axis=1)
    assert flips.min() == 1 and flips.mean() == pytest.approx(1 + (1 - 1 / 40) ** 40, abs=0.1)
    assert (one_family(BITS, [parent, parent], mutation=0.0).ask().sum(axis=1) == 1).all()


@pytest.mark.parametrize(("elites", "kept"), [(0, []), (1, [9.0]), (2, [8.0, 9.0]), (10, list(range(10)))])
def test_elites_compete_with_the_children(elites, kept):
    method = GeneticSearch(mixed_space(4), population=10, elites=elites)
    method.tell(method.ask(), Evaluation(np.arange(10.0)))
    method.tell(method.ask(), Evaluation(-np.arange(1.0, 11.0)))
    survivors = method.result().scores
    assert sorted(survivors[survivors >= 0]) == kept and len(survivors) == 10
    assert method.result().score == 9.0


def test_equals_move_on_a_plateau():
    method = GeneticSearch(mixed_space(4), population=8, elites=8)
    run(method, lambda p: np.zeros(len(p)), 1)
    children = method.ask()
    run(method, lambda p: np.zeros(len(p)), 1)
    assert np.array_equal(method.points, children)


def test_a_failure_gives_way_to_any_success_and_never_replaces_one():
    method = GeneticSearch(mixed_space(4), population=4, elites=4)
    starts = method.ask()
    method.tell(starts, Evaluation([np.nan, 1.0, np.nan, np.nan]))
    children = method.ask()
    method.tell(children, Evaluation([np.nan, -1e9, np.nan, np.nan]))
    assert np.array_equal(method.points[:2], [starts[1], children[1]])
    assert np.array_equal(method.result().scores[:2], [1.0, -1e9]) and np.isnan(method.result().scores[2:]).all()


def test_asking_changes_nothing_and_a_resume_is_exact():
    def judge(points):
        return np.where(points[:, 0] > 2, np.nan, sphere(points))

    whole = run(GeneticSearch(mixed_space(6), population=8), judge, 12).state()
    part = run(GeneticSearch(mixed_space(6), population=8), judge, 5)
    before = part.state()
    part.ask()
    assert all(np.array_equal(before[name], value, equal_nan=True) for name, value in part.state().items())
    rest = GeneticSearch(mixed_space(6), population=8)
    rest.restore(before)
    again = run(rest, judge, 7).state()
    assert all(np.array_equal(whole[name], again[name], equal_nan=True) for name in whole)


def test_given_starts_belong_to_the_first_and_vary_around():
    points = GeneticSearch(mixed_space(4), population=1000, start={"x0": 2.0, "x3": 3.0}).ask()
    assert points[0, [0, 3]].tolist() == [2.0, 3.0]
    assert points[:, 0].std() == pytest.approx(1, abs=0.1) and points[:, 3].mean() == pytest.approx(3, abs=0.1)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"population": 1}, "population: 1 is not allowed; give a whole number, at least 2"),
        ({"tournament": 0}, "tournament: 0 is not allowed; give a whole number, at least 1"),
        ({"crossover": 1.5}, "crossover: 1.5 is not allowed; give a number from 0 to 1"),
        ({"mutation": -0.1}, "mutation: -0.1 is not allowed; give a number from 0 to 1"),
        ({"elites": -1}, "elites: -1 is not allowed; give a whole number, at least 0"),
        ({"start": {"x3": 0.5}}, "x3: 0.5 is not allowed; give a whole number"),
    ],
)
def test_settings_without_sense_are_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        GeneticSearch(mixed_space(4), **settings)


def test_the_best_of_many_starts_are_the_population():
    """The same random points come first, however many there are; of equals the first stay."""
    space = Space((Variable("x", -1, 1), Variable("y", -1, 1)))
    many = GeneticSearch(space, population=4, starts=50, seed=3)
    points = many.ask()
    assert len(points) == 50
    many.tell(points, Evaluation(-(points**2).sum(axis=1)))
    order = np.argsort((points**2).sum(axis=1))[:4]
    np.testing.assert_array_equal(many.points, points[np.sort(order)])
    assert len(many.ask()) == 4
    again = GeneticSearch(space, population=4, starts=50, seed=3)
    again.restore(many.state())
    np.testing.assert_array_equal(again.ask(), many.ask())
    with pytest.raises(ValueError, match=r"^starts: 3 is not allowed"):
        GeneticSearch(space, population=4, starts=3)
