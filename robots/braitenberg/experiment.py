"""Environments and controllers of the published experiment, and rollouts of bodies in them.

Source: dissertation, chapters 3 and 4. ``PUBLISHED`` has the settings that give the published numbers;
``TEXT_OF_CHAPTER_4`` and ``TEXT_OF_CHAPTER_3`` those that the text states.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Unpack

import numpy as np
from numpy.typing import ArrayLike

from robots.braitenberg.body import VehicleBody
from taichi_sim import vehicle
from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import whole_number
from taichi_sim.base.compute import ComputeOptions
from taichi_sim.vehicle import Rollouts, Traces, VehicleBatch, VehicleTask, rollout
from taichi_sim.vehicle.rollout import Until

DISTANCE = 4.0  # m, from the light at the origin to every start
_SIDE = DISTANCE / math.sqrt(2)
# In the order of the experiment; the text lists the last two the other way round.
STARTS = np.array([[_SIDE, _SIDE, 0.0], [_SIDE, -_SIDE, 0.0], [-_SIDE, -_SIDE, 0.0], [-_SIDE, _SIDE, 0.0]])

PUBLISHED = VehicleTask(STARTS, radius=0.075, time_step=0.05, steps=10_000)
TEXT_OF_CHAPTER_4 = replace(PUBLISHED, time_step=0.1, steps=100_000)
TEXT_OF_CHAPTER_3 = replace(PUBLISHED, radius=0.2, time_step=0.1, steps=100_000)


def weight_grid(count: int) -> Floats:
    """Return ``count`` evenly spaced values of a weight from -1 to 1, shape (count,), symmetric about 0.

    Raises:
        ValueError: unless the count is a whole number of at least 2.
    """
    count = whole_number("weights", count, 2)
    values = np.linspace(-1.0, 1.0, count)
    return (values - values[::-1]) / 2


def contralateral(weights: ArrayLike) -> Floats:
    """Make controllers of vehicles with two sensors, each of which drives the motor of the other side.

    Speed and turning rate are v = (w1 s1 + w2 s2) / 2 and a' = w1 s1 - w2 s2.

    Args:
        weights: weights w1 and w2, shape (..., 2), each from -1 to 1.

    Returns:
        Matrices of the controllers (motor, sensor), shape (..., 2, 2).

    Raises:
        ValueError: for other shapes and values.
    """
    try:
        values = np.asarray(weights, np.float64)
    except (TypeError, ValueError):
        raise ValueError("weights: these are not allowed; give an array of numbers, (..., 2): w1, w2") from None
    if values.ndim == 0 or values.shape[-1] != 2:
        raise ValueError(f"weights: an array of shape {values.shape} is not allowed; give (..., 2): w1, w2")
    check_weights(values)
    return values[..., None] * np.eye(2)


def check_weights(values: Floats) -> None:
    """Raise a ValueError for a weight outside -1 to 1."""
    wrong = ~(np.abs(values) <= 1.0)
    if wrong.any():
        raise ValueError(f"weights: {values[wrong][0]} is not allowed; give numbers from -1 to 1")


def check_bodies(bodies: Sequence[VehicleBody]) -> None:
    """Raise a ValueError unless these are bodies, one at least."""
    if not isinstance(bodies, Sequence) or not all(isinstance(body, VehicleBody) for body in bodies):
        raise ValueError(f"bodies: {bodies!r} is not allowed; give a list of bodies")
    if not bodies:
        raise ValueError("bodies: none given; give at least one")


def batch_of(bodies: Sequence[VehicleBody], controllers: ArrayLike) -> VehicleBatch:
    """Bodies and controllers as arrays.

    Args:
        bodies: with equally many sensors.
        controllers: matrices, shape (B or 1, C, 2, S), weights from -1 to 1.

    Raises:
        ValueError: for no bodies, different numbers of sensors, and other shapes and values.
    """
    check_bodies(bodies)
    counts = {len(body.sensors) for body in bodies}
    if len(counts) > 1:
        raise ValueError(f"bodies: {sorted(counts)} sensors are not allowed at once; give bodies with equally many")
    batch = VehicleBatch([body.sensors for body in bodies], controllers)  # type: ignore[arg-type]
    check_weights(batch.controllers)
    return batch


def simulate(
    bodies: Sequence[VehicleBody],
    controllers: ArrayLike,
    task: VehicleTask = PUBLISHED,
    *,
    until: Until = "closest",
    progress: Callable[[float], None] | None = None,
    **compute: Unpack[ComputeOptions],
) -> Rollouts:
    """Simulate Braitenberg vehicles: all controllers in their bodies, in all environments of a task.

    Args:
        bodies: B bodies.
        controllers: see :func:`batch_of`; :func:`contralateral` makes matrices of two weights.
        task: environments, radius and time.
        until: when a rollout may end, see :func:`taichi_sim.vehicle.rollout`.
        progress: called with the fraction done.
        **compute: device, precision and threads, as of :class:`Compute`.

    Returns:
        Arrays of shape (B, C, E).
    """
    return rollout(batch_of(bodies, controllers), task, until=until, progress=progress, **compute)


def trace(
    bodies: Sequence[VehicleBody],
    controllers: ArrayLike,
    task: VehicleTask = PUBLISHED,
    *,
    every: int = 1,
    **compute: Unpack[ComputeOptions],
) -> Traces:
    """Record the motion and sensor readings of vehicles over time, for the same arguments as :func:`simulate`.

    Args:
        bodies, controllers, task: see :func:`simulate`.
        every: steps from one sample to the next.
        **compute: device, precision and threads, as of :class:`Compute`.
    """
    return vehicle.trace(batch_of(bodies, controllers), task, every=every, **compute)
