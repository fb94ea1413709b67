"""The finalists of a search's runs, judged once and kept."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from optim.gait_problem import GaitProblem
from optim.runs.files import sha256
from optim.runs.history import History
from optim.studies.gait_hunt.judging import Finalist, judge_finalists, last_bests
from optim.studies.results import Progress
from robots.files import read_text, write_text
from robots.terrain import Terrain


def _read(path: Path) -> dict[str, Any]:
    """What is kept; what is damaged is as good as missing."""
    try:
        known = json.loads(read_text(path)) if path.exists() else {}
    except ValueError:
        return {}
    return known if isinstance(known, dict) and isinstance(known.get("speeds"), list) else {}


def kept_finalists(
    path: Path, histories: Sequence[History], problem: GaitProblem, terrain: Terrain, count: int, runs: int,
    progress: Progress, **where: Any,
) -> list[list[Finalist]]:  # fmt: skip
    """The last bests of each run of a search, played in full: from the file, if they are of these runs, or now.

    All of them are one batch under either condition, since a few robots take as long as a vector full of them. The
    noise of each follows from its place among them.

    Args:
        path: of the JSON file, which may be missing, or of fewer generations.
        histories: of the runs.
        problem: that they searched.
        terrain: to play them on.
        count: how many of each run, at most.
        runs: with noise, of each under either condition.
        progress: called with the fraction done.
        where: options of the simulations.
    """
    found = [last_bests(history, problem, count) for history in histories]
    bests = json.dumps([[generation.best_point for generation in history.generations] for history in histories])
    of = {"bests": sha256(bests.encode()), "count": count, "runs": runs}
    known, listed = _read(path), [each for one in found for each in one]
    if known.get("of") != of or len(known["speeds"]) != len(listed):
        judged = judge_finalists(listed, terrain, runs, progress=progress, **where)
        speeds = [[f.speeds.tolist(), f.hard_speeds.tolist()] for f in judged]
        known = {"of": of, "speeds": json.loads(json.dumps(speeds).replace("NaN", "null"))}
        write_text(path, json.dumps(known) + "\n")
    rest = iter(known["speeds"])
    return [[Finalist(*each, *(np.array(values, float) for values in next(rest))) for each in one] for one in found]
