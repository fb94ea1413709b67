"""``morpholab status``: how far runs are."""

import argparse
import dataclasses
from typing import TYPE_CHECKING, Any

from optim.commands import FAILED, Report, options
from optim.problem import Objective
from optim.wording import counted, spoken_duration

if TYPE_CHECKING:
    from optim.runs.history import History

COMMAND = options.Command(
    "status",
    "tell how far runs are",
    "Tell how far runs are, what they have found, and whether their files are whole.",
    (options.RUNS,),
)


def run(args: argparse.Namespace) -> Report:
    """Look at each run."""
    from optim.runs.history import read_history, runs_below

    documents: list[dict[str, Any]] = []
    for path in runs_below(args.runs):
        try:
            documents.append(_document(read_history(path)))
        except ValueError as error:
            documents.append({"folder": str(path), "state": "damaged", "reason": str(error)})
    damaged = any(document["state"] == "damaged" for document in documents)
    return Report(documents, "\n".join(map(_text, documents)), FAILED if damaged else 0)


def _document(history: "History") -> dict[str, Any]:
    from optim.runs.config import score_in

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


def _text(document: dict[str, Any]) -> str:
    head = f"{document['folder']}: {document['state']}"
    if document["state"] == "damaged":
        return f"{head}: {document['reason'].removeprefix(document['folder'] + ': ')}"
    if document["generation"] is None:
        return f"{head}, {document['method']}, no complete generation yet of {document['generations'] + 1}"
    score = Objective(**document["score"])
    parts = [
        f"{head}, {document['method']}",
        f"generation {document['generation']}/{document['generations']}",
        f"best {score.name} {score.value(document['best'])}",
        f"{counted(document['evaluations'], 'evaluation')} ({document['failed']} failed)",
    ]
    if document["seconds_per_generation"] is not None:
        parts.append(f"{spoken_duration(document['seconds_per_generation'])} a generation")
    if document["seconds_left"]:
        parts.append(f"{spoken_duration(document['seconds_left'])} left")
    return ", ".join(parts)
