"""The pipeline: from a task to a package. What is simulated is kept, so the same command goes on where it was."""

import dataclasses
from collections.abc import Mapping, Sequence
from functools import cache
from itertools import pairwise, permutations
from pathlib import Path
from typing import Any

from optim.experiments.results import Progress, check_folder
from optim.pipeline.changes import Change, best_single_gait, cross, find_change
from optim.pipeline.machine import change_name
from optim.pipeline.package import Package
from optim.pipeline.plans import Plan, best_of_one_gait, best_of_one_shape, core_of, rank_plans
from optim.pipeline.task import FOUND, PipelineTask, slug
from optim.pipeline.trials import KeptSimulations, NoWorkingGait, State, check_working, speeds_of
from optim.runs import open_run, run_search
from optim.runs.config import GROUND_FILES
from optim.runs.generation import Generation
from optim.search import build_method
from robots.ground_files import ground_files
from robots.inflatable.design import InflatableDesign
from robots.inflatable.timing import gait_steps
from robots.robot import part_of
from robots.world import Terrain
from taichi_sim.base.results_folder import ResultsFolder
from taichi_sim.base.short_text import decimal


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

    def on_generation(done: Generation) -> None:
        if progress:
            progress((done.generation + 1) / (search.generations + 1))

    with open_run(folder, config, resume=True) as run:
        last = run_search(problem, method, run, search.generations, on_generation)
    return problem.in_full().design(problem.space.from_dict(last.best_point)) if last.best_point else None


KIND = "pipeline"
SEARCHES, SIMULATED, PACKAGE = "searches", "simulated", "package"
MOST_PLANS = 5  # that are tried before a change of shape with faults is taken
Changes = dict[tuple[str, str], Change | None]  # from state to state, by their names; None where the shape stays


def run_pipeline(task: PipelineTask, folder: Path, progress: Progress = None, threads: int | None = None) -> Package:
    """Find shapes, gaits and changes of shape for a task.

    Raises:
        ValueError: for a folder of something else.
        NoWorkingGait: for a terrain without a gait that works, or where the rig can go between none of those that do.
    """
    check_folder(folder, (SEARCHES, SIMULATED, PACKAGE))
    trials = KeptSimulations(task, ResultsFolder(folder / SIMULATED, KIND, settings_of(task)), threads)
    candidates = find_gaits(task, folder / SEARCHES, part_of(progress, 0, 20, 10), threads)
    speeds = speeds_of(candidates, trials, part_of(progress, 10, 20, 4))
    check_working(speeds, task)
    means = {name: each.mean(axis=1).tolist() for name, each in speeds.items()}
    plans = _playable(
        rank_plans(candidates, means, task.stretch, task.limits.least_speed, task.core_times), candidates, task
    )
    planned = [
        [
            State(terrain, name, candidates[name], speeds[name][place].tolist())
            for place, (terrain, name) in enumerate(zip(task.terrains, plan.gaits, strict=True))
        ]
        for plan in plans[:MOST_PLANS]
    ]
    number, changes, rejected = _choose(plans, planned, trials, part_of(progress, 14, 20, 4))
    plan, states, single = plans[number], planned[number], best_single_gait(speeds)
    crossings = {
        (a.name, b.name): cross(
            (a, b), changes[a.name, b.name], (single, candidates[single]), trials, part_of(progress, 18, 20, 2)
        )
        for a, b in pairwise(states)
        if a.terrain.is_fluid == b.terrain.is_fluid and a.gait != b.gait
    }
    others = best_of_one_gait(plans), best_of_one_shape(plans, candidates)
    return Package(task, candidates, speeds, plan, *others, states, changes, crossings, rejected)


def _playable(plans: Sequence[Plan], candidates: Mapping[str, InflatableDesign], task: PipelineTask) -> list[Plan]:
    """The plans between whose gaits the rig can go; raises NoWorkingGait if there is none."""
    between = cache(lambda first, second: task.refusal_between(candidates[first], candidates[second]))
    found = [plan for plan in plans if not any(between(*pair) for pair in permutations(dict.fromkeys(plan.gaits), 2))]
    if not found:
        pair, why = next((pair, why) for pair in permutations(plans[0].gaits, 2) if (why := between(*pair)))
        raise NoWorkingGait(f"the rig can go from no gait that works to the next; from {' to '.join(pair)}: {why}")
    return found


def settings_of(task: PipelineTask) -> dict[str, Any]:
    """All that results depend on, as JSON."""
    return {
        "terrains": [terrain.document for terrain in task.terrains],
        "gaits": {
            name: [d.pressure, d.orientation, d.schedule.to_text(), d.schedule.repeats, *_own_body(d)]
            for name, d in task.gaits.items()
        },
        "search": None if task.search is None else dataclasses.asdict(task.search),
        "geometry": task.geometry,
        "runs": task.runs,
        "seed": task.seed,
        "precision": task.precision,
        "rig": {name: value for name, value in dataclasses.asdict(task.rig).items() if name != "lines"},  # it has none
        **({"calibration": dataclasses.asdict(task.calibration)} if task.calibration else {}),
        **({} if task.weight == "published" else {"weight": task.weight}),
        **({GROUND_FILES: files} if (files := ground_files(task.terrains)) else {}),
    }


def _own_body(design: InflatableDesign) -> list[Any]:
    """What a design says of its body; nothing if it says nothing."""
    if design.materials is None and design.bladders is None:
        return []
    materials = None if design.materials is None else dataclasses.asdict(design.materials)
    return [materials, design.bladders]


def _choose(
    plans: Sequence[Plan], planned: Sequence[Sequence[State]], trials: KeptSimulations, progress: Progress
) -> tuple[int, Changes, list[str]]:
    """The number of the fastest plan whose changes of shape go well, these, and why faster ones were rejected.

    If none does, it is the fastest of all, faults and all.
    """
    every, rejected = list[Changes](), list[str]()
    for number, (plan, states) in enumerate(zip(plans, planned, strict=False)):
        changes = _changes(states, trials, part_of(progress, number, len(planned)))
        faults = [f"{change_name(pair)}: {fault}" for pair, one in changes.items() if one for fault in one.faults]
        if not faults:
            return number, changes, rejected
        every.append(changes)
        rejected.append(f"{', '.join(plan.gaits)} ({decimal(plan.speed)} BL/s): {'; '.join(faults)}")
    return 0, every[0], rejected


def _changes(states: Sequence[State], trials: KeptSimulations, progress: Progress) -> Changes:
    """The changes of shape between states, there and back: from each to each other."""
    pairs, found = list(permutations(states, 2)), Changes()
    for number, (a, b) in enumerate(pairs):
        same, part = core_of(a.design) == core_of(b.design), part_of(progress, number, len(pairs))
        found[a.name, b.name] = None if same else find_change(a, b, trials, part)
    return found
