"""Status of a run while it goes on, as values that fit JSON."""

import dataclasses
from pathlib import Path
from typing import Any

from optim.runs.config import score_in
from optim.runs.history import History, read_history


def status_of(history: History) -> dict[str, Any]:
    """Status of a run: how far it is, and what it has found."""
    last = history.generations[-1] if history.generations else None
    return {
        "folder": str(history.path),
        "state": history.state,
        "method": history.config["method"]["name"],
        "generation": last.generation if last else None,
        "generations": history.config["generations"],
        "evaluations": last.evaluations if last else 0,
        "failed": sum(generation.failed for generation in history.generations),
        "score": dataclasses.asdict(score_in(history.config)),
        "best": last.best if last else None,
        "mean": last.mean if last else None,
        "best_details": last.best_details if last else None,
        "numbers": last.numbers if last else {},
        "seconds_per_generation": history.pace,
        "seconds_left": history.seconds_left,
        "finished": history.finished,
    }


def read_status(folder: Path) -> tuple[dict[str, Any], History | None]:
    """Status of the run in a folder, with its history; of one that cannot be read, only why, and None."""
    try:
        history = read_history(folder)
    except ValueError as error:
        return {"folder": str(folder), "state": "damaged", "reason": str(error)}, None
    return status_of(history), history
