"""Whether the files of a run are as they were written."""

import contextlib
import json
import tempfile
from pathlib import Path

import numpy as np

from optim.problem import Problem
from optim.runs.folder import ENVIRONMENT
from optim.runs.history import History
from taichi_sim.base import files

STATES = {"finished": "finished", "running": "running", "stopped": "interrupted"}


def state_of(history: History) -> str:
    """``"finished"``, ``"running"`` or ``"interrupted"``."""
    return STATES[history.state]


def damages(history: History, problem: Problem) -> list[str]:
    """What is wrong with files of a run that can still be read, a line each; none as a rule.

    What makes a run unreadable is an error of ``read_history``.
    """
    if history.found is None:
        return []
    _, record, others = history.found
    told = [f"{name} is unusable ({reason}); the one before is used" for name, reason in others.items()]
    if files.sha256(_content(history.path / ENVIRONMENT)) != record.environment:
        told.append(f"{ENVIRONMENT} is not as it was written; versions and machine may not be the run's")
    if np.isnan(history.seconds).any():
        told.append("timing.jsonl is not as it was written; not all times are known")
    best = history.generations[-1].best_point
    if best is not None and not history.running:  # else it may be newer than what was read
        only_its_file_saves = contextlib.suppress(NotImplementedError)  # a problem of the user's own
        with tempfile.TemporaryDirectory() as folder, only_its_file_saves:
            problem.save(problem.space.from_dict(best), Path(folder) / "best.json")
            if _content(history.path / "best.json") != _content(Path(folder) / "best.json"):
                told.append("best.json is not the best design of the log; the log's is shown here")
    return told


def read_environment(folder: Path) -> dict[str, object]:
    """What a run ran on, as far as that can be read."""
    try:
        found = json.loads(_content(folder / ENVIRONMENT))
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}


def _content(path: Path) -> bytes:
    return path.read_bytes() if path.is_file() else b""
