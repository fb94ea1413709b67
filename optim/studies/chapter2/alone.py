"""Each robot trained on each light alone: whether all bodies can do the task at all.

Source: dissertation, chapter 2, "Discussion": "all morphologies reached and waited at the light source when trained
against a single environment".
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.results import Progress, part_of
from optim.experiments.tables import write_table
from optim.studies.chapter2.champions import champions_of, time_near
from optim.studies.chapter2.evolution import evolve
from optim.studies.chapter2.settings import Interference, Treatment

COLUMNS = ("robot", "x", "y", "run", "distance", "time_near", "time_near_at_the_end")


@dataclass(frozen=True)
class Alone:
    """How much is trained on each light.

    Attributes:
        runs: of each robot.
        generations: of each run.
    """

    runs: int
    generations: int


def train_alone(
    settings: Interference,
    robots: Sequence[str],
    effort: Alone,
    out: Path,
    threads: int | None = None,
    progress: Progress = None,
) -> list[dict[str, Any]]:
    """Train each robot on each light alone, and write what its champions do as ``alone.csv``.

    Args:
        settings: whose lights are taken one by one; each has a folder of its own in ``out / "alone"``.
        robots: names.
        effort: runs and generations.
        out: folder of the study.
        threads: CPU threads.
        progress: called with the fraction done.

    Returns:
        For each robot and light: means of the champions' distance from the light at the end [m], and of the time that
        they spend within half a metre of it, in all and up to the end [s].
    """
    rows, summary = [], []
    chosen = [Treatment(robot, "min") for robot in robots]  # all ways to combine one environment are the same
    for n, light in enumerate(settings.lights):
        single = replace(settings, lights=(light,))
        folder = out / "alone" / f"{light[0]:g},{light[1]:g}"
        found = evolve(
            single, chosen, effort.runs, effort.generations, folder, threads, part_of(progress, n, len(settings.lights))
        )
        for treatment, seen in champions_of(single, found, threads).items():
            near, waiting = time_near(seen, single.lights)
            numbers = np.column_stack([seen.distance, near, waiting])
            rows += [(treatment.robot, *light, run, *values) for run, values in enumerate(numbers.tolist())]
            means = dict(zip(COLUMNS[4:], numbers.mean(axis=0).tolist(), strict=True))
            summary.append({"robot": treatment.robot, "light": list(light), "runs": effort.runs, **means})
    write_table(out / "alone.csv", COLUMNS, rows)
    return summary
