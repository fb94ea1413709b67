"""Derivatives of the final and of the smallest distance by sensor sites and controllers."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Unpack

import numpy as np

from taichi_sim import runtime
from taichi_sim.autodiff.lanes import NATIVE_WIDTH, Real
from taichi_sim.base.arrays import Floats
from taichi_sim.base.compute import Compute, ComputeOptions
from taichi_sim.vehicle import gradient_kernel as kernel
from taichi_sim.vehicle.task import VehicleBatch, VehicleTask

ROLLOUTS_AT_ONCE = 4096


@dataclass(frozen=True, eq=False)
class Slopes:
    """Derivatives of a distance from the light.

    Attributes:
        sites: by the places of the sensors, shape (B, C, E, S, 2).
        controllers: by W, shape (B, C, E, 2, S) [s/m^2]; 0 for connections that no controller has.
    """

    sites: Floats
    controllers: Floats


@dataclass(frozen=True, eq=False)
class VehicleGradient:
    """Distances from the light [m] and their derivatives; NaN where a sensor met the light.

    Attributes:
        closest: the smallest of a rollout, shape (B, C, E).
        final: at its end, shape (B, C, E).
        of_closest: derivatives of the smallest.
        of_final: derivatives of the one at the end.
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
    """Run all rollouts to their end, with exact derivatives in forward mode.

    The smallest distance has the derivative of the step at which it is reached; that may jump from step to step.

    Args:
        batch: bodies and controllers.
        task: environments and time.
        progress: called with the fraction done.
        **compute: device, precision and threads.
    """
    running = runtime.start(Compute.given(compute))
    shape = (batch.bodies, batch.controllers_each, len(task.starts))
    count, connections = int(np.prod(shape)), sum(map(len, batch.wiring))
    real = Real(running.precision, NATIVE_WIDTH[running.precision] if running.device == "cpu" else 1)
    starts, parameters = _parameters(batch, task, connections)
    run = kernel.gradient_kernel(real, batch.sensors, batch.wiring, runtime.GRAIN if running.device == "cpu" else 1)
    slots = kernel.slot_count(batch.sensors, connections)
    found = np.empty((count, slots))
    at_once = max(running.thread_count * real.width, ROLLOUTS_AT_ONCE * 2000 // max(task.steps, 2000) // 64 * 64)
    for first in range(0, count, at_once):
        jobs = np.arange(first, min(first + at_once, count))
        blocks = -(-len(jobs) // real.width)
        lanes = np.resize(jobs, blocks * real.width)  # lanes without a rollout repeat others
        memory = real.array((blocks, slots))
        memory[:, kernel.PX : kernel.CLOSEST] = _lanes_last(starts[lanes], blocks)
        memory[:, kernel.CLOSEST] = (starts[lanes] ** 2).sum(axis=1).reshape(blocks, -1)
        memory[:, kernel.PARAMETERS : kernel.PARAMETERS + parameters.shape[1]] = _lanes_last(parameters[lanes], blocks)
        run(blocks, task.steps, task.time_step, real.reals(memory.reshape(-1, real.width)))
        found[jobs] = np.moveaxis(memory, 1, 2).reshape(-1, slots)[: len(jobs)]
        if progress:
            progress((jobs[-1] + 1) / count)
    return _gradient(found, batch, shape)


def _lanes_last(rows: Floats, blocks: int) -> Floats:
    """Rows of rollouts as blocks: (blocks, columns, lanes)."""
    return np.moveaxis(rows.reshape(blocks, -1, rows.shape[1]), 1, 2)


def _parameters(batch: VehicleBatch, task: VehicleTask, connections: int) -> tuple[Floats, Floats]:
    """Starts, shape (rollouts, 2), and sites and weights, shape (rollouts, 2 S + connections)."""
    bodies, each, environments = batch.bodies, batch.controllers_each, len(task.starts)
    weights = batch.weights[:, :connections].reshape(len(batch.weights) // each, each, connections)
    rows = np.concatenate(
        [
            np.broadcast_to(batch.sites.reshape(bodies, 1, -1), (bodies, each, 2 * batch.sensors)),
            np.broadcast_to(weights, (bodies, each, connections)),
        ],
        axis=-1,
    )
    return np.tile(task.seen, (bodies * each, 1)), np.repeat(rows.reshape(bodies * each, -1), environments, axis=0)


def _gradient(found: Floats, batch: VehicleBatch, shape: tuple[int, ...]) -> VehicleGradient:
    """From what the kernel left in memory to derivatives of distances."""
    parameters = 2 * batch.sensors + sum(map(len, batch.wiring))
    px, py, closest = found[:, kernel.PX], found[:, kernel.PY], np.sqrt(found[:, kernel.CLOSEST])
    tangents = found[:, kernel.PARAMETERS + parameters :].reshape(len(found), parameters, 3)
    final = np.hypot(px, py)
    with np.errstate(divide="ignore", invalid="ignore"):
        final_by = (px[:, None] * tangents[..., 0] + py[:, None] * tangents[..., 1]) / final[:, None]
        closest_by = tangents[..., 2] / (2 * closest[:, None])
    failed = ~np.isfinite(final)
    for array in (closest, final, final_by, closest_by):
        array[failed] = np.nan
    return VehicleGradient(
        closest.reshape(shape),
        final.reshape(shape),
        _slopes(closest_by, batch, shape),
        _slopes(final_by, batch, shape),
    )


def _slopes(by: Floats, batch: VehicleBatch, shape: tuple[int, ...]) -> Slopes:
    """Derivatives by sites and by the elements of W."""
    sensors = batch.sensors
    sites = by[:, : 2 * sensors].reshape(*shape, sensors, 2)
    controllers = np.zeros((len(by), 2, sensors))
    column = 2 * sensors
    for motor, connected in enumerate(batch.wiring):
        controllers[:, motor, list(connected)] = by[:, column : column + len(connected)]
        column += len(connected)
    return Slopes(sites, controllers.reshape(*shape, 2, sensors))
