"""Reading runs without touching them: while they go on, and after."""

import datetime
import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from optim.problem import Problem
from optim.runs import checkpoint
from optim.runs.config import has_run, identity, read_config
from optim.runs.folder import TIMING, in_use
from optim.runs.generation import Generation
from optim.search import build_method
from optim.search.method import SearchResult
from taichi_sim.base import files


@dataclass(frozen=True)
class History:
    """What a run has done so far, checked against its checkpoint.

    Attributes:
        path: the folder.
        config: its settings.
        generations: the generations, as logged.
        seconds: how long each of them took; NaN where that is not known.
        finished: when the last one was finished, ISO 8601; None if that is not known.
        running: whether a process is at work on it.
        found: the newest checkpoint that fits, its record, and why others do not, as ``checkpoint.load`` returns them.
    """

    path: Path
    config: dict[str, Any]
    generations: tuple[Generation, ...]
    seconds: tuple[float, ...]
    finished: str | None
    running: bool
    found: tuple[checkpoint.State, checkpoint.Record, dict[str, str]] | None = None

    @property
    def state(self) -> str:
        """``"running"``, ``"finished"`` or ``"stopped"``."""
        if self.running:
            return "running"
        return "finished" if len(self.generations) > self.config["generations"] else "stopped"

    @property
    def pace(self) -> float | None:
        """Median time of a generation [s]; of the last ten, as the machine may have changed."""
        known = [seconds for seconds in self.seconds[-10:] if not np.isnan(seconds)]
        return float(np.median(known)) if known else None

    @property
    def seconds_left(self) -> float | None:
        """Time that the rest will take at this pace; None if that is not known."""
        left = max(0, self.config["generations"] + 1 - len(self.generations))
        return 0.0 if left == 0 else None if self.pace is None else left * self.pace


def read_history(folder: Path) -> History:
    """What the run in a folder has done so far.

    Raises:
        ValueError: if there is no run, or its files do not fit each other.
    """
    config = read_config(folder)
    running = in_use(folder)  # before the files are read: what ends meanwhile is told as running, not as damaged
    found = checkpoint.load(folder, identity(config))
    lines = files.complete_lines(folder / checkpoint.LOG)[: found[1].lines if found else 0]
    try:
        generations = tuple(Generation(**json.loads(line)) for line in lines)
    except (ValueError, TypeError) as error:
        raise ValueError(f"{folder}: {checkpoint.LOG} cannot be read ({error})") from None
    seconds, finished = _read_timing(folder, found[1] if found else None)
    return History(folder, config, generations, seconds, finished, running, found)


def read_result(history: History, problem: Problem) -> SearchResult | None:
    """What the search of a run holds after its last complete generation, of the run's own problem; None before one."""
    if history.found is None:
        return None
    settings = dict(history.config["method"])
    method = build_method(settings.pop("name"), problem.space, settings)
    method.restore(history.found[0])
    return method.result()


def _read_timing(folder: Path, record: checkpoint.Record | None) -> tuple[tuple[float, ...], str | None]:
    """Times of the generations, and when the last one ended; unknown where the file is not as it was written."""
    count = record.lines if record else 0
    lines = files.complete_lines(folder / TIMING)
    sizes = range(min(count, len(lines)), 0, -1)  # a file begun anew is shorter than the log
    whole = next((n for n in sizes if record and files.sha256(b"".join(lines[:n])) == record.timing), 0)
    entries = [json.loads(line) for line in lines[:whole]]
    seconds = dict.fromkeys(range(count), np.nan) | {entry["generation"]: entry["seconds"] for entry in entries}
    finished = entries[-1]["finished"] if entries else None
    return tuple(seconds.values()), finished and datetime.datetime.strptime(finished, "%Y-%m-%dT%H:%M:%S%z").isoformat()


def runs_below(paths: Iterable[Path]) -> list[Path]:
    """The run folders given, and those in folders given.

    Raises:
        ValueError: if a path holds none.
    """
    found: list[Path] = []
    for path in paths:
        inside = [path] if has_run(path) else sorted(p for p in path.glob("*/") if has_run(p))
        if not inside:
            raise ValueError(f"run: {path} holds no run" if path.exists() else f"run: {path} does not exist")
        found += [run for run in inside if run not in found]
    return found
