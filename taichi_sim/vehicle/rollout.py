"""Rollouts of a batch: bodies, times controllers, times environments."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Unpack, get_args

import numpy as np
from numpy.typing import NDArray

from taichi_sim import runtime
from taichi_sim.autodiff.lanes import Real
from taichi_sim.base import checks
from taichi_sim.base.arrays import Bools, Floats
from taichi_sim.base.compute import Compute, ComputeOptions
from taichi_sim.runtime import GRAIN
from taichi_sim.vehicle import rollout_kernel as kernel
from taichi_sim.vehicle.task import MOST_ROLLOUTS, VehicleBatch, VehicleTask

Until = Literal["success", "closest", "end"]

WIDE, NARROW = 32, 8  # lanes: several native vectors hide the latency of divisions, where there is work for them
ROLLOUTS_PER_BLOCK = 4096
STEPS_PER_LAUNCH = 400_000_000  # keeps progress and Ctrl-C responsive: some seconds
GPU_THREADS = 1 << 16


@dataclass(frozen=True, eq=False)
class Rollouts:
    """Results of rollouts of B bodies with C controllers in E environments; all arrays have shape (B, C, E).

    Attributes:
        reached: whether the vehicle came closer to the light than the radius.
        closest: its smallest distance from the light [m]; with ``until="success"`` up to its success or until it was
            sure not to succeed, and the steps after these do not count exactly.
        arrival: steps before its success, -1 without; not with ``until="success"``, where it is -1 throughout.
        final: its distance at the end [m]; NaN unless ``until="end"``.
        diverged: whether a sensor met the light itself, which ends the rollout; what was before it counts.
    """

    reached: Bools
    closest: Floats
    arrival: NDArray[np.int32]
    final: Floats
    diverged: Bools


@runtime.exclusive
def rollout(
    batch: VehicleBatch,
    task: VehicleTask,
    *,
    until: Until = "closest",
    width: int | None = None,
    progress: Callable[[float], None] | None = None,
    **compute: Unpack[ComputeOptions],
) -> Rollouts:
    """Simulate Braitenberg vehicles: every controller of every body in every environment.

    Args:
        batch: bodies and controllers.
        task: environments, radius and time.
        until: when a rollout may end: at its ``"success"`` or when that is out of reach; when it cannot come closer
            (``"closest"``); or at the ``"end"``. The exits are proven, see ``equations.hopeless``: they change no
            result that is given.
        width: rollouts side by side; results do not depend on it.
        progress: called with the fraction done.
        **compute: device, precision and threads; ``"f32"`` is for exploring, where a few percent of sweeps' cells flip.

    Raises:
        ValueError: for settings that are not allowed, or more rollouts than fit into memory.
    """
    checks.choice("until", until, get_args(Until))
    shape = batch.shape(task)
    if np.prod(shape, dtype=float) > MOST_ROLLOUTS:
        raise ValueError(f"batch: {shape} rollouts are too many at once; give at most {MOST_ROLLOUTS}")
    running = runtime.start(Compute.given(compute))
    count = int(np.prod(shape))
    if running.device != "cpu":
        width = 1
    elif width is None:
        width = WIDE if count > WIDE * running.thread_count else NARROW
    real = Real(running.precision, width)
    found = _launch(batch, task, real, kernel.UNTIL[until], running, progress)
    closest, final = (np.sqrt(x.astype(np.float64)).reshape(shape) for x in (found.closest, found.final))
    reached = closest < task.radius
    arrival = np.where(reached & (until != "success"), found.waited.reshape(shape), -1).astype(np.int32)
    diverged = ~np.isfinite(final)
    return Rollouts(reached, closest, arrival, final if until == "end" else np.full(shape, np.nan), diverged)


def _launch(
    batch: VehicleBatch,
    task: VehicleTask,
    real: Real,
    until: int,
    running: Compute,
    progress: Callable[[float], None] | None,
) -> kernel.Found:
    """Let the kernel do all rollouts, some at a time."""
    shape, number, threads, on_cpu = batch.shape(task), real.numpy, running.thread_count, running.device == "cpu"
    count = int(np.prod(shape))
    at_once = max(STEPS_PER_LAUNCH // task.steps, real.width * threads)
    if on_cpu:
        each = min(ROLLOUTS_PER_BLOCK, max(real.width, -(-min(count, at_once) // (8 * threads))))
    else:
        at_once, each = GPU_THREADS, 1
    blocks = -(-min(count, at_once) // each)
    reals = real.array((blocks, kernel.slot_count(batch.sensors, batch.wiring))).reshape(-1, real.width)
    memory = kernel.Memory(real.reals(reals), reals, np.zeros((blocks, real.width), np.int32))
    found = kernel.Found(np.zeros(count, number), np.zeros(count, np.int32), np.zeros(count, number))
    run = kernel.rollout_kernel(real, batch.sensors, batch.wiring, until, GRAIN if on_cpu else 1)
    sites, falls = batch.sites.reshape(len(batch.sites), -1), 3 * task.time_step * batch.speed_bounds
    arrays = sites, batch.weights, task.seen, batch.reach, falls
    given: list[np.ndarray] = [np.ascontiguousarray(array, number) for array in arrays]
    sizes = (task.steps, *shape[1:], int(batch.shared), task.time_step, task.radius)
    for first in range(0, count, at_once):
        jobs = min(at_once, count - first)
        part = kernel.Found(*(array[first : first + jobs] for array in found))
        run(-(-jobs // each), memory, kernel.Jobs(first, jobs, each, *sizes, *given), part)
        if progress:
            progress((first + jobs) / count)
    return found
