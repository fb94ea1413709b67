"""Rovers at work: pairs of weights in bodies, in environments with a light each."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Unpack

import numpy as np
from numpy.typing import NDArray

from robots.control.neural import GRAVITY, SLIP, TIME_STEP, ControllerTrials, Lights, as_list
from robots.rover.body import LIGHT_HEIGHT, LIGHTS, SENSES, STEPS, Rover
from taichi_sim.base.arrays import Bools, Floats
from taichi_sim.base.compute import ComputeOptions
from taichi_sim.base.short_text import ShortText
from taichi_sim.rigid import Network, Physics, RigidEngine, RigidResult


@dataclass(frozen=True, eq=False, repr=False)
class RoverResult(ShortText):
    """Result of simulating N two-wheel vehicles in E environments.

    Attributes:
        distance: distance from the light at the end, seen from above, (N, E) [m]; NaN if diverged.
        closest: smallest such distance at any reading, (N, E) [m].
        success: whether the smallest distance counts as reaching the light, (N, E).
        position: position of the body at the end, (N, E, 3) [m].
        status: ``"ok"`` or ``"diverged"``, (N, E).
        rollouts: everything about the N E rollouts, environments changing fastest.
        gradient: derivatives of ``distance`` by w1 and w2, (N, E, 2) [m], if asked for.
    """

    distance: Floats
    closest: Floats
    success: Bools
    position: Floats
    status: NDArray[np.str_]
    rollouts: RigidResult
    gradient: Floats | None = None


def controllers(weights: object) -> Floats:
    """Make crossed controllers, (N, 2, 2): sensor 1 drives the right wheel by w1, sensor 2 the left one by w2.

    Args:
        weights: w1 and w2 of each, (N, 2); or those of one, (2,).

    Raises:
        ValueError: for other shapes, or numbers that are not finite.
    """
    try:
        found = np.atleast_2d(np.asarray(weights, float))
    except (TypeError, ValueError):
        found = np.empty((0, 0))
    if found.ndim != 2 or found.shape[1] != 2 or len(found) == 0:
        raise ValueError(f"weights: shape {found.shape} is not allowed; give (N, 2): w1, w2")
    if not np.isfinite(found).all():
        raise ValueError("weights: numbers that are not finite are not allowed")
    crossed = np.zeros((len(found), 2, 2))
    crossed[:, [0, 1], [1, 0]] = found
    return crossed


def engine(
    rovers: Rover | Sequence[Rover], *, width: int | None = None, **compute: Unpack[ComputeOptions]
) -> RigidEngine:
    """Make an engine for vehicles in the world of the published experiment, see ``RigidEngine``.

    Raises:
        ValueError: for no vehicle.
    """
    world, network = Physics(TIME_STEP, GRAVITY, SLIP, integration="velocity"), Network(memory=0.0)
    return RigidEngine([each.tree() for each in as_list(rovers)], world, SENSES, network, width=width, **compute)


def simulate(
    rovers: Rover | Sequence[Rover],
    weights: object,
    lights: Lights = LIGHTS,
    *,
    steps: int = STEPS,
    record_every: int | None = None,
    gradients: bool = False,
    width: int | None = None,
    **compute: Unpack[ComputeOptions],
) -> RoverResult:
    """Simulate two-wheel vehicles with their controllers, each in all environments.

    Args:
        rovers: one body for all controllers, or one for each.
        weights: w1 and w2, (N, 2).
        lights: places of the light in the environments, (E, 2) [m].
        steps: number of light readings, each before a time step; steps - 1 time steps are run.
        record_every: record every so many time steps; not with gradients.
        gradients: with the derivatives of the distances at the end by the weights.
        width: rollouts side by side on a CPU; results do not depend on it.
        **compute: device, precision and threads, as of :class:`Compute`.

    Raises:
        ValueError: for what is not allowed.
    """
    trials = ControllerTrials.of("rovers", rovers, controllers(weights), lights, LIGHT_HEIGHT)
    found, tape = trials.run(engine(trials.bodies, width=width, **compute), steps, record_every, gradients)
    slopes = None
    if tape:
        away = (found.position - trials.lights) * [1.0, 1.0, 0.0]
        by_weights = tape.pull_back(position=away / np.linalg.norm(away, axis=1, keepdims=True)).weights
        slopes = trials.by_environment(by_weights[:, [0, 1], [1, 0]])
    enough = np.array([each.success_distance for each in trials.bodies])
    arrays = (found.closest, found.closest <= enough, found.position, found.status)
    closest, success, position, status = map(trials.by_environment, arrays)
    return RoverResult(trials.distances(found), closest, success, position, status, found, slopes)


# Run controllers, with the derivatives of the distances at the end by their weights.
differentiate = partial(simulate, gradients=True)
