"""Results of studies: parts that are computed once, and summaries."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from robots.files import write_text
from robots.results_folder import ResultsFolder

Arrays = dict[str, NDArray[Any]]
Progress = Callable[[float], None] | None


def kept(folder: ResultsFolder | None, name: str, compute: Callable[[], Arrays]) -> Arrays:
    """Arrays of a part of a study: those in the folder, or computed now and kept there.

    Args:
        folder: None keeps nothing.
        name: of the part, without hyphens, which end names in a folder.
        compute: called if the folder does not have the part, or only a damaged one.
    """
    for arrays in folder.load(name) if folder else ():
        return arrays
    found = compute()
    if folder:
        folder.add(name, name.encode(), **found)
    return found


def part_of(progress: Progress, part: int, parts: int) -> Progress:
    """Progress of one of several parts of the same length; None for None."""
    return progress and (lambda fraction: progress((part + fraction) / parts))


def write_json(path: Path, record: Mapping[str, Any]) -> None:
    """Write numbers as JSON; what is not finite is refused."""
    write_text(path, json.dumps(record, indent=2, allow_nan=False) + "\n")
