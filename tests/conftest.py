"""Settings that all tests share, and the command line."""

import gc
import os
import re
import shlex
import shutil
import tempfile
from pathlib import Path

import pytest
from computing import kernels_of, next_scope, place
from hypothesis import settings
from stand_in import Simulator

from optim.cli import main
from optim.experiments import results
from taichi_sim import runtime
from taichi_sim.base import compute

# What is imported while tests are collected stays. So the collector of garbage, which would walk through it again and
# again, is off until then, and leaves it alone afterwards: that is a tenth of the time of all tests.
gc.disable()

# The same examples in every run, and no deadline: shared machines pause.
settings.register_profile("lab", derandomize=True, deadline=None)
settings.load_profile("lab")

# For another number of threads Taichi starts again and loads all kernels anew. So the default is one, as most tests
# ask for; those of more threads say so.
compute.available_threads = lambda: 1

# Whether files outlive a power cut no test can see, and disks take up to 10 ms to see to it, ten thousands of times. A
# descriptor that is not open still fails.
os.fsync = lambda descriptor: os.fstat(descriptor) and None

# What is computed passes the check that it would have to pass when its folder goes on.
_cached = results.cached


def _checked(folder, name, compute, check):
    def compute_and_check():
        found = compute()
        check(found)
        return found

    return _cached(folder, name, compute_and_check, check)


results.cached = _checked

# Only tests marked with ``kernels`` start Taichi. Of the others, and of their child processes, this folder would be the
# cache; whoever starts Taichi makes it.
_UNMARKED = "starts Taichi: mark it with @pytest.mark.kernels, or the file with pytestmark = pytest.mark.kernels"
_NO_CACHE = Path(tempfile.gettempdir(), f"morpholab-no-kernels-{os.getpid()}")
_CACHE = os.environ.get("MORPHOLAB_CACHE")
_start, _may_start = runtime.start, True


def _start_if_marked(*arguments, **keywords):
    if not _may_start:
        _NO_CACHE.mkdir(exist_ok=True)
        pytest.fail(_UNMARKED)
    return _start(*arguments, **keywords)


runtime.start = _start_if_marked


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item):
    global _may_start
    _may_start = any(item.iter_markers("kernels")) or any(item.iter_markers("slow"))
    if _may_start and _CACHE is None:
        os.environ.pop("MORPHOLAB_CACHE", None)
    else:
        os.environ["MORPHOLAB_CACHE"] = _CACHE if _may_start else str(_NO_CACHE)


@pytest.hookimpl(trylast=True)
def pytest_runtest_teardown():
    if _NO_CACHE.exists():
        shutil.rmtree(_NO_CACHE)
        pytest.fail(f"it, or a process of it, {_UNMARKED}")


def pytest_ignore_collect(collection_path, config):
    """Files of marked tests alone are not even read where those are left out: importing them takes seconds."""
    if collection_path.suffix == ".py" and "not kernels and not long" in config.option.markexpr:
        return (
            re.search(r"^pytestmark = .*\bpytest\.mark\.(kernels|long)\b", collection_path.read_text(), re.M) and True
        )
    return None


def pytest_collection_finish():
    gc.collect()
    gc.freeze()
    gc.enable()


def pytest_sessionstart(session):
    """Who only hands out tests collects none, and needs the collector."""
    if getattr(session.config.option, "numprocesses", None):
        gc.enable()


def pytest_collection_modifyitems(items):
    """Tests go by what they compute with, see ``computing``, and in these groups by files."""
    files = {path: number for number, path in enumerate(dict.fromkeys(item.path for item in items))}
    items.sort(key=lambda item: (place(item.nodeid), files[item.path]))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Processes take a file's tests that compute alike at a time, and stay with what they have compiled."""
    from xdist.scheduler import LoadFileScheduling

    class ByComputing(LoadFileScheduling):
        def __init__(self, *given):
            super().__init__(*given)
            self.last = {}  # which kernels each process launched last

        def _split_scope(self, nodeid):
            return " ".join(map(str, (super()._split_scope(nodeid), *place(nodeid))))

        def _assign_work_unit(self, node):
            kernels = {scope: kernels_of(next(iter(unit))) for scope, unit in self.workqueue.items()}
            of_others = {kind for other, kind in self.last.items() if other is not node}
            scope = next_scope(kernels, self.last.get(node), of_others)
            self.last[node] = kernels[scope] or self.last.get(node)
            self.workqueue.move_to_end(scope, last=False)
            super()._assign_work_unit(node)

    config.option.loadscopereorder = False
    return ByComputing(config, log)


@pytest.fixture
def unseen_pictures(monkeypatch):
    """Figures become files, but are not drawn: most of the time of a study whose pictures a test does not look at."""
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", lambda self, path, **_: Path(path).write_bytes(b"unseen"))


@pytest.fixture
def morpholab(tmp_path, monkeypatch, capfd):
    """Runs a command line in an empty folder: (exit code, stdout, stderr)."""
    monkeypatch.chdir(tmp_path)

    def run(line):
        try:
            code = main(shlex.split(line))
        except SystemExit as stop:
            code = stop.code
        return code, *capfd.readouterr()

    return run


@pytest.fixture
def simulator(monkeypatch):
    """The stand-in, in a folder and with pictures of its own."""
    stand_in = Simulator()
    monkeypatch.setattr("robots.inflatable.simulation.simulate", stand_in)
    picture = lambda design, terrain, path, **_: path.write_text(f"{terrain.name} {design}")  # noqa: E731
    monkeypatch.setattr("robots.inflatable.view.picture.save_motion_picture", picture)
    return stand_in
