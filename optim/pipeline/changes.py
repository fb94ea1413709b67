"""Changes of shape between two gaits: ways to do it, tried one after the other until one goes well."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from optim.experiments.results import Progress, cached, part_of
from optim.pipeline.candidates import slug
from optim.pipeline.plans import core_of
from optim.pipeline.task import PipelineTask
from robots.inflatable.design import InflatableDesign
from robots.inflatable.journeys import Leg, simulate_journey
from robots.inflatable.robustness import NOISE
from robots.inflatable.transition import TransitionJudgement, change_of_shape, deepest_contact, shape_error, turned_by
from robots.world import Terrain
from taichi_sim.base.arrays import Arrays
from taichi_sim.base.results_folder import ResultsFolder

RECORD_EVERY = 4000  # time steps between the poses that are looked at for contact
# Whether the bladders empty while the core changes, and whether the feet grip.
WAYS = ((False, 1.0), (True, 1.0), (False, 0.0))


@dataclass(frozen=True, eq=False)
class Change:
    """A change of shape between two gaits, simulated.

    Attributes:
        before: name of the gait that the robot comes from.
        after: name of the gait that follows.
        terrain: where the shape changes.
        design: what the robot does.
        way: the same in words.
        judgement: of the worst of several noisy runs, number by number.
        next_speed: mean speed of the next gait from there, per its mean speed from a new start.
        faults: limits that it exceeds, a line each; none if it went well.
    """

    before: str
    after: str
    terrain: Terrain
    design: InflatableDesign
    way: str
    judgement: TransitionJudgement
    next_speed: float
    faults: tuple[str, ...]


def find_change(
    names: tuple[str, str],
    designs: tuple[InflatableDesign, InflatableDesign],
    terrains: tuple[Terrain, Terrain],
    task: PipelineTask,
    folder: ResultsFolder,
    progress: Progress = None,
    threads: int | None = None,
) -> Change:
    """The first way from a gait to another that goes well; else the one with the fewest faults.

    The shape changes where the robot comes from, or where it goes to. Into water and out of it, it changes there, and
    the gait before is not simulated: the robot is put there in its shape.

    Args:
        names: of the gaits.
        designs: the gaits.
        terrains: of the gaits.
        task: says what is well.
        folder: keeps what is simulated.
        progress: called with the fraction done.
        threads: CPU threads.
    """
    tried: list[Change] = []
    apart = terrains[0].is_fluid != terrains[1].is_fluid
    grounds = [terrains[1]] if apart else list(dict.fromkeys(terrains))
    ways = [(ground, together, grip) for ground in grounds for together, grip in WAYS]
    for number, (ground, together, grip) in enumerate(ways):
        core = task.rig.channels[0]
        design = change_of_shape(
            core_of(designs[0]),
            core_of(designs[1]),
            designs[1].orientation,
            grip=grip,
            together=together,
            times=(core.rise_s, core.fall_s),
            **task.robot,
        )
        first = [] if apart else [Leg(designs[0], terrains[0])]
        legs = [*first, Leg(design, ground), Leg(designs[1], terrains[1])]
        key = f"change {names} {[slug(t) for t in terrains]} {slug(ground)} {together} {grip}"
        part = part_of(progress, number, len(ways))
        found = cached(folder, part_name(key), lambda legs=legs, part=part: _play(legs, task, part, threads))  # type: ignore[misc]
        way = f"{'while' if together else 'after'} the bladders empty, feet {'grip' if grip else 'slide'}"
        tried.append(_judged(names, ground, design, way, found, task))
        if not tried[-1].faults:
            break
    return min(tried, key=lambda change: (len(change.faults), -np.nan_to_num(change.next_speed, nan=-np.inf)))


def part_name(key: str) -> str:
    """A key as the name of a part in a results folder."""
    return "".join(c if c.isalnum() else "_" for c in key)


def _play(legs: Sequence[Leg], task: PipelineTask, progress: Progress, threads: int | None) -> Arrays:
    """What the runs of a change and the next gait, the last two legs, came to; and that of the next gait alone."""
    place = len(legs) - 2
    options: dict[str, Any] = {
        **task.robot,
        "runs": task.runs,
        "precision": task.precision,
        "threads": threads,
        "perturbation": NOISE,
        "seed": task.seed,
    }
    run = simulate_journey(legs, **options, record_every=RECORD_EVERY, progress=part_of(progress, 0, 3, 2))
    alone = simulate_journey(legs[-1:], **options, progress=part_of(progress, 2, 3))
    assert run.frames is not None
    begin, end = (int(run.steps[:legs_done].sum()) // RECORD_EVERY for legs_done in (place, place + 1))
    robots = range(task.runs)
    start, last = run.positions[:, place], run.positions[:, place + 1]
    frames = run.frames
    return {
        "shape_error": np.array([shape_error(last[r], alone.positions[r, 0]) for r in robots]),
        "moved": np.linalg.norm((last - start).mean(axis=1)[:, :2], axis=1) / task.robot["geometry"].body_length,
        "turned": np.array([turned_by(last[r], start[r]) for r in robots]),
        "deepest": np.array(
            [
                max(
                    deepest_contact(run.body, frames.positions[f, r], frames.sizes[f, r]) for f in range(begin, end + 1)
                )
                for r in robots
            ]
        ),
        "next": run.speeds[:, -1],
        "alone": alone.speeds[:, 0],
        "ok": (run.status == "ok").astype(float),
    }


def _judged(
    names: tuple[str, str], ground: Terrain, design: InflatableDesign, way: str, found: Arrays, task: PipelineTask
) -> Change:
    """What the runs say of a way."""
    worst = {name: float(found[name].max()) for name in ("shape_error", "moved", "turned", "deepest")}
    judgement = TransitionJudgement(**worst, diverged=not found["ok"].all())
    ratio = float(found["next"].mean() / found["alone"].mean())
    faults = list(judgement.faults(task.limits.shape_error, task.limits.moved))
    if not judgement.diverged and not ratio >= task.limits.next_speed:
        faults.append(f"the next gait reaches {ratio:.0%} of its speed, less than {task.limits.next_speed:.0%}")
    return Change(*names, ground, design, way, judgement, ratio, tuple(faults))
