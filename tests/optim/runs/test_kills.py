"""The real command killed again and again: what is left of it goes on as if nothing had been."""

import json
import os
import random
import signal
import time
from pathlib import Path

import kills
import pytest
from run_products import products

pytestmark = pytest.mark.slow
GENERATIONS, KILLS = 20, 25
SMALL = "--terrain flat --geometry small --columns 1 --repeats 1 --climbers 16 --seed 1 --quiet --resume"


def start(folder, more=""):
    return kills.start(f"codesign {SMALL} {more} --out {folder}")


def lines(folder):
    path = folder / "log.jsonl"
    return path.read_bytes().count(b"\n") if path.exists() else 0


def wait_for_lines(process, folder, count):
    while lines(folder) < count and process.poll() is None:
        time.sleep(0.02)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A run that nothing interrupted, and how long a start and a generation take [s]."""
    folder, begun = tmp_path_factory.mktemp("runs") / "whole", time.monotonic()
    process = start(folder, f"--generations {GENERATIONS}")
    wait_for_lines(process, folder, 1)
    first = time.monotonic() - begun
    assert process.wait() == 0
    timing = [json.loads(line)["seconds"] for line in (folder / "timing.jsonl").read_text().splitlines()]
    return folder, first, sum(timing) / len(timing)


def test_25_kills_at_random_instants_change_nothing(tmp_path, whole):
    reference, first, generation = whole
    folder, rng = tmp_path / "killed", random.Random(1)
    for kill in range(KILLS):
        process, known = start(folder, f"--generations {GENERATIONS}"), lines(folder)
        if kill % 2 or known > GENERATIONS - 2:  # during the start or the first generation after it
            time.sleep(rng.uniform(0, first))
        else:  # at any instant of the second
            wait_for_lines(process, folder, known + 1)
            time.sleep(rng.uniform(0, generation))
        assert process.poll() is None, process.communicate()
        kills.kill(process)
    assert 5 < lines(folder) < GENERATIONS + 1
    process = start(folder, f"--generations {GENERATIONS}")
    assert (process.communicate()[1], process.returncode) == ("", 0)
    assert products(folder) == products(reference)
    assert (folder / "robot_flat.png").read_bytes() == (reference / "robot_flat.png").read_bytes()


def descendants(pid):
    """Processes that a process has started, and those that these have."""
    found, parents = [], {pid}
    for entry in sorted(int(p.name) for p in Path("/proc").iterdir() if p.name.isdigit()):
        try:
            fields = Path(f"/proc/{entry}/stat").read_text().rpartition(")")[2].split()
            name = Path(f"/proc/{entry}/cmdline").read_bytes().decode().replace("\0", " ")
        except OSError:
            continue
        if int(fields[1]) in parents:
            parents.add(entry)
            found.append((entry, name))
    return found


@pytest.mark.parametrize(
    ("where", "worker"),
    [("--workers 2", "spawn_main"), ("--ray local --workers 2", "ray::RemoteService")],
    ids=["processes", "ray"],
)
def test_killed_workers_change_nothing(tmp_path, where, worker):
    short = "--generations 4 --precision f64"
    process = start(tmp_path / "whole", short)
    assert process.wait() == 0
    folder = tmp_path / "killed"
    process, killed = start(folder, f"{short} {where}"), 0
    for count in (1, 3):
        wait_for_lines(process, folder, count)
        time.sleep(0.3)
        workers = [pid for pid, name in descendants(process.pid) if worker in name and "resource_tracker" not in name]
        assert workers, descendants(process.pid)
        os.kill(workers[0], signal.SIGKILL)
        killed += 1
    notes = process.communicate()[1].splitlines()
    assert process.returncode == 0 and len(notes) == killed, notes
    assert products(folder) == products(tmp_path / "whole")
