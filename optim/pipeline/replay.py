"""A package played in the simulator from its tables alone: are the gaits as fast as they were designed?"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from optim.experiments.results import Progress, part_of
from optim.pipeline.machine import properties_of, read_machine
from robots.calibration import robot_of
from robots.hardware import read_design
from robots.inflatable import simulation
from robots.inflatable.robustness import NOISE
from robots.world import Terrain

TOLERANCE = 0.05


@dataclass(frozen=True)
class Replayed:
    """A gait of a package."""

    name: str  # of the state
    designed: float  # mean speed that the package says [body lengths/s]
    replayed: float  # the same from the rows of its table

    @property
    def holds(self) -> bool:
        """Whether both agree within ``TOLERANCE``."""
        return bool(abs(self.replayed - self.designed) <= TOLERANCE * abs(self.designed))


def replay_package(folder: Path, progress: Progress = None, threads: int | None = None) -> list[Replayed]:
    """Play every gait of a package from the rows of its table, with the noise with which it was measured.

    Raises:
        ValueError: for a folder that holds no package, or a damaged one.
    """
    machine = read_machine(folder)
    found = []
    for number, state in enumerate(machine["states"]):
        speed = _speed(folder, state, machine["simulated"], part_of(progress, number, len(machine["states"])), threads)
        found.append(Replayed(state["name"], state["speed_bl_per_s"], speed))
    return found


def _speed(
    folder: Path, state: Mapping[str, Any], simulated: Mapping[str, Any], progress: Progress, threads: int | None
) -> float:
    """Mean speed of a state's table."""
    design = read_design(folder / state["table"], from_rows=True)
    geometry, actuation = robot_of(simulated["geometry"], "published", properties_of(simulated))
    run = simulation.simulate(
        [design] * simulated["runs"],
        Terrain(**state["terrain"]),
        geometry=geometry,
        actuation=actuation,
        precision=simulated["precision"],
        perturbation=NOISE,
        seed=simulated["seed"],
        threads=threads,
        progress=progress,
    )
    return float(np.mean(run.speed))
