"""Status of a run while it is going on, as values for JSON."""

import dataclasses
from pathlib import Path
from typing import Any

from optim.runs.config import score_in
from optim.runs.history import History, Progress, read_history, read_progress


def status_of(progress: Progress) -> dict[str, Any]:
    """Status of a run: its progress and its best result so far."""
    last = progress.last
    return {
        "folder": str(progress.path),
        "state": progress.state,
        "method": progress.config["method"]["name"],
        "generation": last.generation if last else None,
        "generations": progress.config["generations"],
        "evaluations": last.evaluations if last else 0,
        "failed": progress.failed,
        "score": dataclasses.asdict(score_in(progress.config)),
        "best": last.best if last else None,
        "mean": last.mean if last else None,
        "best_details": last.best_details if last else None,
        "numbers": last.numbers if last else {},
        "seconds_per_generation": progress.pace,
        "seconds_left": progress.seconds_left,
        "finished": progress.finished,
    }


def read_status(folder: Path) -> dict[str, Any]:
    """Status of the run in a folder; if it cannot be read, only the reason."""
    try:
        return status_of(read_progress(folder))
    except ValueError as error:
        return _damaged(folder, error)


def read_status_and_history(folder: Path) -> tuple[dict[str, Any], History | None]:
    """Status and history of the run in a folder; if it cannot be read, only the reason, and None."""
    try:
        history = read_history(folder)
    except ValueError as error:
        return _damaged(folder, error), None
    return status_of(history.progress), history


def _damaged(folder: Path, error: ValueError) -> dict[str, Any]:
    return {"folder": str(folder), "state": "damaged", "reason": str(error)}
