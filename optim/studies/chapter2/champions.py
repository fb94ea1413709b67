"""Champions, run once more: their paths and what they saw."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from optim.studies.chapter2.evolution import Run
from optim.studies.chapter2.settings import Interference, Treatment
from optim.studies.chapter2.tables import measure
from robots.quadruped.robot import TIME_STEP
from taichi_sim.base.arrays import Arrays, Bools, Floats
from taichi_sim.base.files import write_text

FRAMES = 500  # of a signal, at most
NEAR = 0.5  # m, from the light


@dataclass(frozen=True, eq=False)
class Champions:
    """What the champions of a treatment did; R runs, E environments, F moments.

    Attributes:
        weights: their controllers, (R, 5, 8).
        times: (F,) [s].
        paths: of the main body, seen from above, (R, E, F, 2) [m].
        light: readings, (R, E, F) [1/m^2].
        distance: from the light at the end, (R, E) [m].
    """

    weights: Floats
    times: Floats
    paths: Floats
    light: Floats
    distance: Floats


def champions_of(
    settings: Interference, found: Mapping[Run, Arrays], threads: int | None = None
) -> dict[Treatment, Champions]:
    """Run the champions of all runs again, treatment by treatment."""
    measured = measure(found)
    seen = {}
    for treatment in dict.fromkeys(treatment for treatment, _ in found):
        runs = [key for key in found if key[0] == treatment]
        weights = np.stack([found[key]["weights"][measured[key].champion] for key in runs])
        seen[treatment] = follow(settings, treatment.robot, weights, threads)
    return seen


def follow(settings: Interference, robot: str, weights: Floats, threads: int | None = None) -> Champions:
    """What controllers, (R, 5, 8), do over time."""
    every = max(1, -(-settings.steps // FRAMES))
    result = settings.simulate(robot, weights, threads, record_every=every)
    frames = result.rollouts.frames
    assert frames is not None  # they were asked for
    shape = (len(weights), len(settings.lights), len(frames.times))
    return Champions(
        weights,
        frames.times,
        frames.position[:, :, :2].swapaxes(0, 1).reshape(*shape, 2),
        frames.readings[:, :, -1].T.reshape(shape),
        result.distance,
    )


def time_near(seen: Champions, lights: Sequence[Sequence[float]]) -> tuple[Floats, Floats]:
    """Time within half a metre of the light, seen from above [s], (R, E): in all, and without leaving to the end."""
    near: Bools = np.linalg.norm(seen.paths - np.array(lights, float)[:, None], axis=-1) <= NEAR
    step = seen.times[1] - seen.times[0] if len(seen.times) > 1 else TIME_STEP
    waiting = np.cumprod(near[..., ::-1], axis=-1)
    return near.sum(axis=-1) * step, waiting.sum(axis=-1) * step


def write_champions(champions: Mapping[Treatment, Champions], folder: Path) -> None:
    """Controllers of typical champions, a file a treatment, as ``morpholab view --controller`` reads them."""
    folder.mkdir(exist_ok=True)
    for treatment, seen in champions.items():
        name = f"{treatment.robot}_{treatment.row}".replace(", ", "_")
        write_text(folder / f"{name}.json", json.dumps(seen.weights[typical(seen)].tolist()) + "\n")


def typical(seen: Champions) -> int:
    """The run whose champion's worst distance is the median of all, the better of two."""
    order = np.argsort(seen.distance.max(axis=1), kind="stable")
    return int(order[(len(order) - 1) // 2])
