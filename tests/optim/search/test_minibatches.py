"""Searches that meet a few of a problem's worlds at a time: which, what they find, what counts, what is refused."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from optim import maximise
from optim.problem import Evaluation, Minibatch, Problem, Request, evaluate_request
from optim.problems.braitenberg import VehicleProblem
from optim.problems.inflatable.problem import GaitProblem
from optim.problems.robot import RobotProblem
from optim.problems.user_file import FileProblem
from optim.runs.generation import record
from optim.runs.workers.folder_files import packed_request, unpacked_request
from optim.search import StochasticAscent, build_method
from optim.search.method import SearchResult, generator, next_request
from optim.space import Space, Variable
from robots.lattice_robot import Drive, Free, LatticeRobot
from robots.world import Terrain
from taichi_sim.lattice import LatticeBody, Material

WORLDS = np.random.default_rng(5).normal(0.2, 1.0, (12, 3))
SPACE = Space(tuple(Variable(name, -3.0, 5.0) for name in "xyz"))


class Bowls(Problem):
    """A bowl around another point in each world: the best of all is their mean."""

    space = SPACE

    def __init__(self, worlds=WORLDS, fails=lambda points: np.zeros(len(points), bool)):
        self.worlds, self.fails, self.met = worlds, fails, []

    def check_minibatch(self, size):
        pass

    def in_minibatch(self, minibatch):
        part = Bowls(self.worlds[minibatch.of(len(self.worlds))], self.fails)
        part.met = self.met
        return part

    def evaluate(self, points):
        return self.evaluate_relaxed(points, np.inf, False)

    def evaluate_relaxed(self, points, sharpness, gradients):
        away = np.asarray(points)[:, None] - self.worlds
        self.met.append(len(self.worlds))
        values = np.where(self.fails(points), np.nan, -(away**2).sum(axis=2).mean(axis=1))
        return Evaluation(values, gradients=-2 * away.mean(axis=1) if gradients else None)


@given(st.integers(1, 9), st.integers(1, 20), st.integers(0, 2**63 - 1))
def test_the_minibatches_of_an_order_are_full_and_meet_all(size, count, seed):
    orders = -(-count // size)
    for order in range(2):
        parts = [Minibatch(size, order * orders + n, seed).of(count) for n in range(orders)]
        assert all(len(set(part.tolist())) == len(part) == min(size, count) for part in parts)
        assert set(np.concatenate(parts).tolist()) == set(range(count))


def test_an_order_is_another_one_than_the_one_before_and_the_same_again():
    parts = [[Minibatch(1, n, 3).of(12)[0] for n in range(first, first + 12)] for first in (0, 12, 0)]
    assert parts[0] == parts[2] != parts[1] and sorted(parts[0]) == sorted(parts[1])


@pytest.mark.parametrize("method", ["stochastic", "nes"])
def test_the_best_over_all_worlds_is_found_from_few_at_a_time(method):
    made = {"stochastic": {"moves": 200, "settling": 0.0}, "nes": {"population": 20, "minibatch_size": 1}}[method]
    problem = Bowls()
    found = maximise(problem, method, generations=240, seed=2, progress=False, **made)
    assert found.point == pytest.approx(WORLDS.mean(axis=0), abs=0.35)
    assert found.score == Bowls().evaluate(found.point[None]).objectives[0, 0]  # judged in all worlds
    assert problem.met.count(1) > 0.8 * len(problem.met)


def test_a_minibatch_as_large_as_the_problem_is_all_of_it():
    settings = {"moves": 30, "seed": 1}
    whole, larger = (
        maximise(Bowls(), "stochastic", generations=40, progress=False, minibatch_size=size, **settings)
        for size in (12, 50)
    )
    assert whole.score == larger.score and whole.score > -(WORLDS.var(axis=0).sum() + 0.05)


def test_it_goes_on_from_its_state_and_begins_anew_after_a_round():
    def run(method, turns):
        problem = Bowls()
        for _ in range(turns):
            request = next_request(method)
            method.tell(request.points, evaluate_request(problem, request))
        return method

    settings = {"moves": 8, "judging": 3, "climbers": 2, "candidates": 2, "seed": 4}
    whole, first = (build_method("stochastic", SPACE, settings) for _ in "ab")
    run(whole, 40), run(first, 17)
    again = build_method("stochastic", SPACE, settings)
    again.restore(first.state())
    run(again, 23)
    assert all(np.array_equal(whole.state()[name], again.state()[name], equal_nan=True) for name in whole.state())
    before = run(build_method("stochastic", SPACE, settings), 13)  # starts, their judgement, 8 moves, 3 judgements
    assert before.wants == "points" and before.minibatch is not None and np.isnan(before.here).all()
    assert len(before.ask()) == 4


def test_a_climber_whose_point_failed_goes_on_from_its_average():
    method = StochasticAscent(SPACE, candidates=1, memory=0.5, learning_rate=0.3)
    fails = [False]
    problem = Bowls(fails=lambda points: np.full(len(points), fails[0]))

    def turn():
        request = next_request(method)
        method.tell(request.points, evaluate_request(problem, request))

    for _ in range(4):
        turn()
    average, here = method.average.copy(), method.here.copy()
    fails[0] = True
    turn()
    assert np.array_equal(method.here, average) and not np.array_equal(here, average)
    assert (method.steps.arrays["count"] == 0).all()
    fails[0] = False
    turn()
    assert not np.array_equal(method.here, average) and np.isfinite(method.here).all()


def test_starts_that_failed_are_tried_elsewhere():
    method = StochasticAscent(SPACE, climbers=3, candidates=2, seed=6)
    seen = []
    for fail in (True, False):
        request = next_request(method)
        seen.append(request.points)
        method.tell(request.points, Evaluation(np.full(len(request.points), np.nan if fail else 1.0)))
    assert not np.array_equal(*seen) and method.minibatch is None and np.isfinite(method.ask()).all()


def test_what_is_binary_stays_and_integers_are_refused():
    space = Space((*SPACE.variables, Variable("b", 0, 1, "binary")))
    method = StochasticAscent(space, candidates=1, seed=1)
    for _ in range(30):
        points = method.ask()
        space.validate(points)
        slopes = np.ones(points.shape) if method.wants == "gradients" else None
        method.tell(points, Evaluation(points.sum(axis=1), gradients=slopes))
        assert (method.here[:, 3] == method.here[0, 3]).all() and method.here[0, 3] in (0, 1)
    with pytest.raises(ValueError, match="n: an integer has no gradient; leave it to another method"):
        StochasticAscent(Space((Variable("n", 0, 5, "integer"),)))


def test_only_the_mean_that_all_worlds_judged_is_a_result_of_nes():
    method = build_method("nes", SPACE, {"population": 4, "minibatch_size": 2, "judging": 3, "seed": 1})
    kinds = []
    for _ in range(9):
        request = next_request(method)
        before = method.result().score
        lucky = 100.0 if request.minibatch else 0.0
        method.tell(request.points, Evaluation(lucky + request.points.sum(axis=1)))
        kinds.append((len(request.points), request.minibatch is None))
        assert method.result().score < 50 and (request.minibatch is None or method.result().score == before)
    assert kinds == [(1, True), (4, False), (4, False), (4, False)] * 2 + [(1, True)]


@pytest.mark.parametrize(("size", "count", "judging"), [(8, 16, 1), (2, 22, 10)])
def test_nes_meets_all_minibatches_of_an_order(size, count, judging):
    method = build_method("nes", SPACE, {"population": 4, "minibatch_size": size, "judging": judging})
    met = set()
    while method.generation < 3 * count:
        if method.minibatch and method.minibatch.number < -(-count // size):
            met |= set(method.minibatch.of(count).tolist())
        points = method.ask()
        method.tell(points, Evaluation(points.sum(axis=1)))
    assert met == set(range(count))


def test_orders_are_streams_that_no_search_has():
    orders = [Minibatch(6, n, 2).of(12).tolist() for n in range(6)]
    drawn = [generator(2, n).permutation(12)[:6] for n in range(6)]
    assert orders != [sorted(each.tolist()) for each in drawn]


@pytest.mark.parametrize("minibatch", [None, Minibatch(1)])
def test_details_of_the_best_are_those_in_all_worlds(minibatch):
    """Though a minibatch may give the best point the very same score."""
    problem, point = Bowls(), np.array([0.5, 1.0, 2.0])
    known = SearchResult(point, -1.0, point[None], np.array([[-1.0]]))
    found = Evaluation([-1.0], details={"world": np.array([7])})
    before = record(None, problem, known, Request(point[None]), Evaluation([-1.0], details={"world": np.array([3])}))
    after = record(before, problem, known, Request(point[None], minibatch=minibatch), found)
    assert after.best_details == {"world": 7 if minibatch is None else 3}


FILE = """
import numpy as np
from optim import Evaluation, Problem, Space, Variable

with open("runs.txt", "a") as log:
    log.write("run\\n")


class Worlds(Problem):
    space = Space((Variable("x", -1.0, 1.0),))
    worlds = (0.0, 0.5, 1.0)

    def check_minibatch(self, size):
        pass

    def in_minibatch(self, minibatch):
        part = Worlds()
        part.worlds = [self.worlds[n] for n in minibatch.of(3)]
        return part

    def evaluate(self, points):
        if len(self.worlds) < 3 and FAULT:
            raise IndexError("mine")
        return Evaluation(-((np.asarray(points) - np.array(self.worlds)) ** 2).mean(axis=1))

    def evaluate_relaxed(self, points, sharpness, gradients):
        found = self.evaluate(points)
        slopes = -2 * (np.asarray(points) - np.mean(self.worlds))
        return Evaluation(found.objectives, gradients=slopes if gradients else None)


problem = Worlds()
"""


@pytest.mark.parametrize("fault", [False, True])
def test_the_file_of_a_problem_is_run_once_and_blamed_for_its_faults(tmp_path, monkeypatch, fault):
    monkeypatch.chdir(tmp_path)
    source = FILE.replace("\\\\n", "\\n").replace("FAULT", str(fault))
    problem = FileProblem("mine.py", source.encode(), str(tmp_path))
    if fault:
        with pytest.raises(IndexError) as error:
            maximise(problem, "stochastic", generations=3, candidates=1, progress=False)
        assert error.value.__notes__[0].startswith("a fault of mine.py, line ")
        return
    found = maximise(problem, "stochastic", generations=60, candidates=1, progress=False)
    assert found.best["x"] == pytest.approx(0.5, abs=0.2)
    assert (tmp_path / "runs.txt").read_text().count("run") == 1


def test_what_has_no_gradients_of_true_designs_is_refused_before_any_work():
    gaits = GaitProblem((Terrain(),), columns=1, encoding="graded", uncertain="friction=20%", draws=4)
    with pytest.raises(ValueError, match="it wants gradients of true designs, which gaits do not have"):
        maximise(gaits, "stochastic", progress=False)


def test_a_request_keeps_its_minibatch_on_the_way_to_workers():
    for minibatch in (None, Minibatch(2, 7, 2**63 - 1)):
        request = Request(np.zeros((4, 2)), "gradients", np.inf, minibatch)
        assert unpacked_request(packed_request(request, "s")[1])[1].minibatch == minibatch
        assert request.part(1, 3).minibatch == minibatch
    assert packed_request(Request(np.zeros((4, 2))), "s")[0] != packed_request(request, "s")[0]


def crawler():
    """Three voxels that swell in turn, on a time scale of milliseconds."""
    places = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0]])
    soft = Material(1e5, 1000.0, static_friction=1.0, kinetic_friction=0.8, internal_damping=1.0)
    body = LatticeBody(places, (soft,), np.zeros(3, int), 0.01, places[:, 0])
    front = Drive("front", (0,), amplitude=Free(0.0, 0.2), phase=0.1)
    rear = Drive("rear", (2,), amplitude=0.1, phase=Free(0.0, 1.0))
    drives = front, rear
    return LatticeRobot(body, drives, frequency=20.0, cycles=1, settling=0.01)


@pytest.mark.kernels
@pytest.mark.parametrize("given", ["draws", "worlds"])
def test_the_mean_over_the_minibatches_is_the_objective_with_its_gradient(given):
    worlds = {"draws": (Terrain(),), "worlds": (Terrain(), Terrain(5.0), Terrain(10.0), Terrain(15.0))}[given]
    uncertain = {"uncertain": "friction=20%,slope=2,levels=10%", "draws": 4} if given == "draws" else {}
    problem = RobotProblem(crawler(), worlds, threads=1, **uncertain)
    points = problem.space.sample(np.random.default_rng(3), 2)
    whole = evaluate_request(problem, Request(points, "gradients", np.inf))
    parts = [evaluate_request(problem, Request(points, "gradients", np.inf, Minibatch(2, n, 9))) for n in range(2)]
    assert np.mean([part.objectives for part in parts], axis=0) == pytest.approx(whole.objectives, rel=1e-9)
    assert np.mean([part.gradients for part in parts], axis=0) == pytest.approx(whole.gradients, rel=1e-9)
    assert not np.array_equal(parts[0].objectives, parts[1].objectives)


@pytest.mark.kernels
def test_vehicles_are_judged_in_a_few_environments():
    problem = VehicleProblem()
    points = problem.space.sample(np.random.default_rng(0), 2)
    count = len(problem.task.starts)
    parts = [problem.in_minibatch(Minibatch(1, n, 5)).evaluate(points).objectives for n in range(count)]
    assert np.sum(parts, axis=0) == pytest.approx(problem.evaluate(points).objectives, rel=1e-12)
    problem.check_minibatch(1)
    with pytest.raises(ValueError, match="minibatch_size: 1 is not allowed with objectives 'environments'; choose tot"):
        VehicleProblem(objectives="environments").check_minibatch(1)


@pytest.mark.kernels
def test_gaits_of_the_inflatable_robot_are_judged_in_a_few_draws():
    uncertain = {"uncertain": "friction=20%,levels=5%", "draws": 4}
    problem = GaitProblem(
        (Terrain(5.0),),
        columns=1,
        encoding="graded",
        geometry="small",
        steps=1000,
        ramp_steps=200,
        threads=1,
        **uncertain,
    )
    points = problem.space.sample(np.random.default_rng(3), 2)
    whole = problem.evaluate(points)
    parts = [problem.in_minibatch(Minibatch(2, n, 9)).evaluate(points) for n in range(2)]
    assert (whole.status == "ok").all() and not np.array_equal(parts[0].objectives, parts[1].objectives)
    assert np.mean([part.objectives for part in parts], axis=0) == pytest.approx(whole.objectives, rel=1e-9)
    GaitProblem((Terrain(),), columns=1).check_minibatch(1)  # all of it


@pytest.mark.kernels
def test_the_worst_of_several_takes_several():
    """Of one world, of which nothing is uncertain, a minibatch is all."""
    robot = crawler()
    alone = RobotProblem(robot, (Terrain(),), objective="worst")
    alone.check_minibatch(1)
    point = alone.space.sample(np.random.default_rng(0), 1)
    assert alone.in_minibatch(Minibatch(1)).evaluate(point).objectives == alone.evaluate(point).objectives
    worst = RobotProblem(robot, (Terrain(),), uncertain="friction=20%", draws=4, risk="worst")
    with pytest.raises(ValueError, match="minibatch_size: 1 is not allowed with worst of several draws; give at least"):
        maximise(worst, "stochastic", progress=False)
    worst.check_minibatch(2)
    several = RobotProblem(robot, (Terrain(), Terrain(5.0)), objective="worst")
    with pytest.raises(ValueError, match="minibatch_size: 1 is not allowed with worst of several worlds; give at leas"):
        maximise(several, "nes", minibatch_size=1, progress=False)
    with pytest.raises(ValueError, match="minibatch_size: FunctionProblem judges in all worlds at once, and cannot in"):
        maximise(lambda points: points[:, 0], "nes", bounds={"x": (0, 1)}, minibatch_size=1, progress=False)
