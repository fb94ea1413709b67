"""Tools for the results of studies: budgets, parts that are computed once, progress, and summaries."""

import json
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, TypeVar

from optim.experiments.tables import write_records
from taichi_sim.base import checks, files
from taichi_sim.base.arrays import Arrays
from taichi_sim.base.results_folder import ResultsFolder

Progress = Callable[[float], None] | None
Budget = Literal["small", "medium", "full"]  # to see that a study works; hours, where offered; all of it
_Settings = TypeVar("_Settings")


def scale_of(budget: str, scales: Mapping[Budget, _Settings]) -> _Settings:
    """Settings of a study for a budget; raises ValueError for a budget that it does not have."""
    checks.choice("budget", budget, scales)
    return next(settings for name, settings in scales.items() if name == budget)


def check_folder(folder: Path, names: Collection[str], kind: str = "") -> None:
    """Check that a folder is free for a study, or belongs to it, before the study fills it.

    Args:
        folder: the study's folder, which may be new.
        names: names of all files and folders that the study puts there.
        kind: kind of study, kept in a file of the folder if names alone do not tell it.

    Raises:
        ValueError: for a file, a folder that holds anything else, or one that cannot be made.
    """

    known = {*names, f"{kind}.json"}

    def other(path: Path) -> bool:
        return path.name not in known and not path.name.startswith(files.ASIDE)  # what a kill left of a write

    if folder.exists() and (not folder.is_dir() or any(map(other, folder.iterdir()))):
        raise ValueError(f"out: {folder} holds something else; name a new folder")
    if kind and not (folder / f"{kind}.json").exists():
        files.make_folder(folder)
        files.write_record(folder / f"{kind}.json", f"morpholab-{kind}-1", {})


def cached(folder: ResultsFolder | None, name: str, compute: Callable[[], Arrays]) -> Arrays:
    """Load the arrays of a part of a study from the folder, or compute and keep them there.

    Args:
        folder: None keeps nothing.
        name: name of the part, without hyphens, which end names in a folder.
        compute: called if the folder does not have the part, or only a damaged one.
    """
    for arrays in folder.load(name) if folder else ():
        return arrays
    found = compute()
    if folder:
        folder.add(name, name.encode(), **found)
    return found


def part_of(progress: Progress, done: int, total: int, length: int = 1) -> Progress:
    """Make the progress of a part of ``length`` after ``done`` of ``total`` work; None for None."""
    return progress and (lambda fraction: progress((done + length * fraction) / total))


def write_json(path: Path, record: Mapping[str, Any]) -> None:
    """Write numbers as JSON; raises ValueError for numbers that are not finite."""
    files.write_text(path, json.dumps(record, indent=2, allow_nan=False) + "\n")


def write_summary(folder: Path, name: str, summary: Mapping[str, Any], page: str = "") -> None:
    """Write the results of a study: its rows as CSV, a page of Markdown if given, and ``summary.json``.

    Args:
        folder: folder of the study.
        name: name of the table and the page.
        summary: all numbers; ``rows`` are those of the table, by column, at least one.
        page: Markdown; none if empty.
    """
    write_records(folder / f"{name}.csv", summary["rows"])
    if page:
        files.write_text(folder / f"{name}.md", page)
    write_json(folder / "summary.json", summary)


class Costs:
    """A file of costs, one line for each completed piece of work; a kill loses at most the last."""

    def __init__(self, path: Path) -> None:
        """Continue the file, if it exists."""
        self._path = path
        files.keep_lines(path, len(files.complete_lines(path)))  # a torn last line

    @contextmanager
    def of(self, part: str) -> Iterator[None]:
        """Measure the time of a piece of work on a part, and write it when the work is complete."""
        wall, cpu = time.perf_counter(), time.process_time()
        yield
        spent = {"wall": round(time.perf_counter() - wall, 3), "cpu": round(time.process_time() - cpu, 3)}
        files.append_line(self._path, json.dumps({"part": part, **spent}))

    def total(self) -> dict[str, dict[str, float]]:
        """Seconds of wall time and of CPU time (of all threads), by part, and of ``"all"``."""
        found: dict[str, dict[str, float]] = {}
        for line in files.complete_lines(self._path):
            entry = json.loads(line)
            for part in (entry["part"], "all"):
                sums = found.setdefault(part, {"wall": 0.0, "cpu": 0.0})
                for clock in sums:
                    sums[clock] = round(sums[clock] + entry[clock], 3)
        return found
