"""Read runs without changing them, while they are going on and afterwards."""

import datetime
import glob
import hashlib
import itertools
import re
import warnings
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from optim.problem import Problem
from optim.runs import checkpoint
from optim.runs.config import folders_in, folders_of_seeds, has_run, identity, read_config
from optim.runs.folder import TIMING
from optim.runs.folder_lock import in_use
from optim.runs.generation import Generation
from optim.search import build_method
from optim.search.method import SearchResult
from taichi_sim.base import line_files
from taichi_sim.base.checks import shown
from taichi_sim.base.parsing import parse_json
from taichi_sim.base.records import Count, Duration, checked

Found = TypeVar("Found")
READ_ATTEMPTS = 3  # for a run that is going on, whose files may be read at different moments
# Beginning of a line of the log; the rest is long, with a number for each variable, climber and detail.
_HEAD = re.compile(rb'\{"generation": (\d+), "evaluations": \d+, "failed": (\d+), ')


@dataclass(frozen=True)
class _Time:
    """A line of ``timing.jsonl``."""

    generation: Count
    seconds: Duration
    finished: str


@dataclass(frozen=True)
class Progress:
    """Progress of a run, checked against its checkpoint, without a record of every generation.

    Attributes:
        path: the folder.
        config: its settings.
        complete: number of complete generations, including the starts.
        failed: number of failed evaluations in all of them.
        last: the last complete generation; None before the first.
        seconds: time of each generation [s]; NaN if unknown.
        finished: when the last one ended, ISO 8601; None if unknown.
        running: whether a process is at work on it.
    """

    path: Path
    config: dict[str, Any]
    complete: int
    failed: int
    last: Generation | None
    seconds: tuple[float, ...]
    finished: str | None
    running: bool

    @property
    def state(self) -> str:
        """State of the run: ``"running"``, ``"finished"`` or ``"stopped"``."""
        if self.running:
            return "running"
        return "finished" if self.complete > self.config["generations"] else "stopped"

    @property
    def pace(self) -> float | None:
        """Median time of the last ten generations [s]; None if unknown."""
        known = [seconds for seconds in self.seconds[-10:] if not np.isnan(seconds)]
        return float(np.median(known)) if known else None

    @property
    def seconds_left(self) -> float | None:
        """Time that the remaining generations will take at the present pace [s]; None if unknown."""
        left = max(0, self.config["generations"] + 1 - self.complete)
        return 0.0 if left == 0 else None if self.pace is None else left * self.pace


@dataclass(frozen=True)
class History:
    """History of a run with all its generations, checked against its checkpoint.

    Attributes:
        path: the folder.
        config: its settings.
        generations: the generations as logged.
        seconds: time of each generation [s]; NaN if unknown.
        finished: when the last one ended, ISO 8601; None if unknown.
        running: whether a process is at work on it.
        found: result of ``checkpoint.load``: the newest checkpoint that fits, its record, and why newer ones do not.
    """

    path: Path
    config: dict[str, Any]
    generations: tuple[Generation, ...]
    seconds: tuple[float, ...]
    finished: str | None
    running: bool
    found: tuple[checkpoint.State, checkpoint.Record, dict[str, str]] | None = None

    @property
    def progress(self) -> Progress:
        """Progress of the run."""
        failed = sum(generation.failed for generation in self.generations)
        last = self.generations[-1] if self.generations else None
        known = self.seconds, self.finished, self.running
        return Progress(self.path, self.config, len(self.generations), failed, last, *known)

    @property
    def state(self) -> str:
        """State of the run: ``"running"``, ``"finished"`` or ``"stopped"``."""
        return self.progress.state


def read_history(folder: Path) -> History:
    """Read the run in a folder with all its generations.

    Raises:
        ValueError: if there is no run, or its files cannot be read or do not fit each other.
    """
    return _read_steadily(folder, _read_history)


def read_progress(folder: Path) -> Progress:
    """Read the progress of the run in a folder, much faster than :func:`read_history` and with little memory.

    Raises:
        ValueError: as :func:`read_history`, but only the last line of the log is checked in full.
    """
    return _read_steadily(folder, _read_progress)


def _read_steadily(folder: Path, read: Callable[[Path, bool], Found]) -> Found:
    """Read a folder, and retry if its files do not fit each other because a process is writing them."""
    for attempt in range(READ_ATTEMPTS):
        running = in_use(folder)  # before the files are read: what ends meanwhile is told as running, not as damaged
        try:
            return read(folder, running)
        except (OSError, ValueError) as error:
            if attempt == READ_ATTEMPTS - 1 or not (running or in_use(folder)):
                if not isinstance(error, OSError):
                    raise
                raise ValueError(f"{error.filename or folder}: cannot be read ({error.strerror})") from None
    raise AssertionError("the last attempt returns or raises")


def read_histories(folders: Iterable[Path], build: Callable[["History"], Found]) -> tuple[list[Found], list[str]]:
    """Read the runs in several folders; runs that cannot be read are left out with a warning.

    Args:
        folders: folders of the runs.
        build: converts a history to the result wanted; may refuse it with a ValueError.

    Returns:
        Results of ``build``, and for each other run one line that says why it cannot be read.

    Raises:
        ValueError: if none of them can be read; says why the first cannot.
    """
    found, damaged = list[Found](), list[str]()
    for folder in folders:
        try:
            found.append(build(read_history(folder)))
        except ValueError as error:
            damaged.append(str(error))
    if damaged and not found:
        raise ValueError(damaged[0])
    for reason in damaged:
        warnings.warn(f"{reason}; the run is left out", stacklevel=2)
    return found, damaged


def begun(history: History) -> History:
    """Return the history; raise ValueError if it has no complete generation."""
    if not history.generations:
        raise ValueError(f"run: {history.path} has no complete generation yet; continue it with --resume")
    return history


def _read_history(folder: Path, running: bool) -> History:
    config = read_config(folder)
    found = checkpoint.load(folder, identity(config))
    lines = line_files.complete_lines(folder / checkpoint.LOG)[: found[1].lines if found else 0]
    try:
        generations = tuple(map(_generation, lines))
        _check_numbers([each.generation for each in generations])
    except ValueError as error:
        raise ValueError(f"{folder}: {checkpoint.LOG} cannot be read ({error})") from None
    seconds, finished = _read_timing(folder, found[1] if found else None)
    return History(folder, config, generations, seconds, finished, running, found)


def _read_progress(folder: Path, running: bool) -> Progress:
    config = read_config(folder)
    found = checkpoint.load(folder, identity(config))
    record = found[1] if found else None
    numbers, failed, last = list[int](), 0, b""
    try:
        for last in itertools.islice(line_files.lines_of(folder / checkpoint.LOG), record.lines if record else 0):
            head = _HEAD.match(last)
            number, failures = map(int, head.groups()) if head else _number_and_failures(last)
            numbers.append(number)
            failed += failures
        _check_numbers(numbers)
        generation = _generation(last) if numbers else None
    except ValueError as error:
        raise ValueError(f"{folder}: {checkpoint.LOG} cannot be read ({error})") from None
    return Progress(folder, config, len(numbers), failed, generation, *_read_timing(folder, record), running)


def _generation(line: bytes) -> Generation:
    """The generation of a line of the log."""
    return checked(Generation, parse_json(line))


def _number_and_failures(line: bytes) -> tuple[int, int]:
    """Number and failed evaluations of a generation, from a line with an unusual beginning."""
    generation = _generation(line)
    return generation.generation, generation.failed


def _check_numbers(numbers: list[int]) -> None:
    """Refuse generations that are not numbered from 0."""
    if numbers != list(range(len(numbers))):
        raise ValueError(f"generation: {shown(numbers)} is not allowed; lines are numbered from 0")


def read_result(history: History, problem: Problem) -> SearchResult | None:
    """Restore the result of a search after its last complete generation; None before the first.

    ``problem`` must be the problem of the run.
    """
    if history.found is None:
        return None
    settings = dict(history.config["method"])
    method = build_method(settings.pop("name"), problem.space, settings)
    state, _, unfit = history.found
    name = checkpoint.PREVIOUS if checkpoint.CHECKPOINT in unfit else checkpoint.CHECKPOINT
    checkpoint.restore(history.path, method, state, name)
    return method.result()


def _read_timing(folder: Path, record: checkpoint.Record | None) -> tuple[tuple[float, ...], str | None]:
    """Read the times of the generations, and when the last one ended; unknown if the file was changed."""
    count = record.lines if record else 0
    lines = line_files.complete_lines(folder / TIMING)[:count]
    whole, hasher = 0, hashlib.sha256()
    for number, line in enumerate(lines, 1):  # a file that replaced a damaged one is shorter than the log
        hasher.update(line)
        if record and hasher.hexdigest() == record.timing:
            whole = number
    try:
        entries = [checked(_Time, parse_json(line)) for line in lines[:whole]]
        ended = datetime.datetime.strptime(entries[-1].finished, "%Y-%m-%dT%H:%M:%S%z") if entries else None
    except ValueError as error:
        raise ValueError(f"{folder}: {TIMING} cannot be read ({error})") from None
    seconds = dict.fromkeys(range(count), np.nan) | {each.generation: each.seconds for each in entries}
    return tuple(seconds.values()), ended.isoformat() if ended else None


def runs_below(paths: Iterable[Path]) -> list[Path]:
    """List the given run folders and those inside the given folders, each once; patterns such as ``runs/a*`` expand.

    Runs of several seeds may lie one folder deeper. A folder that cannot be listed counts as a run, so that reading
    it raises the error.

    Raises:
        ValueError: if a path holds no run.
    """
    found: dict[Path, Path] = {}
    for path in itertools.chain.from_iterable(map(_matching, paths)):
        inside = _runs_of(path, lambda folder: [run for each in folders_in(folder) for run in _runs_of(each)])
        if not inside:
            raise ValueError(f"run: {path} holds no run" if path.exists() else f"run: {path} does not exist")
        for run in inside:
            found.setdefault(run.resolve(), run)
    return list(found.values())


def _matching(path: Path) -> list[Path]:
    """The path, or if there is none what it matches as a pattern, in order; then itself if that is nothing."""
    return [path] if path.exists() else [Path(name) for name in sorted(glob.glob(str(path)))] or [path]


def _runs_of_seeds(folder: Path) -> list[Path]:
    return list(filter(_may_have_run, folders_of_seeds(folder)))


def _runs_of(folder: Path, below: Callable[[Path], list[Path]] = _runs_of_seeds) -> list[Path]:
    """The folder itself if it may hold a run or cannot be listed; otherwise the runs below it, by default its seeds."""
    if _may_have_run(folder):
        return [folder]
    try:
        return below(folder)
    except ValueError:
        return [folder]


def _may_have_run(folder: Path) -> bool:
    """Whether a folder holds a run, or may hold one but cannot be accessed."""
    try:
        return has_run(folder)
    except OSError:
        return True
