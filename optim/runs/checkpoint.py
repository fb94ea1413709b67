"""Checkpoints: the state of a search, and checksums of the files that go with it.

A checkpoint fits its folder if the settings are those it was made with, and the log begins with the very lines it
knew. The newest that is whole and fits is where a run goes on.
"""

import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_sim.base import files
from taichi_sim.base.arrays import Arrays

State = Arrays

CHECKPOINT, PREVIOUS, LOG = "checkpoint.npz", "checkpoint.previous.npz", "log.jsonl"
_RECORD = "run/record"  # entry of a checkpoint beside the method's own


@dataclass(frozen=True)
class Record:
    """What a checkpoint knows of its run.

    Attributes:
        lines: of the log.
        log: checksum of these.
        timing: checksum of ``timing.jsonl``.
        environment: checksum of ``environment.json``.
        settings: checksum of the settings, see ``config.identity``.
    """

    lines: int
    log: str
    timing: str
    environment: str
    settings: str


def save(folder: Path, state: Mapping[str, NDArray[Any]], record: Record) -> None:
    """Write a checkpoint; the last one becomes the previous one."""
    own = {_RECORD: np.frombuffer(json.dumps(asdict(record)).encode(), np.uint8)}
    with files.replacing(folder / CHECKPOINT) as aside:
        aside.write_bytes(files.pack({**state, **own}))
        if (folder / CHECKPOINT).exists():
            os.replace(folder / CHECKPOINT, folder / PREVIOUS)


def load(folder: Path, settings: str) -> tuple[State, Record, dict[str, str]] | None:
    """The newest checkpoint that fits, and why others did not, by file name; None if there has not been any.

    Raises:
        ValueError: if there are checkpoints, or lines of the log, but no checkpoint fits.
    """
    lines = files.complete_lines(folder / LOG)
    reasons: dict[str, str] = {}
    for name in (CHECKPOINT, PREVIOUS):
        try:
            state = files.unpack((folder / name).read_bytes())
            record = Record(**json.loads(state.pop(_RECORD).tobytes()))
        except FileNotFoundError:
            reasons[name] = "missing"
        except (OSError, ValueError, KeyError, TypeError) as error:
            reasons[name] = str(error) if isinstance(error, OSError | ValueError) else "not a checkpoint of a run"
        else:
            if (reason := _misfit(record, lines, settings)) is None:
                return state, record, reasons
            reasons[name] = reason
    if set(reasons.values()) == {"missing"}:
        if len(lines) <= 1:  # one may have come just before the first checkpoint
            return None
        raise ValueError(f"{folder}: {LOG} has {len(lines)} lines, but no checkpoint is left; cannot resume")
    found = " and ".join(f"{name} ({reason})" for name, reason in reasons.items())
    raise ValueError(f"{folder}: {found} are unusable; cannot resume")


def _misfit(record: Record, lines: list[bytes], settings: str) -> str | None:
    """Why a checkpoint does not fit; None if it does."""
    if record.settings != settings:
        return "made with other settings"
    if len(lines) < record.lines:
        return f"{LOG} has {len(lines)} lines of {record.lines}"
    if files.sha256(b"".join(lines[: record.lines])) != record.log:
        return f"{LOG} is not as it was written"
    return None
