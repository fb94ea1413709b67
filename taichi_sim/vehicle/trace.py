"""Traces: where vehicles are and what their sensors read, over time."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Unpack

import numpy as np

from taichi_sim import runtime
from taichi_sim.autodiff.lanes import Real
from taichi_sim.base.arrays import Floats
from taichi_sim.base.compute import Compute, ComputeOptions
from taichi_sim.vehicle.task import VehicleBatch, VehicleTask
from taichi_sim.vehicle.trace_kernel import trace_kernel

MOST_NUMBERS = 1 << 30  # of all traces at once


@dataclass(frozen=True, eq=False)
class Traces:
    """Motion of a batch, F samples each.

    Attributes:
        times: of the samples [s], shape (F,).
        poses: x, y [m] and heading [rad, not wrapped] in the world, shape (B, C, E, F, 3).
        readings: of the sensors [1/m^2], shape (B, C, E, S, F).
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
    if isinstance(every, bool) or not isinstance(every, int) or every < 1:
        raise ValueError(f"every: {every!r} is not allowed; give a whole number, at least 1")
    shape = (batch.bodies, batch.controllers_each, len(task.starts))
    samples, count = task.steps // every + 1, int(np.prod(shape))
    if count * samples * (3 + batch.sensors) > MOST_NUMBERS:
        raise ValueError(f"every: {every} makes {count} traces of {samples} samples, too many; give a larger one")
    running = runtime.start(Compute.given(compute))
    real = Real(running.precision, 1)
    places: np.ndarray = np.zeros((count, samples, 3), real.numpy)
    readings: np.ndarray = np.zeros((count, batch.sensors, samples), real.numpy)
    arrays = batch.sites.reshape(batch.bodies, -1), batch.weights, np.column_stack([task.seen, task.starts[:, 2]])
    given: list[np.ndarray] = [np.ascontiguousarray(a, real.numpy) for a in arrays]
    sizes = (task.steps, every, batch.controllers_each, len(task.starts), int(batch.shared))
    run = trace_kernel(real, batch.sensors, batch.wiring)
    at_once = max(running.thread_count, 2_000_000 // task.steps)
    for first in range(0, count, at_once):
        part = slice(first, min(first + at_once, count))
        run(first, part.stop - first, *sizes, task.time_step, *given, places[part], readings[part])
        if progress:
            progress(part.stop / count)
    poses: Floats = places.astype(np.float64).reshape(*shape, samples, 3)
    poses[..., :2] += task.lights[:, None, :]
    times = every * task.time_step * np.arange(samples, dtype=np.float64)
    seen: Floats = readings.astype(np.float64).reshape(*shape, batch.sensors, samples)
    return Traces(times, poses, seen)
