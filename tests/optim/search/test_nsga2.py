import re
import sys

import numpy as np
import pytest
from fronts import (
    GENERATIONS,
    MIXED,
    POPULATION,
    SEEDS,
    VOLUME_OF_PYMOO,
    count_of_ones,
    mixed,
    problem,
    same,
    volume,
    volume_of_pymoo,
)
from searching import run

from optim.measures.pareto import dominates, non_dominated
from optim.problem import Evaluation
from optim.search import NSGA2, build_method
from optim.search.unit_cube import into_cube, mutate_in_cube, out_of_cube
from optim.space import Space, Variable
from taichi_sim.base.foreign import install_extra


@pytest.mark.long
@pytest.mark.parametrize("name", ["zdt1", "dtlz2"])
def test_fronts_are_as_good_as_those_of_pymoo(name):
    space, judge = problem(name)
    found = [run(NSGA2(space, population=POPULATION, seed=seed), judge, GENERATIONS).result() for seed in SEEDS]
    ours = [volume(name, result.objectives) for result in found]
    assert np.mean(ours) > 0.98 * VOLUME_OF_PYMOO[name]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["zdt1", "dtlz2"])
def test_pymoo_reaches_what_it_is_said_to(name):
    found = np.mean([volume_of_pymoo(name, seed) for seed in SEEDS])
    assert found == pytest.approx(VOLUME_OF_PYMOO[name], abs=5e-3)


def test_it_continues_exactly_from_any_generation():
    whole = run(NSGA2(MIXED, population=14, seed=5), mixed, 25)
    for stop in (0, 1, 2, 13, 24):
        rest = NSGA2(MIXED, population=14, seed=5)
        rest.restore(run(NSGA2(MIXED, population=14, seed=5), mixed, stop).state())
        assert same(run(rest, mixed, 25 - stop), whole)


def test_the_global_generator_of_numpy_is_not_touched():
    np.random.seed(1)
    before = run(NSGA2(MIXED, population=10), mixed, 4)
    drawn = np.random.random()
    np.random.seed(1)
    assert np.random.random() == drawn
    assert same(run(NSGA2(MIXED, population=10), mixed, 4), before)


def test_the_result_is_the_front_of_the_successes():
    method = run(NSGA2(MIXED, population=30, seed=2), mixed, 40)
    result = method.result()
    assert result.kind == "front" and result.numbers == {"front": len(result.points)}
    assert non_dominated(result.objectives).all() and np.array_equal(mixed(result.points), result.objectives)
    assert not dominates(method.objectives[:, None], result.objectives).any()
    assert result.score >= result.scores.max() and mixed(result.point[None]).mean() == result.score
    assert {2.0, 6.0} <= set(result.points[:, 2]) and result.points[:, 3].mean() > 0.7  # both ends of the true front
    turned = (result.points[:, 1] + 180) % 360
    assert abs(turned - 170).max() < 45


def test_failures_survive_only_where_successes_are_too_few():
    space = Space((Variable("x", 0.0, 1.0),))
    method = NSGA2(space, population=4)
    first = method.ask()
    method.tell(first, Evaluation([[1.0, 1.0], [np.nan, np.nan], [np.nan, np.nan], [np.nan, np.nan]]))
    assert len(method.result().points) == 1
    children = method.ask()
    method.tell(children, Evaluation([[-5.0, -5.0], [np.nan, 1.0], [-6.0, 2.0], [np.nan, np.nan]]))
    assert np.array_equal(method.points[:3], [first[0], children[2], children[0]])
    assert np.isnan(method.objectives[3]).all() and np.array_equal(method.ranks[:3], [0, 0, 1])


def test_a_tournament_is_won_by_rank_then_by_room():
    method = NSGA2(Space((Variable("x", 0.0, 1.0),)), population=4)
    method.points = np.array([[0.0], [0.1], [0.2], [0.3]])
    method.ranks, method.crowding = np.array([0, 0, 1, 1]), np.array([np.inf, 0.5, np.inf, 0.1])
    wins = np.zeros(4)
    for seed in range(300):
        parents = method._parents(np.random.default_rng(seed))
        wins += (parents.reshape(-1, 1) == method.points[:, 0]).sum(axis=0)
    assert wins[3] == 0 and wins[0] > wins[1] > wins[2] > 0  # the worst has nobody to beat
    assert wins[0] == 600  # both tournaments that everyone enters


def test_binaries_and_integers_are_searched():
    space, judge, best = count_of_ones()
    assert run(NSGA2(space, population=20, seed=1), judge, 60).result().score == best


def test_copies_of_points_are_mutated():
    space = Space((Variable("b", 0, 1, "binary"), Variable("n", 0, 9, "integer")))
    method = NSGA2(space, population=10)
    method.generation, method.points = 1, np.tile([1.0, 3.0], (10, 1))
    assert (method.ask() != [1, 3]).any(axis=1).all()


def test_whole_numbers_change_by_at_least_one_when_mutated():
    space = Space((Variable("n", 0, 8, "integer"), Variable("b", 0, 1, "binary"), Variable("x", 0.0, 1.0)))
    points = np.array([[0.0, 0.0, 0.5], [8.0, 1.0, 0.5], [4.0, 1.0, 0.5], [4.0, 1.0, 0.5]])
    push = np.array([[-1e-3] * 3, [1e-3] * 3, [1e-3] * 3, [0.0] * 3])
    mutants = mutate_in_cube(space, points, lambda unit: unit + push)
    assert mutants[:, :2].tolist() == [[1, 1], [7, 0], [5, 0], [4, 1]]
    assert np.allclose(mutants[:, 2], [0.499, 0.501, 0.501, 0.5])


def test_angles_are_near_across_the_seam():
    space = Space((Variable("heading", 0.0, 360.0, "angle"), Variable("n", 0, 3, "integer")))
    points = np.array([[350.0, 0.0], [10.0, 3.0]])
    unit = into_cube(space, points, points[0])
    assert np.allclose(unit, [[0.5, 0.125], [0.5 + 20 / 360, 0.875]])
    assert np.allclose(out_of_cube(space, unit, points[0]), points)
    method = NSGA2(space, population=200, seed=0, mutation_index=500.0)
    method.generation, method.points = 1, np.tile(points, (100, 1))
    headings = (method.ask()[:, 0] + 180) % 360
    assert (abs(headings - 180) < 60).all()  # between the parents or near them, never half way round


def test_without_pymoo_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "pymoo.util", None)
    with pytest.raises(ValueError, match=re.escape(install_extra("moo"))):
        build_method("nsga2", MIXED, {})


def test_settings_without_sense_are_refused():
    with pytest.raises(ValueError, match="crossover_probability: 2 is not allowed; give a number from 0 to 1"):
        NSGA2(MIXED, crossover_probability=2)
    method = NSGA2(MIXED, population=4)
    with pytest.raises(ValueError, match="evaluation: 3 given for 4 points; give one for each"):
        method.tell(method.ask(), Evaluation(np.zeros((3, 2))))
