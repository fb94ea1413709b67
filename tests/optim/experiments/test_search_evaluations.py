"""Evaluations of searches: what is recorded, counted and reported, and comparisons of them."""

from functools import partial

import numpy as np
import pytest
from scipy.stats import mannwhitneyu

from optim.experiments.comparison import compare, describe_times, ranked
from optim.experiments.results import cached, write_json
from optim.experiments.search_evaluations import SearchEvaluations, computed_searches, first_time, record_searches
from optim.problem import Evaluation
from optim.search import Borg
from optim.space import Space, Variable
from taichi_sim.base.results_folder import ResultsFolder


class Hill:
    """Four environments, solved one after the other as x grows; several objectives, or their sum with its gradient."""

    space = Space((Variable("x", 0.0, 1.0), Variable("y", 0.0, 1.0)))

    def __init__(self, several=False):
        self.several, self.calls = several, 0

    def evaluate(self, points):
        self.calls += 1
        x, y = np.asarray(points).T
        objectives = np.stack([x - y, y - 0.5 * x, -abs(x - 0.7)], axis=1) if self.several else x
        objectives = np.where(x[:, None] > 0.99, np.nan, objectives.reshape(len(x), -1))
        return Evaluation(objectives, details={"solved": np.floor(x / 0.2).astype(int).clip(0, 4)})

    def evaluate_relaxed(self, points, sharpness, gradients):
        found = self.evaluate(points)
        slope = np.tile([1.0, 0.0], (len(points), 1)) if gradients else None
        return Evaluation(found.objectives, found.status, found.details, slope)


def test_points_are_recorded_in_the_order_asked_for_and_same_seeds_have_the_same_bits():
    one = record_searches(Hill(), "random", {"climbers": 4}, [3, 5], 10)
    again = record_searches(Hill(), "random", {"climbers": 4}, [5], 10)
    assert one.points.shape == (2, 10, 2) and (one.evaluations == 10).all()
    assert np.array_equal(one.points[1], again.points[0]) and not np.array_equal(one.points[0], one.points[1])
    assert np.array_equal(
        one.objectives[..., 0], np.where(one.points[..., 0] > 0.99, np.nan, one.points[..., 0]), equal_nan=True
    )


def test_what_does_not_fit_a_method_is_refused_before_any_work():
    hill = Hill()
    with pytest.raises(ValueError, match=r"^minibatch_size: Hill judges in all worlds at once"):
        record_searches(hill, "nes", {"minibatch_size": 2}, [0], 10)
    assert hill.calls == 0


def test_a_trial_ends_with_the_step_that_solves_everything_and_its_first_success_is_counted():
    searches = record_searches(Hill(), "random", {"climbers": 3}, range(5), 60, until_solved=True)
    x = searches.points[..., 0]
    solves = (x >= 0.8) & (x <= 0.99)
    assert np.array_equal(searches.first(), solves.argmax(axis=1) + 1)
    assert (searches.evaluations == -(-searches.first() // 3) * 3).all()
    assert np.isnan(x[0, searches.evaluations[0] :]).all() and not searches.with_gradient.any()


def test_a_gradient_costs_as_many_evaluations_more_as_there_are_variables():
    searches = record_searches(
        Hill(), "gradient", {"climbers": 1, "candidates": 5, "learning_rate": 0.01}, [2, 4], 60, until_solved=True
    )
    first = searches.first()
    assert first[0] > 6 and first[1] <= 5  # on its way up, and among the candidates, which need no gradient
    assert searches.cost().tolist() == [5 + 3 * (first[0] - 5), first[1]]
    never = SearchEvaluations(
        searches.points, searches.objectives, np.zeros_like(searches.solved), searches.with_gradient
    )
    assert (never.first() == -1).all() and (never.cost() == -1).all()


def test_what_is_reported_is_the_best_of_the_archive_by_its_sum():
    settings = {"population": 8, "children": 1, "epsilons": 0.1}
    searches = record_searches(Hill(several=True), "borg", settings, [1, 2], 40)
    reported = searches.reported(0.1)
    for search, seed in enumerate((1, 2)):
        method, problem = Borg(Hill.space, seed=seed, **settings), Hill(several=True)
        for n in (8, *range(9, 41)):
            points = method.ask()
            method.tell(points, problem.evaluate(points))
            archive = method.result()
            best = archive.points[archive.objectives.sum(axis=1).argmax()]
            assert np.array_equal(searches.points[search, reported[search, n - 1]], best)
    assert len(np.unique(reported)) > 3


def test_nothing_is_reported_before_the_first_success():
    objectives = np.array([[[np.nan], [2.0], [1.0]]])
    solved = np.array([[0, 3, 4]], np.int8)
    searches = SearchEvaluations(np.zeros((1, 3, 2)), objectives, solved, np.zeros((1, 3), bool))
    assert searches.reported(0.1).tolist() == [[-1, 1, 1]]
    assert searches.of_points(solved, searches.reported(0.1), 0).tolist() == [[0, 3, 3]]
    assert first_time(solved >= 4).tolist() == [3] and first_time(solved > 4).tolist() == [-1]


def test_what_a_folder_has_is_not_computed_again_unless_it_is_damaged(tmp_path):
    folder, problem = ResultsFolder(tmp_path / "a", "study", {"x": 1}), Hill()
    arms = {"one": partial(record_searches, problem, "random", {"climbers": 2}, [1], 6)}
    first = computed_searches(folder, arms, None)["one"]
    calls = problem.calls
    again = computed_searches(folder, arms, None)["one"]
    assert problem.calls == calls and all(np.array_equal(first.arrays[n], again.arrays[n]) for n in first.arrays)
    (file,) = (tmp_path / "a").glob("trials_one-*.npz")
    file.write_bytes(file.read_bytes()[:-40])
    with pytest.warns(UserWarning, match="is damaged, and as good as missing"):
        third = computed_searches(folder, arms, None)["one"]
    assert problem.calls > calls and np.array_equal(third.points, first.points)
    with pytest.raises(ValueError, match=r"holds a study of other settings .*; name another folder"):
        ResultsFolder(tmp_path / "a", "study", {"x": 2})
    assert cached(None, "one", lambda: {"a": np.ones(2)}, len)["a"].tolist() == [1.0, 1.0]


def test_comparisons_name_the_test_and_agree_with_scipy():
    rng = np.random.default_rng(0)
    samples = {"a": rng.integers(0, 20, 30), "b": rng.integers(12, 32, 25), "c": rng.integers(0, 20, 30)}
    found = compare(samples, [("a", "b"), ("a", "c")], "less")
    for row in found:
        test = mannwhitneyu(samples[row["first"]], samples[row["second"]], alternative="less", method="asymptotic")
        assert row["U"] == pytest.approx(test.statistic) and row["p"] == pytest.approx(test.pvalue)
        assert row["p_bonferroni"] == min(1.0, 2 * row["p"])
        assert row["interval"][0] < row["difference"] < row["interval"][1]
        assert row["A12"] == pytest.approx(1 - test.statistic / np.prod(row["n"]))
    assert found[0]["p"] < 0.01 and compare({"a": [1, 1], "b": [1, 1]}, [("a", "b")], "less")[0]["p"] == 1.0


def test_searches_without_success_come_after_all_others():
    assert ranked([3, -1, 500], 500).tolist() == [3, 501, 500]
    numbers = describe_times([3, -1, 5, -1, 500], 500)
    assert numbers["solved"] == 3 and numbers["median"] == 500.0
    assert numbers["mean_with_failures_at_budget"] == pytest.approx((3 + 5 + 500 * 3) / 5)
    assert describe_times([-1, -1, 4], 9)["median"] is None
    assert describe_times([-1], 9)["quartiles_of_solved"] is None


def test_summaries_hold_no_numbers_that_are_none(tmp_path):
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_json(tmp_path / "a.json", {"x": float("nan")})


def test_searches_that_no_method_can_have_made_are_run_again(tmp_path):
    """Files of earlier commits hold the same arrays, and are taken as they are."""
    run = partial(record_searches, Hill(), "random", {"climbers": 4}, [3, 5], 10)
    folder, made = ResultsFolder(tmp_path, "study", {}), run()
    for changed, why in (
        ({"solved": np.full((2, 10), 5, np.int8)}, "solved: 5 is not allowed; give whole numbers from -1 to 4"),
        ({"points": made.points[:, :3]}, "points: shape .* does not fit"),
    ):
        folder.add("trials_one", b"trials_one", **made.arrays | changed)
        with pytest.warns(UserWarning, match=rf"trials_one-.*npz: is damaged, and as good as missing \({why}"):
            found = computed_searches(folder, {"one": run}, None)["one"]
        assert np.array_equal(found.solved, made.solved) and np.array_equal(found.points, made.points)
