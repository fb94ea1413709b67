"""The pipeline: from a task to a package. What is simulated is kept, so the same command goes on where it was."""

import dataclasses
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from optim.experiments.results import Progress, check_folder, part_of
from optim.pipeline.candidates import check_working, find_gaits, slug, speeds_of
from optim.pipeline.changes import Change, find_change
from optim.pipeline.crossing import best_single_gait, cross
from optim.pipeline.machine import State, change_name
from optim.pipeline.package import Package
from optim.pipeline.plans import Plan, best_of_one_gait, best_of_one_shape, core_of, rank_plans
from optim.pipeline.task import PipelineTask
from robots.inflatable.design import InflatableDesign
from taichi_sim.base.results_folder import ResultsFolder

KIND = "pipeline"
SEARCHES, SIMULATED, PACKAGE = "searches", "simulated", "package"
MOST_PLANS = 5  # that are tried before a change of shape with faults is taken


def run_pipeline(task: PipelineTask, folder: Path, progress: Progress = None, threads: int | None = None) -> Package:
    """Find shapes, gaits and changes of shape for a task.

    Args:
        task: what is asked for.
        folder: new, or that of the same task, which goes on.
        progress: called with the fraction done.
        threads: CPU threads.

    Raises:
        ValueError: in one line, for a folder of something else.
        NoWorkingGait: for a terrain without a gait that works.
    """
    check_folder(folder, (SEARCHES, SIMULATED, PACKAGE))
    beside = ResultsFolder(folder / SIMULATED, KIND, settings_of(task))
    candidates = find_gaits(task, folder / SEARCHES, part_of(progress, 0, 20, 10), threads)
    speeds = speeds_of(candidates, task, beside, part_of(progress, 10, 20, 4), threads)
    check_working(speeds, task)
    means = {name: each.mean(axis=1).tolist() for name, each in speeds.items()}
    core = task.rig.channels[0]
    plans = rank_plans(candidates, means, task.stretch, task.limits.least_speed, (core.rise_s, core.fall_s))
    plan, changes, rejected = _choose(plans, candidates, task, beside, part_of(progress, 14, 20, 4), threads)
    states = [
        State(terrain, name, candidates[name], speeds[name][place].tolist())
        for place, (terrain, name) in enumerate(zip(task.terrains, plan.gaits, strict=True))
    ]
    single = best_single_gait(speeds)
    pairs = [(a, b) for a, b in pairwise(states) if a.terrain.is_fluid == b.terrain.is_fluid and a.gait != b.gait]
    crossings = {
        (a.name, b.name): cross(
            (a, b),
            changes[a.name, b.name],
            (single, candidates[single]),
            task,
            beside,
            part_of(progress, 18, 20, 2),
            threads,
        )
        for a, b in pairs
    }
    others = best_of_one_gait(plans), best_of_one_shape(plans, candidates)
    return Package(task, candidates, speeds, plan, *others, states, changes, crossings, rejected)


def settings_of(task: PipelineTask) -> dict[str, Any]:
    """All that results depend on, as JSON."""
    return {
        "terrains": [dataclasses.asdict(terrain) for terrain in task.terrains],
        "gaits": {
            name: [d.pressure, d.orientation, d.schedule.to_text(), d.schedule.repeats]
            for name, d in task.gaits.items()
        },
        "search": None if task.search is None else dataclasses.asdict(task.search),
        "geometry": task.geometry,
        "runs": task.runs,
        "seed": task.seed,
        "precision": task.precision,
        "rig": dataclasses.asdict(task.rig),
        **({"calibration": dataclasses.asdict(task.calibration)} if task.calibration else {}),
    }


def _choose(
    plans: Sequence[Plan],
    candidates: Mapping[str, InflatableDesign],
    task: PipelineTask,
    folder: ResultsFolder,
    progress: Progress,
    threads: int | None,
) -> tuple[Plan, dict[tuple[str, str], Change | None], list[str]]:
    """The fastest plan whose changes of shape go well; if none does, the fastest of all, faults and all."""
    rejected: list[str] = []
    first: tuple[Plan, dict[tuple[str, str], Change | None]] | None = None
    for number, plan in enumerate(plans[:MOST_PLANS]):
        part = part_of(progress, number, min(len(plans), MOST_PLANS))
        changes = _changes(plan, candidates, task, folder, part, threads)
        faults = [
            f"{change_name(pair)}: {fault}" for pair, change in changes.items() if change for fault in change.faults
        ]
        if not faults:
            return plan, changes, rejected
        first = first or (plan, changes)
        rejected.append(f"{', '.join(plan.gaits)} ({plan.speed:.4f} BL/s): {'; '.join(faults)}")
    assert first is not None
    return *first, rejected


def _changes(
    plan: Plan,
    candidates: Mapping[str, InflatableDesign],
    task: PipelineTask,
    folder: ResultsFolder,
    progress: Progress,
    threads: int | None,
) -> dict[tuple[str, str], Change | None]:
    """The changes of shape of a plan, there and back: from each terrain to each other."""
    places = range(len(task.terrains))
    ways = [(a, b) for a in places for b in places if a != b]
    found: dict[tuple[str, str], Change | None] = {}
    for number, (a, b) in enumerate(ways):
        names, terrains = (plan.gaits[a], plan.gaits[b]), (task.terrains[a], task.terrains[b])
        designs = (candidates[names[0]], candidates[names[1]])
        same = core_of(designs[0]) == core_of(designs[1])
        found[slug(terrains[0]), slug(terrains[1])] = (
            None
            if same
            else find_change(names, designs, terrains, task, folder, part_of(progress, number, len(ways)), threads)
        )
    return found
