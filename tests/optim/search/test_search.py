import json
from inspect import signature

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from optim.problem import Evaluation
from optim.search import METHODS, HillClimb, RandomSearch, build_method, default_settings, has_independent_climbers
from optim.space import Space, Variable

SPACE = Space(
    (
        Variable("x", -5.0, 5.0, step=0.5),
        Variable("y", 0.0, 90.0, step=9.0),
        Variable("n", 0, 8, "integer", step=0.9),
    )
)
RELAXABLE = Space((*SPACE.variables[:2], Variable("n", 0, 1, "binary")))
SPACES = dict.fromkeys(("gradient", "race", "stochastic"), RELAXABLE)  # of the others SPACE
BEST = np.array([1.0, 30.0, 1.0])
SCALE = np.array([10.0, 90.0, 8.0])
INDEPENDENT = [n for n in METHODS if has_independent_climbers(n)]
methods = pytest.mark.parametrize("name", METHODS)
independent = pytest.mark.parametrize("name", INDEPENDENT)


def size_of(name):
    return "climbers" if "climbers" in default_settings(name) else "population"


def build(name, size=None, **settings):
    sizes = {} if size is None else {size_of(name): size}
    return build_method(name, SPACES.get(name, SPACE), {**sizes, **settings})


def sphere(points):
    return -np.sum(((points - BEST) / SCALE) ** 2, axis=1)


def run(method, generations, judge=sphere):
    for _ in range(generations):
        points = method.ask()
        assert np.array_equal(points, method.ask())
        (method.space if method.wants == "points" else method.space.relaxed()).validate(points)
        gradients = -2 * (points - BEST) / SCALE**2 if method.wants == "gradients" else None
        method.tell(points, Evaluation(judge(points), gradients=gradients))
    return method


def same(a, b):
    return all(np.array_equal(a.state()[key], b.state()[key], equal_nan=True) for key in a.state())


@pytest.mark.long
@methods
def test_converges_on_a_sphere(name):
    result = run(build(name, 20, seed=3), 151).result()
    assert result.score > -2e-3 and result.score == sphere(result.point[None])[0]


@independent
def test_climbers_only_rise(name):
    method = build(name, 20, seed=3)
    start = run(method, 1).result().scores
    result = run(method, 150).result()
    assert (result.scores >= start).all() and np.median(result.scores) > -0.02
    assert np.array_equal(sphere(result.points), result.scores) and result.score == result.scores.max()


@methods
def test_continues_exactly_from_its_state(name):
    whole = run(build(name, 8, seed=8), 20)
    for stop in (1, 9):
        rest = build(name, 8, seed=8)
        rest.restore(run(build(name, 8, seed=8), stop).state())
        assert same(run(rest, 20 - stop), whole)
        assert rest.result().score == whole.result().score


@pytest.mark.long
@methods
def test_failures_never_win(name):
    def judge(points):  # everything on the left has failed
        return np.where(points[:, 0] < 0, np.nan, sphere(points))

    result = run(build(name, 20, seed=0), 61, judge).result()
    succeeded = ~np.isnan(result.scores)
    assert (result.points[succeeded, 0] >= 0).all() and result.point[0] >= 0 and result.score > -0.01


@independent
def test_climbers_whose_start_failed_begin_where_they_can(name):
    def judge(points):
        return np.where(points[:, 0] < 0, np.nan, sphere(points))

    method = run(build(name, 20, seed=0), 1, judge)
    failed = np.isnan(method.result().scores)
    succeeded = ~np.isnan(run(method, 60, judge).result().scores)
    assert failed.any() and (failed & succeeded).any() and (~failed <= succeeded).all()


@methods
def test_without_a_success_there_is_no_score(name):
    def judge(points):
        return np.full(len(points), np.nan)

    result = run(build(name, 8, seed=0), 5, judge).result()
    assert np.isnan(result.score) and np.isnan(result.scores).all()


@independent
def test_climbers_know_nothing_of_each_other(name):
    few, many = (run(build(name, n, seed=1), 10) for n in (3, 7))
    assert np.array_equal(few.result().points, many.result().points[:3])
    assert len(np.unique(many.result().points, axis=0)) == 7


@methods
def test_another_seed_is_another_search(name):
    a, b = (build(name, 8, seed=seed) for seed in (1, 2))
    assert not np.array_equal(a.ask(), b.ask())


@methods
@pytest.mark.parametrize(("setting", "value"), [("size", 0), ("size", 2.5), ("seed", -1)])
def test_settings_without_sense_are_refused(name, setting, value):
    field = size_of(name) if setting == "size" else setting
    with pytest.raises(ValueError, match=f"{field}: {value} is not allowed"):
        build(name, **{setting: value})


@methods
def test_wrong_shapes_are_refused(name):
    method = build(name, 8)
    points = method.ask()
    count = len(points)
    if not method.several_objectives:
        message = rf"objectives of shape \({count}, 2\) are not allowed; give \({count}, 1\)"
        with pytest.raises(ValueError, match=message):
            method.tell(points, Evaluation(np.zeros((count, 2))))
    with pytest.raises(ValueError, match="state: points of shape"):
        method.restore(build(name, 9).state())


def test_unknown_names_and_settings_are_listed():
    with pytest.raises(ValueError, match=r"method: 'annealing' is unknown; choose one of .*hill-climb"):
        build_method("annealing", SPACE, {})
    with pytest.raises(ValueError, match="start: method random does not take it; its settings are climbers, seed"):
        build_method("random", SPACE, {"start": {}})


def test_a_child_must_be_strictly_better():
    climb = HillClimb(SPACE, climbers=2)
    parents = climb.ask()
    climb.tell(parents, Evaluation([1.0, 1.0]))
    children = climb.ask()
    climb.tell(children, Evaluation([1.0, 1.5]))
    assert np.array_equal(climb.result().points, [parents[0], children[1]])


def test_a_failed_start_gives_way_to_any_valid_child():
    climb = HillClimb(SPACE, climbers=1)
    climb.tell(climb.ask(), Evaluation([np.nan]))
    child = climb.ask()
    climb.tell(child, Evaluation([-1e9]))
    assert np.array_equal(climb.result().point, child[0]) and climb.result().score == -1e9
    climb.tell(climb.ask(), Evaluation([np.nan]))
    assert climb.result().score == -1e9


def test_mutations_have_the_steps_of_the_variables():
    space = Space(tuple(Variable(f"x{i}", -1e3, 1e3, step=step) for i, step in enumerate((0.9, 9.0, 90.0))))
    climb = HillClimb(space, climbers=3000, start={"x0": 0.0, "x1": 0.0, "x2": 0.0})
    climb.tell(climb.ask(), Evaluation(np.zeros(3000)))
    children = climb.ask()
    assert children.std(axis=0) == pytest.approx(space.step, rel=0.05)
    assert np.abs(children.mean(axis=0)) == pytest.approx(0, abs=5) and np.abs(np.corrcoef(children.T)[0, 1]) < 0.06


def test_given_starts_are_kept_and_the_rest_is_random():
    points = HillClimb(SPACE, climbers=5, start={"y": 12.0}).ask()
    assert (points[:, 1] == 12).all() and len(np.unique(points[:, 0])) == 5
    with pytest.raises(ValueError, match="start: z not free to change; the variables are x, y, n"):
        HillClimb(SPACE, start={"z": 1.0})
    with pytest.raises(ValueError, match="y: 91 is not allowed; give a number from 0 to 90"):
        HillClimb(SPACE, start={"y": 91.0})


@pytest.mark.parametrize("name", [name for name, method in METHODS.items() if "start" in signature(method).parameters])
def test_no_search_ends_below_a_start_that_is_given_in_full(name):
    """Not even at a peak as narrow as a needle, which no other point meets."""
    start = {"x": 1.25, "y": 31.0, "n": 1}
    needle = np.array(list(start.values()))
    method = run(build(name, 6, start=start, seed=1), 4, lambda points: sphere(points) + (points == needle).all(axis=1))
    assert method.result().score > 0.9
    np.testing.assert_array_equal(method.result().point, needle)


@pytest.mark.parametrize("name", ["cma", "cma-gradient", "nes"])
def test_a_distribution_is_not_told_of_its_start(name):
    """It is judged for the record alone; what is drawn later does not depend on it."""
    start, least = {"x": 1.25, "y": 31.0, "n": 1}, {"population": 6, "seed": 1}
    drawn = []
    for score in (5.0, -5.0, np.nan):
        method = build_method(name, RELAXABLE, {**least, "start": start})
        points = method.ask()
        assert len(points) == 7 and list(points[6]) == [1.25, 31.0, 1.0]
        method.tell(points, Evaluation(np.append(sphere(points[:6]), score)))
        assert len(method.result().points) == 6 and (method.result().score == 5.0) == (score == 5.0)
        while method.wants != "points":
            method.tell(method.ask(), Evaluation([0.0], gradients=np.zeros((1, 3))))
        drawn.append(method.ask())
        assert len(drawn[-1]) == 6
    assert np.array_equal(drawn[0], drawn[1]) and np.array_equal(drawn[0], drawn[2])
    assert len(build_method(name, RELAXABLE, {**least, "start": {"x": 1.25}}).ask()) == 6


def test_a_climber_needs_steps():
    with pytest.raises(ValueError, match="step: 0 of x is not allowed"):
        HillClimb(Space((Variable("x", 0, 1),)))
    assert RandomSearch(Space((Variable("x", 0, 1),)), climbers=2).ask().shape == (2, 1)


@given(st.lists(st.floats(allow_nan=True, allow_infinity=True), min_size=1, max_size=6))
def test_an_evaluation_holds_no_number_that_did_not_succeed(objectives):
    evaluation = Evaluation(objectives, ["ok", "diverged"] * 3 if len(objectives) == 6 else ())
    assert np.array_equal(evaluation.failed, ~np.isfinite(evaluation.objectives[:, 0]))
    assert set(evaluation.status) <= {"ok", "failed", "diverged"}


@pytest.mark.parametrize("name", METHODS)
def test_every_setting_has_a_default_that_is_allowed(name):
    settings = default_settings(name)
    assert settings[size_of(name)] == {"race": 8, "stochastic": 1}.get(name, 60) and settings["seed"] == 0
    assert same(build(name, **settings), build(name))


def test_gradients_of_failures_are_none_at_all():
    evaluation = Evaluation([1.0, np.nan], gradients=np.ones((2, 3)))
    assert np.array_equal(np.isnan(evaluation.gradients[:, 0]), [False, True])
    for objectives, gradients in (([1.0, 2.0], np.ones((1, 3))), (np.ones((2, 2)), np.ones((2, 3)))):
        with pytest.raises(ValueError, match=r"gradients: shape \(\d, 3\) is not allowed; give \(points, variables\)"):
            Evaluation(objectives, gradients=gradients)


def test_an_evaluation_is_one_judgement_a_point():
    with pytest.raises(ValueError, match="status: 1 given for 2 points"):
        Evaluation([1.0, 2.0], ["ok"])
    with pytest.raises(ValueError, match="speed: 3 given for 2 points"):
        Evaluation([1.0, 2.0], details={"speed": np.zeros(3)})


SETTINGS = [(name, setting) for name in METHODS for setting in list(signature(METHODS[name]).parameters)[1:]]
WRONG = ["abc", 3, 0.5, True, None, -1.7e308, 10**30, 10**400, float("nan"), [1], ["a"], [["a"]], [None], {"a": "b"}]
WRONG += [{"x": "b"}, {"x": None}, {"x": 10**400}, {"x": [0.0, 1.0]}, {"parents": None}, {"parents": 10**9}]


@pytest.mark.parametrize(("name", "setting"), SETTINGS)
def test_a_setting_of_any_type_is_allowed_or_refused_in_one_line(name, setting):
    for value in WRONG:
        settings = {size_of(name): 8, setting: value}
        if (name, setting) == ("gradient", "samples"):
            settings["gradient"] = "smoothed"
        try:
            method = build(name, **settings)
        except ValueError as error:
            fields = (setting, "parents") if setting == "operators" else (setting,)
            assert str(error).split(": ")[0] in fields and "\n" not in str(error), error
        else:
            run(method, 4)
            json.dumps(dict(method.result().numbers), allow_nan=False)


@pytest.mark.parametrize("name", ["gradient", "lamarckian", "memetic", "cma-gradient"])
def test_where_nothing_has_a_gradient_a_search_by_gradients_is_refused(name):
    whole = Space((Variable("n", 0, 8, "integer"), Variable("m", 0, 8, "integer")))
    with pytest.raises(ValueError, match=r"^n: an integer has no gradient"):
        build_method(name, whole, {})


def test_as_many_points_as_no_memory_holds_are_refused():
    for name in METHODS:
        with pytest.raises(ValueError, match=f"{size_of(name)}: 100000000000 is not allowed; give .* at most 100000"):
            build(name, 10**11)
    with pytest.raises(ValueError, match="samples: 5000 is not allowed; give a whole number, at most 2500"):
        build("gradient", 20, gradient="smoothed", samples=5000)


def test_a_qd_score_beyond_all_numbers_is_none():
    method = build("map-elites", 8)
    points = method.ask()
    method.tell(points, Evaluation(np.full(8, 1e308)))
    assert method.result().numbers["cells"] > 1 and method.result().numbers["qd_score"] is None


def test_sharpness_stays_a_number_however_long_a_search_is():
    method = build("gradient", 2, stage=1)
    method.generation = 5000
    assert method.sharpness == 8.0
