"""How much of its speed a freeform robot keeps under changed conditions, from the tables of the study."""

from collections.abc import Collection, Sequence
from typing import Any

import numpy as np

from optim.experiments.tables import Record, column, distinct, markdown, select

START = "start"  # what the trials from noisy starts are called; others have the name of what was changed


def kept_speeds(runs: Sequence[Record], trials: Sequence[Record], searches: Collection[str]) -> dict[str, Any]:
    """Summarise the trials of what runs of some searches had found in the end.

    A design that does not move forwards is left out, since no part of its speed can be told.

    Args:
        runs: rows of ``runs.csv``, with ``score``, the speed in single precision.
        trials: rows of ``trials.csv``.
        searches: whose runs count.

    Returns:
        ``designs``; ``conditions``, with the number of designs tried under each, and the median, the least and the most
        of the parts of the speed that remain; ``starts`` and ``single_precision``, the largest parts by which the speed
        from a noisy start, and in single precision, differs from the median of noisy starts. Empty without any design.
    """
    last = {_run(row): row for row in sorted(runs, key=lambda row: row["seconds"]) if row["search"] in searches}
    tried: dict[tuple[Any, ...], list[Record]] = {}
    for trial in trials:
        tried.setdefault((*_run(trial), trial["seconds"]), []).append(trial)
    parts: list[Record] = []
    singles: list[float] = []
    for run, row in last.items():
        each = tried.get((*run, row["seconds"]), [])
        starts = column(select(each, trial=START), "speed")
        if row["score"] is None or not len(starts) or not (speed := float(np.median(starts))) > 0:
            continue
        parts += [{"trial": trial["trial"], "part": trial["speed"] / speed} for trial in each]
        singles.append(abs(row["score"] / speed - 1))
    if not singles:
        return {}
    by_trial = {name: column(select(parts, trial=name), "part") for name in distinct(parts, "trial")}
    return {
        "designs": len(singles),
        "starts": float(np.abs(by_trial.pop(START) - 1).max()),
        "single_precision": max(singles),
        "conditions": {
            name: {
                "designs": len(found),
                "median": float(np.median(found)),
                "least": float(found.min()),
                "most": float(found.max()),
            }
            for name, found in by_trial.items()
        },
    }


def kept_table(kept: dict[str, Any]) -> list[str | list[str]]:
    """Paragraphs and a table of what :func:`kept_speeds` found; none of nothing."""
    if not kept:
        return []
    lines = [
        (name, str(each["designs"]), *(f"{each[part]:.2f}" for part in ("median", "least", "most")))
        for name, each in kept["conditions"].items()
    ]
    return [
        "The part of its speed that remains under other conditions, of each design that a search with gradients found:",
        markdown(("condition", "designs", "median", "least", "most"), "lrrrr", lines),
        f"Of all {kept['designs']}, the speed from a noisy start differs from the median of such starts by at most "
        f"{100 * kept['starts']:.1f} %, and the speed in single precision by {100 * kept['single_precision']:.1f} %.",
    ]


def _run(row: Record) -> tuple[Any, ...]:
    return row["problem"], row["search"], row["seed"]
