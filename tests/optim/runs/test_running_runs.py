"""Run folders that are read, moved, replaced or interrupted while a run goes on."""

import errno
import json
import os
import tracemalloc
import weakref

import numpy as np
import pytest

from optim.problem import Evaluation
from optim.runs import checkpoint, history, loop, open_run, run_search
from optim.runs.generation import Generation
from optim.runs.history import read_history, read_progress
from optim.search import build_method
from optim.space import Space, Variable
from taichi_sim.base import files
from taichi_sim.base.locks import HeldLock

GENERATIONS = 6
PRODUCTS = ("log.jsonl", "best.json", "config.toml")
FILE = """
import os

bounds, count = {"x": (-1, 1)}, 0


def evaluate(points):
    global count
    count += 1
    if count == 4:
        MEDDLE
    return 1 - points[:, 0] ** 2
"""


class Bowl:
    """A quick problem, during whose fourth generation something happens to the folder."""

    space = Space((Variable("x", -5.0, 5.0, step=0.5),))
    objective_names = ("score",)

    def __init__(self, meddle=lambda: None):
        self.meddle, self.count = meddle, 0

    def describe(self):
        return {"kind": "bowl"}

    def evaluate(self, points):
        self.count += 1
        if self.count == 4:
            self.meddle()
        return Evaluation(-(points**2))

    def save(self, point, path):
        path.write_text(f"{point.tolist()}\n")


def run(path, meddle=lambda: None, seed=0, resume=False):
    settings, problem = {"climbers": 2, "seed": seed}, Bowl(meddle)
    config = {
        "problem": problem.describe(),
        "method": {"name": "hill-climb", **settings},
        "generations": GENERATIONS,
    }
    with open_run(path, config, resume=resume) as folder:
        return run_search(problem, build_method("hill-climb", problem.space, settings), folder, GENERATIONS)


def products(path):
    return {name: (path / name).read_bytes() for name in PRODUCTS}


@pytest.mark.parametrize("replaced", [False, True])
def test_a_run_whose_folder_was_moved_writes_no_more(tmp_path, replaced):
    run(tmp_path / "whole")
    run(tmp_path / "other", seed=1)

    def move():
        os.rename(tmp_path / "a", tmp_path / "moved")
        if replaced:
            run(tmp_path / "a", seed=1)

    with pytest.raises(RuntimeError, match=r"a: the folder was moved or replaced, .*; its 3 complete generations are "):
        run(tmp_path / "a", move)
    assert (tmp_path / "a").exists() == replaced
    if replaced:
        assert products(tmp_path / "a") == products(tmp_path / "other")
    run(tmp_path / "moved", resume=True)
    assert products(tmp_path / "moved") == products(tmp_path / "whole")


def test_a_run_whose_lock_was_deleted_gives_way_to_the_next(tmp_path):
    run(tmp_path / "whole")

    def take_over():
        (tmp_path / "a/.lock").unlink()
        run(tmp_path / "a", resume=True)

    with pytest.raises(RuntimeError, match=r"a: the folder was moved or replaced, or its \.lock deleted, in use; "):
        run(tmp_path / "a", take_over)
    assert products(tmp_path / "a") == products(tmp_path / "whole")


@pytest.mark.parametrize("how", ["os.rename('run', 'moved')", "os.unlink('run/.lock')"])
def test_a_command_whose_folder_was_moved_fails_in_one_line(morpholab, tmp_path, how):
    (tmp_path / "hill.py").write_text(FILE.replace("MEDDLE", how))
    code, out, error = morpholab("codesign --problem hill.py --method hill-climb --generations 6 --out run --quiet")
    assert (code, out, error.count("\n")) == (1, "", 1)
    assert error.startswith("morpholab codesign: failed: run: the folder was moved or replaced, ")


def test_an_interrupted_run_whose_folder_was_replaced_tells_nothing_of_the_other(morpholab, tmp_path):
    how = "os.rename('run', 'moved'); raise KeyboardInterrupt"
    (tmp_path / "hill.py").write_text(FILE.replace("MEDDLE", how))
    code, out, error = morpholab("codesign --problem hill.py --method hill-climb --generations 6 --out run --quiet")
    assert (code, out, error.count("\n")) == (1, "", 1) and "run: the folder was moved or replaced, " in error


def test_a_folder_that_is_replaced_while_it_is_locked_is_refused(tmp_path, monkeypatch):
    flock = history.in_use.__globals__["fcntl"].flock

    def lose(file, how):
        flock(file, how)
        (tmp_path / "a/.lock").unlink()

    monkeypatch.setattr("fcntl.flock", lose)
    with pytest.raises(ValueError, match=r"out: .*a was moved or replaced just now; try again"):
        run(tmp_path / "a")


def line(number, **details):
    return Generation(number, 2 * number + 2, number % 2, 1.0, 1.0, 1.0, None, {"x": 0.0}, details, {}).to_json()


def commit(folder, **details):
    """End a generation of a run."""
    folder.commit(line(folder.lines, **details), {"points": np.full(3, folder.lines)}, 0.5)


@pytest.fixture
def opened(tmp_path):
    """A run of three generations that goes on."""
    config = {"problem": {"kind": "bowl"}, "method": {"name": "hill-climb"}, "generations": 99}
    with open_run(tmp_path / "a", config) as folder:
        for _ in range(3):
            commit(folder)
        yield folder


@pytest.mark.parametrize("read", [read_history, read_progress])
def test_generations_that_end_while_a_run_is_read_are_no_damage(opened, monkeypatch, read):
    """Two of them before each checkpoint is read."""
    content_of = files.content_of

    def late(path, *more):
        if path.name.startswith("checkpoint"):
            commit(opened)
            commit(opened)
        return content_of(path, *more)

    monkeypatch.setattr(files, "content_of", late)
    assert read(opened.path).running and opened.lines == 5


@pytest.mark.parametrize("linked", [True, False])
def test_at_no_moment_is_a_running_run_damaged(opened, monkeypatch, linked):
    """It is read after each call that changes the disk; also where disks have no second names."""
    monkeypatch.setattr(history, "READ_ATTEMPTS", 1)
    seen = []

    def watched(function):
        def call(*arguments, **options):
            result = function(*arguments, **options)
            assert (opened.path / "checkpoint.npz").exists()
            seen.append(len(read_history(opened.path).generations))
            return result

        return call

    def refused(*_):
        raise PermissionError(errno.EPERM, "Operation not permitted")

    with monkeypatch.context() as patch:
        for name in ("replace", "fsync", *(["link"] if linked else [])):
            patch.setattr(os, name, watched(getattr(os, name)))
        if not linked:
            patch.setattr(os, "link", refused)
        commit(opened)
        commit(opened)
    assert seen == sorted(seen) and {3, 4, 5} == set(seen) and len(seen) > 10
    for name, lines in (("checkpoint.npz", 5), ("checkpoint.previous.npz", 4)):
        assert json.loads(files.unpack((opened.path / name).read_bytes())["run/record"].tobytes())["lines"] == lines
    assert os.stat(opened.path / "checkpoint.npz").st_nlink == 1


@pytest.mark.parametrize("running", [True, False])
def test_a_run_is_read_again_only_while_it_goes_on(opened, monkeypatch, running):
    content_of, missing = files.content_of, ["checkpoint.npz", "checkpoint.previous.npz"]

    def late(path, *more):
        if path.name in missing:
            missing.remove(path.name)
            raise FileNotFoundError(path)
        return content_of(path, *more)

    monkeypatch.setattr(files, "content_of", late)
    monkeypatch.setattr(history, "in_use", lambda _: running)
    if running:
        assert len(read_history(opened.path).generations) == 3
    else:
        with pytest.raises(ValueError, match="no checkpoint is left"):
            read_history(opened.path)


def test_progress_is_that_of_the_history_in_little_memory(opened):
    """Of the log's lines one is in memory at a time, also when the run continues, and only the last is understood."""
    for _ in range(60):
        commit(opened, pad=[0.25] * 20_000)
    assert (opened.path / "log.jsonl").stat().st_size > 7e6
    for read in (lambda: read_progress(opened.path), opened.restore):
        tracemalloc.start()
        try:
            read()
            assert tracemalloc.get_traced_memory()[1] < 3e6
        finally:
            tracemalloc.stop()
    progress = read_progress(opened.path)
    assert progress == read_history(opened.path).progress
    assert (progress.complete, progress.failed, progress.last.generation) == (63, 31, 62)


def test_lines_that_begin_in_another_order_are_read_too(opened):
    """As a log of another program's version might."""
    document = json.loads(line(3))
    opened.commit(json.dumps(dict(reversed(document.items()))), {}, 0.5)
    assert read_progress(opened.path) == read_history(opened.path).progress
    opened.commit(line(7), {}, 0.5)
    for read in (read_progress, read_history):
        with pytest.raises(ValueError, match=r"log.jsonl cannot be read \(generation: \[0, 1, 2, 3, 7\] is not"):
            read(opened.path)


def test_a_search_keeps_no_generation_but_the_last(morpholab, tmp_path, monkeypatch):
    record, living, most = loop.record, [], 0

    def watched(*arguments):
        nonlocal most
        found = record(*arguments)
        living.append(weakref.ref(found))
        most = max(most, sum(each() is not None for each in living))
        return found

    monkeypatch.setattr(loop, "record", watched)
    (tmp_path / "hill.py").write_text(FILE.replace("MEDDLE", "pass"))
    line = "codesign --problem hill.py --method hill-climb --generations 20 --out run"
    for quiet in ("", " --quiet --resume --generations 40"):
        assert morpholab(line + quiet)[0] == 0
    assert len(living) == 41 and most <= 3


def test_an_interrupted_search_understands_only_the_last_line(morpholab, tmp_path, monkeypatch):
    understood, generation = [], history._generation
    monkeypatch.setattr(history, "_generation", lambda text: understood.append(text) or generation(text))
    (tmp_path / "hill.py").write_text(FILE.replace("MEDDLE", "raise KeyboardInterrupt"))
    line = "codesign --problem hill.py --method hill-climb --generations 6 --out run --quiet --json"
    code, out, _ = morpholab(line)
    last = (tmp_path / "run/log.jsonl").read_text().splitlines()[2]
    assert code == 130 and json.loads(out) == {"folder": "run", "interrupted": True, **json.loads(last)}
    assert [text.decode() for text in understood] == [last + "\n"]
    # A line that the checkpoint does not cover, as after a kill, is not told.
    with (tmp_path / "run/log.jsonl").open("a") as file:
        file.write(last + "\n" + last[:9])
    assert read_progress(tmp_path / "run").last == generation(last)
    assert checkpoint.load(tmp_path / "run", read_history(tmp_path / "run").found[1].settings)[1].lines == 3


def test_a_lock_that_another_machine_deleted_is_gone(tmp_path, monkeypatch):
    """A network file system says so by an error of its own; any other error is no news of the lock."""
    with (tmp_path / "lock").open("a") as file:
        lock = HeldLock(tmp_path / "lock", file)
        assert lock.found_at_path
        for number, expected in ((errno.ESTALE, RuntimeError), (errno.EIO, OSError)):

            def stat(path, number=number):
                raise OSError(number, os.strerror(number))

            monkeypatch.setattr("taichi_sim.base.locks.os.stat", stat)
            with pytest.raises(expected):
                lock.check()
