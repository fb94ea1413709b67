"""What tests of workers share: the options, bits compared, processes watched."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import worker_problems
from graded import settling

from optim.problems.inflatable.problem import GaitProblem
from optim.runs.workers import open_workers
from robots.world import Terrain

ROOT = Path(__file__).resolve().parents[2]
PATHS = os.pathsep.join(map(str, (ROOT, ROOT / "tests" / "support")))


class Workers:
    """Opens workers and remembers what they noted and saved."""

    def __init__(self, folder, **options):
        self.folder, self.options = folder, options
        self.notes, self.saved, self.progress = [], [], []

    def open(self, problem, count=2, **options):
        told = {"save_failed": self.save, "note": self.notes.append, "progress": self.progress.append}
        return open_workers(problem, count=count, **{**told, **self.options, **options})

    def save(self, points, reason):
        self.saved.append((points, reason))
        return self.folder / "failed.npz"


# Orientations and pressures of such gaits, so low that nothing leaps.
GAITS = np.array([[10.0, 50.0], [45.0, 100.0], [80.0, 200.0], [30.0, 0.0], [60.0, 150.0]])


def short_gaits(precision):
    """A gait of a moment, of which orientation and pressure are free."""
    levels = np.zeros((10, 2))
    levels[:5, 0], levels[8:, 0] = 0.05, 1.0
    gait = settling(levels, [50, 50], 1)
    return GaitProblem((Terrain(),), schedule=gait, ramp_steps=200, geometry="small", precision=precision, threads=1)


def same(first, second):
    """Whether two evaluations have the same bits."""
    assert first.details.keys() == second.details.keys()
    pairs = [(first.objectives, second.objectives), (first.status, second.status)]
    pairs += [(first.details[name], second.details[name]) for name in first.details]
    if first.gradients is not None or second.gradients is not None:
        pairs.append((first.gradients, second.gradients))
    return all((a.dtype, a.shape, a.tobytes()) == (b.dtype, b.shape, b.tobytes()) for a, b in pairs)


PATIENCE = 600.0  # s, after which something hangs: a loaded machine may take minutes for what takes a second


def wait_for(condition):
    """The first true value of a condition; an error if there is none within ``PATIENCE``."""
    end = time.monotonic() + PATIENCE
    while not (value := condition()):
        assert time.monotonic() < end
        time.sleep(0.01)
    return value


def numbers(folder):
    """Of the processes that left theirs in a folder."""
    return [int(path.name) for path in folder.iterdir() if path.name.isdigit()]


def lives(pid):
    """Whether a process is there and more than a zombie."""
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    return False


def heed_interrupts():
    """Have a child process end at Ctrl-C and SIGHUP, also where tests run in the background or under ``nohup``."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


def stopped(folder, backend, how):
    """The exit code and stderr of a program with two busy workers that a signal ends; no worker may survive it."""
    command = [sys.executable, worker_problems.__file__, folder, backend]
    process = subprocess.Popen(
        command,
        env={**os.environ, "PYTHONPATH": PATHS},
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=heed_interrupts,
    )
    pids = wait_for(lambda: len(found := numbers(folder)) == 2 and found)
    if how == signal.SIGINT:
        os.killpg(process.pid, how)  # as a terminal does
    else:
        process.send_signal(how)
    error = process.communicate(timeout=PATIENCE)[1]
    wait_for(lambda: not any(map(lives, pids)))
    return process.returncode, error
