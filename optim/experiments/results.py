"""Results of studies in their folders: parts that are computed once, tables that stand alone, summaries, costs."""

import json
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

from numpy.typing import NDArray

from optim.experiments.allowed import Allowed, check_arrays
from optim.experiments.tables import write_records
from robots.robot import part_of
from taichi_sim.base import files, line_files
from taichi_sim.base.arrays import Arrays
from taichi_sim.base.parsing import parse_json
from taichi_sim.base.results_folder import ResultsFolder

Progress = Callable[[float], None] | None  # called with the fraction done
Part = Callable[[Progress], Arrays]
Check = Callable[[Arrays], object]  # refuses the arrays of a part that is damaged, by a ValueError
Key = TypeVar("Key", str, int)
RAW = "runs"  # folder of raw results


def check_folder(folder: Path, names: Collection[str], kind: str = "") -> None:
    """Check that a folder is free for a study, or belongs to it, before the study fills it.

    It may be new, or hold files and folders of these ``names``, and the file of its ``kind`` if names alone do not tell
    it. Raises ValueError for a file, a folder that holds anything else, or one that cannot be made.
    """
    known = {*names, f"{kind}.json"}

    def other(path: Path) -> bool:
        return path.name not in known and not path.name.startswith(files.ASIDE)  # what a kill left of a write

    if folder.exists() and (not folder.is_dir() or any(map(other, folder.iterdir()))):
        raise ValueError(f"out: {folder} holds something else; name a new folder")
    files.remove_cut_off(folder)
    if kind and not (folder / f"{kind}.json").exists():
        files.make_folder(folder)
        files.write_record(folder / f"{kind}.json", f"morpholab-{kind}-1", {})


def check_runs(
    folder: Path,
    kind: str,
    tables: Sequence[str],
    names: Sequence[str],
    settings: Mapping[str, Any] = MappingProxyType({}),
) -> None:
    """Check a folder as :func:`check_folder`, and that it holds no tables whose runs are not there to go on from.

    Raises ValueError if it does, or holds something else, or what was made with other ``settings``.
    """
    if not (folder / RAW).exists() and any((folder / name).exists() for name in tables):
        raise ValueError(
            f"out: {folder} holds tables without their runs; name a new folder, or give it to --from-data to make "
            "the rest from them"
        )
    check_folder(folder, names, kind)
    if settings:
        path, form = folder / f"{kind}.json", f"morpholab-{kind}-1"
        if files.read_record(path, form, len) == 1:  # the format alone: a new folder, or one of before
            files.write_record(path, form, settings)
        ResultsFolder(folder, kind, settings)  # refuses other settings


def cached(folder: ResultsFolder | None, name: str, compute: Callable[[], Arrays], check: Check) -> Arrays:
    """Load the arrays of a part of a study from the folder, or compute and keep them there; without one, just compute.

    What is damaged is computed again, and so is what ``check`` refuses by a ValueError, with a warning. Names have no
    hyphens, which end names in a folder.
    """
    for arrays in folder.load(name, check) if folder else ():
        return arrays
    found = compute()
    if folder:
        folder.add(name, name.encode(), **found)
    return found


def computed(
    folder: ResultsFolder | None,
    parts: Mapping[Key, Part],
    progress: Progress,
    name: str,
    check: Check | Mapping[Key, Check],
) -> dict[Key, Arrays]:
    """Load or compute the parts of a study one after the other; a kill loses at most one; see :func:`cached`.

    Parts are kept by ``name``, in which their key stands for ``{}``. A ``check`` is of all, or each has its own.
    """
    found = {}
    for number, (key, compute) in enumerate(parts.items()):
        own = check[key] if isinstance(check, Mapping) else check
        found[key] = cached(folder, name.format(key), partial(compute, part_of(progress, number, len(parts))), own)
        if progress:
            progress((number + 1) / len(parts))
    return found


def computed_arrays(
    folder: ResultsFolder,
    key: str,
    parts: Mapping[str, Callable[[Progress], NDArray[Any]]],
    progress: Progress,
    allowed: Mapping[str, Allowed],
) -> list[NDArray[Any]]:
    """Load or compute parts of a single array each, which files call ``key``; see :func:`computed`.

    A file whose array is not what is ``allowed`` of its part is damaged.
    """
    checks: Mapping[str, Check] = {name: partial(check_arrays, {key: each}) for name, each in allowed.items()}

    def named(compute: Callable[[Progress], NDArray[Any]], progress: Progress) -> Arrays:
        return {key: compute(progress)}

    found = computed(folder, {name: partial(named, compute) for name, compute in parts.items()}, progress, "{}", checks)
    return [arrays[key] for arrays in found.values()]


def write_json(path: Path, record: Mapping[str, Any]) -> None:
    """Write numbers as JSON; raises ValueError for numbers that are not finite."""
    files.write_text(path, json.dumps(record, indent=2, allow_nan=False) + "\n")


def write_summary(folder: Path, name: str, summary: Mapping[str, Any], page: str = "") -> None:
    """Write ``summary.json``, its ``rows``, at least one, as a table, and a page of Markdown if given, both by name."""
    write_records(folder / f"{name}.csv", summary["rows"])
    if page:
        files.write_text(folder / f"{name}.md", page)
    write_json(folder / "summary.json", summary)


class Costs:
    """A file of costs, one line for each completed piece of work; a kill loses at most the last."""

    def __init__(self, path: Path) -> None:
        """Continue the file, if it exists."""
        self._path = path
        line_files.keep_lines(path, len(line_files.complete_lines(path)))  # a torn last line

    @contextmanager
    def of(self, part: str) -> Iterator[None]:
        """Measure the time of a piece of work on a part, and write it when the work is complete."""
        wall, cpu = time.perf_counter(), time.process_time()
        yield
        spent = {"wall": round(time.perf_counter() - wall, 3), "cpu": round(time.process_time() - cpu, 3)}
        line_files.append_line(self._path, json.dumps({"part": part, **spent}))

    def total(self) -> dict[str, dict[str, float]]:
        """Seconds of wall time and of CPU time (of all threads), by part, and of ``"all"``."""
        found: dict[str, dict[str, float]] = {}
        for line in line_files.complete_lines(self._path):
            entry = parse_json(line)
            for part in (entry["part"], "all"):
                sums = found.setdefault(part, {"wall": 0.0, "cpu": 0.0})
                for clock in sums:
                    sums[clock] = round(sums[clock] + entry[clock], 3)
        return found
