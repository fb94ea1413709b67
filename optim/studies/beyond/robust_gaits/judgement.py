"""Gaits are judged here, in double precision under draws that no search has seen."""

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from optim.experiments.results import Progress, computed_arrays
from optim.studies.beyond.robust_gaits.settings import BATCH, RobustGaits, file_of
from robots.inflatable.design import InflatableDesign
from robots.inflatable.robot import InflatableRobot
from robots.inflatable.schedule import BLADDERS
from robots.uncertainty import HELD_OUT
from taichi_sim.base.arrays import Floats
from taichi_sim.base.compute import Compute
from taichi_sim.base.results_folder import ResultsFolder


def judged(
    settings: RobustGaits,
    parts: ResultsFolder,
    gaits: Mapping[str, tuple[InflatableDesign, float]],
    threads: int | None,
    progress: Progress,
) -> list[dict[str, Any]]:
    """Speeds of all gaits under the held-out draws, and under none (draw -1)."""
    drawn = settings.told.draw(settings.held_out, HELD_OUT, actuators=BLADDERS)
    compute = Compute(precision=settings.precision, threads=threads)

    def speeds(name: str, first: int, told: Progress) -> Floats:
        design, slope = gaits[name]
        robot = InflatableRobot(design, settings.geometry, "physical")
        terrain, some = settings.terrain(slope), drawn[first : first + BATCH]
        terrains = [one.around(robot, terrain) for one in some]
        if first < 0:
            some, terrains = [], [terrain]
        outcomes = robot.simulate_in(terrains, draws=some, compute=compute, progress=told)
        return np.array([float(outcome.measures["speed_simulated"][0]) for outcome in outcomes])

    firsts = [-1, *range(0, settings.held_out, BATCH)]
    tasks = {f"judge_{file_of(name)}_{first}": partial(speeds, name, first) for name in gaits for first in firsts}
    found = computed_arrays(parts, "speeds", tasks, progress)
    rows, each = [], iter(found)
    for name, (_, slope) in gaits.items():
        for first in firsts:
            for number, speed in enumerate(next(each)):
                about = {"gait": name, "slope": slope, "precision": settings.precision}
                rows.append({**about, "draw": first + number, "speed": float(speed)})
    return rows
