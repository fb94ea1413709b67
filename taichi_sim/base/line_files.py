"""Text files that grow by a line at a time; a line that a kill cut off does not count."""

import itertools
import os
from collections.abc import Iterator
from pathlib import Path

from taichi_sim.base.file_kinds import check_plain_file


def append_line(path: Path, line: str) -> None:
    """Add a line to a text file and wait until it is on disk."""
    with path.open("ab") as file:
        file.write(line.encode() + b"\n")
        file.flush()
        os.fsync(file.fileno())


def lines_of(path: Path) -> Iterator[bytes]:
    """Read the complete lines of a text file one by one, without an unfinished last one; none if there is no file.

    Raises:
        OSError: if it cannot be read, or is a pipe or device, which may have no end; names the file.
    """
    if path.exists():
        try:
            check_plain_file(path, None)
        except OSError as error:
            error.filename = str(path)
            raise
        with path.open("rb") as file:
            yield from (line for line in file if line.endswith(b"\n"))


def complete_lines(path: Path) -> list[bytes]:
    """Complete lines of a text file, without an unfinished last one; empty if there is no file."""
    return list(lines_of(path))


def keep_lines(path: Path, count: int) -> None:
    """Cut a text file, if it exists, after its first ``count`` complete lines."""
    size = sum(map(len, itertools.islice(lines_of(path), count)))
    if path.exists() and path.stat().st_size > size:
        os.truncate(path, size)
