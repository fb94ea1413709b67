"""Gaits that the pipeline may choose from: those given, and what a search on each terrain finds."""

from pathlib import Path

from optim.experiments.results import Progress, part_of
from optim.pipeline.task import PipelineTask, slug
from optim.runs import open_run, run_search
from optim.runs.generation import Generation
from optim.search import build_method
from robots.inflatable.design import InflatableDesign
from robots.inflatable.timing import gait_steps
from robots.world import Terrain

FOUND = "found-"  # how names begin of what searches find


def find_gaits(
    task: PipelineTask, folder: Path, progress: Progress = None, threads: int | None = None
) -> dict[str, InflatableDesign]:
    """All candidates by name that are short enough and that the rig can play; searches go on where they were."""
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
    search, problem = task.search, task.problem(terrain, threads=threads)
    method = build_method(search.method, problem.space, task.method_settings)
    about = {"name": search.method, **task.method_settings}
    config = {"problem": problem.describe(), "method": about, "generations": search.generations}

    def told(done: Generation) -> None:
        if progress:
            progress((done.generation + 1) / (search.generations + 1))

    with open_run(folder, config, resume=True) as run:
        last = run_search(problem, method, run, search.generations, told)
    return problem.in_full().design(problem.space.from_dict(last.best_point)) if last.best_point else None
