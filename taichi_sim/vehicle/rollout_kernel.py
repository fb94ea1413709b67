"""Rollouts side by side in the lanes of native vectors (CPU), or one a thread (GPU).

A block works through a range of rollouts. Its lanes hold one rollout each; a lane whose rollout has ended takes the
next one, so that long rollouts do not hold up short ones. Neither neighbours nor their number change a lane's numbers.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

from taichi_sim.autodiff.lanes import Real, any_lane
from taichi_sim.autodiff.tracing import primitive, select, sqrt
from taichi_sim.bundling import kernel_of
from taichi_sim.runtime import element, ti
from taichi_sim.vehicle import equations
from taichi_sim.vehicle.task import Wiring

# How long a rollout lasts: until it succeeds, or cannot any more; until it cannot come closer; or to its end.
UNTIL_SUCCESS, UNTIL_CLOSEST, UNTIL_END = range(3)
UNTIL = {"success": UNTIL_SUCCESS, "closest": UNTIL_CLOSEST, "end": UNTIL_END}

# Slots of a block: where the light is seen, the smallest squared distance so far, steps before success, steps left,
# the fall of rho^3 in a step, the largest |l|, whether the rollout has ended; then sites and weights.
PX, PY, CLOSEST, WAITED, LEFT, BOUND, REACH, ENDED, SITES = range(9)
STATE = (PX, PY, CLOSEST, WAITED, LEFT, BOUND, REACH)
CHANGING = STATE[:5]

NOTHING = -1  # no rollout
STEPS_BETWEEN_CHECKS = 40
NEVER = 1e30


def slot_count(sensors: int, wiring: Wiring) -> int:
    """Reals of a block's memory; there is room for one weight where nothing is connected."""
    return SITES + 2 * sensors + max(1, sum(map(len, wiring)))


class Memory(NamedTuple):
    """Memory of blocks.

    Attributes:
        m: reals, one block after the other.
        ms: the same memory, (reals, lanes).
        lanes: number of the rollout in each lane, (blocks, lanes).
    """

    m: Any
    ms: Any
    lanes: Any


class Jobs(NamedTuple):
    """Inputs of rollouts: sizes, and arrays of bodies, controllers and environments.

    Attributes:
        first: number of the launch's first rollout.
        count: rollouts of the launch.
        each: rollouts of a block.
        steps: of a rollout.
        controllers: of each body.
        environments: of each controller.
        shared: whether all bodies have the same controllers, 0 or 1.
        time_step: [s].
        radius: how close to the light a vehicle succeeds [m].
        sites: of sensors, (B, 2 S).
        weights: of controllers.
        starts: where the light is seen, (E, 2).
        reach: largest |l| of bodies.
        bound: fall of rho^3 in a step, of controllers.
    """

    first: Any
    count: Any
    each: Any
    steps: Any
    controllers: Any
    environments: Any
    shared: Any
    time_step: Any
    radius: Any
    sites: Any
    weights: Any
    starts: Any
    reach: Any
    bound: Any


class Found(NamedTuple):
    """Results of rollouts: smallest squared distances, steps before success, final squared distances."""

    closest: Any
    waited: Any
    final: Any


@primitive
def load_all(memory: Memory, k: Any, slots: Sequence[int], single: bool) -> tuple[Any, ...]:
    """Read reals. Where they are scalars their memory has one name only: a GPU gets a copy of every argument."""
    return tuple(element(memory.ms, k + slot, 0) if single else element(memory.m, k + slot) for slot in slots)


@primitive
def store_all(memory: Memory, k: Any, slots: Sequence[int], single: bool, values: Sequence[Any]) -> None:
    """Write reals."""
    for place, value in zip(load_all(memory, k, slots, single), values, strict=True):
        place._assign(value)


@ti.func
def end_rollout(ms: ti.template(), k, lane, job, found: ti.template()):
    """Write down the results of a rollout."""
    found.closest[job] = ms[k + CLOSEST, lane]
    found.waited[job] = ti.cast(ms[k + WAITED, lane], ti.i32)
    px, py = ms[k + PX, lane], ms[k + PY, lane]
    found.final[job] = px * px + py * py


@ti.func
def begin_rollout(ms: ti.template(), k, lane, job, jobs: ti.template()):
    """Put a rollout into a lane."""
    body = job // (jobs.controllers * jobs.environments)
    controller = (job // jobs.environments) % jobs.controllers
    start = job % jobs.environments
    row = body * jobs.controllers + controller
    if jobs.shared != 0:
        row = controller
    px, py = jobs.starts[start, 0], jobs.starts[start, 1]
    ms[k + PX, lane] = px
    ms[k + PY, lane] = py
    ms[k + CLOSEST, lane] = px * px + py * py
    ms[k + WAITED, lane] = 0.0
    ms[k + LEFT, lane] = jobs.steps
    ms[k + BOUND, lane] = jobs.bound[row]
    ms[k + REACH, lane] = jobs.reach[body]
    for c in range(jobs.sites.shape[1]):
        ms[k + SITES + c, lane] = jobs.sites[body, c]
    for c in range(jobs.weights.shape[1]):
        ms[k + SITES + jobs.sites.shape[1] + c, lane] = jobs.weights[row, c]


@ti.func
def empty_lane(ms: ti.template(), k, lane, slots: ti.template()):
    """A lane without a rollout: a vehicle at rest, which never ends."""
    for slot in range(slots):
        ms[k + slot, lane] = 1.0
    ms[k + LEFT, lane] = NEVER
    ms[k + BOUND, lane] = NEVER
    for slot in range(SITES, slots):
        ms[k + slot, lane] = 0.0


@ti.func
def fill_lane(ms: ti.template(), k, lane, job, end, slots: ti.template(), jobs: ti.template()):
    """Put a rollout into a lane, if there is one left; its number, or NOTHING."""
    result = NOTHING
    if job < end:
        result = job
        begin_rollout(ms, k, lane, jobs.first + job, jobs)
    else:
        empty_lane(ms, k, lane, slots)
    return result


@lru_cache
def rollout_kernel(real: Real, sensors: int, wiring: Wiring, until: int, grain: int) -> Any:
    """The kernel for one kind of real, number of sensors and wiring; a block gets ``grain`` iterations of its loop."""
    width, single = real.width, real.width == 1
    slots = slot_count(sensors, wiring)
    at_sites = tuple(range(SITES, SITES + 2 * sensors))
    at_weights = tuple(range(SITES + 2 * sensors, SITES + 2 * sensors + sum(map(len, wiring))))
    reals = ti.types.ndarray(dtype=real.type, ndim=1)
    ints1, ints2 = (ti.types.ndarray(dtype=ti.i32, ndim=n) for n in (1, 2))
    scalars1, scalars2 = (ti.types.ndarray(dtype=real.scalar, ndim=n) for n in (1, 2))
    numbers = (*[ti.i32] * 7, real.scalar, real.scalar)

    @ti.func
    def run(blocks: ti.template(), memory: ti.template(), jobs: ti.template(), found: ti.template()):
        for i in range(grain * blocks):
            if i % grain == 0:
                block = i // grain
                k = block * slots
                upcoming = block * jobs.each
                end = ti.min(upcoming + jobs.each, jobs.count)
                active = ti.min(width, end - upcoming)
                for lane in range(width):
                    memory.lanes[block, lane] = fill_lane(memory.ms, k, lane, upcoming, end, slots, jobs)
                    upcoming += 1
                soonest = jobs.steps
                while active > 0:
                    run_on = ti.min(soonest, STEPS_BETWEEN_CHECKS)
                    px, py, closest, waited, left, fall, outermost = load_all(memory, k, STATE, single)
                    l = ti.static(load_all(memory, k, at_sites, single))
                    w = ti.static(load_all(memory, k, at_weights, single))
                    radius = jobs.radius
                    for _ in range(run_on):
                        if ti.static(until != UNTIL_SUCCESS):
                            waited = waited + select(closest >= radius * radius, 1.0, 0.0)
                        px, py, _turn = equations.advance(px, py, l, w, wiring, jobs.time_step)
                        distance = px * px + py * py
                        closest = select(distance < closest, distance, closest)
                    left = left - ti.cast(run_on, real.scalar)
                    ended = (left < 0.5) | ((px + py) * 0.0 != 0.0)
                    if ti.static(until == UNTIL_SUCCESS):
                        ended = ended | (closest < radius * radius)
                        ended = ended | equations.hopeless(px, py, outermost, radius, fall * left)
                    if ti.static(until == UNTIL_CLOSEST):
                        ended = ended | equations.hopeless(px, py, outermost, sqrt(closest), fall * left)
                    store_all(memory, k, CHANGING, single, (px, py, closest, waited, left))
                    soonest -= run_on
                    if any_lane(ended):
                        store_all(memory, k, (ENDED,), single, (select(ended, 1.0, 0.0),))
                        soonest = jobs.steps
                        for lane in range(width):
                            job = memory.lanes[block, lane]
                            if job != NOTHING and memory.ms[k + ENDED, lane] > 0.5:
                                end_rollout(memory.ms, k, lane, job, found)
                                job = fill_lane(memory.ms, k, lane, upcoming, end, slots, jobs)
                                memory.lanes[block, lane] = job
                                upcoming += 1
                                if job == NOTHING:
                                    active -= 1
                            if job != NOTHING:
                                soonest = ti.min(soonest, ti.cast(memory.ms[k + LEFT, lane], ti.i32))

    given = Jobs._make((*numbers, scalars2, scalars2, scalars2, scalars1, scalars1))
    return kernel_of(run, ti.i32, Memory(reals, scalars2, ints2), given, Found(scalars1, ints1, scalars1))
