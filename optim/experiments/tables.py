"""Read and write tables as CSV files, compressed or not."""

import ast
import csv
import gzip
import io
import zlib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from taichi_sim.base.files import write_bytes


def write_table(path: Path, header: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    """Write a CSV file atomically, compressed if its name ends in ``.gz``; equal rows give equal bytes."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    content = text.getvalue().encode()
    write_bytes(path, gzip.compress(content, mtime=0) if path.suffix == ".gz" else content)


def write_records(path: Path, records: Sequence[Mapping[str, Any]]) -> None:
    """Write records, at least one, as the rows of a CSV file; the first one's keys are its columns."""
    header = tuple(records[0])
    write_table(path, header, [tuple(record[name] for name in header) for record in records])


def markdown(header: Sequence[str], align: str, rows: Iterable[Sequence[Any]]) -> list[str]:
    """Format the lines of a Markdown table.

    Args:
        header: names of the columns.
        align: alignment of each column: ``l`` for left, ``r`` for right.
        rows: cells of each row.
    """
    rules = [{"l": "---", "r": "---:"}[side] for side in align]
    return [f"| {' | '.join(map(str, cells))} |" for cells in (header, rules, *rows)]


def read_records(path: Path) -> list[dict[str, Any]]:
    """Read the rows of a CSV file as records by column; numbers, truth values and lists get their types back.

    Empty cells become None.

    Raises:
        ValueError: if the file cannot be read, is empty, or has rows of another length than its header.
    """
    header, rows = read_table(path)
    if any(len(row) != len(header) for row in rows):
        raise ValueError(f"{path}: is no table; every row must have {len(header)} cells")
    return [dict(zip(header, map(_value, row), strict=True)) for row in rows]


def _value(cell: str) -> Any:
    if not cell:
        return None
    try:
        return ast.literal_eval(cell)
    except (ValueError, SyntaxError):
        return cell


def read_table(path: Path) -> tuple[list[str], list[list[str]]]:
    """Read header and rows of a CSV file, compressed if its name ends in ``.gz``.

    Raises:
        ValueError: if it cannot be read or is empty.
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
