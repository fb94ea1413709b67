"""Vehicles that evolve for metrics of learning, and while they learn."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from optim.experiments.body_metrics import Environments, Measuring, measure_body
from optim.experiments.side_by_side import run_with_budget
from optim.experiments.tables import read_records
from optim.problem import Evaluation, Problem, Request, evaluate_request
from optim.search import build_method
from optim.space import Space, Variable
from optim.studies.beyond.evolving_vehicles import searches
from optim.studies.beyond.evolving_vehicles import study as of_study
from optim.studies.beyond.evolving_vehicles.bodies import (
    BODY,
    BOUND,
    HERE,
    body_of,
    drawn_body,
    exact,
    problem_of,
    tried,
)
from optim.studies.beyond.evolving_vehicles.searches import LOOPS, MARKS, OBJECTIVES, PairProblem, evolve
from optim.studies.beyond.evolving_vehicles.study import NAME, STUDY, Part
from robots.braitenberg import VehicleBody
from robots.braitenberg.robot import VehicleRobot
from robots.tasks import Success
from taichi_sim.base.results_folder import ResultsFolder

DATA = Path(__file__).parents[3] / "docs" / "data" / NAME
CANONICAL = np.array([8.0, 8.0, 8.0, 0.0])


def test_every_published_body_has_a_point():
    points = np.stack(np.meshgrid(*[np.arange(9)] * 4, indexing="ij"), axis=-1).reshape(-1, 4)
    assert [body_of(point).design for point in points[::97]] == list(range(1, 6562))[::97]
    assert body_of(CANONICAL) == VehicleBody.published(6553) and BODY.contains(points).all()


@pytest.mark.kernels
def test_exact_metrics_are_those_of_all_controllers_on_a_grid():
    """Of a body in which many succeed, by the sweep and by the robot; drawn ones agree within their interval.

    Not to the digit: weights of the two grids differ by rounding, which decides a few paths that pass the light.
    """
    point = np.array([1.0, 8.0, 8.0, 6.0])
    robot, near = VehicleRobot(body_of(point)), (Success("closest", "<=", BOUND),)
    grid = measure_body(robot, Environments(robot.worlds, (near,) * 4), Measuring(grid=21), HERE).sampled
    assert exact(point, 21) == pytest.approx((grid.learnability.value, grid.resistance.value), abs=0.02)
    drawn, performance = tried(point, 256, 0)
    assert drawn.resistance.low <= grid.resistance.value <= drawn.resistance.high and -4 < performance < 0


@pytest.mark.kernels
def test_pairs_score_as_each_body_does():
    """With gradients by the controller and none by the body."""
    pairs, rng = PairProblem(), np.random.default_rng(0)
    points = np.hstack([np.array([CANONICAL, [7, 6, 5, 1], CANONICAL]), rng.uniform(0.1, 1, (3, 2))])
    found = evaluate_request(pairs, Request(points, "gradients", np.inf))
    for row, slopes, score in zip(points, found.gradients, found.objectives, strict=True):
        alone = evaluate_request(problem_of(row[:4]), Request(row[None, 4:], "gradients", np.inf))
        assert score == alone.objectives[0] and np.array_equal(slopes[4:], alone.gradients[0])
        assert not slopes[:4].any()


class Known(Problem):
    """Bodies of which all objectives are known; what is best of one is worst of the other."""

    space = Space((Variable("n", 0, 10, "integer"), Variable("m", 0, 3, "integer")))
    objective_names = ("one", "other")
    seed = 0

    def evaluate(self, points):
        n, m = np.asarray(points, float).T
        return Evaluation(np.column_stack([100 - (10 - n) ** 2 - m, 100 - n**2 - m]))


def test_evolution_ends_with_the_knee_of_its_front():
    found = evolve(Known(), 16, 20)
    assert found["body"].tolist() == [5, 0] and found["objectives"].tolist() == [75, 75]


def test_where_every_body_fails_evolution_is_as_good_as_drawing(monkeypatch):
    """A body of which nothing is known is not chosen by its number."""
    monkeypatch.setattr(
        searches.BodyProblem, "evaluate", lambda self, points: Evaluation(np.full((len(points), 2), np.nan))
    )
    found = evolve(searches.BodyProblem(OBJECTIVES["resistance"], 4, 3), 4, 1)
    assert np.array_equal(found["body"], drawn_body(3)) and np.isnan(found["objectives"]).all()


def test_evaluations_with_gradients_have_their_price():
    """Three units each: of a budget of 12 there are four."""
    space, seen = Space((Variable("x", 0.0, 1.0),)), []
    method = build_method("gradient", space, {"climbers": 1})

    def evaluate(_, request):
        return Evaluation(request.points[:, 0], gradients=np.ones(request.points.shape))

    run_with_budget([method], 12, evaluate, lambda n, points, found: bool(seen.extend(points)), price=3.0)
    assert len(seen) == 4


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"costs": np.linspace(0, 9999, MARKS)}, r"costs: \d.* is not allowed; give 0 to "),
        ({"best": np.zeros(MARKS - 1)}, rf"best: shape \({MARKS - 1},\) is not allowed; give \({MARKS},\)"),
        ({"best": np.full(MARKS, np.nan)}, "best: nan is not allowed; give finite numbers"),
        ({"seconds": np.array(-1.0)}, "seconds: -1.0 is not allowed; give 0 to inf"),
    ],
)
def test_a_course_that_no_loop_can_take_is_taken_again(tmp_path, monkeypatch, changed, why):
    settings = STUDY.scales["small"]
    course = {"costs": np.linspace(0, settings.loop_budget, MARKS), "best": np.full(MARKS, -np.inf)}
    monkeypatch.setattr(of_study, "loop", lambda *_: course)
    monkeypatch.setattr(Part, "_evolved", lambda *_: {})
    _, rows = Part(tmp_path, settings, 0)({}, None)
    (part,) = tmp_path.glob("parts/0/loop_flat-*.npz")
    np.savez(part, **course | {"seconds": np.array(0.0)} | changed)
    with pytest.warns(UserWarning, match=rf"loop_flat-.*: is damaged, and as good as missing \({why}"):
        _, again = Part(tmp_path, settings, 0)({}, None)
    assert [row["best"] for row in again] == [row["best"] for row in rows] == [None] * MARKS * len(LOOPS)


def test_a_loop_that_has_found_nothing_at_first_is_told_from_its_table(morpholab, tmp_path):
    shutil.copytree(DATA, tmp_path / "found")
    header, first, *rows = (DATA / "loops.csv").read_text().splitlines()
    arm, seed, cost, _, seconds = first.split(",")
    (tmp_path / "found" / "loops.csv").write_text("\n".join([header, f"{arm},{seed},{cost},,{seconds}", *rows]))
    assert morpholab(f"reproduce {NAME} --from-data found --quiet --out told")[::2] == (0, "")


@pytest.mark.slow
def test_the_study_goes_on_where_it_was(tmp_path):
    """What a seed found before is not sought again, and what is lost is found again."""
    settings = replace(STUDY.scales["small"], seeds=1, weights=3)
    ResultsFolder(tmp_path / "a", NAME, settings.lasting("seeds"))
    bodies, loops = Part(tmp_path / "a", settings, 0)({}, None)
    for name in ("learned_random_evolution", "evolved_resistance"):
        (lost,) = (tmp_path / "a/parts/0").glob(f"{name}-*.npz")
        lost.unlink()
    STUDY.run(tmp_path / "a", settings)
    assert [str(row) for row in read_records(tmp_path / "a/bodies.csv")] == [str(row) for row in bodies]
    assert [str(row) for row in read_records(tmp_path / "a/loops.csv")] == [str(row) for row in loops]
    assert [row["arm"] for row in bodies] == ["random", *OBJECTIVES]
    assert {row["arm"] for row in loops} == set(LOOPS) and len(loops) == MARKS * len(LOOPS)
    assert all(1 <= row["evolution"] <= 8 and 0 <= row["M_L"] <= row["M_CI"] <= 1 for row in bodies)
    assert all((tmp_path / "a" / name).stat().st_size for name in STUDY.writes)
    with pytest.raises(ValueError, match="of other settings"):
        STUDY.run(tmp_path / "a", replace(settings, budget=5))
