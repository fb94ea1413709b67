from functools import cache

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
)
from hypothesis import given
from hypothesis import strategies as st
from searching import run

from optim.measures.pareto import non_dominated
from optim.problem import Evaluation
from optim.search import Borg
from optim.search.borg_operators import (
    OPERATORS,
    OperatorParameters,
    breed,
    differential_evolution,
    parent_centric,
    polynomial_mutation,
    simplex,
    simulated_binary,
    uniform_mutation,
    unimodal_normal,
)
from optim.search.epsilon_archive import EpsilonArchive
from optim.space import Space, Variable

EPSILONS = {"zdt1": 0.01, "dtlz2": 0.05}
MANY = 20_000
PARENTS = np.array([[0.5, 0.2, 0.3], [0.7, 0.4, 0.5], [0.3, 0.6, 0.4], [0.6, 0.5, 0.7]])
offers = st.lists(st.tuples(st.floats(-2, 2), st.floats(-2, 2)), max_size=25)


def matings(parents, count=MANY):
    """The same parents, shape (P, D), for many children."""
    return np.repeat(np.asarray(parents, float)[:, None], count, axis=1)


def archived(objectives, epsilons=(0.5, 0.25)):
    archive, steps = EpsilonArchive.empty(np.array(epsilons), 1), []
    for i, values in enumerate(objectives):
        archive, progressed = archive.with_point(np.array([float(i)]), np.array(values), i)
        steps.append(progressed)
    return archive, steps


@cache
def finished(name, seed):
    space, judge = problem(name)
    return run(Borg(space, population=POPULATION, seed=seed, epsilons=EPSILONS[name]), judge, GENERATIONS)


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("name", ["zdt1", "dtlz2"])
def test_fronts_are_as_good_as_those_of_pymoo(name):
    ours = [volume(name, finished(name, seed).result().objectives) for seed in SEEDS]
    assert np.mean(ours) > 0.98 * VOLUME_OF_PYMOO[name]


@pytest.mark.long
def test_a_search_restarts_and_prefers_operators_that_prove_themselves():
    method = finished("zdt1", 1)
    numbers = method.result().numbers
    assert numbers["restarts"] >= 2 and numbers["front"] == len(method.archive.points)
    shares = method.probabilities()
    counts = np.array([(method.archive.labels == k).sum() for k in range(6)])
    assert np.allclose(shares, (counts + 1) / (counts.sum() + 6)) and shares.sum() == pytest.approx(1)
    assert shares.max() > 0.3 and shares.min() > 0
    assert {name: numbers[name] for name in OPERATORS} == dict(zip(OPERATORS, shares, strict=True))


def test_it_continues_exactly_from_any_generation_and_across_restarts():
    def build():
        return Borg(MIXED, population=12, seed=3, epsilons=[0.2, 0.1], window=30)

    method, restarts, states = build(), [], []
    for _ in range(30):
        states.append(method.state())
        restarts.append((int(method.restarts), int(method.missing)))
        run(method, mixed, 1)
    assert restarts[-1][0] >= 2 and any(missing for _, missing in restarts)
    halfway = next(i for i, (_, missing) in enumerate(restarts) if missing)  # mutants are yet to be asked for
    for stop in {0, 1, 2, 15, 29, halfway - 1, halfway, halfway + 1}:
        rest = build()
        rest.restore(states[stop])
        assert same(run(rest, mixed, 30 - stop), method)


def test_children_can_be_bred_one_at_a_time_and_resume_exactly():
    judge = lambda points: Evaluation(np.stack([-points[:, 0], points[:, 0] - points[:, 1]], axis=1))  # noqa: E731
    space = Space((Variable("x", -1, 1), Variable("y", -1, 1)))
    method = Borg(space, population=8, children=1, epsilons=0.1)
    sizes = []
    for _ in range(30):
        points = method.ask()
        sizes.append(len(points))
        method.tell(points, judge(points))
        again = Borg(space, population=8, children=1, epsilons=0.1)
        again.restore(method.state())
        assert np.array_equal(again.ask(), method.ask())
    assert sizes == [8] + [1] * 29
    assert len(method.members) == 8 and len(method.result().points) > 1


def test_a_restart_begins_with_the_archive_and_mutants_of_it():
    space = Space(tuple(Variable(f"x{i}", 0.0, 1.0) for i in range(5)))
    method = Borg(space, population=8, seed=1, window=8, epsilons=0.5)
    run(method, lambda points: np.stack([points[:, 0], 1 - points[:, 0]], axis=1), 1)
    while not method.restarts:  # boxes run out soon
        run(method, lambda points: np.stack([points[:, 0], 1 - points[:, 0]], axis=1), 1)
    count = len(method.archive.points)
    assert np.array_equal(method.members, method.archive.points)
    assert method.size == max(8, 4 * count) and method.missing == method.size - count
    mutants = method.ask()[: int(min(method.missing, 8))]
    changed = (mutants[:, None] != method.archive.points).sum(axis=2).min(axis=1)
    assert (changed >= 1).all() and changed.mean() < 4
    while method.missing:
        run(method, lambda points: np.stack([points[:, 0], 1 - points[:, 0]], axis=1), 1)
    assert len(method.members) == method.size


def test_the_population_grows_with_the_archive():
    def judge(points):
        return np.stack([points[:, 0], 1 - points[:, 0] ** 2 - points[:, 1]], axis=1)

    method = run(
        Borg(Space((Variable("x", 0.0, 1.0), Variable("y", 0.0, 1.0))), population=10, epsilons=0.02), judge, 60
    )
    while method.missing or not method.restarts:
        run(method, judge, 1)
    assert len(method.members) == method.size > 60
    assert abs(method.size - 4 * len(method.archive.points)) <= 0.25 * method.size


def test_the_result_is_a_front_of_successes():
    method = run(Borg(MIXED, population=30, seed=2, epsilons=0.05), mixed, 40)
    result = method.result()
    assert result.kind == "front" and non_dominated(result.objectives).all()
    assert np.array_equal(mixed(result.points), result.objectives)
    assert mixed(result.point[None]).mean() == result.score >= result.scores.max()
    assert np.ptp(result.points[:, 2]) >= 4 and (result.points[:, 3] == 1).all()


def test_binaries_and_integers_are_searched():
    space, judge, best = count_of_ones()
    assert run(Borg(space, population=20, seed=1), judge, 100).result().score == best


def test_a_child_replaces_whom_it_dominates_or_anyone_but_never_its_betters():
    def joined(objectives):
        method = Borg(Space((Variable("x", 0.0, 1.0),)), population=3)
        method._begin(2)
        method.members = np.zeros((3, 1))
        method.member_objectives = np.array([[1.0, 4.0], [2.0, 2.0], [4.0, 1.0]])
        method._join(np.ones(1), np.array(objectives), np.random.default_rng(0))
        return method.members[:, 0].tolist()

    assert joined([3.0, 3.0]) == [0, 1, 0] and joined([1.0, 1.0]) == [0, 0, 0]
    assert sorted(joined([0.5, 5.0])) == [0, 0, 1]


def test_tournaments_keep_the_dominated_from_breeding():
    method = Borg(Space((Variable("x", 0.0, 1.0),)), population=2, seed=1)
    method.tell(method.ask(), Evaluation([[1.0, 1.0], [0.0, 0.0]]))
    parents = method._parents(3, 4000, np.random.default_rng(0))
    assert (parents[0] == method.archive.points[0]).all()
    losers = (parents[1:] == method.members[1]).mean()
    assert losers == pytest.approx(0.25, abs=0.02)  # only where it met itself


def test_settings_without_sense_are_refused():
    for settings, message in (
        ({"epsilons": 0.0}, "epsilons: 0.0 is not allowed; give a number from 1e-12"),
        ({"children": 0}, "children: 0 is not allowed; give a whole number, at least 1"),
        ({"epsilons": [0.1, "a"]}, "epsilons: 'a' is not allowed"),
        ({"epsilons": ""}, "epsilons: '' is not allowed"),
        ({"window": 0}, "window: 0 is not allowed; give a whole number, at least 1"),
        ({"operators": {"sbx": 1}}, "operators: 'sbx' is unknown; its parameters are parents, sbx_index"),
        ({"operators": {"de_rate": 2}}, "de_rate: 2 is not allowed; give a number from 0 to 1"),
        ({"operators": {"parents": 2}}, "parents: 2 is not allowed; give a whole number, at least 3"),
    ):
        with pytest.raises(ValueError, match=message):
            Borg(MIXED, **settings)
    method = Borg(MIXED, epsilons=[0.1, 0.1, 0.1])
    with pytest.raises(ValueError, match="epsilons: 3 given for 2 objectives; give one, or one for each"):
        run(method, mixed, 1)
    assert Borg(MIXED, operators={"pcx_eta": 0.2}).parameters == OperatorParameters(pcx_eta=0.2)


@given(offers)
def test_no_member_of_the_archive_is_in_or_below_the_box_of_another(objectives):
    archive, _ = archived(objectives)
    boxes = np.ceil(archive.objectives / archive.epsilons)
    assert len(np.unique(boxes, axis=0)) == len(boxes) and non_dominated(boxes).all()
    assert non_dominated(archive.objectives).all()
    for offered in objectives:  # everything offered is in or below the box of a member
        assert not objectives or (boxes >= np.ceil(np.array(offered) / archive.epsilons)).all(axis=1).any()
    assert np.array_equal(archive.points[:, 0], archive.labels)
    assert np.array_equal(archive.objectives, np.array(objectives).reshape(-1, 2)[archive.labels])


@given(offers, st.randoms(use_true_random=False))
def test_the_archive_does_not_depend_on_the_order_of_offers(objectives, random):
    shuffled = random.sample(objectives, len(objectives))
    (ours, _), (theirs, _) = archived(objectives), archived(shuffled)
    nearness = [
        sorted(map(tuple, np.column_stack([boxes, ((boxes - a.objectives / a.epsilons) ** 2).sum(axis=1)]).tolist()))
        for a in (ours, theirs)
        for boxes in [np.ceil(a.objectives / a.epsilons)]
    ]
    assert nearness[0] == nearness[1]


def test_progress_is_a_box_that_held_no_point():
    archive, steps = archived([(0.1, 0.1), (0.2, 0.1), (0.15, 0.1), (0.6, 0.1), (0.1, 0.3), (0.1, 0.1), (0.9, 0.9)])
    assert steps == [True, False, False, True, True, False, True]
    assert archive.labels.tolist() == [6]
    assert archived([(0.6, 0.1), (0.1, 0.3)])[0].labels.tolist() == [0, 1]
    assert archived([(0.0, 0.0), (0.1, 0.1)])[1] == [True, True]  # a corner belongs to the box below it


def test_simulated_binary_children_lie_about_their_parents():
    parents = [[0.2, 0.4, 0.5], [0.6, 0.4, 0.3]]
    children = simulated_binary(matings(parents), 15.0, np.random.default_rng(0))
    assert children.mean(axis=0) == pytest.approx([0.3, 0.4, 0.45], abs=0.003)  # a quarter of the values cross over
    assert (children[:, 1] == 0.4).all()
    kept = (children[:, 0] == 0.2).mean()
    assert kept == pytest.approx(0.5, abs=0.02)
    changed = children[children[:, 0] != 0.2, 0]
    spread = abs(changed - 0.4) / 0.2  # beta: half of it below 1, by a density symmetric in 1 / beta
    assert (spread < 1).mean() == pytest.approx(0.5, abs=0.02)
    assert (spread < 0.5 ** (1 / 16)).mean() == pytest.approx(0.25, abs=0.02)


def test_differential_children_are_the_target_or_the_donor():
    parents = [[0.1, 0.2, 0.3], [0.5, 0.5, 0.5], [0.8, 0.6, 0.4], [0.4, 0.4, 0.6]]
    children = differential_evolution(matings(parents), 0.1, 0.5, np.random.default_rng(0))
    donor = np.array([0.7, 0.6, 0.4])
    crossed = np.isclose(children, donor)
    assert (crossed | (children == parents[0])).all() and crossed.any(axis=1).all()
    assert crossed.mean() == pytest.approx(1 / 3 + 2 / 3 * 0.1, abs=0.01)


def test_parent_centric_children_have_the_centroid_of_the_parents():
    children = parent_centric(matings(PARENTS), 0.1, 0.1, np.random.default_rng(0))
    assert children.mean(axis=0) == pytest.approx(PARENTS.mean(axis=0), abs=0.004)
    nearest = np.linalg.norm(children[:, None] - PARENTS, axis=2).argmin(axis=1)
    assert np.bincount(nearest) / MANY == pytest.approx(0.25, abs=0.02)


def test_parent_centric_deviates_have_the_spread_of_the_parents():
    parents = [[0.5, 0.3], [0.5, 0.7], [0.2, 0.5], [0.8, 0.5]]  # a cross
    children = parent_centric(matings(parents), 0.1, 0.2, np.random.default_rng(0))
    mine = children[np.linalg.norm(children[:, None] - parents, axis=2).argmin(axis=1) == 3]
    assert mine.mean(axis=0) == pytest.approx([0.8, 0.5], abs=0.003)
    assert mine.std(axis=0) == pytest.approx([0.1 * 0.3, 0.2 * (0.2 + 0.2) / 3], rel=0.05)


def test_simplex_children_fill_the_expanded_simplex_evenly():
    corners = np.array([[0.2, 0.2], [0.6, 0.2], [0.2, 0.6]])
    children = simplex(matings(corners), 2.0, np.random.default_rng(0))
    centroid = corners.mean(axis=0)
    assert children.mean(axis=0) == pytest.approx(centroid, abs=0.005)
    weights = np.linalg.solve(np.vstack([corners.T, np.ones(3)]), np.vstack([children.T, np.ones(MANY)])).T
    weights = 1 / 3 + (weights - 1 / 3) / 2  # in the expanded simplex
    assert (weights > -1e-9).all()
    for k in range(3):  # uniform: a corner's weight exceeds w with probability (1 - w)^2
        assert (weights[:, k] > 0.5).mean() == pytest.approx(0.25, abs=0.01)


def test_unimodal_children_have_the_centroid_of_all_but_the_last_parent():
    children = unimodal_normal(matings(PARENTS), 0.5, 0.35, np.random.default_rng(0))
    assert children.mean(axis=0) == pytest.approx(PARENTS[:-1].mean(axis=0), abs=0.004)


def test_unimodal_deviates_lie_along_and_across_the_parents():
    parents = [[0.4, 0.5, 0.5], [0.6, 0.5, 0.5], [0.5, 0.8, 0.5]]
    children = unimodal_normal(matings(parents), 0.5, 0.35, np.random.default_rng(0))
    along = 0.5 * 0.1 * np.sqrt(2)  # two vectors of length 0.1
    across = 0.35 / np.sqrt(3) * 0.3
    assert children.std(axis=0) == pytest.approx([along, across, across], rel=0.02)
    flat = unimodal_normal(matings([*parents[:2], [0.9, 0.5, 0.5]]), 0.5, 0.35, np.random.default_rng(0))
    assert np.allclose(flat[:, 1:], 0.5, atol=1e-12)  # the last parent is on the line of the others


def test_parents_that_are_one_point_have_children_there():
    parents = matings(np.full((10, 3), 0.25), 50)
    rng = np.random.default_rng(0)
    for children in (parent_centric(parents, 0.1, 0.1, rng), unimodal_normal(parents, 0.5, 0.35, rng)):
        assert np.allclose(children, 0.25, atol=1e-12)
    assert np.allclose(simplex(parents, 3.0, rng), 0.25, atol=1e-12)


def test_polynomial_mutation_changes_one_variable_on_average_and_stays_inside():
    points = np.tile([0.0, 0.3, 0.5, 1.0], (MANY, 1))
    mutants = polynomial_mutation(points, 20.0, np.random.default_rng(0))
    assert ((mutants >= 0) & (mutants <= 1)).all()
    changed = mutants != points
    assert changed.mean(axis=0) == pytest.approx([0.125, 0.25, 0.25, 0.125], abs=0.01)  # at bounds half stays
    moves = (mutants - points)[changed[:, 2], 2]
    assert moves.mean() == pytest.approx(0, abs=0.005) and np.median(abs(moves)) == pytest.approx(
        1 - 0.5 ** (1 / 21), rel=0.1
    )


def test_uniform_mutation_changes_at_least_one_variable():
    points = np.tile([0.5, 90.0, 4.0, 1.0], (MANY, 1))
    mutants = uniform_mutation(MIXED, points, np.random.default_rng(0))
    drawn = (mutants != points)[:, :2]
    assert drawn.mean() == pytest.approx(0.25 + 0.75 * 0.25, abs=0.01)
    assert np.bincount(mutants[mutants[:, 2] != 4, 2].astype(int))[[0, 8]].min() > 0.03 * MANY * 0.4


@pytest.mark.parametrize("operator", OPERATORS)
def test_children_are_points_of_the_space(operator):
    rng, parameters = np.random.default_rng(1), OperatorParameters()
    count = parameters.count(operator)
    parents = MIXED.sample(rng, count * 500).reshape(count, 500, MIXED.size)
    children = MIXED.validate(breed(MIXED, operator, parents, parameters, rng))
    assert children.shape == (500, 4) and (children != parents[0]).any(axis=0).all()


def test_angles_are_near_across_the_seam():
    space = Space((Variable("heading", 0.0, 360.0, "angle"),))
    parents = matings([[350.0], [10.0], [355.0], [5.0], *[[0.0]] * 6], 400)
    for operator in OPERATORS[:-1]:
        parameters = OperatorParameters(mutation_index=500.0)
        some = parents[: parameters.count(operator)]
        headings = (breed(space, operator, some, parameters, np.random.default_rng(0))[:, 0] + 180) % 360
        assert np.median(abs(headings - 180)) < 20, operator
