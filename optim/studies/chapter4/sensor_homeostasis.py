"""Sensor homeostasis of what co-optimisation finds: how alike a solution's sensors see the environments.

Source: dissertation, chapter 4, figure "neurips_cooptimization" (right). Solutions that fail may score best of all, as
their sensors never see the light; so solved ones are looked at alone, beside all that were reported, as in the chapter.
"""

from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from optim.measures import homeostasis
from optim.problems.braitenberg import VehicleProblem
from taichi_sim.base.arrays import Arrays, Bools, Floats
from taichi_sim.signals import warping_distances
from taichi_sim.vehicle import VehicleBatch, VehicleTask, trace

MEASURES = ("raw", "normalised")
SAMPLES = 1000  # of a decimated trace, at most, beside the start
SAMPLES_AT_ONCE = 2_000_000  # of light: 16 MB


def decimation(task: VehicleTask, samples: int = SAMPLES) -> int:
    """Steps between samples of a trace that has at most so many beside the start.

    Vehicles that stay by the light turn quickly there, which few samples miss: for two solutions of the best body,
    every 5th, 10th and 20th sample gives up to 1.5, 1.8 and 2.8 times the raw distance of all (two of the baseline:
    1.06).
    """
    return -(-task.steps // samples)


def sensor_distances(
    sites: ArrayLike, controllers: ArrayLike, task: VehicleTask, every: int = 1, threads: int | None = None
) -> tuple[Floats, Floats]:
    """Mean warping distance of N controllers' light signals between environments, see ``homeostasis``.

    Sites have shape (N, S, 2) [m], controllers (N, 2, S). Distances of signals of every so many steps differ from those
    of full ones.

    Returns:
        Of the readings [1/m^2], and of the same shifted and scaled to mean 0 and standard deviation 1, shape (N,)
        each; NaN where a sensor met the light.
    """
    sites, controllers = np.asarray(sites, float), np.asarray(controllers, float)
    raw, normalised = np.full((2, len(sites)), np.nan)
    per_controller = len(task.starts) * sites.shape[1] * (task.steps // every + 1)
    at_once = max(1, SAMPLES_AT_ONCE // per_controller)
    for first in range(0, len(sites), at_once):
        part = slice(first, first + at_once)
        seen = trace(VehicleBatch(sites[part], controllers[part, None]), task, every=every, threads=threads).readings
        for values, scaled in ((raw, False), (normalised, True)):
            values[part] = homeostasis(seen[:, 0], partial(warping_distances, normalise=scaled, threads=threads))
    return raw, normalised


def distances_of(problem: VehicleProblem, points: Floats, chosen: Bools, every: int = 1) -> Arrays:
    """The :func:`sensor_distances` of chosen points of a problem, (..., D), by ``MEASURES``; NaN for the others."""
    arrays = {name: np.full(chosen.shape, np.nan) for name in MEASURES}
    if chosen.any():
        sites, controllers = problem.split(points[chosen])
        found = sensor_distances(sites, controllers[:, 0], problem.task, every, problem.threads)
        for name, values in zip(MEASURES, found, strict=True):
            arrays[name][chosen] = values
    return arrays
