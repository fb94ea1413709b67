"""Vehicles and worlds that are not quite as planned, and how many controllers still succeed in them.

Source: dissertation, chapter 6: a body with more controllers that succeed may lose fewer of them in reality. The model
knows no noise over time; a reading that is wrong by a constant factor is exactly a weight that is, so sensors that are
wrongly calibrated are among what is tried, and sensors that flicker are not.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from taichi_sim.base.arrays import Floats
from taichi_sim.vehicle import VehicleBatch, VehicleTask, rollout

Change = Callable[[Floats, Floats, VehicleTask, np.random.Generator], tuple[Floats, Floats, VehicleTask]]


@dataclass(frozen=True)
class Perturbation:
    """A kind of perturbation, of some strength.

    Attributes:
        name: of the kind.
        strength: in the unit that the kind has.
        change: sites (N, S, 2), controllers (N, 2, S) and task, with random numbers, to what they become.
        random: whether it is drawn anew again and again, or always the same.
    """

    name: str
    strength: float
    change: Change
    random: bool


def _gain(factor: float) -> Change:
    return lambda sites, controllers, task, _: (sites, controllers * factor, task)


def _sensitivity(deviation: float) -> Change:
    def change(s: Floats, c: Floats, task: VehicleTask, rng: np.random.Generator) -> tuple[Floats, Floats, VehicleTask]:
        return s, c * (1 + deviation * rng.standard_normal((len(c), 1, c.shape[2]))), task

    return change


def _sites(deviation: float) -> Change:
    return lambda s, c, task, rng: (s + deviation * rng.standard_normal(s.shape), c, task)


def _radius(factor: float) -> Change:
    return lambda s, c, task, _: (s, c, replace(task, radius=task.radius * factor))


def _start(deviations: tuple[float, float, float]) -> Change:
    def change(s: Floats, c: Floats, task: VehicleTask, rng: np.random.Generator) -> tuple[Floats, Floats, VehicleTask]:
        return s, c, replace(task, starts=task.starts + rng.standard_normal(task.starts.shape) * deviations)

    return change


def _step(factor: float) -> Change:
    def change(s: Floats, c: Floats, task: VehicleTask, _: np.random.Generator) -> tuple[Floats, Floats, VehicleTask]:
        return s, c, replace(task, time_step=task.time_step * factor, steps=math.ceil(task.steps / factor))

    return change


PERTURBATIONS = (
    *(Perturbation("gain of both motors [factor]", f, _gain(f), False) for f in (0.8, 0.9, 1.1, 1.2)),
    *(Perturbation("sensitivity of sensors [sd, share]", d, _sensitivity(d), True) for d in (0.02, 0.05, 0.1, 0.2)),
    *(Perturbation("places of sensors [sd, m]", d, _sites(d), True) for d in (0.005, 0.01, 0.02, 0.05)),
    *(Perturbation("radius of the light [factor]", f, _radius(f), False) for f in (0.9, 0.75, 0.5)),
    *(Perturbation("place of the start [sd, m]", d, _start((d, d, 0.0)), True) for d in (0.05, 0.1, 0.2, 0.4)),
    *(Perturbation("heading at the start [sd, rad]", d, _start((0.0, 0.0, d)), True) for d in (0.05, 0.1, 0.2, 0.4)),
    *(Perturbation("time step [factor]", f, _step(f), False) for f in (0.25, 0.5, 2.0)),
)


def survival(
    sites: ArrayLike,
    controllers: ArrayLike,
    task: VehicleTask,
    perturbation: Perturbation,
    draws: int,
    seed: int,
    threads: int | None = None,
) -> Floats:
    """The share of perturbed copies of each vehicle that solve all environments.

    Args:
        sites: of the sensors, shape (N, S, 2) [m].
        controllers: matrices, shape (N, 2, S).
        task: environments, radius and time.
        perturbation: what is changed.
        draws: copies of each vehicle, if the perturbation is random.
        seed: of all draws: with the same, all vehicles of a call start alike, and calls with equally many do.
        threads: CPU threads, all available if None; changes no result.

    Returns:
        Shape (N,).
    """
    sites, controllers = np.asarray(sites, float), np.asarray(controllers, float)
    draws = draws if perturbation.random else 1
    solved = np.zeros((draws, len(sites)))
    for draw in range(draws):
        rng = np.random.default_rng((seed, draw))
        changed_sites, changed, changed_task = perturbation.change(sites, controllers, task, rng)
        batch = VehicleBatch(changed_sites, changed[:, None])
        solved[draw] = rollout(batch, changed_task, until="success", threads=threads).reached[:, 0].all(axis=1)
    return np.asarray(solved.mean(axis=0))
