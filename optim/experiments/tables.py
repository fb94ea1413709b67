"""Tables: records, which are rows by column, as CSV files, compressed or not, and on pages of Markdown."""

import ast
import csv
import gzip
import io
import re
import zlib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from optim.measures.statistics import mean_interval
from taichi_sim.base.arrays import Floats
from taichi_sim.base.files import content_of, unzipped, write_bytes

Record = Mapping[str, Any]
MISSING = "–"
_WHOLE, _DECIMAL = re.compile("-?(?:0|[1-9][0-9]{0,99})"), re.compile(r"-?[0-9]+\.[0-9]+(?:e[+-]?[0-9]+)?")
_NAMED = {"True": True, "False": False, "None": None}


def select(records: Iterable[Record], **values: Any) -> list[Record]:
    """Choose the records that have these values."""
    return [record for record in records if all(record[name] == value for name, value in values.items())]


def distinct(records: Iterable[Record], name: str) -> list[Any]:
    """List the different values of a column, in the order in which they first come."""
    return list(dict.fromkeys(record[name] for record in records))


def column(records: Iterable[Record], name: str) -> Floats:
    """Gather a column of numbers, NaN where it is None, shape (N,)."""
    return np.array([record[name] for record in records], float)


def write_table(path: Path, header: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    """Write a CSV file atomically, compressed if its name ends in ``.gz``; equal rows give equal bytes."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    content = text.getvalue().encode()
    write_bytes(path, gzip.compress(content, mtime=0) if path.suffix == ".gz" else content)


def write_records(path: Path, records: Sequence[Record]) -> None:
    """Write records, at least one, as the rows of a CSV file; the first one's keys are its columns."""
    header = tuple(records[0])
    write_table(path, header, [tuple(record[name] for name in header) for record in records])


def write_columns(path: Path, columns: Mapping[str, ArrayLike | Sequence[Any]]) -> None:
    """Write columns of equal length as a CSV file."""
    values = (np.asarray(each).tolist() if isinstance(each, np.ndarray) else each for each in columns.values())
    write_table(path, tuple(columns), zip(*values, strict=True))


def read_table(path: Path) -> tuple[list[str], list[list[str]]]:
    """Read header and rows of a CSV file, compressed if its name ends in ``.gz``.

    Raises ValueError if it cannot be read, is empty, or has rows of another length than its header.
    """
    try:
        content = content_of(path)
        text = (unzipped(content) if path.suffix == ".gz" else content).decode("utf-8-sig")
    except (OSError, EOFError, zlib.error, UnicodeDecodeError) as error:
        reason = (error.strerror if isinstance(error, OSError) else None) or "it is damaged"
        raise ValueError(f"{path}: cannot be read ({reason})") from None
    try:
        lines = list(csv.reader(io.StringIO(text)))
    except csv.Error as error:
        raise ValueError(f"{path}: is no table ({error})") from None
    while lines and not lines[-1]:  # empty lines at the end
        lines.pop()
    if not lines:
        raise ValueError(f"{path}: is empty")
    for number, row in enumerate(lines, 1):
        if len(row) != len(lines[0]):
            raise ValueError(f"{path}: row {number} is none of the table; it must have {len(lines[0])} cells")
    return lines[0], lines[1:]


def read_records(path: Path) -> list[dict[str, Any]]:
    """Read the rows of a CSV file as records; numbers, truth values and lists get their types back, empty cells None.

    Raises ValueError if the file cannot be read, is empty, or has rows of another length than its header.
    """
    header, rows = read_table(path)
    return [dict(zip(header, map(value_of, row), strict=True)) for row in rows]


def value_of(cell: str) -> Any:
    """The value that the text of a cell stands for: a number, a truth value, a list, None if empty, or the text."""
    if not cell:
        return None
    if _WHOLE.fullmatch(cell):  # these are most cells, and take a tenth of the time so
        return int(cell)
    if _DECIMAL.fullmatch(cell):
        return float(cell)
    if cell.isidentifier():
        return _NAMED.get(cell, cell)
    try:
        return ast.literal_eval(cell)
    except (ValueError, SyntaxError, RecursionError, MemoryError):  # the last two of what is nested too deep
        return cell


def page(*parts: str | Sequence[str]) -> str:
    """Join paragraphs, and tables given by their lines; empty ones are left out."""
    texts = (part if isinstance(part, str) else "\n".join(part) for part in parts)
    return "\n\n".join(text for text in texts if text) + "\n"


def markdown(header: Sequence[str], align: str, rows: Iterable[Sequence[Any]]) -> list[str]:
    """Format the lines of a Markdown table; ``align`` has a letter a column: ``l`` for left, ``r`` for right.

    Raises:
        ValueError: if it has not one for each, as pages then show no table.
    """
    rules = [{"l": "---", "r": "---:"}[side] for _, side in zip(header, align, strict=True)]
    return [f"| {' | '.join(map(str, cells))} |" for cells in (header, rules, *rows)]


def mean_with_interval(values: Floats, form: str) -> str:
    """A mean with its 95 % interval, of those that are finite."""
    values = values[np.isfinite(values)]
    if not len(values):
        return "-"
    interval = " ({:{form}} to {:{form}})".format(*mean_interval(values), form=form) if len(values) > 1 else ""
    return f"{values.mean():{form}}{interval}"


def between(low: float | None, high: float | None, form: str = ".2f") -> str:
    """Format the ends of an interval; "unbounded" if it has none."""
    return "unbounded" if low is None or high is None else f"{low:{form}} to {high:{form}}"


def cell(value: float | None, form: str = ".4f", missing: str = MISSING) -> str:
    """Format a number of a table; ``missing`` for None."""
    return missing if value is None else format(value, form)
