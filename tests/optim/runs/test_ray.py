"""Requests judged by actors on a Ray cluster of one machine."""

import os
import signal
import socket
import sys
import threading

import numpy as np
import pytest
from worker_checks import GAITS, PATHS, Workers, lives, numbers, same, short_gaits, stopped, wait_for
from worker_problems import Bowl, sample

from optim.problem import Request, evaluate_request
from optim.runs.workers import ray_cluster

pytestmark = [pytest.mark.kernels, pytest.mark.long]  # all share a cluster, which judges with the simulator

pytest.importorskip("ray", reason="needs the extra ray")

REAL_VERSIONS = ray_cluster.versions()
REQUEST = Request(sample(7), "gradients", 0.5)


@pytest.fixture(scope="module")
def address():
    """Of a cluster with two CPUs, which can import what the tests can."""
    from ray.cluster_utils import Cluster

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", PATHS)
        patch.setenv("RAY_worker_niceness", "0")  # by default others go first, of whom a busy machine has many
        cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 2, "include_dashboard": False})
    yield cluster.address
    cluster.shutdown()


@pytest.fixture
def workers(tmp_path, address):
    """Workers on the cluster."""
    return Workers(tmp_path, backend="ray", address=address)


@pytest.mark.parametrize("count", [1, 2])
def test_a_cluster_changes_no_bit(workers, count, capfd):
    before = signal.getsignal(signal.SIGTERM)
    with workers.open(Bowl(), count, part=3) as evaluate:
        assert same(evaluate(REQUEST), evaluate_request(Bowl(), REQUEST))
    assert workers.notes == [] and workers.progress[-1] == 1
    assert capfd.readouterr().out.count("chatter") == 1  # of the judgement here
    assert signal.getsignal(signal.SIGTERM) is before


def test_there_are_as_many_workers_as_the_cluster_has_cores(workers, tmp_path):
    problem = Bowl(pids=tmp_path, hold=tmp_path / "go")
    thread = threading.Thread(target=lambda: (wait_for(lambda: len(numbers(tmp_path)) == 2), problem.hold.touch()))
    thread.start()
    with workers.open(problem, None) as evaluate:
        evaluate(REQUEST)
    thread.join()
    assert len(numbers(tmp_path)) == 2


def test_gaits_are_judged_to_the_same_bits(workers):
    problem = short_gaits("f32")
    request = Request(GAITS)
    with workers.open(problem, 1, part=3) as evaluate:
        judgement = evaluate(request)
    assert same(judgement, problem.evaluate(request.points))


def test_a_killed_actor_is_replaced(workers, tmp_path, capfd):
    problem = Bowl(pids=tmp_path, hold=tmp_path / "go")

    def strike():
        os.kill(wait_for(lambda: len(found := numbers(tmp_path)) == 2 and found)[0], signal.SIGKILL)
        wait_for(lambda: len(workers.notes) == 1)
        problem.hold.touch()

    thread = threading.Thread(target=strike)
    thread.start()
    with workers.open(problem) as evaluate:
        judgement = evaluate(REQUEST)
    thread.join()
    assert capfd.readouterr().out == ""  # Ray speaks of it, too
    assert same(judgement, evaluate_request(Bowl(), REQUEST))
    assert len(workers.notes) == 1 and "a worker died (" in workers.notes[0] and "\n" not in workers.notes[0]
    wait_for(lambda: not any(map(lives, numbers(tmp_path))))


def test_a_design_that_kills_is_found(workers):
    points = np.array([[1.0, 0.0], [2.0, 1.0]])
    with workers.open(Bowl(poison=1.5)) as evaluate:
        judgement = evaluate(Request(points))
    assert judgement.status.tolist() == ["ok", "killed its worker"]
    assert np.array_equal(workers.saved[0][0], points[1:])


def test_an_exception_of_the_problem_passes_through(workers):
    with workers.open(Bowl(error=OSError(2, "no file")), 1) as evaluate, pytest.raises(OSError, match="no file"):
        evaluate(Request(np.full((1, 2), -4.5)))


def test_other_versions_are_refused(workers, monkeypatch):
    monkeypatch.setattr(ray_cluster, "versions", lambda added: {**REAL_VERSIONS, "numpy": "1.0"})
    with (
        workers.open(Bowl(), 1) as evaluate,
        pytest.raises(ValueError, match=r"has numpy 2\..*, this machine 1\.0; install the same there"),
    ):
        evaluate(REQUEST)


def test_another_patch_release_of_python_and_another_cpu_will_do(workers, monkeypatch):
    release = REAL_VERSIONS["python"].rpartition(".")[0] + ".999"
    monkeypatch.setattr(ray_cluster, "versions", lambda added: {**REAL_VERSIONS, "python": release})
    monkeypatch.setattr(ray_cluster, "cpu_model", lambda: "abacus")
    with workers.open(Bowl()) as evaluate:
        evaluate(REQUEST)
    assert len(workers.notes) == 1 and "than this machine (abacus); results may differ" in workers.notes[0]


def test_a_cluster_that_is_too_small_is_noted(workers, monkeypatch):
    monkeypatch.setattr(ray_cluster, "NOTE_AFTER", np.inf)
    held = Bowl(pids=workers.folder, hold=workers.folder / "go")

    def hurry():
        wait_for(lambda: len(numbers(workers.folder)) == 2)  # a start takes two seconds, of a busy machine a minute
        monkeypatch.setattr(ray_cluster, "NOTE_AFTER", 0.5)
        wait_for(lambda: workers.notes)
        held.hold.touch()

    thread = threading.Thread(target=hurry)
    thread.start()
    with workers.open(held, 3) as evaluate:
        judgement = evaluate(REQUEST)
    thread.join()
    assert same(judgement, evaluate_request(Bowl(), REQUEST))
    assert workers.notes == ["ray: 2 of 3 workers run; the others wait for free CPUs of the cluster"]


def test_a_cluster_without_any_place_is_one_line(workers, monkeypatch):
    monkeypatch.setattr(ray_cluster, "NOTE_AFTER", 0.1)
    monkeypatch.setattr(ray_cluster, "GIVE_UP_AFTER", 0.5)
    message = r"ray: none of 2 workers could be started in 0\.5 s; the cluster has too few free CPUs"
    with workers.open(Bowl(), threads=99) as evaluate, pytest.raises(RuntimeError, match=message):
        evaluate(REQUEST)
    assert workers.notes == ["ray: 0 of 2 workers run; the others wait for free CPUs of the cluster"]


@pytest.mark.parametrize("wrong", ["somewhere", "host:0", "host:70000", "http://host:80", "host:port", ""])
def test_what_is_no_address_is_refused(tmp_path, wrong):
    with pytest.raises(ValueError, match="is not an address; give HOST:PORT"):
        Workers(tmp_path).open(Bowl(), backend="ray", address=wrong).__enter__()


@pytest.mark.parametrize("scheme", ["", "ray://"])
def test_a_closed_port_is_one_line_at_once(tmp_path, scheme):
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))  # and does not listen
        there = f"{scheme}127.0.0.1:{closed.getsockname()[1]}"
        with pytest.raises(ValueError, match=rf"ray: no cluster answers at {there} \(Connection refused\); start one"):
            Workers(tmp_path).open(Bowl(), backend="ray", address=there).__enter__()


def test_without_ray_one_line_says_how_to_install_it(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(ValueError, match=r"^ray: it is missing; install the extra ray \(pip install -e '.\[ray\]' in"):
        Workers(tmp_path).open(Bowl(), backend="ray").__enter__()


def test_ctrl_c_ends_program_cluster_and_workers(tmp_path):
    code, error = stopped(tmp_path, "ray", signal.SIGINT)
    assert code == 130 and error == "interrupted; notes: []; threads: 1\n"
