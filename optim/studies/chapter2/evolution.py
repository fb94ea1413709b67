"""Runs of climbers side by side, kept in a folder, where they go on after any interruption."""

import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from optim.experiments.results import Progress
from optim.studies.chapter2.climbers import Climbers
from optim.studies.chapter2.settings import Interference, Treatment
from optim.studies.chapter2.trainers import TRAINERS
from taichi_sim import runtime
from taichi_sim.base import checks
from taichi_sim.base.arrays import Arrays
from taichi_sim.base.results_folder import ResultsFolder

KIND = "interference"
SECONDS_BETWEEN_FILES = 60.0  # a kill loses so much

Run = tuple[Treatment, int]


def evolve(
    settings: Interference,
    chosen: Sequence[Treatment],
    runs: int,
    generations: int,
    out: Path | None = None,
    threads: int | None = None,
    progress: Progress = None,
) -> dict[Run, Arrays]:
    """Train every treatment in every run.

    All that lag behind move on together: their controllers go through one simulation for each kind of robot and
    generation. What a run does depends neither on those beside it nor on where it went on.

    Args:
        settings: that all results depend on.
        chosen: treatments.
        runs: of each, numbered from 0, which is also their seed.
        generations: after the first population.
        out: folder that takes a file for each run and goes on from it; also with more treatments, runs, generations.
        threads: CPU threads; no result depends on them.
        progress: called with the fraction done.

    Returns:
        Of every treatment and run, the state of its climbers, as ``Climbers.state`` tells.

    Raises:
        ValueError: in one line, for numbers that are not allowed, a device that is not there, or a folder of other
            settings, or of runs that went further.
    """
    for name, value, low in (("runs", runs, 1), ("generations", generations, 0)):
        checks.integer(name, value, low)
    runtime.start(settings.device, settings.precision, threads)  # refuses what is not there before a folder is made
    folder = None if out is None else ResultsFolder(out, KIND, asdict(settings))
    members = {
        (treatment, run): TRAINERS[treatment.trainer](treatment, run, settings, threads)
        for treatment in chosen
        for run in range(runs)
    }
    for (treatment, run), climbers in members.items():
        for state in folder.load(treatment.file(run)) if folder else ():
            if "climber" in state:
                climbers.restore(state)
    goal, reached = generations + 1, max(each.generation for each in members.values())
    if reached > goal:
        raise ValueError(f"generations: {generations} is not allowed; {out} holds {reached - 1}")
    changed: set[Run] = set()
    written = time.monotonic()
    while (lag := min(each.generation for each in members.values())) < goal:
        behind = {key: each for key, each in members.items() if each.generation == lag}
        for robot in dict.fromkeys(treatment.robot for treatment, _ in behind):
            _advance(settings, robot, [each for key, each in behind.items() if key[0].robot == robot], threads)
        changed |= set(behind)
        if progress:
            progress(sum(each.generation for each in members.values()) / (goal * len(members)))
        if time.monotonic() - written > SECONDS_BETWEEN_FILES:
            _write(folder, members, changed)
            written = time.monotonic()
    _write(folder, members, changed)
    return {key: each.state() for key, each in members.items()}


def _advance(settings: Interference, robot: str, climbers: Sequence[Climbers], threads: int | None) -> None:
    """A generation of some runs of one robot."""
    asked = [each.ask() for each in climbers]
    seen = settings.simulate(robot, np.concatenate(asked), threads)
    ends = np.cumsum([len(weights) for weights in asked])[:-1]
    parts = zip(climbers, asked, np.split(seen.light, ends), np.split(seen.distance, ends), strict=True)
    for each, weights, light, distance in parts:
        each.tell(weights, light, distance)


def _write(folder: ResultsFolder | None, members: dict[Run, Climbers], changed: set[Run]) -> None:
    """Write the files of all runs that moved since, and forget that they did."""
    for treatment, run in sorted(changed, key=lambda key: key[0].file(key[1])) if folder else ():
        name = treatment.file(run)
        folder.add(name, name.encode(), **members[treatment, run].state())  # type: ignore[union-attr]
    changed.clear()
