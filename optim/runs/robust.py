"""Read ``robust.json`` of runs: the judgements of their best designs over draws that their searches never used."""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from optim.measures.statistics import mean_interval
from optim.problems.uncertain import ROBUST_FILE
from robots.uncertainty import interval_of, spoken
from taichi_sim.base.checks import NotNegative, number, whole_number
from taichi_sim.base.files import read_json
from taichi_sim.base.records import checked

NAMES = ("mean", "cvar", "worst")


@dataclass(frozen=True)
class HeldOut:
    """One statistic of a group of runs over held-out draws in one world.

    Attributes:
        label: label of the group.
        world: name of the world.
        name: ``"mean"``, ``"cvar"`` or ``"worst"``.
        runs: number of runs with a valid judgement.
        value: value of one run, or the mean of several.
        low: lower end of its 95 % interval, over the draws of one run or, by Student's t, over several runs; None of
            the worst draw of one run.
        high: upper end.
    """

    label: str
    world: str
    name: str
    runs: int
    value: float
    low: float | None
    high: float | None


Share = Annotated[float, partial(number, low=0.0, high=1.0)]
Draws = Annotated[int, partial(whole_number, low=0, high=2**31 - 1)]


@dataclass(frozen=True)
class _Robust:
    """Content of ``robust.json``."""

    risk: str
    terrains: dict[str, dict[str, Any]]


@dataclass(frozen=True)
class _Failed:
    """Judgement in a world in which some draws failed."""

    uncertain: str
    draws: Draws
    failed: Draws


@dataclass(frozen=True)
class _Judged(_Failed):
    """Judgement in a world in which no draw failed."""

    measure: str
    unit: str
    risk: str
    share: Share
    sd: NotNegative
    mean: float
    mean_low: float
    mean_high: float
    cvar: float
    cvar_low: float
    cvar_high: float
    worst: float
    worst_low: float
    worst_high: float
    stands_in: bool = False  # whether the robot's first measure replaces an objective that is not a single measure


def read_robust(folder: Path) -> Mapping[str, Mapping[str, Any]]:
    """Judgements of a run by world; none if there is no ``robust.json``, as when nothing was uncertain.

    A damaged file is ignored with a warning that names the field.
    """
    try:
        return checked_robust(folder)
    except ValueError as error:
        warnings.warn(f"{error}; it is left out", stacklevel=2)
        return {}


def checked_robust(folder: Path) -> Mapping[str, Mapping[str, Any]]:
    """Judgements of a run by world; none if there is no such file.

    Raises:
        ValueError: if it is damaged; names the file and the field.
    """
    path = folder / ROBUST_FILE
    return read_json(path, _judgements) if path.exists() else {}


def _judgements(found: object) -> Mapping[str, Mapping[str, Any]]:
    judged = checked(_Robust, found).terrains
    for world, each in judged.items():
        checked(_Judged if each.get("failed") == 0 else _Failed, each, f"terrains.{world}")
    return judged


def lines_of(folder: Path) -> list[str]:
    """Judgements in a run's folder as readable text, one line for each world."""
    return [f"{world}: {spoken(judged)}" for world, judged in read_robust(folder).items()]


def held_out(groups: Mapping[str, Sequence[str]]) -> list[HeldOut]:
    """Statistics over held-out draws of groups of run folders, given by label."""
    found = []
    for label, folders in groups.items():
        known = [read_robust(Path(folder)) for folder in folders]
        for world in dict.fromkeys(world for judged in known for world in judged):
            ok = [judged[world] for judged in known if world in judged and not judged[world].get("failed")]
            for name in NAMES if ok else ():
                values = [float(judged[name]) for judged in ok]
                ends = mean_interval(values) if len(ok) > 1 else interval_of(ok[0], name)
                found.append(HeldOut(label, world, name, len(ok), float(np.mean(values)), *(ends or (None, None))))
    return found
