"""Gaits that the pipeline may choose from: those given, and what a search on each terrain finds; their speeds."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.results import Progress, cached, part_of
from optim.pipeline.task import PipelineTask
from optim.runs import open_run, run_search
from optim.search import build_method
from robots.inflatable import simulation
from robots.inflatable.design import InflatableDesign
from robots.inflatable.robustness import NOISE
from robots.inflatable.timing import gait_steps
from robots.world import Terrain
from taichi_sim.base.results_folder import ResultsFolder

FOUND = "found-"  # how names begin of what searches find


class NoWorkingGait(RuntimeError):
    """A terrain has no gait that works."""


def slug(terrain: Terrain) -> str:
    """The name of a terrain in names of files."""
    return terrain.name.replace(":", "-")


def find_gaits(
    task: PipelineTask, folder: Path, progress: Progress = None, threads: int | None = None
) -> dict[str, InflatableDesign]:
    """All candidates by name that are short enough and that the rig can play; searches go on where they were.

    Args:
        task: what is asked for.
        folder: takes the run of a search on each terrain.
        progress: called with the fraction done.
        threads: CPU threads.
    """
    found = dict(task.gaits)
    for place, terrain in enumerate(task.terrains if task.search else ()):
        best = _search(task, terrain, folder / slug(terrain), part_of(progress, place, len(task.terrains)), threads)
        if best is not None:
            found[FOUND + slug(terrain)] = best
    return {
        name: design
        for name, design in found.items()
        if gait_steps(design.schedule, task.robot["actuation"]) <= task.limits.most_steps and not task.refusal(design)
    }


def _search(
    task: PipelineTask, terrain: Terrain, folder: Path, progress: Progress, threads: int | None
) -> InflatableDesign | None:
    """The best gait of a search on a terrain, in full; None if all failed."""
    assert task.search is not None
    search, settings = task.search, task.method_settings(task.search)
    problem = task.problem(terrain, threads=threads)
    config = {
        "problem": problem.describe(),
        "method": {"name": search.method, **settings},
        "generations": search.generations,
    }
    with open_run(folder, config, resume=True) as run:
        last = run_search(
            problem,
            build_method(search.method, problem.space, settings),
            run,
            search.generations,
            lambda done: progress((done.generation + 1) / (search.generations + 1)) if progress else None,
        )
    return problem.in_full().design(problem.space.from_dict(last.best_point)) if last.best_point else None


def speeds_of(
    designs: Mapping[str, InflatableDesign],
    task: PipelineTask,
    folder: ResultsFolder,
    progress: Progress = None,
    threads: int | None = None,
) -> dict[str, np.ndarray]:
    """Speeds of gaits on all terrains, with noise [body lengths/s], shape (terrains, runs) each; NaN of failures.

    Args:
        designs: by name.
        task: says where, and how often.
        folder: keeps what is simulated.
        progress: called with the fraction done.
        threads: CPU threads.
    """
    where: dict[str, Any] = {**task.robot, "precision": task.precision, "threads": threads}
    found, total = {}, len(designs) * len(task.terrains)
    for number, (name, design) in enumerate(designs.items()):
        rows = []
        for place, terrain in enumerate(task.terrains):
            part = part_of(progress, number * len(task.terrains) + place, total)
            copies = [design] * task.runs

            def play(
                copies: Sequence[InflatableDesign] = copies, terrain: Terrain = terrain, part: Progress = part
            ) -> Any:
                run = simulation.simulate(copies, terrain, perturbation=NOISE, seed=task.seed, progress=part, **where)
                return {"speeds": run.speed}

            rows.append(cached(folder, f"speed_{name}_{slug(terrain)}".replace("-", "_"), play)["speeds"])
        found[name] = np.array(rows)
    return found


def check_working(speeds: Mapping[str, np.ndarray], task: PipelineTask) -> None:
    """Refuse a task of which a terrain has no gait that works.

    Raises:
        NoWorkingGait: in one line, with what was tried and how fast it was.
    """
    for place, terrain in enumerate(task.terrains):
        means = {name: float(each[place].mean()) for name, each in speeds.items()}
        if not any(speed >= task.limits.least_speed for speed in means.values()):
            tried = ", ".join(
                f"{name} {'diverged' if np.isnan(speed) else f'{speed:.4f}'}" for name, speed in means.items()
            )
            raise NoWorkingGait(
                f"{terrain.name}: no gait reaches {task.limits.least_speed:g} BL/s; tried: {tried or 'none'}"
            )
