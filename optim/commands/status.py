"""``morpholab status``: how far runs are."""

import argparse
from typing import Any

from optim.commands import Report, options
from optim.exit_codes import FAILED
from optim.problem import Objective
from optim.wording import spoken_duration
from taichi_sim.base.short_text import counted

COMMAND = options.Command(
    "status",
    "tell how far runs are",
    "Tell how far runs are, what they have found, and whether their files are whole.",
    (options.RUNS,),
)


def run(args: argparse.Namespace) -> Report:
    """Look at each run."""
    from optim.runs.history import runs_below
    from optim.runs.run_status import read_status

    documents = [read_status(path) for path in runs_below(args.runs)]
    damaged = any(document["state"] == "damaged" for document in documents)
    return Report(documents, "\n".join(map(_text, documents)), FAILED if damaged else 0)


def _text(document: dict[str, Any]) -> str:
    head = f"{document['folder']}: {document['state']}"
    if document["state"] == "damaged":
        return f"{head}: {document['reason'].removeprefix(document['folder'] + ': ')}"
    if document["generation"] is None:
        return f"{head}, {document['method']}, no complete generation yet of {document['generations']}"
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
