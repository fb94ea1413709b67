"""How well workers around a shared folder are used: a search whose evaluations only sleep, so that all else is cost.

    python benchmarks/workers.py --workers 8 --seconds 2

starts that many ``morpholab work`` processes, evaluates generations of parts of one point each, and tells the share of
the workers' time in which they evaluated; the first generation, in which they start, is not counted. With ``--killed
0.3`` that share of workers is killed at random instants and replaced. It fails if the log is not that of one process.
"""

import argparse
import contextlib
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

from optim.problems.user_file import FileProblem, load_problem
from optim.runs import open_run, run_search
from optim.runs.config import settings_of
from optim.runs.workers import open_workers
from optim.runs.workers.folder_files import end_workers, make_folders
from optim.search import build_method, default_settings

SOURCE = """
import time

bounds = {{"x": (-1, 1), "y": (-1, 1)}}


def evaluate(points):
    time.sleep({seconds} * len(points))
    return -(points[:, 0] ** 2) - points[:, 1] ** 4
"""


def log_of(
    problem: FileProblem, out: Path, climbers: int, generations: int, evaluate: Any = None, progress: Any = None
) -> bytes:
    """Search, and return the log."""
    settings = {**default_settings("hill-climb"), "climbers": climbers, "seed": 0}
    method = build_method("hill-climb", problem.space, settings)
    with open_run(out, settings_of(problem, "hill-climb", settings, generations)) as run:
        run_search(problem, method, run, generations, progress, evaluate)
    return (out / "log.jsonl").read_bytes()


class Crew:
    """Keeps a number of worker processes at work; kills a share of them at random instants."""

    def __init__(self, folder: Path, file: Path, count: int, killed: float, seconds: float) -> None:
        self._command = [
            sys.executable,
            "-m",
            "morpholab",
            "work",
            str(folder),
            "--problem",
            str(file),
            "--threads",
            "1",
        ]
        self._draw, self._killed, self._seconds = random.Random(1), killed, seconds
        self._processes: list[tuple[subprocess.Popen[bytes], float]] = []
        self.count, self.deaths, self.ended = count, 0, False
        self._thread = threading.Thread(target=self._keep)
        self._thread.start()

    def _keep(self) -> None:
        while not self.ended:
            while len(self._processes) < self.count:
                dies = self._draw.random() < self._killed
                after = self._draw.uniform(5, 5 + 10 * self._seconds) if dies else float("inf")
                process = subprocess.Popen(self._command, stdout=subprocess.DEVNULL)
                self._processes.append((process, time.monotonic() + after))
            for each in list(self._processes):
                process, end = each
                if time.monotonic() > end:
                    process.send_signal(signal.SIGKILL)
                    process.wait()
                    self._processes.remove(each)
                    self.deaths += 1
            time.sleep(0.2)

    def close(self) -> None:
        """Wait for the end of all workers."""
        self.ended = True
        self._thread.join()
        for process, _ in self._processes:
            process.wait()


def main() -> int:
    """Measure, and print one JSON document."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--workers", type=int, default=8)
    parser.add_argument("--seconds", type=float, default=2.0, help="that an evaluation takes")
    parser.add_argument("--rounds", type=int, default=4, help="evaluations of each worker in a generation")
    parser.add_argument("--generations", type=int, default=3, help="after the first, which is not counted")
    parser.add_argument("--killed", type=float, default=0.0, help="share of workers that are killed")
    parser.add_argument("--silence", type=float, default=20.0, help="after which a part is given to others [s]")
    args = parser.parse_args()
    climbers = args.workers * args.rounds
    with tempfile.TemporaryDirectory() as aside:
        folder, file = Path(aside, "shared"), Path(aside, "asleep.py")
        file.write_text(SOURCE.format(seconds=args.seconds))
        make_folders(folder)
        crew = Crew(folder, file, args.workers, args.killed, args.seconds)
        times: list[float] = []
        opened = open_workers(
            load_problem(file),
            count=climbers,
            backend="folder",
            address=str(folder),
            silence=args.silence,
            save_failed=lambda points, reason: Path(aside),
            note=lambda text: print(text, file=sys.stderr),
        )
        with contextlib.ExitStack() as stack:
            stack.callback(crew.close)
            stack.callback(end_workers, folder)
            evaluate = stack.enter_context(opened)
            found = log_of(
                load_problem(file),
                Path(aside, "workers"),
                climbers,
                args.generations,
                evaluate,
                lambda last: times.append(time.monotonic()),
            )
        asleep = SOURCE.format(seconds=args.seconds).encode()
        awake = FileProblem(file.name, asleep, aside)
        judge = FileProblem(file.name, asleep.replace(b"time.sleep", b"float"), aside).evaluate
        awake.evaluate = judge  # type: ignore[method-assign]  # the same settings, without sleep
        same = found == log_of(awake, Path(aside, "alone"), climbers, args.generations)
    wall = times[-1] - times[0]
    useful = args.seconds * args.rounds * args.generations
    document = {
        **vars(args),
        "evaluations": climbers * args.generations,
        "wall_s": round(wall, 3),
        "efficiency": round(useful / wall, 4),
        "deaths": crew.deaths,
        "same_log": same,
        "cores": os.cpu_count(),
    }
    print(json.dumps(document))
    return 0 if same else 1


if __name__ == "__main__":
    raise SystemExit(main())
