"""Changes of shape between two gaits, and of terrain with these.

Ways to change shape are tried one after the other until one goes well. From one terrain to the next the robot then goes
in one simulation: with the state machine, and with the best single gait.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

import numpy as np

from optim.experiments.allowed import Allowed, check_arrays
from optim.experiments.results import Progress, cached
from optim.pipeline.task import PipelineTask, slug
from optim.pipeline.trials import KeptSimulations, State, part_name
from robots.inflatable.design import InflatableDesign
from robots.inflatable.journeys import JourneyResult, Leg
from robots.inflatable.transition import TransitionJudgement, deepest_contact, shape_error, turned_by
from robots.robot import part_of
from robots.world import Terrain
from taichi_sim.base.arrays import Arrays, Floats

MOST_STEPS = 10**9  # time steps of a leg, far more than any takes
RECORD_EVERY = 4000  # time steps between the poses that are looked at for contact


@dataclass(frozen=True, eq=False)
class Change:
    """A change of shape between two gaits, simulated."""

    terrain: Terrain  # where the shape changes
    design: InflatableDesign  # what the robot does
    way: str  # the same in words
    judgement: TransitionJudgement  # of the worst of several noisy runs, number by number
    next_speed: float  # mean speed of the next gait from there, per its mean speed from a new start
    faults: tuple[str, ...]  # limits that it exceeds, a line each; none if it went well


def find_change(before: State, after: State, trials: KeptSimulations, progress: Progress = None) -> Change:
    """The first way from a gait to another that the rig can play and that goes well; else that with the fewest faults.

    The shape changes where the robot comes from, or where it goes to. Into water and out of it, it changes there, and
    the gait before is not simulated: the robot is put there in its shape.
    """
    task, both = trials.task, (before, after)
    apart = before.terrain.is_fluid != after.terrain.is_fluid
    grounds = [after.terrain] if apart else list(dict.fromkeys(state.terrain for state in both))
    names, places = tuple(state.gait for state in both), [state.name for state in both]
    tried = list[Change]()
    ways = list(product(grounds, task.ways_between(before.design, after.design).items()))
    for number, (ground, (way, design)) in enumerate(ways):
        legs = [Leg(before.design, before.terrain), Leg(design, ground), Leg(after.design, after.terrain)]
        key = f"change {names} {places} {slug(ground)} {way.together} {way.grip}"
        play = partial(_play, legs[1:] if apart else legs, trials, part_of(progress, number, len(ways)))
        found = cached(trials.folder, part_name(key), play, partial(_check_played, task.runs))
        tried.append(_judged(ground, design, str(way), found, task))
        if not tried[-1].faults:
            break
    return min(tried, key=lambda change: (len(change.faults), -np.nan_to_num(change.next_speed, nan=-np.inf)))


def _play(legs: Sequence[Leg], trials: KeptSimulations, progress: Progress) -> Arrays:
    """What the runs of a change and the next gait, the last two legs, came to; and that of the next gait alone."""
    place, robots = len(legs) - 2, range(trials.task.runs)
    run = trials.journey(legs, part_of(progress, 0, 3, 2), RECORD_EVERY)
    alone = trials.journey(legs[-1:], part_of(progress, 2, 3))
    frames, start, last = run.frames, run.positions[:, place], run.positions[:, place + 1]
    assert frames is not None
    begin, end = (int(run.steps[:legs_done].sum()) // RECORD_EVERY for legs_done in (place, place + 1))
    contacts = [
        [deepest_contact(run.body, frames.positions[f, r], frames.sizes[f, r]) for f in range(begin, end + 1)]
        for r in robots
    ]
    return {
        "shape_error": np.array([shape_error(last[r], alone.positions[r, 0]) for r in robots]),
        "moved": np.linalg.norm((last - start).mean(axis=1)[:, :2], axis=1) / run.body_length,
        "turned": np.array([turned_by(last[r], start[r]) for r in robots]),
        "deepest": np.max(contacts, axis=1),
        "next": run.speeds[:, -1],
        "alone": alone.speeds[:, 0],
        "ok": (run.status == "ok").astype(float),
    }


def _check_played(runs: int, arrays: Arrays) -> None:
    """Refuse a file that does not hold what :func:`_play` gives of so many runs, by a ValueError."""
    number = Allowed((runs,), failed=np.nan)
    allowed = dict.fromkeys(("shape_error", "moved", "deepest"), replace(number, low=0.0))
    allowed |= dict.fromkeys(("turned", "next", "alone"), number)
    check_arrays({**allowed, "ok": Allowed((runs,), 0.0, 1.0)}, arrays)


def _judged(ground: Terrain, design: InflatableDesign, way: str, found: Arrays, task: PipelineTask) -> Change:
    """A way of changing shape, judged by its runs."""
    worst = {name: float(found[name].max()) for name in ("shape_error", "moved", "turned", "deepest")}
    judgement = TransitionJudgement(**worst, diverged=not found["ok"].all())
    ratio = float(found["next"].mean() / found["alone"].mean())
    faults = list(judgement.faults(task.limits.shape_error, task.limits.moved))
    if not judgement.diverged and not ratio >= task.limits.next_speed:
        faults.append(f"the next gait reaches {ratio:.0%} of its speed, less than {task.limits.next_speed:.0%}")
    return Change(ground, design, way, judgement, ratio, tuple(faults))


@dataclass(frozen=True, eq=False)
class Crossing:
    """A change of terrain mid-way."""

    legs: Sequence[Leg]  # what the state machine has the robot do
    shown: JourneyResult  # one run of it, with frames
    machine: Floats  # speeds on the first terrain and the second [body lengths/s], shape (R, 2)
    single: Floats  # the same of the best single gait, shape (R, 2)
    gait: str  # name of that gait

    @property
    def survived(self) -> tuple[bool, bool]:
        """Whether the robot gets ahead on both terrains: with the state machine, with the single gait."""
        return bool((self.machine.mean(axis=0) > 0).all()), bool((self.single.mean(axis=0) > 0).all())


def cross(
    states: tuple[State, State],
    change: Change | None,
    single: tuple[str, InflatableDesign],
    trials: KeptSimulations,
    progress: Progress = None,
) -> Crossing:
    """Simulate a change of terrain and perhaps of shape; both terrains are ground, or both fluids."""
    first, last = (Leg(state.design, state.terrain, state.name) for state in states)
    between = [] if change is None else [Leg(change.design, change.terrain, "change of shape")]
    legs = [first, *between, last]
    alone = [Leg(single[1], state.terrain, state.name) for state in states]

    def play() -> Arrays:
        machine, lone = (trials.journey(each, part_of(progress, n, 3)) for n, each in enumerate((legs, alone)))
        return {"machine": machine.speeds[:, [0, -1]], "single": lone.speeds, "steps": machine.steps}

    way = "" if change is None else f"{slug(change.terrain)} {change.way}"
    key = f"crossing {[f'{state.name} {state.gait}' for state in states]} {way} {single[0]}"
    both = Allowed((trials.task.runs, 2), failed=np.nan)
    steps = Allowed((len(legs),), 0, MOST_STEPS, kind="i")
    check = partial(check_arrays, {"machine": both, "single": both, "steps": steps})
    played = cached(trials.folder, part_name(key), play, check)
    shown = trials.shown(legs, int(played["steps"].sum()), part_of(progress, 2, 3))
    return Crossing(legs, shown, played["machine"], played["single"], single[0])


def best_single_gait(speeds: Mapping[str, Floats]) -> str:
    """The gait that is fastest on its worst terrain; speeds as of ``speeds_of``."""
    worst = {name: float(np.nan_to_num(each.mean(axis=1), nan=-np.inf).min()) for name, each in speeds.items()}
    return max(worst, key=lambda name: worst[name])
