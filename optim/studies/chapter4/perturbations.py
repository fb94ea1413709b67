"""Changes of a vehicle or its world, as between a simulator and reality: of motors, sensors, light, start and time."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from numpy.random import Generator

from taichi_sim.base.arrays import Floats
from taichi_sim.vehicle import VehicleTask

# sites (N, S, 2), controllers (N, 2, S), or (N, C, 2, S) of vehicles that try several each, and their task
Vehicles = tuple[Floats, Floats, VehicleTask]


@dataclass(frozen=True)
class Perturbation:
    """A kind of perturbation, of some strength."""

    name: str  # of the kind
    strength: float  # in the unit that the kind has
    # sites, controllers, task, random numbers and the strength to what they become
    change: Callable[[Floats, Floats, VehicleTask, Generator, float], Vehicles]
    random: bool  # whether it is drawn anew again and again, or always the same


def _gain(sites: Floats, controllers: Floats, task: VehicleTask, _: Generator, factor: float) -> Vehicles:
    return sites, controllers * factor, task


def _sensitivity(sites: Floats, controllers: Floats, task: VehicleTask, rng: Generator, deviation: float) -> Vehicles:
    shape = (
        len(controllers),
        *[1] * (controllers.ndim - 2),
        controllers.shape[-1],
    )  # a vehicle has its sensors
    return sites, controllers * (1 + deviation * rng.standard_normal(shape)), task


def _sites(sites: Floats, controllers: Floats, task: VehicleTask, rng: Generator, deviation: float) -> Vehicles:
    return sites + deviation * rng.standard_normal(sites.shape), controllers, task


def _radius(sites: Floats, controllers: Floats, task: VehicleTask, _: Generator, factor: float) -> Vehicles:
    return sites, controllers, replace(task, radius=task.radius * factor)


def _start(sites: Floats, controllers: Floats, task: VehicleTask, rng: Generator, deviation: float) -> Vehicles:
    change = rng.standard_normal(task.starts.shape) * (deviation, deviation, 0.0)
    return sites, controllers, replace(task, starts=task.starts + change)


def _heading(sites: Floats, controllers: Floats, task: VehicleTask, rng: Generator, deviation: float) -> Vehicles:
    change = rng.standard_normal(task.starts.shape) * (0.0, 0.0, deviation)
    return sites, controllers, replace(task, starts=task.starts + change)


def _step(sites: Floats, controllers: Floats, task: VehicleTask, _: Generator, factor: float) -> Vehicles:
    steps = math.ceil(task.steps / factor)
    return sites, controllers, replace(task, time_step=task.time_step * factor, steps=steps)


PERTURBATIONS = (
    *(Perturbation("gain of both motors [factor]", f, _gain, False) for f in (0.8, 0.9, 1.1, 1.2)),
    *(Perturbation("sensitivity of sensors [sd, share]", d, _sensitivity, True) for d in (0.02, 0.05, 0.1, 0.2)),
    *(Perturbation("places of sensors [sd, m]", d, _sites, True) for d in (0.005, 0.01, 0.02, 0.05)),
    *(Perturbation("radius of the light [factor]", f, _radius, False) for f in (0.9, 0.75, 0.5)),
    *(Perturbation("place of the start [sd, m]", d, _start, True) for d in (0.05, 0.1, 0.2, 0.4)),
    *(Perturbation("heading at the start [sd, rad]", d, _heading, True) for d in (0.05, 0.1, 0.2, 0.4)),
    *(Perturbation("time step [factor]", f, _step, False) for f in (0.25, 0.5, 2.0)),
)
