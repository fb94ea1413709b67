"""Every design that a run has evaluated, with its scores: ``evaluations.jsonl``, which is kept on request.

The first line names the variables and the objectives; then each generation has a line with its points, objectives,
status and details. A run that goes on keeps the lines of complete generations and adds the next.
"""

import json
import math
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from optim.problem import Evaluation, Problem, Request
from taichi_sim.base import line_files
from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import shown
from taichi_sim.base.parsing import parse_json
from taichi_sim.base.records import Count, checked

EVALUATIONS = "evaluations.jsonl"
FORMAT = "morpholab evaluations 1"
OF_ALL = ("generation", "wants", "sharpness", "partly", "status")  # columns of all runs
_NUMBER = re.compile(rb'\{"generation": (\d+),')


@dataclass(frozen=True)
class _Head:
    """The first line: what the numbers of the others are."""

    format: str
    variables: list[str]
    objectives: list[str]

    def __post_init__(self) -> None:
        if self.format != FORMAT:
            raise ValueError(f"format: {self.format!r} is not allowed; it is {FORMAT!r}")
        for field in ("variables", "objectives"):
            if len(set(names := getattr(self, field))) < len(names):
                raise ValueError(f"{field}: {names} are not allowed; give each name once")


@dataclass(frozen=True)
class _Line:
    """The designs of a generation.

    Attributes:
        generation: its number.
        wants: what the method asked for, see ``optim.problem.Request``.
        sharpness: of relaxed designs, whose scores are not those of true ones; 0 of true ones.
        partly: whether scores are of a part of the draws or worlds only.
        points: (N, D).
        objectives: (N, K); null where a design failed.
        status: (N,).
        details: numbers or texts by name, (N,) each.
    """

    generation: Count
    wants: str
    sharpness: float
    partly: bool
    points: list[list[float]]
    objectives: list[list[float | None]]
    status: list[str]
    details: dict[str, list[float | bool | str | None]]


class EvaluationLog:
    """The file of a run to which the designs of each generation are added."""

    def __init__(self, folder: Path, problem: Problem) -> None:
        """Use the file of a run folder.

        Raises:
            ValueError: if it is there and of another run.
        """
        self._path = folder / EVALUATIONS
        self._head = _json_of(_Head(FORMAT, list(problem.space.names), list(problem.objective_names)))
        if (first := next(_lines_of(self._path), None)) not in (None, self._head.encode() + b"\n"):
            told = f"line 1: {shown(first)} is not of this run; remove the file, and the run goes on without it"
            raise ValueError(f"{self._path}: {told}")

    def keep(self, generations: int) -> None:
        """Cut the file back to what a run with so many complete generations has evaluated, or begin it."""
        if next(line_files.lines_of(self._path), None) is None:  # not there, or a kill cut its first line off
            self._path.unlink(missing_ok=True)
            line_files.append_line(self._path, self._head)
        size = 0
        for number, line in enumerate(line_files.lines_of(self._path)):
            found = _NUMBER.match(line)
            if number and (found is None or int(found[1]) >= generations):
                break
            size += len(line)
        if self._path.stat().st_size > size:
            os.truncate(self._path, size)

    def add(self, generation: int, request: Request, evaluation: Evaluation) -> None:
        """Add the designs of a generation."""
        line = _Line(
            generation,
            request.wants,
            float(request.sharpness),
            request.minibatch is not None,
            request.points.tolist(),
            [_plain(row) for row in evaluation.objectives],
            [str(each) for each in evaluation.status],
            {name: _plain(values) for name, values in evaluation.details.items() if np.ndim(values) == 1},
        )
        line_files.append_line(self._path, _json_of(line))


def evaluations(folder: str | os.PathLike[str]) -> dict[str, NDArray[Any]]:
    """Read every design that a run has evaluated, as columns of equal length, for tables such as those of pandas.

    The run must have been started with ``codesign --evaluations``. A search by gradients also asks for relaxed
    designs, whose ``sharpness`` is not 0 and whose scores are not those of designs that can be built.

    Args:
        folder: of the run.

    Returns:
        Arrays by name, one value for each design: ``generation``, ``wants``, ``sharpness`` and ``partly`` (whether its
        scores are of some of the draws or worlds only), the variables, the objectives, ``status``, and the measures
        that have other names. What a design does not have, or failed to have, is NaN or an empty text.

    Raises:
        ValueError: if the run has not kept its designs, or the file is damaged; names file, line and field.
    """
    path = Path(folder) / EVALUATIONS
    if not path.exists():
        raise ValueError(f"{path}: is not there; start the run with --evaluations, which keeps every design")
    parts: list[dict[str, NDArray[Any]]] = []
    for number, read in _parsed(path):
        if isinstance(read, _Head):
            head = read
            parts.append(_columns(head, _Line(0, "", 0.0, False, [], [], [], {})))  # its columns, without a design
            continue
        try:
            parts.append(_columns(head, read))
        except ValueError as error:
            raise ValueError(f"{path}: line {number}: {error}") from None
    if not parts:
        raise ValueError(f"{path}: is empty; its first line names the variables")
    names = dict.fromkeys(name for part in parts for name in part)
    return {
        name: _joined([part.get(name) for part in parts], [len(part["status"]) for part in parts]) for name in names
    }


def _parsed(path: Path) -> Iterator[tuple[int, _Head | _Line]]:
    """The complete lines of a file with their numbers, counted from 1."""
    for number, line in enumerate(_lines_of(path), 1):
        try:
            read = parse_json(line)
            yield number, checked(_Head, read) if number == 1 else checked(_Line, read)
        except ValueError as error:
            raise ValueError(f"{path}: line {number}: {error}") from None


def _lines_of(path: Path) -> Iterator[bytes]:
    """The complete lines of the file.

    Raises:
        ValueError: if it cannot be read, or is a pipe or device.
    """
    try:
        yield from line_files.lines_of(path)
    except OSError as error:
        raise ValueError(f"{path}: cannot be read ({error.strerror})") from None


def _columns(head: _Head, line: _Line) -> dict[str, NDArray[Any]]:
    """The designs of a generation as columns."""
    count = len(line.points)
    points = _table("points", line.points, count, len(head.variables))
    objectives = _table("objectives", line.objectives, count, len(head.objectives))
    found: dict[str, NDArray[Any]] = {
        "generation": np.full(count, line.generation),
        "wants": np.full(count, line.wants),
        "sharpness": np.full(count, line.sharpness),
        "partly": np.full(count, line.partly),
    }
    found |= {
        each if each not in OF_ALL else f"{each} (variable)": x
        for each, x in zip(head.variables, points.T, strict=True)
    }
    more = {**dict(zip(head.objectives, objectives.T, strict=True)), "status": np.array(line.status)}
    more |= {name: _column(values) for name, values in line.details.items() if name not in more}
    for name, values in more.items():
        if len(values) != count:
            raise ValueError(f"{name}: {len(values)} values are not allowed for {count} designs")
        found[name if name not in found else f"{name} (measured)"] = values
    return found


def _table(name: str, rows: list[Any], count: int, width: int) -> Floats:
    """Rows of numbers, (count, width), NaN where there is none."""
    if len(rows) != count or any(len(row) != width for row in rows):
        raise ValueError(f"{name}: {count} rows of {width} numbers are needed")
    return np.array(rows, float).reshape(count, width)


def _column(values: list[Any]) -> NDArray[Any]:
    """Texts as texts, numbers as numbers."""
    return np.array(values) if any(isinstance(each, str) for each in values) else np.array(values, float)


def _joined(columns: list[NDArray[Any] | None], counts: list[int]) -> NDArray[Any]:
    """A column of all generations; where one does not have it, NaN or empty texts."""
    missing = "" if any(column is not None and column.dtype.kind == "U" for column in columns) else np.nan
    pairs = zip(columns, counts, strict=True)
    return np.concatenate([np.full(count, missing) if column is None else column for column, count in pairs])


def _plain(values: NDArray[Any]) -> list[Any]:
    """Values as JSON can tell them: None for what is not finite."""
    return [None if isinstance(each, float) and not math.isfinite(each) else each for each in values.tolist()]


def _json_of(line: _Head | _Line) -> str:
    """A line of the file; equal numbers give equal bytes."""
    return json.dumps({each.name: getattr(line, each.name) for each in fields(line)}, allow_nan=False)
