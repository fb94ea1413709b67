"""Check that the scores of several runs mean the same, before they are compared; the best run of several seeds."""

import json
import math
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from optim.problem import GAIT
from optim.runs.config import GROUND_FILES, folders_of_seeds, has_run
from optim.runs.history import History, begun, read_histories
from robots.partly_fixed import inner_description
from robots.robot import KINDS

# Settings of a problem on which scores depend; the others may differ between runs that are compared.
JUDGED = (
    "kind",
    "terrains",
    "terrain",
    "worlds",
    "objective",
    "measure",
    "summed",
    "objectives",
    "steps",
    "warm_up",
    "stages",
    "ladder",
    "ahead",
    "hard",
    "uncertain",
    "risk",
    "effort",
    "geometry",
    "weight",
    "properties",
    "repeats",
    "actuation",
    "task",
    "sha256",
    "objective_names",
)


def check_comparable(histories: Sequence[History]) -> None:
    """Raise ValueError unless the scores of all runs have the same meaning; warn of trials that differ."""
    first = histories[0]
    for other in histories[1:]:
        problems = [{"kind": GAIT, **history.config["problem"]} for history in (first, other)]
        files = [history.config.get(GROUND_FILES) for history in (first, other)]
        if all(files):  # earlier versions did not record them
            problems = [{**each, GROUND_FILES: told} for each, told in zip(problems, files, strict=True)]
        for name in (*JUDGED, GROUND_FILES):
            values = [json.dumps(problem.get(name)) for problem in problems]
            if values[0] != values[1] and not (name == "worlds" and _are_same_worlds(problems)):
                raise ValueError(
                    f"run: {first.path} and {other.path} are judged differently ({name} {values[0]} and {values[1]}); "
                    "give runs whose scores mean the same"
                )
    _warn_of_trials(histories)


def _are_same_worlds(problems: Sequence[Mapping[str, Any]]) -> bool:
    """Whether problems of one kind have the same worlds, which versions may have called otherwise."""
    kind = KINDS.find(problems[0]["kind"])
    first, *others = (
        [kind.present_world(kind.world_of(record)) for record in problem.get("worlds", ())] for problem in problems
    )
    return all(other == first for other in others)


def best_of_seeds(folder: Path) -> History:
    """The run with the best score in the folder of several seeds; the first of those that are equal.

    Raises:
        ValueError: if there is none with a complete generation, or their scores mean different things.
    """
    found, _ = read_histories(filter(has_run, folders_of_seeds(folder)), begun)
    check_comparable(found)
    return max(found, key=lambda history: -math.inf if (best := history.generations[-1].best) is None else best)


def _warn_of_trials(histories: Sequence[History]) -> None:
    """Warn once of all settings of the trials that differ between runs, such as a duration."""
    problems = [history.config["problem"] for history in histories]
    if any(not isinstance(problem.get("robot"), str) for problem in problems):
        return
    records = [inner_description(json.loads(problem["robot"])) for problem in problems]
    found = []
    for name in KINDS.find(problems[0]["kind"]).trial_fields:
        values = [_part_of(record, name) for record in records]
        if any(value != values[0] for value in values):
            told = dict.fromkeys("usual" if value is None else f"{value}" for value in values)
            found.append(f"{name.rpartition('.')[2].replace('_', ' ')} ({', '.join(told)})")
    if found:
        warnings.warn(f"the runs differ in {', '.join(found)}: their scores may not mean the same", stacklevel=2)


def _part_of(record: Any, name: str) -> Any:
    """Value of a field of a description; dots in the name lead to fields of parts; None where there is none."""
    for part in name.split("."):
        record = record.get(part) if isinstance(record, Mapping) else None
    return record
