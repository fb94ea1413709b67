"""Quadrupeds at work: controllers in bodies, in environments with a light each, and derivatives by the weights."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Unpack

import numpy as np
from numpy.typing import NDArray

from robots.control.neural import GRAVITY, SLIP, TIME_STEP, ControllerTrials, Lights, as_list, check_weights
from robots.quadruped.body import (
    AS_RUN,
    LIGHT_HEIGHT,
    MOTORS,
    SENSORS,
    STEPS,
    TWO_ENVIRONMENTS,
    Quadruped,
    Variant,
)
from taichi_sim.base.arrays import Floats
from taichi_sim.base.compute import ComputeOptions
from taichi_sim.base.short_text import ShortText
from taichi_sim.rigid import Network, Physics, RigidEngine, RigidResult


@dataclass(frozen=True, eq=False, repr=False)
class QuadrupedResult(ShortText):
    """Result of simulating N quadrupeds in E environments.

    Attributes:
        light: last reading of the light sensor, (N, E) [1/m^2]; the fitness of an environment.
        distance: distance from the light at the end, seen from above, (N, E) [m].
        closest: smallest such distance at any time, (N, E) [m].
        position: position of the main body at the end, (N, E, 3) [m].
        status: ``"ok"`` or ``"diverged"``, (N, E); numbers of the latter are NaN.
        rollouts: everything about the N E rollouts, environments changing fastest.
        gradient: derivatives of ``light`` by the weights, (N, E, 5, 8) [1/m^2], if asked for; readings are not rounded
            before.
    """

    light: Floats
    distance: Floats
    closest: Floats
    position: Floats
    status: NDArray[np.str_]
    rollouts: RigidResult
    gradient: Floats | None = None


def engine(
    robots: Quadruped | Sequence[Quadruped],
    variant: Variant = AS_RUN,
    *,
    width: int | None = None,
    **compute: Unpack[ComputeOptions],
) -> RigidEngine:
    """Make an engine for quadrupeds of one kind in the world of the published experiment, see ``RigidEngine``.

    Raises:
        ValueError: for no robot, or several kinds.
    """
    several = as_list(robots)
    if not several:
        raise ValueError("robots: an empty list is not allowed; give at least one")
    if len({each.kind for each in several}) > 1:
        raise ValueError("robots: several kinds are not allowed at once; give robots of one kind")
    world = Physics(TIME_STEP, GRAVITY, SLIP, integration="velocity")
    network = Network(1.0, variant.gain, variant.touch_values)
    trees = [each.tree(variant) for each in several]
    return RigidEngine(trees, world, several[0].senses(), network, width=width, **compute)


def simulate(
    robots: Quadruped | Sequence[Quadruped],
    weights: object,
    lights: Lights = TWO_ENVIRONMENTS,
    *,
    variant: Variant = AS_RUN,
    steps: int = STEPS,
    record_every: int | None = None,
    gradients: bool = False,
    width: int | None = None,
    **compute: Unpack[ComputeOptions],
) -> QuadrupedResult:
    """Simulate quadrupeds with their controllers, each in all environments.

    Args:
        robots: one robot for all controllers, or one for each, of one kind.
        weights: weights of the controllers, (N, 5, 8): from four touch sensors and the light to eight motors.
        lights: places of the light in the environments, (E, 2) [m].
        variant: the published experiment, or its text.
        steps: number of sensor readings; the last one counts, so that steps - 1 time steps are run.
        record_every: record every so many time steps; not with gradients.
        gradients: with the derivatives of the last light readings by the weights. Contacts, stops and limits act as
            they did (see ``taichi_sim.rigid.gradient``). It takes about five times as long, and 2 MB for a rollout of
            1,000 steps in f64. Derivatives of robots that diverged are NaN.
        width: rollouts side by side on a CPU; results do not depend on it.
        **compute: device, precision and threads, as of :class:`Compute`.

    Raises:
        ValueError: for what is not allowed.
    """
    trials = ControllerTrials.of("robots", robots, check_weights(weights, SENSORS, MOTORS), lights, LIGHT_HEIGHT)
    found, tape = trials.run(engine(trials.bodies, variant, width=width, **compute), steps, record_every, gradients)
    slopes = None
    if tape:
        of_light = np.zeros((len(trials.weights), SENSORS))
        of_light[:, -1] = 1
        slopes = trials.by_environment(tape.pull_back(readings=of_light).weights)
    light = found.readings[:, -1]
    if variant.quantum:
        light = np.round(light / variant.quantum) * variant.quantum
    arrays = (light, found.closest, found.position, found.status)
    light, closest, position, status = map(trials.by_environment, arrays)
    return QuadrupedResult(light, trials.distances(found), closest, position, status, found, slopes)


# Run controllers, with the derivatives of the last light readings by their weights.
differentiate = partial(simulate, gradients=True)
