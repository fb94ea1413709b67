import numpy as np
import pytest
from fronts import same
from searching import run

from optim.problem import Evaluation
from optim.search import MapElites
from optim.search.method import check_fit
from optim.space import Space, Variable

SPACE = Space(
    (
        Variable("x", -1.0, 1.0, step=0.2),
        Variable("heading", 0.0, 360.0, "angle", step=30.0),
        Variable("n", 0, 8, "integer", step=1.0),
        Variable("b", 0, 1, "binary"),
    )
)
PLANE = Space(tuple(Variable(name, -1.0, 1.0) for name in "xyz"))
VARIATIONS = pytest.mark.parametrize("variation", ["gaussian", "line"])


def sphere(points):
    return 1 - (points**2).sum(axis=1)


def judge(points):
    values = -(points[:, 0] ** 2) - (points[:, 2] - 5) ** 2 + points[:, 3]
    return np.where((points[:, 1] > 90) & (points[:, 1] < 180), np.nan, values)


@VARIATIONS
def test_a_sphere_is_filled_with_good_elites(variation):
    method = run(MapElites(PLANE, population=50, seed=1, variation=variation), sphere, 100)
    result = method.result()
    assert result.kind == "elites" and result.numbers["cells"] == len(result.points) > 95
    assert result.numbers["coverage"] == len(result.points) / 100
    cells = np.floor((result.points[:, :2] + 1) * 5).astype(int) @ [10, 1]
    assert np.array_equal(cells, method.cells) and (np.diff(cells) > 0).all()
    x, y = (0.2 * (cells // 10 - 5) + 0.1, 0.2 * (cells % 10 - 5) + 0.1)
    ideal = 1 - np.maximum(abs(x) - 0.1, 0) ** 2 - np.maximum(abs(y) - 0.1, 0) ** 2
    assert (result.scores <= ideal + 1e-12).all() and np.mean(ideal - result.scores) < 0.05
    assert result.numbers["qd_score"] == pytest.approx(np.maximum(result.scores, 0).sum())
    assert np.array_equal(sphere(result.points), result.scores) and result.score == result.scores.max()


def test_a_cell_keeps_the_best_it_met_and_the_first_of_equals():
    method = MapElites(Space((Variable("x", 0.0, 1.0),)), population=6, bins=2)
    best: dict[int, tuple[float, float]] = {}
    rng = np.random.default_rng(0)
    for _ in range(20):
        points = method.ask()
        values = np.where(rng.random(6) < 0.3, np.nan, rng.integers(0, 15, 6))
        method.tell(points, Evaluation(values))
        for (x,), value in zip(points, values, strict=True):
            if value > best.get(int(x >= 0.5), (-np.inf, 0))[0]:
                best[int(x >= 0.5)] = (value, x)
        kept = np.column_stack([method.result().objectives, method.elites]).tolist()
        assert dict(zip(method.cells.tolist(), map(tuple, kept), strict=True)) == best
    assert len(best) == 2


@VARIATIONS
def test_it_continues_exactly_from_any_generation(variation):
    whole = run(MapElites(SPACE, population=9, seed=4, variation=variation), judge, 20)
    for stop in (0, 1, 7, 19):
        rest = MapElites(SPACE, population=9, seed=4, variation=variation)
        rest.restore(run(MapElites(SPACE, population=9, seed=4, variation=variation), judge, stop).state())
        assert same(run(rest, judge, 20 - stop), whole)


@VARIATIONS
def test_failures_have_no_cell(variation):
    method = run(MapElites(SPACE, population=20, seed=0, variation=variation, bins=4), judge, 60)
    result = method.result()
    assert tuple(method.axes) == ("x", "heading") and result.numbers["cells"] == 12  # a quarter of headings fails
    assert not np.isnan(result.objectives).any() and np.array_equal(judge(result.points), result.scores)
    assert result.score > 0.99 and {0.0, 1.0} == set(method.points[:, 3])


def test_without_a_success_it_draws_again():
    method = MapElites(SPACE, population=5)
    first = method.ask()
    method.tell(first, Evaluation(np.full(5, np.nan)))
    assert not (method.ask()[:, 0] == first[:, 0]).any() and len(method.result().points) == 0
    assert method.result().numbers == {"cells": 0, "coverage": 0.0, "qd_score": 0.0}


def test_descriptors_can_be_details_of_the_evaluation():
    method = MapElites(PLANE, population=4, descriptors=["height", "x"], bins=5, ranges={"height": [0, 10]})
    points = method.ask()
    points[:, 0] = [-1.0, 1.0, 0.0, 0.0]
    heights = np.array([-3.0, 10.0, 4.0, np.nan])
    method.tell(points, Evaluation([1.0, 2.0, 3.0, np.nan], details={"height": heights}))
    assert method.cells.tolist() == [0, 12, 24]  # beyond a range is its end
    method.axes = {"width": (0.0, 1.0)}
    for details, message in (
        ({}, "descriptors: width is no detail of the evaluation; it has none"),
        ({"width": np.zeros((4, 2))}, r"descriptors: width of shape \(4, 2\) is not allowed; give one number a point"),
    ):
        with pytest.raises(ValueError, match=message):
            method.tell(points, Evaluation(np.ones(4), details=details))


def test_both_ends_of_an_angle_are_one_cell():
    method = MapElites(SPACE, population=2, descriptors=["heading"], bins=8)
    points = np.array([[0.0, 0.0, 1.0, 1.0], [0.0, 360.0, 1.0, 1.0]])
    method.tell(points, Evaluation([1.0, 2.0]))
    assert method.cells.tolist() == [0] and method.elites[0, 1] == 360


def test_the_first_two_variables_that_are_not_whole_describe_a_point():
    names = ("n", "x", "b", "y", "z")
    kinds = ("integer", "continuous", "binary", "angle", "continuous")
    space = Space(tuple(Variable(n, 0, 1, kind) for n, kind in zip(names, kinds, strict=True)))
    assert tuple(MapElites(space).axes) == ("x", "y")
    assert tuple(MapElites(Space(space.variables[:2])).axes) == ("x",)


def test_children_by_lines_lie_along_two_elites():
    space = Space((Variable("x", 0.0, 100.0), Variable("y", 0.0, 100.0)))
    method = MapElites(space, population=4000, seed=1, variation="line")
    method.generation, method.elites = 1, np.array([[40.0, 50.0], [60.0, 50.0]])
    offsets = method.ask() - 50
    assert offsets[:, 1].std() == pytest.approx(1, rel=0.05)  # a hundredth of the range
    assert (abs(offsets[:, 0]) - 10).std() == pytest.approx(np.sqrt(1 + (0.2 * 20) ** 2 / 2), rel=0.05)


def test_variables_without_steps_move_by_a_tenth_of_their_range():
    space = Space((Variable("x", 0.0, 100.0), Variable("n", 0, 20, "integer"), Variable("b", 0, 1, "binary")))
    method = MapElites(space, population=4000, seed=1)
    method.generation, method.elites = 1, np.array([[50.0, 10.0, 0.0]])
    children = method.ask()
    assert children[:, 0].std() == pytest.approx(10, rel=0.05) and children[:, 1].std() == pytest.approx(2, rel=0.05)
    assert children[:, 2].mean() == pytest.approx(0.317, abs=0.03)  # beyond one standard deviation


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"bins": 0}, "bins: 0 is not allowed; give a whole number, at least 1"),
        ({"bins": 1001}, "bins: 1001 is not allowed for 2 descriptors; give at most 1000000 cells"),
        ({"variation": "pcx"}, "variation: 'pcx' is unknown; choose one of gaussian, line"),
        ({"descriptors": []}, r"descriptors: \[\] is not allowed; give a list of names that differ, at least one"),
        ({"descriptors": "x"}, "descriptors: 'x' is not allowed"),
        ({"descriptors": ["x", "x"]}, r"descriptors: \['x', 'x'\] is not allowed"),
        ({"descriptors": ["speed"]}, r"descriptors: speed is no variable \(x, heading, n, b\); give its \[low, high\]"),
        ({"ranges": {"x": [1, 0]}}, r"ranges: \[1, 0\] of x is not allowed; give \[low, high\]"),
        ({"ranges": {"x": 3}}, "ranges: 3 of x is not allowed"),
        ({"ranges": {"speed": [0, 1]}}, "ranges: speed is no descriptor; these are x, heading"),
        ({"offset": float("nan")}, "offset: nan is not allowed"),
    ],
)
def test_settings_without_sense_are_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        MapElites(SPACE, **settings)


def test_whole_numbers_alone_suggest_no_descriptors():
    with pytest.raises(ValueError, match=r"descriptors: \[\] is not allowed; give a list of names"):
        MapElites(Space((Variable("b", 0, 1, "binary"),)))


class Telling:
    """A problem that names its details, or not, and counts its evaluations."""

    space, objective_names = PLANE, ("score",)

    def __init__(self, **named):
        self.evaluations = 0
        self.__dict__.update(named)

    def evaluate(self, points):
        self.evaluations += 1
        return Evaluation(np.zeros(len(points)), details={"height": points[:, 0], "more": points[:, 1]})


class Counting(MapElites):
    """A method whose ``ask`` changes something."""

    asked = 0

    def ask(self):
        self.asked += 1
        return super().ask()


@pytest.mark.parametrize(
    ("descriptor", "named", "evaluations"),
    [("height", {"detail_names": {"height"}}, 0), ("more", {"detail_names": {"height"}}, 1), ("width", {}, 0)],
)
def test_descriptors_are_checked_with_no_work_where_that_can_be(descriptor, named, evaluations):
    method = Counting(PLANE, population=4, descriptors=[descriptor], ranges={descriptor: [0, 1]})
    problem = Telling(**named)
    check_fit(method, problem)
    assert (method.asked, problem.evaluations) == (0, evaluations)


def test_a_descriptor_that_is_not_told_is_refused_before_the_search():
    method = Counting(PLANE, population=4, descriptors=["width"], ranges={"width": [0, 1]})
    with pytest.raises(ValueError, match="width is no detail of the evaluation; it has height, more"):
        check_fit(method, Telling(detail_names={"height"}))
    assert method.asked == 0
