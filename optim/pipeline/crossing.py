"""From one terrain to the next in one simulation: with the state machine, and with the best single gait."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from optim.experiments.results import Progress, cached, part_of
from optim.pipeline.candidates import slug
from optim.pipeline.changes import Change, part_name
from optim.pipeline.machine import State
from optim.pipeline.task import PipelineTask
from robots.inflatable.design import InflatableDesign
from robots.inflatable.journeys import JourneyResult, Leg, simulate_journey
from robots.inflatable.robustness import NOISE
from taichi_sim.base.arrays import Arrays
from taichi_sim.base.results_folder import ResultsFolder


@dataclass(frozen=True, eq=False)
class Crossing:
    """A change of terrain mid-way.

    Attributes:
        legs: what the state machine has the robot do.
        shown: one run of it, with frames.
        machine: speeds on the first terrain and the second [body lengths/s], shape (R, 2).
        single: the same of the best single gait, shape (R, 2).
        gait: name of that gait.
    """

    legs: Sequence[Leg]
    shown: JourneyResult
    machine: np.ndarray
    single: np.ndarray
    gait: str

    @property
    def survived(self) -> tuple[bool, bool]:
        """Whether the robot gets ahead on both terrains: with the state machine, with the single gait."""
        return bool((self.machine.mean(axis=0) > 0).all()), bool((self.single.mean(axis=0) > 0).all())


def cross(
    states: tuple[State, State],
    change: Change | None,
    single: tuple[str, InflatableDesign],
    task: PipelineTask,
    folder: ResultsFolder,
    progress: Progress = None,
    threads: int | None = None,
) -> Crossing:
    """Simulate a change of terrain; both terrains are ground, or both fluids.

    Args:
        states: on the first terrain and the second.
        change: of shape between them; None where it stays.
        single: name and design of the gait to compare with.
        task: what it is for.
        folder: keeps the speeds.
        progress: called with the fraction done.
        threads: CPU threads.
    """
    first, second = states
    between = [] if change is None else [Leg(change.design, change.terrain, "change of shape")]
    legs = [Leg(first.design, first.terrain, first.name), *between, Leg(second.design, second.terrain, second.name)]
    alone = [Leg(single[1], state.terrain, state.name) for state in states]
    where = {**task.robot, "precision": task.precision, "threads": threads}
    noise = {"runs": task.runs, "perturbation": NOISE, "seed": task.seed}

    def play() -> Arrays:
        machine = simulate_journey(legs, **where, **noise, progress=part_of(progress, 0, 3))  # type: ignore[arg-type]
        lone = simulate_journey(alone, **where, **noise, progress=part_of(progress, 1, 3))  # type: ignore[arg-type]
        return {"machine": machine.speeds[:, [0, -1]], "single": lone.speeds, "steps": machine.steps}

    way = "" if change is None else f"{slug(change.terrain)} {change.way}"
    key = f"crossing {[f'{slug(state.terrain)} {state.gait}' for state in states]} {way} {single[0]}"
    played = cached(folder, part_name(key), play)
    shown = simulate_journey(
        legs,
        **{**where, "precision": "f32"},
        progress=part_of(progress, 2, 3),
        record_every=-(-int(played["steps"].sum()) // task.frames),
    )
    return Crossing(legs, shown, played["machine"], played["single"], single[0])


def best_single_gait(speeds: Mapping[str, np.ndarray]) -> str:
    """The gait that is fastest on its worst terrain; speeds as of ``speeds_of``."""
    worst = {name: float(np.nan_to_num(each.mean(axis=1), nan=-np.inf).min()) for name, each in speeds.items()}
    return max(worst, key=lambda name: worst[name])
