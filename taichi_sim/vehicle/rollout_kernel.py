"""Rollouts side by side in the lanes of native vectors (CPU), or one a thread (GPU).

A block works through a range of rollouts. Its lanes hold one rollout each; a lane whose rollout has ended takes the
next one, so that long rollouts do not hold up short ones. Neither neighbours nor their number change a lane's numbers.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

from taichi_sim.autodiff.lanes import Real, any_lane
from taichi_sim.autodiff.tracing import primitive, select, sqrt
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


class Jobs(NamedTuple):
    """What rollouts are given: sizes, and arrays of bodies, controllers and environments.

    Attributes:
        first: number of the launch's first rollout.
        steps: of each.
        controllers: of each body.
        environments: of each controller.
        shared: whether all bodies have the same controllers, 0 or 1.
        sites: of sensors, (B, 2 S).
        weights: of controllers.
        starts: where the light is seen, (E, 2).
        reach: largest |l| of bodies.
        bound: fall of rho^3 in a step, of controllers.
    """

    first: Any
    steps: Any
    controllers: Any
    environments: Any
    shared: Any
    sites: Any
    weights: Any
    starts: Any
    reach: Any
    bound: Any


@primitive
def load_all(m: Any, ms: Any, k: Any, slots: Sequence[int], single: bool) -> tuple[Any, ...]:
    """Read reals. Where they are scalars their memory has one name only: a GPU gets a copy of every argument."""
    return tuple(element(ms, k + slot, 0) if single else element(m, k + slot) for slot in slots)


@primitive
def store_all(m: Any, ms: Any, k: Any, slots: Sequence[int], single: bool, values: Sequence[Any]) -> None:
    """Write reals."""
    for place, value in zip(load_all(m, ms, k, slots, single), values, strict=True):
        place._assign(value)


@ti.func
def end_rollout(ms: ti.template(), k, lane, job, closest: ti.template(), waited: ti.template(), final: ti.template()):
    """Note what a rollout came to."""
    closest[job] = ms[k + CLOSEST, lane]
    waited[job] = ti.cast(ms[k + WAITED, lane], ti.i32)
    px, py = ms[k + PX, lane], ms[k + PY, lane]
    final[job] = px * px + py * py


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

    @ti.kernel
    def run(
        blocks: ti.i32,
        first: ti.i32,
        count: ti.i32,
        jobs_per_block: ti.i32,
        steps: ti.i32,
        controllers: ti.i32,
        environments: ti.i32,
        shared: ti.i32,
        time_step: real.scalar,
        radius: real.scalar,
        m: reals,
        ms: scalars2,
        lanes: ints2,
        sites: scalars2,
        weights: scalars2,
        starts: scalars2,
        reach: scalars1,
        bound: scalars1,
        closest_of: scalars1,
        waited_of: ints1,
        final_of: scalars1,
    ):
        for i in range(grain * blocks):
            if i % grain == 0:
                block = i // grain
                k = block * slots
                jobs = ti.static(
                    Jobs(first, steps, controllers, environments, shared, sites, weights, starts, reach, bound)
                )
                upcoming = block * jobs_per_block
                end = ti.min(upcoming + jobs_per_block, count)
                active = ti.min(width, end - upcoming)
                for lane in range(width):
                    lanes[block, lane] = fill_lane(ms, k, lane, upcoming, end, slots, jobs)
                    upcoming += 1
                soonest = steps
                while active > 0:
                    run_on = ti.min(soonest, STEPS_BETWEEN_CHECKS)
                    px, py, closest, waited, left, fall, outermost = load_all(m, ms, k, STATE, single)
                    l = ti.static(load_all(m, ms, k, at_sites, single))
                    w = ti.static(load_all(m, ms, k, at_weights, single))
                    for _ in range(run_on):
                        if ti.static(until != UNTIL_SUCCESS):
                            waited = waited + select(closest >= radius * radius, 1.0, 0.0)
                        px, py, _turn = equations.advance(px, py, l, w, wiring, time_step)
                        distance = px * px + py * py
                        closest = select(distance < closest, distance, closest)
                    left = left - ti.cast(run_on, real.scalar)
                    ended = (left < 0.5) | ((px + py) * 0.0 != 0.0)
                    if ti.static(until == UNTIL_SUCCESS):
                        ended = ended | (closest < radius * radius)
                        ended = ended | equations.hopeless(px, py, outermost, radius, fall * left)
                    if ti.static(until == UNTIL_CLOSEST):
                        ended = ended | equations.hopeless(px, py, outermost, sqrt(closest), fall * left)
                    store_all(m, ms, k, CHANGING, single, (px, py, closest, waited, left))
                    soonest -= run_on
                    if any_lane(ended):
                        store_all(m, ms, k, (ENDED,), single, (select(ended, 1.0, 0.0),))
                        soonest = steps
                        for lane in range(width):
                            if lanes[block, lane] != NOTHING:
                                if ms[k + ENDED, lane] > 0.5:
                                    end_rollout(ms, k, lane, lanes[block, lane], closest_of, waited_of, final_of)
                                    lanes[block, lane] = fill_lane(ms, k, lane, upcoming, end, slots, jobs)
                                    upcoming += 1
                                    if lanes[block, lane] == NOTHING:
                                        active -= 1
                            if lanes[block, lane] != NOTHING:
                                soonest = ti.min(soonest, ti.cast(ms[k + LEFT, lane], ti.i32))

    return run
