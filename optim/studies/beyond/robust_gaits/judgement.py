"""Gaits are judged here, in double precision: under draws that no search has seen, and as a rig plays them."""

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from optim.experiments.allowed import Allowed
from optim.experiments.results import Progress, computed_arrays
from optim.studies.beyond.robust_gaits.settings import BATCH, RobustGaits, file_of
from robots.hardware import gait_table
from robots.hardware.rig import PRESETS
from robots.hardware.rig_play import Play, play_tables
from robots.hardware.rig_response import LAG, WHOLE_RESPONSE
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
    drawn = settings.uncertainty.draw(settings.held_out, HELD_OUT, actuators=BLADDERS)
    compute = Compute(precision=settings.precision, threads=threads)

    def speeds(name: str, first: int, told: Progress) -> Floats:
        design, slope = gaits[name]
        robot = InflatableRobot(design, settings.geometry, "physical")
        terrain, some = settings.terrain(slope), drawn[first : first + BATCH]
        terrains = [robot.drawn_terrain(terrain, one) for one in some]
        if first < 0:
            some, terrains = [], [terrain]
        outcomes = robot.simulate_in(terrains, draws=some, compute=compute, progress=told)
        return np.array([float(outcome.measures["speed_simulated"][0]) for outcome in outcomes])

    firsts = [-1, *range(0, settings.held_out, BATCH)]
    tasks = {f"judge_{file_of(name)}_{first}": partial(speeds, name, first) for name in gaits for first in firsts}
    sizes = [1, *(min(BATCH, settings.held_out - first) for first in firsts[1:])] * len(gaits)
    allowed = {name: Allowed((size,), failed=np.nan) for name, size in zip(tasks, sizes, strict=True)}
    found = computed_arrays(parts, "speeds", tasks, progress, allowed)
    rows, each = [], iter(found)
    for name, (_, slope) in gaits.items():
        for first in firsts:
            for number, speed in enumerate(next(each)):
                about = {"gait": name, "slope": slope, "precision": settings.precision}
                rows.append({**about, "draw": first + number, "speed": float(speed)})
    return rows


def on_rig(
    settings: RobustGaits,
    parts: ResultsFolder,
    gaits: Mapping[str, tuple[InflatableDesign, float]],
    threads: int | None,
    progress: Progress,
) -> list[dict[str, Any]]:
    """Speeds of gaits as the rig plays them where nothing is uncertain: without the lag of its lines, and with it."""
    rig, responses = PRESETS[settings.rig], (WHOLE_RESPONSE - {LAG}, WHOLE_RESPONSE)

    def speeds(name: str, told: Progress) -> Floats:
        design, slope = gaits[name]
        robot = InflatableRobot(design, settings.geometry, "physical")
        geometry, drive = robot.parts
        table = gait_table(design, rig, on_violation="clip")
        plays = [Play(table, rig, settings.terrain(slope), response) for response in responses]
        played = play_tables(
            plays, geometry=geometry, actuation=drive, precision=settings.precision, threads=threads, progress=told
        )
        return np.asarray(played.speed_simulated, float)

    tasks = {f"rig_{file_of(name)}": partial(speeds, name) for name in gaits}
    allowed = dict.fromkeys(tasks, Allowed((len(responses),), failed=np.nan))
    found = computed_arrays(parts, "speeds", tasks, progress, allowed)
    return [
        {
            "gait": name,
            "slope": slope,
            "precision": settings.precision,
            "rig": settings.rig,
            "without_lag": float(without),
            "with_lag": float(lagged),
        }
        for (name, (_, slope)), (without, lagged) in zip(gaits.items(), found, strict=True)
    ]
