"""Checkpoints of runs: the state of a search, with checksums of the files beside it.

A checkpoint fits its folder if it was made with the same settings and the log begins with the lines that it covers.
A run continues from the newest undamaged checkpoint that fits.
"""

import hashlib
import itertools
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from optim.search.method import Method
from taichi_sim.base import files, line_files
from taichi_sim.base.arrays import Arrays
from taichi_sim.base.parsing import parse_json
from taichi_sim.base.records import Count, checked

State = Arrays

CHECKPOINT, PREVIOUS, LOG = "checkpoint.npz", "checkpoint.previous.npz", "log.jsonl"
_RECORD = "run/record"  # entry of a checkpoint beside the method's own


@dataclass(frozen=True)
class Record:
    """Checksums in a checkpoint that tell whether it fits its run folder.

    Attributes:
        lines: number of lines of the log.
        log: checksum of these lines.
        timing: checksum of ``timing.jsonl``.
        environment: checksum of ``environment.json``.
        settings: checksum of the settings, made by ``config.identity``.
    """

    lines: Count
    log: str
    timing: str
    environment: str
    settings: str


def save(folder: Path, state: Mapping[str, NDArray[Any]], record: Record) -> None:
    """Write a checkpoint, and keep the previous one as ``checkpoint.previous.npz``; one exists at every moment."""
    own = {_RECORD: np.frombuffer(json.dumps(asdict(record)).encode(), np.uint8)}
    with files.replacing(folder / CHECKPOINT) as aside:
        aside.write_bytes(files.pack({**state, **own}))
        if (folder / CHECKPOINT).exists():
            files.keep_as(folder / CHECKPOINT, folder / PREVIOUS)


def load(folder: Path, settings: str) -> tuple[State, Record, dict[str, str]] | None:
    """Read the newest checkpoint that fits.

    The log is read after each checkpoint. As it only grows, it has the lines that the checkpoint covers even if the
    run is going on.

    Returns:
        State, record, and why newer checkpoints do not fit, by file name; None if there has not been a checkpoint.

    Raises:
        ValueError: if there are checkpoints, or lines of the log, but no checkpoint fits.
    """
    reasons: dict[str, str] = {}
    for name in (CHECKPOINT, PREVIOUS):
        try:
            state = files.unpack(files.content_of(folder / name, files.LARGEST_UNPACKED))
            record = checked(Record, parse_json(state.pop(_RECORD).tobytes()))
        except FileNotFoundError:
            reasons[name] = "missing"
        except (OSError, ValueError) as error:
            reasons[name] = files.why_unread(error)
        except KeyError:
            reasons[name] = f"not a checkpoint of a run; {_RECORD} is missing or no record"
        else:
            if (reason := _misfit(record, folder / LOG, settings)) is None:
                return state, record, reasons
            reasons[name] = reason
    if set(reasons.values()) == {"missing"}:
        lines = summed(folder / LOG).lines
        if lines <= 1:  # a kill may have come between the first line and the first checkpoint
            return None
        raise ValueError(f"{folder}: {LOG} has {lines} lines, but no checkpoint is left; cannot resume")
    found = " and ".join(f"{name} ({reason})" for name, reason in reasons.items())
    raise ValueError(f"{folder}: {found} are unusable; cannot resume")


def restore(folder: Path, method: Method, state: State, name: str = CHECKPOINT) -> None:
    """Restore a method from the state in a checkpoint.

    Raises:
        ValueError: if the state does not fit the method; names the folder, the file and the array.
    """
    try:
        method.restore(state)
    except KeyError as missing:
        raise ValueError(f"{folder}: {name}: state: {missing} is missing") from None
    except (ValueError, IndexError) as error:
        raise ValueError(f"{folder}: {name}: {error}") from None


class Summed(NamedTuple):
    """Summary of the lines of a log: their checksum (which may be continued), their number, and the last line."""

    hasher: "hashlib._Hash"
    lines: int
    last: bytes


def summed(path: Path, count: int | None = None) -> Summed:
    """Summarise the complete lines of a log, or its first ``count``, with one line in memory at a time."""
    hasher, lines, last = hashlib.sha256(), 0, b""
    for line in itertools.islice(line_files.lines_of(path), count):
        hasher.update(line)
        lines, last = lines + 1, line
    return Summed(hasher, lines, last)


def _misfit(record: Record, log: Path, settings: str) -> str | None:
    """Reason why a checkpoint does not fit, or None if it fits."""
    if record.settings != settings:
        return "made with other settings"
    found = summed(log, record.lines)
    if found.lines < record.lines:
        return f"{LOG} has {found.lines} lines of {record.lines}"
    if found.hasher.hexdigest() != record.log:
        return f"{LOG} is not as it was written"
    return None
