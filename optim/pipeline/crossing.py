"""From one terrain to the next in one simulation: with the state machine, and with the best single gait."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from optim.experiments.results import Progress, cached, part_of
from optim.pipeline.changes import Change, part_name
from optim.pipeline.task import slug
from optim.pipeline.trials import State, Trials
from robots.inflatable.design import InflatableDesign
from robots.inflatable.journeys import JourneyResult, Leg
from taichi_sim.base.arrays import Arrays, Floats


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
    trials: Trials,
    progress: Progress = None,
) -> Crossing:
    """Simulate a change of terrain; both terrains are ground, or both fluids.

    Args:
        change: of shape between them; None where it stays.
    """
    first, last = (Leg(state.design, state.terrain, state.name) for state in states)
    between = [] if change is None else [Leg(change.design, change.terrain, "change of shape")]
    legs = [first, *between, last]
    alone = [Leg(single[1], state.terrain, state.name) for state in states]

    def play() -> Arrays:
        machine, lone = (trials.journey(each, part_of(progress, n, 3)) for n, each in enumerate((legs, alone)))
        return {"machine": machine.speeds[:, [0, -1]], "single": lone.speeds, "steps": machine.steps}

    way = "" if change is None else f"{slug(change.terrain)} {change.way}"
    key = f"crossing {[f'{state.name} {state.gait}' for state in states]} {way} {single[0]}"
    played = cached(trials.folder, part_name(key), play)
    shown = trials.shown(legs, int(played["steps"].sum()), part_of(progress, 2, 3))
    return Crossing(legs, shown, played["machine"], played["single"], single[0])


def best_single_gait(speeds: Mapping[str, Floats]) -> str:
    """The gait that is fastest on its worst terrain; speeds as of ``speeds_of``."""
    worst = {name: float(np.nan_to_num(each.mean(axis=1), nan=-np.inf).min()) for name, each in speeds.items()}
    return max(worst, key=lambda name: worst[name])
