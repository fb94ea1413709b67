"""What the searches of chapter 5 have found so far: of run folders, and as a table of speeds."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import groupby
from operator import itemgetter
from pathlib import Path

import numpy as np

from optim.experiments.data import Data
from optim.experiments.tables import write_table
from optim.runs.history import read_history, read_result
from optim.studies.chapter5.experiments import EXPERIMENTS, ShapeChange
from robots.inflatable.design import InflatableDesign
from taichi_sim.base.arrays import Floats

SPEEDS = "speeds.csv"
NAMES = {experiment.name for experiment in EXPERIMENTS}
COLUMNS = {"experiment": str, "generation": int, "climber": int, "speed": float | None}


@dataclass(frozen=True, eq=False)
class Found:
    """The designs and scores that an experiment has found so far."""

    # best speeds of the climbers after every generation [body lengths/s], shape (G + 1, C); NaN while all have failed
    scores: Floats
    designs: tuple[InflatableDesign, ...]  # the climbers' best, C; none where a table tells of the speeds only
    evaluations: int  # made

    @property
    def final(self) -> Floats:
        """Speeds of the best designs of the climbers that have any, shape (at most C,)."""
        last = self.scores[-1]
        return last[~np.isnan(last)]

    def best(self, count: int) -> list[int]:
        """The climbers with the fastest designs, the fastest first; those without any are left out."""
        order = np.argsort(-np.nan_to_num(self.scores[-1], nan=-np.inf), kind="stable")
        return [int(climber) for climber in order if not np.isnan(self.scores[-1, climber])][:count]


def read(settings: ShapeChange, folder: Path) -> dict[str, Found]:
    """Read what experiments in a folder have found so far, by name, without those that have no generation yet."""
    found = {}
    for experiment in EXPERIMENTS:
        history, problem = read_history(folder / experiment.name), settings.problem(experiment)
        if (result := read_result(history, problem)) is None:
            continue
        scores = np.array([generation.scores for generation in history.generations], float)
        designs = tuple(d for d in map(problem.design, result.points) if isinstance(d, InflatableDesign))
        found[experiment.name] = Found(scores, designs, history.generations[-1].evaluations)
    return found


def write_speeds(found: Mapping[str, Found], path: Path) -> None:
    """Write a row for each climber after each generation: its best speed, empty while all its designs have failed."""
    rows = [
        (name, generation, climber, speed)
        for name, one in found.items()
        for generation, speeds in enumerate(one.scores)
        for climber, speed in enumerate(np.where(np.isnan(speeds), None, speeds))
    ]
    write_table(path, tuple(COLUMNS), rows)


def read_speeds(data: Data, climbers: int) -> dict[str, Found]:
    """Read what :func:`write_speeds` wrote, without the designs; raises ValueError for what it cannot have written."""
    rows = data.records(SPEEDS, COLUMNS, finite=("speed",))
    path = data.path(SPEEDS)
    found = {}
    for name, each in groupby(rows, itemgetter("experiment")):
        of_experiment = list(each)
        generations, climbing = divmod(len(of_experiment), climbers)
        order = [(row["generation"], row["climber"]) for row in of_experiment]
        if name in found or name not in NAMES or climbing or order != list(np.ndindex(generations, climbers)):
            raise ValueError(f"{path}: its rows of {name} are not those of {climbers} climbers by generation")
        speeds = np.array([row["speed"] for row in of_experiment], float)
        found[name] = Found(speeds.reshape(generations, climbers), (), generations * climbers)
    return found
