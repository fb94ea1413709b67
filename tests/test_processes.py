"""What surrounds a process must not end it: no cache, no home, threads, forks, closed pipes, two at once."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

# Small kernels in both precisions, so that threads restart Taichi under each other.
WITHOUT_CACHE_AND_HOME = """
import os, sys, threading
import numpy as np
from taichi_sim.signals import warping_distances

signals = np.random.default_rng(0).standard_normal((2, 3, 20))
measure = lambda precision: warping_distances(*signals, precision=precision, threads=1)
expected = {precision: measure(precision) for precision in ("f64", "f32")}
wrong = []

def work(precisions):
    wrong.extend(p for p in precisions if not np.array_equal(measure(p), expected[p]))

threads = [threading.Thread(target=work, args=(order,)) for order in (("f32", "f64"), ("f64", "f32"))]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
print("wrong:", wrong, flush=True)
child = os.fork()
if child == 0:
    try:
        measure("f64")
    except RuntimeError as refusal:
        print("child:", refusal, flush=True)
    sys.exit(3)
print("child ended:", os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""


def run(*command, environment=None, **options):
    environment = {**os.environ, "PYTHONPATH": str(ROOT), **(environment or {})}
    environment = {name: value for name, value in environment.items() if value is not None}
    process = subprocess.run(
        [sys.executable, *command],
        env=environment,
        text=True,
        stderr=subprocess.PIPE,
        timeout=120,
        check=False,
        **options,
    )
    assert "Traceback" not in process.stderr and process.returncode >= 0, process.stderr
    return process


def test_threads_and_forks_without_a_cache_and_a_home(tmp_path):
    """Compiles two small kernels."""
    (tmp_path / "file").touch()
    process = run(
        "-W",
        "ignore",
        "-c",
        WITHOUT_CACHE_AND_HOME,
        environment={"HOME": None, "MORPHOLAB_CACHE": str(tmp_path / "file/below")},
        stdout=subprocess.PIPE,
    )
    assert process.returncode == 0, process.stderr
    notes = process.stderr.splitlines()
    assert len(notes) == 1 and notes[0].startswith("note: kernels are not cached, ") and "cannot be written" in notes[0]
    wrong, refusal, ended = process.stdout.splitlines()
    assert wrong == "wrong: []" and "'spawn'" in refusal and ended == "child ended: 3"
