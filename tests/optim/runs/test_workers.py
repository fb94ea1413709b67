"""Requests judged in worker processes: the same bits, whatever dies."""

import dataclasses
import os
import signal
import subprocess
import sys
import threading
from types import SimpleNamespace

import numpy as np
import pytest
from worker_checks import GAITS, PATHS, Workers, lives, numbers, same, short_gaits, stopped, wait_for
from worker_problems import Awkward, Bowl, Fatal, Threads, Unloadable, sample

from optim.problem import Evaluation, Request, evaluate_request
from optim.runs.requests import failures, join
from optim.runs.workers import open_workers, ray_cluster
from optim.runs.workers.batch import Batch

pytestmark = pytest.mark.long


@pytest.fixture
def workers(tmp_path):
    return Workers(tmp_path)


REQUESTS = [
    Request(sample(23)),
    Request(sample(1)),
    Request(sample(20), "gradients", 0.3),
    Request(sample(3), "relaxed"),
]


@pytest.mark.parametrize("count", [1, 2, 3])
def test_the_number_of_workers_changes_no_bit(workers, count):
    with workers.open(Bowl(), count, part=5) as evaluate:
        for request in REQUESTS:
            assert same(evaluate(request), evaluate_request(Bowl(), request))
            assert workers.progress == sorted(workers.progress) and workers.progress[-1] == 1.0
            workers.progress.clear()
    assert workers.notes == workers.saved == []


def test_no_points_are_judged_too(workers):
    with workers.open(Bowl(), 1) as evaluate:
        assert evaluate(Request(sample(0))).objectives.shape == (0, 1)


def test_parts_come_in_any_order():
    request = Request(sample(50))
    whole = evaluate_request(Bowl(), request)
    batch = Batch(request, 7)
    taken = [batch.take() for _ in range(8)]
    assert batch.take() is None and not batch.complete
    for part, piece in reversed(taken):
        batch.put(part, evaluate_request(Bowl(), piece))
    assert batch.complete and batch.fraction == 1 and same(batch.joined(whole), whole)


def test_failures_join_with_any_judgement():
    details = {"text": np.array(["a", "b"]), "matrix": np.ones((2, 3, 4)), "whole": np.array([1, 2])}
    other = Evaluation(np.ones(2), details=details, gradients=np.ones((2, 5)))
    both = join([other, failures(other, 3, "lost")])
    assert both.status.tolist() == ["ok"] * 2 + ["lost"] * 3 and np.isnan(both.objectives[2:]).all()
    assert np.isnan(both.gradients[2:]).all() and np.isnan(both.details["matrix"][2:]).all()
    assert both.details["whole"].tolist() == [1, 2, 0, 0, 0] and both.details["whole"].dtype == int
    assert both.details["text"].tolist() == ["a", "b", "", "", ""]


@pytest.mark.parametrize(("number", "name"), [(signal.SIGKILL, "SIGKILL"), (40, "signal 40")])
def test_a_killed_worker_is_replaced(workers, tmp_path, number, name):
    problem = Bowl(pids=tmp_path, hold=tmp_path / "go")
    request = Request(sample(12))

    def strike():
        os.kill(wait_for(lambda: len(found := numbers(tmp_path)) == 2 and found)[0], number)
        wait_for(lambda: len(workers.notes) == 1)
        problem.hold.touch()

    thread = threading.Thread(target=strike)
    thread.start()
    with workers.open(problem) as evaluate:
        judgement = evaluate(request)
    thread.join()
    assert same(judgement, evaluate_request(Bowl(), request))
    assert len(workers.notes) == 1 and f"a worker died (killed by {name}) with designs " in workers.notes[0]


def test_a_worker_killed_while_idle_costs_nothing(workers, tmp_path):
    with workers.open(Bowl(pids=tmp_path), 1) as evaluate:
        evaluate(Request(sample(3)))
        (pid,) = numbers(tmp_path)
        os.kill(pid, signal.SIGKILL)
        wait_for(lambda: not lives(pid))
        assert same(evaluate(Request(sample(4))), evaluate_request(Bowl(), Request(sample(4))))
    assert workers.notes == ["a worker died while it was idle; it is replaced"]


def chosen(evaluation, rows):
    """The judgement of some points."""
    details = {name: values[rows] for name, values in evaluation.details.items()}
    return Evaluation(evaluation.objectives[rows], evaluation.status[rows], details, evaluation.gradients[rows])


@pytest.mark.parametrize("part", [4, 16])
def test_designs_that_kill_are_found_and_saved(workers, part):
    points = sample(12)
    poison = np.sort(points[:, 0])[-2]  # above it there is one
    with workers.open(Bowl(poison=poison), part=part) as evaluate:
        judgement = evaluate(Request(points, "gradients", 0.5))
    killer = points[:, 0] > poison
    whole = evaluate_request(Bowl(), Request(points, "gradients", 0.5))
    assert judgement.status[killer].tolist() == ["killed its worker"]
    assert np.isnan(judgement.objectives[killer]).all() and np.isnan(judgement.gradients[killer]).all()
    assert np.isnan(judgement.details["pair"][killer]).all()
    assert same(chosen(judgement, ~killer), chosen(whole, ~killer))
    ((saved, reason),) = workers.saved
    assert np.array_equal(saved, points[killer]) and reason == "killed its worker"
    assert "1 of 12 designs killed their workers and failed; saved in " in workers.notes[-1]
    assert workers.notes[-1].endswith("failed.npz") and not any("\n" in note for note in workers.notes)


def test_if_every_design_kills_the_fault_is_not_theirs(workers):
    message = r"every design killed its worker twice, .* see .*failed.npz"
    with workers.open(Bowl(poison=-np.inf)) as evaluate, pytest.raises(RuntimeError, match=message):
        evaluate(Request(sample(2)))
    assert np.array_equal(workers.saved[0][0], sample(2))


@pytest.mark.parametrize("wants", ["points", "gradients"])
def test_a_request_that_only_kills_has_failed_if_others_have_been_judged(workers, wants):
    deadly = Request(np.array([[5.0, 1.0]]), wants)
    with workers.open(Bowl(poison=4.0), 1) as evaluate:
        evaluate(Request(np.zeros((3, 2))))
        judgement = evaluate(deadly)
    assert judgement.status.tolist() == ["killed its worker"] and np.isnan(judgement.objectives).tolist() == [[True]]
    assert (judgement.gradients is not None) == (wants == "gradients")
    assert wants == "points" or np.isnan(judgement.gradients).tolist() == [[True, True]]
    assert judgement.details.keys() == {"pair", "count"}
    assert np.array_equal(workers.saved[0][0], deadly.points)


def test_workers_that_die_at_start_end_in_one_line(workers):
    message = r"3 died one after the other .* \(exit code 3\)"
    with workers.open(Fatal()) as evaluate, pytest.raises(RuntimeError, match=message):
        evaluate(Request(sample(2)))


@pytest.mark.parametrize("error", [ValueError("x: bad"), OSError(2, "no file"), ZeroDivisionError("zero")])
def test_an_exception_of_the_problem_passes_through(workers, tmp_path, error):
    problem = Bowl(error=error, pids=tmp_path)
    good = Request(np.ones((5, 2)))
    with workers.open(problem, 1) as evaluate:
        with pytest.raises(type(error)) as caught:
            evaluate(Request(np.full((5, 2), -4.5)))
        assert str(caught.value) == str(error) and "worker_problems.py" in caught.value.__notes__[0]
        assert same(evaluate(good), evaluate_request(Bowl(), good))  # nothing stale is left
    assert workers.notes == [] and len(numbers(tmp_path)) == 1


def test_an_exception_that_cannot_travel_is_described(workers):
    with workers.open(Awkward(), 1) as evaluate, pytest.raises(RuntimeError, match="PickyError: one two"):
        evaluate(Request(sample(1)))


def test_a_problem_that_cannot_be_loaded_is_one_line(workers):
    message = r"cannot be loaded in one \(ValueError: invalid literal"
    with workers.open(Unloadable(), 1) as evaluate, pytest.raises(RuntimeError, match=message):
        evaluate(Request(sample(1)))


def test_threads_are_set_before_libraries_are_loaded(workers):
    before = os.environ.get("OMP_NUM_THREADS")
    with workers.open(Threads(), 1, threads=3) as evaluate:
        assert evaluate(Request(sample(1))).objectives.tolist() == [[3.0]]
    assert os.environ.get("OMP_NUM_THREADS") == before


def test_workers_leave_stdout_alone(workers, capfd):
    with workers.open(Bowl(), 1) as evaluate:
        evaluate(Request(sample(1)))
    out, error = capfd.readouterr()
    assert out == "" and "chatter of a worker" in error


@pytest.mark.parametrize("reason", [KeyboardInterrupt, ValueError])
def test_whatever_ends_the_block_ends_the_workers_at_once(workers, tmp_path, reason):
    problem = Bowl(pids=tmp_path, hold=tmp_path / "never")

    def give_up(line):
        raise reason

    def strike():
        os.kill(wait_for(lambda: len(found := numbers(tmp_path)) == 2 and found)[0], signal.SIGKILL)

    thread = threading.Thread(target=strike)
    thread.start()
    told = {"save_failed": workers.save, "note": give_up}
    with pytest.raises(reason), open_workers(problem, count=2, **told) as evaluate:
        evaluate(Request(sample(4)))
    thread.join()
    assert not any(map(lives, numbers(tmp_path)))
    assert not any(os.path.exists(f"/proc/{pid}") for pid in numbers(tmp_path))  # nor are there zombies


def test_ctrl_c_ends_program_and_workers(tmp_path):
    code, error = stopped(tmp_path, "processes", signal.SIGINT)
    assert code == 130 and error == "interrupted; notes: []; threads: 1\n"


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM])
def test_workers_do_not_outlive_their_parent(tmp_path, how):
    assert stopped(tmp_path, "processes", how)[0] == -how


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"count": 0}, "count: 0 is not allowed"),
        ({"threads": 0}, "threads: 0 is not allowed"),
        ({"part": 1.5}, "part: 1.5 is not allowed"),
        ({"backend": "threads"}, "backend: 'threads' is unknown; choose one of processes, ray"),
        ({"address": "auto"}, "address: 'auto' is not allowed with processes; it belongs to ray or folder"),
    ],
)
def test_settings_that_are_not_allowed_are_one_line(workers, options, message):
    with pytest.raises(ValueError, match=message), workers.open(Bowl(), **options):
        pass


def test_a_problem_that_cannot_be_pickled_is_one_line(workers):
    problem = dataclasses.replace(Bowl(), error=lambda: None)
    with pytest.raises(ValueError, match="problem: it cannot be sent to workers"), workers.open(problem):
        pass


@pytest.mark.parametrize(
    ("error", "said", "message"),
    [
        (ConnectionError("Failed to connect"), "Unauthenticated: RPC error: InvalidAuthToken: Authentication", "token"),
        (RuntimeError("Token authentication is enabled but no authentication token was found"), "", "token"),
        (ConnectionError("Failed to connect"), "some other trouble", "no cluster"),
    ],
)
def test_a_cluster_that_asks_for_a_token_is_told_as_such(capfd, error, said, message):
    def init(*_, **__):
        os.write(2, said.encode())
        raise error

    messages = {
        "token": r"^ray: the cluster at host:1 asks for a token, and this machine's is missing or another; [^\n]+$",
        "no cluster": r"^ray: no cluster answers at host:1 \(Failed to connect\); start one by 'ray start --head'",
    }
    with pytest.raises(ValueError, match=messages[message]):
        ray_cluster._connect(SimpleNamespace(init=init), "host:1", 1)
    assert capfd.readouterr().err == ""
    os.write(2, b"stderr is as it was")
    assert capfd.readouterr().err == "stderr is as it was"


def test_importing_workers_imports_no_ray():
    program = "import sys, optim.runs.workers; print([m for m in ('ray', 'robots', 'taichi') if m in sys.modules])"
    environment = {**os.environ, "PYTHONPATH": PATHS}
    out = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True)
    assert out.stdout == "[]\n"


@pytest.mark.slow
@pytest.mark.kernels
def test_gradients_of_gaits_are_the_same_bits_however_they_are_cut(workers):
    problem = short_gaits("f64")
    request = Request(GAITS[:3], "gradients", 0.3)
    with workers.open(problem) as evaluate:  # parts of two and of one, where here there is one of three
        judgement = evaluate(request)
    assert np.all(judgement.gradients != 0) and same(judgement, evaluate_request(problem, request))


@pytest.mark.kernels
@pytest.mark.parametrize(("precision", "count"), [("f32", 2), ("f64", 1)])
def test_gaits_are_judged_to_the_same_bits(workers, precision, count):
    problem = short_gaits(precision)
    request = Request(GAITS)
    with workers.open(problem, count, part=3) as evaluate:
        judgement = evaluate(request)
    assert same(judgement, problem.evaluate(request.points))
