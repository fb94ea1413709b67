"""Derivatives of the final and of the smallest distance by sensor sites and controllers."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Unpack

import numpy as np

from taichi_sim import runtime
from taichi_sim.autodiff.lanes import NATIVE_WIDTH, Real
from taichi_sim.base.arrays import Floats
from taichi_sim.base.compute import Compute, ComputeOptions
from taichi_sim.store import Store
from taichi_sim.vehicle import gradient_kernel as kernel
from taichi_sim.vehicle.task import VehicleBatch, VehicleTask

ROLLOUTS_AT_ONCE = 4096


@dataclass(frozen=True, eq=False)
class Slopes:
    """Derivatives of distances from the light [m] by sensor places and controllers.

    Attributes:
        sites: by the places of the sensors [m/m], shape (B, C, E, S, 2).
        controllers: by W, shape (B, C, E, 2, S) [s/m^2]; 0 for connections that no controller has.
    """

    sites: Floats
    controllers: Floats


@dataclass(frozen=True, eq=False)
class VehicleGradient:
    """Distances from the light [m] and their derivatives; NaN where a sensor met the light.

    Attributes:
        closest: smallest distance in each rollout, shape (B, C, E).
        final: distance at the end of each rollout, shape (B, C, E).
        of_closest: derivatives of the smallest distance.
        of_final: derivatives of the distance at the end.
    """

    closest: Floats
    final: Floats
    of_closest: Slopes
    of_final: Slopes


@runtime.exclusive
def differentiate(
    batch: VehicleBatch,
    task: VehicleTask,
    *,
    progress: Callable[[float], None] | None = None,
    **compute: Unpack[ComputeOptions],
) -> VehicleGradient:
    """Simulate vehicles to the end of all rollouts, with exact derivatives of their distances from the light.

    The smallest distance has the derivative of the step at which it is reached; that may jump from step to step.

    Args:
        batch: bodies and controllers.
        task: environments and time.
        progress: called with the fraction done.
        **compute: device, precision and threads.
    """
    running = runtime.start(Compute.given(compute))
    shape, connections = batch.shape(task), len(batch.connections[0])
    count, parameters = int(np.prod(shape)), 2 * batch.sensors + connections
    real = Real(running.precision, NATIVE_WIDTH[running.precision] if running.device == "cpu" else 1)
    run = kernel.gradient_kernel(real, batch.sensors, batch.wiring, runtime.GRAIN if running.device == "cpu" else 1)
    slots = kernel.slot_count(batch.sensors, connections)
    found = np.empty((count, slots))
    at_once = max(running.thread_count * real.width, ROLLOUTS_AT_ONCE * 2000 // max(task.steps, 2000) // 64 * 64)
    for first in range(0, count, at_once):
        jobs = range(first, min(first + at_once, count))
        environments, sites, weights = batch.rollouts(task, jobs)
        starts = task.seen[environments]
        rows = np.hstack([starts, (starts**2).sum(axis=1, keepdims=True), sites, weights[:, :connections]])
        blocks = -(-len(jobs) // real.width)
        lanes = np.resize(np.arange(len(jobs)), blocks * real.width)  # those without a rollout repeat others
        memory, values = Store(real, slots, blocks, True), np.zeros((slots, len(lanes)))
        values[: rows.shape[1]] = rows[lanes].T
        memory.write(values)
        runtime.go_on()  # whatever ``progress`` has done
        run(blocks, task.steps, task.time_step, memory.argument)
        found[first : jobs.stop] = memory.read().T[: len(jobs)]
        if progress:
            progress(jobs.stop / count)
    px, py, closest = found[:, kernel.PX], found[:, kernel.PY], np.sqrt(found[:, kernel.CLOSEST])
    tangents = found[:, kernel.PARAMETERS + parameters :].reshape(count, parameters, 3)
    final = np.hypot(px, py)
    with np.errstate(divide="ignore", invalid="ignore"):
        final_by = (px[:, None] * tangents[..., 0] + py[:, None] * tangents[..., 1]) / final[:, None]
        closest_by = tangents[..., 2] / (2 * closest[:, None])
    failed = ~np.isfinite(final)
    for array in (closest, final, final_by, closest_by):
        array[failed] = np.nan
    slopes = (_slopes(by, batch, shape) for by in (closest_by, final_by))
    return VehicleGradient(closest.reshape(shape), final.reshape(shape), *slopes)


def _slopes(by: Floats, batch: VehicleBatch, shape: tuple[int, ...]) -> Slopes:
    """Derivatives by sites and by the elements of W."""
    places, (motors, sensors) = 2 * batch.sensors, batch.connections
    controllers = np.zeros((len(by), 2, batch.sensors))
    controllers[:, motors, sensors] = by[:, places:]
    return Slopes(by[:, :places].reshape(*shape, -1, 2), controllers.reshape(*shape, 2, -1))
