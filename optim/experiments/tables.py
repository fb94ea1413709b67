"""Tables as CSV files, compressed or not."""

import csv
import gzip
import io
import zlib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from taichi_sim.base.files import write_bytes


def write_table(path: Path, header: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    """Write a CSV file, whole or not at all, compressed if its name ends in ``.gz``: same rows, same bytes."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    content = text.getvalue().encode()
    write_bytes(path, gzip.compress(content, mtime=0) if path.suffix == ".gz" else content)


def write_records(path: Path, header: Sequence[str], records: Iterable[Mapping[str, Any]]) -> None:
    """The same of records by name: what the header names of each."""
    write_table(path, header, [tuple(record[name] for name in header) for record in records])


def read_table(path: Path) -> tuple[list[str], list[list[str]]]:
    """Header and rows of a CSV file, compressed if its name ends in ``.gz``.

    Raises:
        ValueError: in one line, when it cannot be read or is empty.
    """
    try:
        content = path.read_bytes()
        text = (gzip.decompress(content) if path.suffix == ".gz" else content).decode()
    except (OSError, EOFError, zlib.error, UnicodeDecodeError) as error:
        reason = (error.strerror if isinstance(error, OSError) else None) or "it is damaged"
        raise ValueError(f"{path}: cannot be read ({reason})") from None
    lines = list(csv.reader(io.StringIO(text)))
    if not lines:
        raise ValueError(f"{path}: is empty")
    return lines[0], lines[1:]
