"""Quick problems for workers, importable there, and a program that the tests interrupt and kill."""

import os
import signal
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from optim.problem import Evaluation
from optim.space import Space, Variable

LOADED_WITH = os.environ.get("OMP_NUM_THREADS")


@dataclass(frozen=True)
class Bowl:
    """Some points fail; it has details of several shapes and a gradient.

    Attributes:
        poison: where x is larger, the process that evaluates it is killed.
        error: raised where x is below -4.
        pids: folder where every process that evaluates leaves its number.
        hold: file; while it does not exist, evaluations wait for it.
    """

    poison: float = np.inf
    error: Exception | None = None
    pids: Path | None = None
    hold: Path | None = None

    space = Space((Variable("x", -5.0, 5.0, step=0.5), Variable("on", 0, 1, "binary", step=0.3)))
    objective_names = ("score",)

    def describe(self):
        return {}

    def save(self, point, path):
        path.write_text(str(point))

    def evaluate(self, points):
        if self.pids:
            (self.pids / str(os.getpid())).touch()
        while self.hold and not self.hold.exists():
            time.sleep(0.01)
        print("chatter of a worker", flush=True)
        if self.error and (points[:, 0] < -4).any():
            raise self.error
        if (points[:, 0] > self.poison).any():
            os.kill(os.getpid(), signal.SIGKILL)
        score = -np.exp(np.abs(points[:, 0] - 1)) - points[:, 1] / 3
        details = {
            "pair": np.sin(points),
            "count": np.arange(5)[points[:, 1].astype(int)],
        }
        return Evaluation(np.where(points[:, 0] < -3, np.nan, score), details=details)

    def evaluate_relaxed(self, points, sharpness, gradients):
        judgement = self.evaluate(points)
        slopes = np.cos(points) * sharpness if gradients else None
        return Evaluation(judgement.objectives, judgement.status, judgement.details, slopes)


class Threads(Bowl):
    """Judges by the number of threads that libraries were loaded with."""

    def evaluate(self, points):
        return Evaluation(np.full(len(points), float(LOADED_WITH)))


class Unloadable(Bowl):
    """Can be pickled, and not loaded again."""

    def __reduce__(self):
        return int, ("no number",)


class Fatal(Bowl):
    """Ends whoever loads it."""

    def __reduce__(self):
        return os._exit, (3,)


class PickyError(Exception):
    """Cannot be unpickled."""

    def __init__(self, first, second):
        super().__init__(f"{first} {second}")


class Awkward(Bowl):
    """Raises what cannot travel."""

    def evaluate(self, points):
        raise PickyError("one", "two")


def sample(count, seed=0):
    return Bowl.space.sample(np.random.default_rng(seed), count)


def main(folder, backend):
    """Evaluates with two workers for ever, leaving their numbers in the folder."""
    from optim.problem import Request
    from optim.runs.workers import open_workers

    problem = Bowl(pids=folder, hold=folder / "never")
    notes = []
    options = {"count": 2, "backend": backend, "save_failed": None, "note": notes.append}
    try:
        with open_workers(problem, **options) as evaluate:
            evaluate(Request(sample(4)))
    except KeyboardInterrupt:
        print(f"interrupted; notes: {notes}; threads: {threading.active_count()}", file=sys.stderr)
        raise SystemExit(130) from None


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2])
