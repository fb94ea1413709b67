"""Simulations of a task's robot with noise, each kept in a folder, so that it is done once."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from optim.experiments.allowed import Allowed, check_arrays
from optim.experiments.results import Progress, cached
from optim.pipeline.task import PipelineTask, slug
from robots.inflatable import simulation
from robots.inflatable.design import InflatableDesign
from robots.inflatable.journeys import JourneyResult, Leg, simulate_journey
from robots.inflatable.robustness import NOISE
from robots.robot import part_of
from robots.world import Terrain
from taichi_sim.base.arrays import Floats
from taichi_sim.base.files import sha256
from taichi_sim.base.results_folder import ResultsFolder
from taichi_sim.base.short_text import decimal


class NoWorkingGait(RuntimeError):
    """A terrain has no gait that works, or a rig cannot go from one that does to the next."""


def part_name(key: str) -> str:
    """A key as the name of a part in a results folder, with a digest, as different keys may have the same letters."""
    letters = "".join(c if c.isalnum() and c.isascii() else "_" for c in key)
    return f"{letters}_{sha256(key.encode())[:8]}"


@dataclass(frozen=True, eq=False)
class State:
    """A terrain and what the robot does there."""

    terrain: Terrain  # where
    gait: str  # name of the gait among the candidates
    design: InflatableDesign  # the gait
    speeds: Sequence[float]  # with noise [body lengths/s], shape (R,)

    @property
    def name(self) -> str:
        """Name of the state and its files."""
        return slug(self.terrain)

    @property
    def speed(self) -> float:
        """Mean [body lengths/s]."""
        return float(sum(self.speeds) / len(self.speeds))


@dataclass(frozen=True, eq=False)
class KeptSimulations:
    """Simulations of a task, whose results a folder keeps."""

    task: PipelineTask  # says which robot, how often and how precisely
    folder: ResultsFolder  # keeps what is simulated
    threads: int | None = None  # CPU threads

    @property
    def noisy(self) -> dict[str, Any]:
        """Options of simulations of several runs."""
        noise = {"perturbation": NOISE, "seed": self.task.seed, "precision": self.task.precision}
        return {**self.task.robot, **noise, "threads": self.threads}

    def journey(self, legs: Sequence[Leg], progress: Progress, record_every: int | None = None) -> JourneyResult:
        """Several noisy runs of some legs, in one batch."""
        return simulate_journey(legs, **self.noisy, runs=self.task.runs, progress=progress, record_every=record_every)

    def shown(self, legs: Sequence[Leg], steps: int, progress: Progress) -> JourneyResult:
        """One run without noise, of so many steps, with the frames that the player shows."""
        every = -(-steps // self.task.frames)
        settings: dict[str, Any] = {**self.task.robot, "precision": "f32", "threads": self.threads}
        return simulate_journey(legs, **settings, record_every=every, progress=progress)

    def speeds(self, name: str, design: InflatableDesign, terrain: Terrain, progress: Progress) -> Floats:
        """Speeds of a gait on a terrain, with noise [body lengths/s], shape (runs,); NaN of failures."""

        def play() -> dict[str, Floats]:
            copies = [design] * self.task.runs
            return {"speeds": simulation.simulate(copies, terrain, **self.noisy, progress=progress).speed}

        check = partial(check_arrays, {"speeds": Allowed((self.task.runs,), failed=np.nan)})
        return cached(self.folder, part_name(f"speed {name} {slug(terrain)}"), play, check)["speeds"]


def speeds_of(
    designs: Mapping[str, InflatableDesign], trials: KeptSimulations, progress: Progress = None
) -> dict[str, Floats]:
    """Speeds of gaits by name on all terrains, as :meth:`KeptSimulations.speeds`, shape (terrains, runs) each."""
    terrains, found = trials.task.terrains, {}
    total = len(designs) * len(terrains)
    for number, (name, design) in enumerate(designs.items()):
        parts = [part_of(progress, number * len(terrains) + place, total) for place in range(len(terrains))]
        rows = [trials.speeds(name, design, terrain, part) for terrain, part in zip(terrains, parts, strict=True)]
        found[name] = np.array(rows)
    return found


def check_working(speeds: Mapping[str, Floats], task: PipelineTask) -> None:
    """Raise NoWorkingGait for a terrain without a gait that works, with what was tried and how fast it was."""
    for place, terrain in enumerate(task.terrains):
        means = {name: float(each[place].mean()) for name, each in speeds.items()}
        if not any(speed >= task.limits.least_speed for speed in means.values()):
            tried = ", ".join(f"{name} {'diverged' if np.isnan(v) else decimal(v)}" for name, v in means.items())
            raise NoWorkingGait(
                f"{terrain.name}: no gait reaches {task.limits.least_speed:g} BL/s; tried: {tried or 'none'}"
            )
