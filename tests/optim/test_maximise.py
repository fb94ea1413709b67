"""A search in one call: functions as problems, what comes back, and what is refused before any work."""

import subprocess
import sys

import numpy as np
import pytest

from morpholab import robot
from optim import Evaluation, Problem, Space, Variable, maximise, problem_of
from optim.problem import Objective
from optim.search import METHODS, build_method

BOUNDS = {"x": (-1.0, 2.0), "n": (0, 6, "integer"), "on": (0, 1, "binary")}
BEST = np.array([0.5, 4.0, 1.0])


def bowl(points):
    return -((points - BEST) ** 2).sum(axis=1)


def slopes(points):
    return -2 * (points - BEST)


def front(points):
    return np.column_stack([points[:, 0], 1 - points[:, 0] ** 2 - points[:, 1]])


def test_a_function_is_maximised_in_one_call():
    found = maximise(bowl, bounds=BOUNDS, generations=60, seed=1, population=20, progress=False)
    assert found.best["n"] == 4 and found.best["on"] == 1 and found.best["x"] == pytest.approx(0.5, abs=1e-3)
    assert found.score == bowl(found.point[None])[0] == found.history["best"][-1]
    assert set(found.history) == {"evaluations", "failed", "best", "mean", "median"}
    assert found.history["evaluations"].tolist() == [20.0 * n for n in range(1, 62)]
    assert (np.diff(found.history["best"]) >= 0).all() and found.result.kind == "population"
    assert repr(found).startswith("best score 0.0000 after 1220 evaluations: x 0.5")


@pytest.mark.parametrize("method", [name for name in METHODS if name != "stochastic"])  # a function has one world
def test_every_method_gives_the_same_bits_again(method):
    bounds = {name: each for name, each in BOUNDS.items() if method not in ("gradient", "race") or name != "n"}
    best = np.array([BEST[list(BOUNDS).index(name)] for name in bounds])
    problem = problem_of(lambda p: -((p - best) ** 2).sum(axis=1), bounds, gradient=lambda p: -2 * (p - best))
    first, second = (maximise(problem, method, generations=8, seed=3, progress=False) for _ in range(2))
    assert first.score == second.score and np.array_equal(first.result.points, second.result.points)
    search = build_method(method, problem.space, {"seed": 3})
    for _ in range(9):
        points = search.ask()
        wanted = search.wants, search.sharpness
        relaxed = problem.evaluate_relaxed(points, wanted[1], wanted[0] == "gradients")
        search.tell(points, problem.evaluate(points) if wanted[0] == "points" else relaxed)
    assert search.result().score == first.score


def test_several_objectives_give_a_front():
    problem = problem_of(front, {"x": (0, 1), "y": (0, 1)}, name=("far", "light"), unit=("m", "kg"))
    found = maximise(problem, "borg", generations=10, progress=False)
    assert found.objectives == (Objective("far", "m"), Objective("light", "kg"))
    assert found.result.kind == "front" and found.result.objectives.shape[1] == 2
    with pytest.raises(ValueError, match="method: cma takes one objective, not far, light; choose one of borg, nsga2"):
        maximise(problem, progress=False)


def test_details_units_and_failures():
    class Rocket(Problem):
        space = Space((Variable("fuel", 0.0, 1.0, step=0.1),))
        objective_names, objective_units = ("height",), ("km",)

        def evaluate(self, points):
            fuel = np.asarray(points)[:, 0]
            height = np.where(fuel > 0.8, np.nan, fuel * 100)
            return Evaluation(height, details={"mass": 5 + fuel})

    found = maximise(Rocket(), "hill-climb", climbers=8, generations=40, seed=2, progress=False)
    assert 70 < found.score <= 80 and "best height 7" in repr(found) and " km after" in repr(found)
    assert found.generations[-1].best_details == {"mass": 5 + found.best["fuel"]}
    nothing = maximise(lambda p: np.full(len(p), np.nan), "random", bounds={"x": (0, 1)}, generations=2, progress=False)
    assert nothing.best is None and np.isnan(nothing.score) and repr(nothing) == "nothing succeeded in 180 evaluations"


def test_progress_is_a_function_or_silence(capsys):
    seen = []
    maximise(bowl, "random", bounds=BOUNDS, generations=3, climbers=4, progress=seen.append)
    assert [each.generation for each in seen] == [0, 1, 2, 3]
    maximise(bowl, "random", bounds=BOUNDS, generations=3, climbers=4)
    assert capsys.readouterr() == ("", "")


def test_progress_is_a_bar_on_a_terminal(monkeypatch, capsys):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    maximise(problem_of(bowl, BOUNDS, "height", "m"), "random", generations=2, climbers=4)
    assert "generation 2/2: best height -" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"bounds": None}, "bounds: missing"),
        ({"bounds": {"x": (1, 0)}}, "x: bounds 1.0 to 0.0 are not allowed"),
        ({"bounds": {"x": (0, 1, "round")}}, "kind: 'round' of x is unknown"),
        ({"bounds": {"x": 3}}, r"bounds: 3 of x is not allowed; give \(low, high\)"),
        ({"method": "cmaes"}, "method: 'cmaes' is unknown; did you mean cma"),
        ({"method": dict}, "method: dict is no search method; derive it from optim.search.method.Method"),
        ({"generations": -1}, "generations: -1 is not allowed"),
        ({"popluation": 5}, "popluation: method cma does not take it; .*did you mean population"),
        ({"problem": problem_of(bowl, BOUNDS)}, "bounds: they are of a function"),
        ({"problem": robot("vehicle"), "bounds": None}, r"problem: .* is a robot; give RobotProblem\(robot, objective"),
    ],
)
def test_wrong_arguments_are_refused_before_any_work(arguments, message):
    def never(points):
        raise AssertionError

    with pytest.raises(ValueError, match=message):
        maximise(**{"problem": never, "bounds": BOUNDS, "progress": False, **arguments})


@pytest.mark.parametrize(
    ("function", "gradient", "message"),
    [
        (lambda points: points[:-1, 0], None, r"function: it gave objectives of shape \(59, 1\) for 60 points"),
        (lambda points: points, None, r"give \(60, 1\), one column for each of score"),
        (bowl, lambda points: points[:, 0], "gradient: shape"),
        (bowl, None, "gradient: the method needs one"),
    ],
)
def test_what_a_function_gives_is_checked(function, gradient, message):
    with pytest.raises(ValueError, match=message):
        maximise(problem_of(function, BOUNDS, gradient=gradient), "cma-gradient", generations=3, progress=False)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"name": ()}, "name: "),
        ({"name": ("a", "a")}, "name: "),
        ({"name": ("a", "b"), "unit": ("m",)}, "unit: 1 given for 2 objectives"),
        ({"name": ("a", "b"), "gradient": slopes}, "gradient: not allowed with several objectives"),
    ],
)
def test_wrong_descriptions_of_functions(options, message):
    with pytest.raises(ValueError, match=message):
        problem_of(bowl, BOUNDS, **options)
    with pytest.raises(ValueError, match="function: 5 is not allowed"):
        problem_of(5, BOUNDS)


def test_importing_it_is_light():
    program = "import sys; from optim import maximise, problem_of; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    heavy = {"taichi", "torch", "scipy", "matplotlib", "rich", "cmaes", "pymoo", "robots", "optim.search.cma"}
    assert not heavy & set(done.stdout.split())


def test_infinite_sharpness_is_of_true_points():
    problem = problem_of(lambda p: p.sum(axis=1), {"b": (0, 1, "binary"), "x": (0, 1)}, gradient=np.ones_like)
    found = problem.evaluate_relaxed(np.array([[0.7, 0.25]]), np.inf, True)
    assert found.objectives[0, 0] == 1.25
    assert problem.evaluate_relaxed(np.array([[0.75, 0.25]]), 3.0, True).objectives[0, 0] == 1.0


def test_bounds_without_names_are_refused():
    with pytest.raises(ValueError, match=r"^bounds: \[\(0, 1\)\] is not allowed; give \(low, high\) by name"):
        problem_of(lambda points: points[:, 0], [(0, 1)])


@pytest.mark.parametrize("method", ["cma", "hill-climb", "gradient"])
def test_a_function_that_changes_its_points_changes_no_others(method):
    def reckless(points):
        points -= 0.3
        points *= points
        return -points.sum(axis=1)

    def reckless_slopes(points):
        points -= 0.3
        points *= -2
        return points

    bounds = {"x": (0.0, 1.0), "y": (0.0, 1.0)}
    problems = [
        problem_of(lambda p: -((p - 0.3) * (p - 0.3)).sum(axis=1), bounds, gradient=lambda p: (p - 0.3) * -2),
        problem_of(reckless, bounds, gradient=reckless_slopes),
    ]
    found = [maximise(each, method, generations=5, progress=False) for each in problems]
    assert found[0].best == found[1].best
    given = np.array([[0.5, 0.5]])
    problem_of(reckless, bounds).evaluate(given)
    assert given.tolist() == [[0.5, 0.5]]


def test_what_a_masked_array_hides_has_failed():
    found = problem_of(lambda p: np.ma.masked_less(p.sum(axis=1), 1.5), {"x": (0, 1), "y": (0, 1)})
    assert found.evaluate([[1.0, 1.0], [0.0, 0.0]]).status.tolist() == ["ok", "failed"]
    with pytest.raises(ValueError, match=r"^y: nan is not allowed"):
        found.evaluate(np.ma.masked_greater([[0.2, 0.9]], 0.5))


@pytest.mark.parametrize("method", ["memetic", "gradient", "cma-gradient", "race"])
def test_methods_along_gradients_refuse_a_problem_without_before_any_work(method):
    class Plain:
        objective_names = ("score",)
        space = Space((Variable("x", 0.0, 1.0),))

        def evaluate(self, points):
            raise AssertionError("it is evaluated")

    with pytest.raises(ValueError, match=r"^method: it wants gradients, but Plain has no relaxation; choose another"):
        maximise(Plain(), method, progress=False)
