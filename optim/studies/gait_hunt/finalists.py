"""The finalists of a run, judged once and kept."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from optim.gait_problem import GaitProblem
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
    path: Path, history: History, problem: GaitProblem, terrain: Terrain, count: int, runs: int, progress: Progress,
    **where: Any,
) -> list[Finalist]:  # fmt: skip
    """The last bests of a run, played in full: from the file, if they are of this run and so many, or now.

    Args:
        path: of the JSON file, which may be missing, or of fewer generations.
        history: of the run.
        problem: that it searched.
        terrain: to play them on.
        count: how many, at most.
        runs: of each under either condition.
        progress: called with the fraction done.
        where: options of the simulations.
    """
    found = last_bests(history, problem, count)
    of = {"generations": len(history.generations), "count": count, "runs": runs}
    known = _read(path)
    if known.get("of") != of:
        judged = judge_finalists(found, terrain, runs, progress=progress, **where)
        speeds = [[f.speeds.tolist(), f.hard_speeds.tolist()] for f in judged]
        known = {"of": of, "speeds": json.loads(json.dumps(speeds).replace("NaN", "null"))}
        write_text(path, json.dumps(known) + "\n")
    return [
        Finalist(*one, *(np.array(values, float) for values in speeds))
        for one, speeds in zip(found, known["speeds"], strict=True)
    ]
