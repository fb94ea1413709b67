"""Parts of a study beside each other: what they leave, and what happens if one fails."""

import json
import multiprocessing
import os
import signal
import threading
from functools import partial

import jobs_to_do
import pytest
from hill import Hill, search
from worker_checks import numbers, wait_for

from optim.experiments.jobs import run_parallel
from optim.studies.beyond.gait_hunt import study as hunting
from robots.inflatable import simulation

pytestmark = pytest.mark.long


@pytest.fixture
def nine_cores(monkeypatch):
    monkeypatch.setattr("optim.experiments.jobs.available_threads", lambda: 9)


def test_all_is_done_by_so_many_processes(tmp_path, nine_cores):
    seen, tasks = [], [(name, partial(jobs_to_do.leave, tmp_path, name)) for name in "abcde"]
    run_parallel(tasks, 2, {"precision": "f32"}, seen.append)
    left = [(tmp_path / name).read_text().split() for name in "abcde"]
    assert all(one[:2] == ["4", "4"] for one in left)
    assert len({one[2] for one in left}) == 5 and str(os.getpid()) not in {one[2] for one in left}
    assert seen == sorted(seen) and seen[-1] == 1.0 and len(seen) == 10


def test_one_job_is_none_beside_the_study(tmp_path):
    run_parallel([("a", partial(jobs_to_do.leave, tmp_path, "a"))], 1, {}, None)
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(ValueError, match=r"^jobs: 0 is not allowed"):
        run_parallel([], 0, {}, None)


def test_fewer_parts_than_jobs_have_more_of_the_machine(tmp_path, nine_cores):
    run_parallel([(name, partial(jobs_to_do.leave, tmp_path, name)) for name in "abc"], 8, {})
    assert {(tmp_path / name).read_text().split()[0] for name in "abc"} == {"3"}


def test_threads_that_were_asked_for_stay(tmp_path):
    run_parallel([("a", partial(jobs_to_do.leave, tmp_path, "a"))], 2, {"threads": 7}, None)
    assert (tmp_path / "a").read_text().split()[0] == "7"


def test_warnings_are_notes_of_a_line(tmp_path, capfd):
    run_parallel([("a", partial(jobs_to_do.warn, tmp_path))], 2, {})
    assert capfd.readouterr().err == "morpholab worker: note: kite: it has no tail\n"


@pytest.mark.parametrize(
    ("task", "error", "message"),
    [
        (jobs_to_do.refuse, ValueError, "^kite: it does not fly"),
        (jobs_to_do.stumble, RuntimeError, "^Wordy: kite: it fell"),
        (jobs_to_do.panic, RuntimeError, "^Panic: it fell"),
        (jobs_to_do.interrupt, KeyboardInterrupt, "^$"),
        (jobs_to_do.die, RuntimeError, r"^bad: its process ended \(killed by SIGKILL\)"),
    ],
)
def test_a_part_that_fails_ends_the_others(tmp_path, task, error, message):
    with pytest.raises(error, match=message):
        run_parallel([("long", partial(jobs_to_do.wait, tmp_path)), ("bad", partial(task, tmp_path))], 2, {}, None)
    assert len(numbers(tmp_path)) == 1 and multiprocessing.active_children() == []


@pytest.fixture
def interruptible():
    """A shell's background job ignores Ctrl-C, and what it starts does so, too."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("interruptible")
def test_an_interrupt_ends_all(tmp_path):
    def strike():
        try:
            wait_for(lambda: len(numbers(tmp_path)) == 2)
        finally:
            signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)  # as Ctrl-C, which the main thread gets

    thread = threading.Thread(target=strike)
    thread.start()
    with pytest.raises(KeyboardInterrupt):
        run_parallel([(name, partial(jobs_to_do.wait, tmp_path)) for name in "ab"], 2, {}, None)
    thread.join()
    assert len(numbers(tmp_path)) == 2 and multiprocessing.active_children() == []


def test_a_hunt_in_two_processes_finds_the_same(tmp_path, monkeypatch):
    monkeypatch.setattr(hunting, "search_once", search)
    monkeypatch.setattr(simulation, "simulate", Hill())  # of the finalists
    settings = hunting.Hunt(20, (0, 1), ("genetic",), finalists=1, runs=1)
    hunting.study(tmp_path / "one", settings, threads=1)
    hunting.study(tmp_path / "two", settings, jobs=2)
    assert (tmp_path / "one/table.md").read_text() == (tmp_path / "two/table.md").read_text()
    rows = [json.loads((tmp_path / name / "summary.json").read_text())["runs"] for name in ("one", "two")]
    assert [row | {"wall_s": 0} for row in rows[0]] == [row | {"wall_s": 0} for row in rows[1]]
    at_work = [
        {pid for run in (tmp_path / name / "runs").glob("*-*") for pid in numbers(run)} for name in ("one", "two")
    ]
    assert at_work[0] == {os.getpid()} and len(at_work[1] - at_work[0]) == 2
