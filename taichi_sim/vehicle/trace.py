"""Traces: where vehicles are and what their sensors read, over time."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Unpack

import numpy as np

from taichi_sim import runtime
from taichi_sim.autodiff.lanes import Real
from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import integer
from taichi_sim.base.compute import Compute, ComputeOptions
from taichi_sim.vehicle.task import VehicleBatch, VehicleTask
from taichi_sim.vehicle.trace_kernel import trace_kernel

MOST_NUMBERS = 1 << 30  # of all traces at once


@dataclass(frozen=True, eq=False)
class Traces:
    """Recorded motion and sensor readings of a batch of vehicles, at F times.

    Attributes:
        times: times of the samples [s], shape (F,).
        poses: x, y [m] and heading [rad, not wrapped] in the world, shape (B, C, E, F, 3).
        readings: readings of the sensors [1/m^2], shape (B, C, E, S, F).
    """

    times: Floats
    poses: Floats
    readings: Floats


@runtime.exclusive
def trace(
    batch: VehicleBatch,
    task: VehicleTask,
    *,
    every: int = 1,
    progress: Callable[[float], None] | None = None,
    **compute: Unpack[ComputeOptions],
) -> Traces:
    """Motion and readings of every controller of every body in every environment.

    Args:
        batch: bodies and controllers.
        task: environments and time; its radius does not matter.
        every: steps from one sample to the next; the start is the first.
        progress: called with the fraction done.
        **compute: device, precision and threads.

    Raises:
        ValueError: for ``every`` below 1, or more samples than fit into memory.
    """
    every = integer("every", every, 1)
    shape, sensors = batch.shape(task), batch.sensors
    samples, count = task.steps // every + 1, int(np.prod(shape))
    if count * samples * (3 + sensors) > MOST_NUMBERS:
        raise ValueError(f"every: {every} makes {count} traces of {samples} samples, too many; give a larger one")
    running = runtime.start(Compute.given(compute))
    real = Real(running.precision, 1)
    places: np.ndarray = np.zeros((count, samples, 3), real.numpy)
    readings: np.ndarray = np.zeros((count, sensors, samples), real.numpy)
    run = trace_kernel(real, sensors, batch.wiring)
    begin = np.column_stack([task.seen, task.starts[:, 2]])
    at_once = max(running.thread_count, 2_000_000 // task.steps)
    for first in range(0, count, at_once):
        jobs = range(first, min(first + at_once, count))
        environments, sites, weights = batch.rollouts(task, jobs)
        given: np.ndarray = np.hstack([begin[environments], sites, weights]).astype(real.numpy)
        runtime.go_on()  # whatever ``progress`` has done
        run(len(jobs), task.steps, every, task.time_step, given, places[first : jobs.stop], readings[first : jobs.stop])
        if progress:
            progress(jobs.stop / count)
    poses: Floats = places.astype(np.float64).reshape(*shape, samples, 3)
    poses[..., :2] += task.lights[:, None, :]
    times = every * task.time_step * np.arange(samples, dtype=np.float64)
    return Traces(times, poses, readings.astype(np.float64).reshape(*shape, sensors, samples))
