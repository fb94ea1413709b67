"""Workers around a shared folder: the same bits, whoever dies, whatever is damaged, and data alone."""

import multiprocessing
import os
import random
import signal
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from worker_checks import Workers, same

from optim.problem import Request, evaluate_request
from optim.problems.user_file import FileProblem
from optim.runs import open_run, run_search
from optim.runs.config import settings_of
from optim.runs.workers import folder_files, open_workers, shared_folder
from optim.runs.workers.folder_files import CLAIMED, DONE, OPEN, Gone, Offer
from optim.runs.workers.folder_worker import FolderWorker
from optim.runs.workers.service import Raised
from optim.search import build_method, default_settings

SOURCE = b"""
import numpy as np
from optim import Evaluation

bounds = {"x": (-1, 1), "on": (0, 1, "binary")}


def evaluate(points):
    if (points[:, 0] > 0.999).any():
        raise OSError("no more than 0.999")
    details = {"pair": np.sin(points), "word": np.where(points[:, 0] > 0, "right", "left")}
    return Evaluation(np.where(points[:, 0] < -0.9, np.nan, np.exp(points[:, 0]) / 3), details=details)
"""
PROBLEM = FileProblem("steep.py", SOURCE, ".")
REQUEST = Request(PROBLEM.space.sample(np.random.default_rng(0), 11))


class Here:
    """Evaluates in the worker's own process."""

    def __init__(self, before=lambda request, beat: None):
        self.before = before

    def evaluate(self, request, beat):
        self.before(request, beat)
        try:
            return evaluate_request(PROBLEM, request)
        except OSError as error:
            return Raised(error)

    def close(self):
        pass


@pytest.fixture
def workers(tmp_path):
    return Workers(tmp_path, backend="folder", address=str(tmp_path / "shared"), silence=60.0)


@pytest.fixture
def crew(tmp_path):
    """Starts workers in threads, which end with the test."""
    folder, threads = tmp_path / "shared", []
    folder_files.make_folders(folder)

    def start(evaluator=None, **options):
        worker = FolderWorker(folder, lambda offer: evaluator or Here(), name=f"worker{len(threads)}", **options)
        threads.append(threading.Thread(target=worker.serve))
        threads[-1].start()
        return worker

    yield start
    folder_files.end_workers(folder)
    for thread in threads:
        thread.join()


def wait_for(condition):
    while not (value := condition()):
        time.sleep(0.002)
    return value


@pytest.mark.parametrize("count", [1, 3, 16])
def test_the_number_of_parts_changes_no_bit(workers, crew, count):
    crew(), crew()
    with workers.open(PROBLEM, count, part=4) as evaluate:
        for _ in range(2):
            assert same(evaluate(REQUEST), evaluate_request(PROBLEM, REQUEST))
    assert workers.notes == workers.saved == [] and workers.progress[-1] == 1.0


def test_equal_parts_have_an_answer_each(workers, crew):
    crew()
    twice = Request(REQUEST.points[[0, 0, 0]])
    with workers.open(PROBLEM, 3) as evaluate:
        assert same(evaluate(twice), evaluate_request(PROBLEM, twice))


def searched(folder, **options):
    """The log of a short search."""
    chosen = {**default_settings("hill-climb"), "climbers": 8, "seed": 2}
    method = build_method("hill-climb", PROBLEM.space, chosen)
    with open_run(folder, settings_of(PROBLEM, "hill-climb", chosen, 3)) as run:
        if not options:
            run_search(PROBLEM, method, run, 3)
        else:
            with open_workers(PROBLEM, **options) as evaluate:
                run_search(PROBLEM, method, run, 3, evaluate=evaluate)
    return (folder / "log.jsonl").read_bytes()


def work_and_die(folder, number):
    """A worker of a process of its own, which kills itself at three parts of ten."""
    draw = random.Random(number)

    def perhaps_die(request, beat):
        time.sleep(0.01)
        if draw.random() < 0.3:
            os.kill(os.getpid(), signal.SIGKILL)

    FolderWorker(folder, lambda offer: Here(perhaps_die)).serve()


def keep_working(folder, dead):
    """Keep four such workers at work until the search has ended, counting those that have died."""
    start = multiprocessing.get_context("fork").Process
    working, number = [], 0
    while not (folder / folder_files.STOP).exists():
        dead.value += sum(process.exitcode == -signal.SIGKILL for process in working)
        working = [process for process in working if process.is_alive()]
        while len(working) < 4:
            working.append(start(target=work_and_die, args=(folder, number)))
            working[-1].start()
            number += 1
        time.sleep(0.01)
    for process in working:
        process.join()


@pytest.mark.long
def test_workers_of_whom_a_third_is_killed_leave_the_same_log(tmp_path):
    folder, notes = tmp_path / "shared", []
    folder_files.make_folders(folder)
    context = multiprocessing.get_context("fork")
    dead = context.Value("i", 0)
    keeper = context.Process(target=keep_working, args=(folder, dead))
    keeper.start()
    try:
        options = {"backend": "folder", "address": str(folder), "silence": 0.25, "count": 4}
        log = searched(tmp_path / "killed", save_failed=None, note=notes.append, **options)
    finally:
        folder_files.end_workers(folder)
        keeper.join()
    assert log == searched(tmp_path / "whole")
    assert dead.value >= 3 and sum("has been silent for 0.25 s: its part is given to others" in n for n in notes) >= 3
    assert folder_files.parts_in(folder, DONE) == folder_files.parts_in(folder, OPEN) == []


def test_a_silent_worker_that_answers_after_all_is_taken_once(workers, crew):
    asleep, awake = threading.Event(), threading.Event()

    def sleep_once(request, beat):
        if not asleep.is_set():
            asleep.set()
            awake.wait(60)  # if an assertion below fails, the crew ends all the same
            beat()

    crew(Here(sleep_once))
    with workers.open(PROBLEM, 1, silence=0.2) as evaluate, ThreadPoolExecutor(1) as pool:
        found = pool.submit(evaluate, REQUEST)
        asleep.wait()
        wait_for(lambda: workers.notes)
        second = crew()
        assert same(found.result(), evaluate_request(PROBLEM, REQUEST))
        wait_for(lambda: second.parts)  # it counts a part after it has answered
        assert second.parts == 1
        awake.set()
        late = wait_for(lambda: folder_files.parts_in(workers.folder / "shared", DONE))  # nobody waits for it
        other = Request(REQUEST.points[:3])
        assert len(late) == 1 and same(evaluate(other), evaluate_request(PROBLEM, other))
    assert workers.notes == ["worker0 has been silent for 0.2 s: its part is given to others"]


def test_a_part_that_takes_long_is_given_to_an_idle_worker_too(workers, crew, monkeypatch):
    monkeypatch.setattr(shared_folder, "LOOK_EVERY", 0.02)
    slow, awake, tried = REQUEST.points[4], threading.Event(), []

    def sleep_over_the_slow_one(request, beat):
        if (request.points == slow).all(axis=1).any():
            tried.append(request)
            if len(tried) == 1:
                awake.wait(60)

    for _ in range(2):
        crew(Here(sleep_over_the_slow_one))
    with workers.open(PROBLEM, 11) as evaluate:  # whose silence is noticed after a minute
        assert same(evaluate(REQUEST), evaluate_request(PROBLEM, REQUEST)) and len(tried) >= 2
        awake.set()
        other = Request(REQUEST.points[:3])
        assert same(evaluate(other), evaluate_request(PROBLEM, other))
    assert workers.notes == []
    shared = workers.folder / "shared"
    assert not any(folder_files.parts_in(shared, state) for state in (OPEN, CLAIMED))


@pytest.mark.parametrize("harm", [lambda b: b[: len(b) // 2], lambda b: b[:90] + b"?" + b[91:], lambda b: b""])
def test_a_damaged_answer_is_named_and_judged_again(workers, crew, harm, monkeypatch):
    packed, harmed = folder_files.packed_answer, []

    def harm_once(*given):
        content = packed(*given)
        if harmed:
            return content
        harmed.append(True)
        return harm(content)

    monkeypatch.setattr(folder_files, "packed_answer", harm_once)
    crew()
    with workers.open(PROBLEM, 2) as evaluate:
        assert same(evaluate(REQUEST), evaluate_request(PROBLEM, REQUEST))
    (note,) = workers.notes
    assert f"{workers.folder}/shared/done/" in note and ".npz is damaged (" in note and "\n" not in note


def test_a_part_that_is_damaged_on_its_way_is_put_there_again(workers, crew):
    with workers.open(PROBLEM, 1) as evaluate, ThreadPoolExecutor(1) as pool:
        found = pool.submit(evaluate, REQUEST)
        (part,) = wait_for(lambda: folder_files.parts_in(workers.folder / "shared", OPEN))
        path = folder_files.part_path(workers.folder / "shared", OPEN, part)
        path.write_bytes(path.read_bytes()[:-9])
        crew()
        assert same(found.result(), evaluate_request(PROBLEM, REQUEST))
    assert len(workers.notes) == 1 and "worker0 could not read the part: the checksum does not" in workers.notes[0]


def test_a_folder_that_damages_everything_is_given_up(workers, crew, monkeypatch):
    monkeypatch.setattr(folder_files, "packed_answer", lambda *given: b"rubbish")
    crew()
    with workers.open(PROBLEM, 1) as evaluate, pytest.raises(RuntimeError, match=r"3 times .* cannot be relied on"):
        evaluate(REQUEST)


def test_a_part_that_vanishes_is_put_there_again(workers, crew):
    with workers.open(PROBLEM, 1, silence=0.1) as evaluate, ThreadPoolExecutor(1) as pool:
        found = pool.submit(evaluate, REQUEST)
        (part,) = wait_for(lambda: folder_files.parts_in(workers.folder / "shared", OPEN))
        folder_files.part_path(workers.folder / "shared", OPEN, part).unlink()
        wait_for(lambda: workers.notes)
        crew()
        assert same(found.result(), evaluate_request(PROBLEM, REQUEST))
    assert workers.notes == [f"part {part} has vanished from {workers.folder}/shared: it is put there again"]


def test_designs_that_kill_processes_are_found_and_saved(workers, crew):
    poison = REQUEST.points[:, 0] == REQUEST.points[:, 0].max()

    class Fatal(Here):
        def evaluate(self, request, beat):
            if request.points[:, 0].max() == REQUEST.points[poison, 0]:
                return Gone("killed by SIGSEGV")
            return super().evaluate(request, beat)

    crew(Fatal())
    with workers.open(PROBLEM, 2) as evaluate:
        found = evaluate(REQUEST)
    assert (found.status == "killed its worker").tolist() == poison.tolist()
    assert np.array_equal(workers.saved[0][0], REQUEST.points[poison])
    assert "(killed by SIGSEGV, on worker0)" in workers.notes[0]


def test_a_part_whose_workers_always_fall_silent_counts_as_a_killer(workers, crew, monkeypatch):
    monkeypatch.setattr(shared_folder, "LOSSES", 2)
    poison = REQUEST.points[4]

    class Silent(Here):
        def evaluate(self, request, beat):
            while (request.points == poison).all(axis=1).any() and not (workers.folder / "shared/stop").exists():
                time.sleep(0.01)
            return super().evaluate(request, beat)

    for _ in range(5):
        crew(Silent())
    evaluated = []
    with workers.open(PROBLEM, 11, silence=0.1) as evaluate:
        evaluated.append(evaluate(REQUEST))
        folder_files.end_workers(workers.folder / "shared")
    assert (evaluated[0].status == "killed its worker").nonzero()[0].tolist() == [4]


def test_an_exception_of_the_problem_passes_through(workers, crew):
    crew()
    with workers.open(PROBLEM, 1) as evaluate, pytest.raises(OSError, match=r"no more than 0\.999"):
        evaluate(Request(np.ones((1, 2))))


def test_a_worker_that_is_asked_to_end_gives_its_part_back(workers, crew):
    def stop(request, beat):
        raise KeyboardInterrupt

    folder = workers.folder / "shared"
    with workers.open(PROBLEM, 1) as evaluate, ThreadPoolExecutor(1) as pool:
        found = pool.submit(evaluate, REQUEST)
        wait_for(lambda: folder_files.parts_in(folder, OPEN))
        with pytest.raises(KeyboardInterrupt):
            FolderWorker(folder, lambda offer: Here(stop)).serve()
        assert len(folder_files.parts_in(folder, OPEN)) == 1 and folder_files.parts_in(folder, CLAIMED) == []
        crew()
        assert same(found.result(), evaluate_request(PROBLEM, REQUEST))
    assert workers.notes == []


def test_a_worker_ends_when_the_search_ends_while_it_works(workers, tmp_path):
    folder = tmp_path / "shared"

    def wait_for_end(request, beat):
        folder_files.end_workers(folder)
        beat()
        raise AssertionError

    worker = FolderWorker(folder, lambda offer: Here(wait_for_end))
    with workers.open(PROBLEM, 1):
        part, content = folder_files.packed_request(REQUEST, Offer.read(folder).digest)
        folder_files.part_path(folder, OPEN, part).write_bytes(content)
        assert worker.serve() == "the search has ended" and worker.parts == 0


def test_a_worker_without_a_search_ends_after_its_idle_time(tmp_path):
    folder_files.make_folders(tmp_path)
    begun, cpu = time.monotonic(), time.process_time()
    why = FolderWorker(tmp_path, lambda offer: Here(), idle=0.3).serve()
    assert why == "there was no sign of a search for 0.3 s" and time.monotonic() - begun >= 0.3
    assert time.process_time() - cpu < 0.15


def test_answers_of_a_search_that_was_killed_serve_the_next(workers, crew):
    folder = workers.folder / "shared"
    with workers.open(PROBLEM, 1):
        pass
    part, _ = folder_files.packed_request(REQUEST, Offer.read(folder).digest)
    told = evaluate_request(PROBLEM, REQUEST)
    folder_files.part_path(folder, DONE, part).write_bytes(folder_files.packed_answer(part, "old", told))
    with workers.open(PROBLEM, 1) as evaluate:  # nobody works
        assert same(evaluate(REQUEST), told)


def test_a_part_that_a_worker_still_holds_is_left_to_it(workers, crew):
    folder = workers.folder / "shared"
    told = evaluate_request(PROBLEM, REQUEST)
    with workers.open(PROBLEM, 1):
        pass
    part, content = folder_files.packed_request(REQUEST, Offer.read(folder).digest)
    claim = folder_files.part_path(folder, CLAIMED, f"{part}@old")
    claim.write_bytes(content)
    with workers.open(PROBLEM, 1, silence=0.3) as evaluate:  # it is dead, as is soon noticed
        crew()
        assert same(evaluate(REQUEST), told)
    assert workers.notes == ["old has been silent for 0.3 s: its part is given to others"]


def test_a_part_put_out_again_waits_for_no_claim(workers, crew, monkeypatch):
    unlink, deaths = Path.unlink, []

    def slowly(path, **options):  # the search has read the answer long before the claim is removed
        if CLAIMED in path.parts:
            time.sleep(0.2)
        unlink(path, **options)

    class Dying(Here):
        def evaluate(self, request, beat):
            deaths.append(1)
            return Gone("killed by SIGSEGV") if len(deaths) == 1 else super().evaluate(request, beat)

    monkeypatch.setattr(Path, "unlink", slowly)
    crew(Dying())
    begun = time.monotonic()
    with workers.open(PROBLEM, 1) as evaluate:
        assert same(evaluate(REQUEST), evaluate_request(PROBLEM, REQUEST))
    assert time.monotonic() - begun < 30.0


def test_two_searches_do_not_share_a_folder(workers, tmp_path):
    with workers.open(PROBLEM, 1), pytest.raises(ValueError, match=r"^workers-dir: .*shared is in use"):
        workers.open(PROBLEM, 1).__enter__()


def test_a_problem_that_is_no_data_is_refused(workers):
    from optim.problems.function import problem_of

    with pytest.raises(ValueError, match=r"^workers-dir: a problem of kind 'function' is not told by data alone"):
        workers.open(problem_of(np.sum, {"x": (0, 1)}), 1).__enter__()


@pytest.mark.parametrize("when", ["before a request", "while it waits"])
def test_a_search_whose_shared_folder_was_replaced_leaves_the_other_alone(workers, tmp_path, when):
    """Another search may be at work at the same path."""

    def replace():
        os.rename(tmp_path / "shared", tmp_path / "moved")
        folder_files.make_folders(tmp_path / "shared")
        (tmp_path / "shared" / CLAIMED / "theirs.npz").write_bytes(b"")

    with workers.open(PROBLEM, 1) as evaluate, ThreadPoolExecutor(1) as pool:
        if when == "before a request":
            replace()
        found = pool.submit(evaluate, REQUEST)
        if when == "while it waits":
            wait_for(lambda: folder_files.parts_in(tmp_path / "shared", OPEN))
            replace()
        with pytest.raises(RuntimeError, match=r"shared: the folder was moved or replaced, or its \.lock deleted"):
            found.result()
    assert folder_files.parts_in(tmp_path / "shared", OPEN) == []
    assert folder_files.parts_in(tmp_path / "shared", CLAIMED) == ["theirs"]
