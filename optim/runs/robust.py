"""What runs found of their best designs over draws that their searches never saw, as their ``robust.json`` says."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from optim.measures.statistics import mean_band
from optim.problems.uncertain import ROBUST_FILE
from robots.uncertainty import spoken

NAMES = ("mean", "cvar", "worst")


@dataclass(frozen=True)
class HeldOut:
    """A number of a group of runs over held-out draws, in one world.

    Attributes:
        label: of the group.
        world: where.
        name: ``"mean"``, ``"cvar"`` or ``"worst"``.
        runs: how many runs are known.
        value: of one run, or the mean of several.
        low: lower end of its 95 % bootstrap interval: over the draws of one run, or over the runs.
        high: upper end.
    """

    label: str
    world: str
    name: str
    runs: int
    value: float
    low: float
    high: float


def read_robust(folder: Path) -> Mapping[str, Mapping[str, Any]]:
    """Judgements of a run by world; none if nothing was uncertain, or the file is lost or damaged."""
    try:
        found = json.loads((folder / ROBUST_FILE).read_text(encoding="utf-8"))["terrains"]
        judged = {str(world): dict(each) for world, each in found.items()}
        _ = [spoken(each) for each in judged.values()]  # what is damaged lacks something
        return judged
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return {}


def told_of(folder: Path) -> list[str]:
    """Lines for people, one for each world."""
    return [f"{world}: {spoken(judged)}" for world, judged in read_robust(folder).items()]


def held_out(groups: Mapping[str, Sequence[str]]) -> list[HeldOut]:
    """What is known of groups of run folders, by their labels."""
    found = []
    for label, folders in groups.items():
        known = [read_robust(Path(folder)) for folder in folders]
        for world in dict.fromkeys(world for judged in known for world in judged):
            ok = [judged[world] for judged in known if world in judged and not judged[world].get("failed")]
            for name in NAMES if ok else ():
                values = [float(judged[name]) for judged in ok]
                low, high = mean_band(values) if len(ok) > 1 else (ok[0][f"{name}_low"], ok[0][f"{name}_high"])
                found.append(HeldOut(label, world, name, len(ok), float(np.mean(values)), float(low), float(high)))
    return found
