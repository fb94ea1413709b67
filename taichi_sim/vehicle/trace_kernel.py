"""The kernel of traces: one rollout a thread, by the same laws as rollouts, so with the same bits."""

from functools import lru_cache
from typing import Any

from taichi_sim.autodiff.elementary import sine_cosine
from taichi_sim.autodiff.lanes import Real
from taichi_sim.runtime import ti
from taichi_sim.vehicle import equations
from taichi_sim.vehicle.task import Wiring


@lru_cache
def trace_kernel(real: Real, sensors: int, wiring: Wiring) -> Any:
    """The kernel for one kind of real, number of sensors and wiring."""
    first_weight = 3 + 2 * sensors
    at_sites, at_weights = range(3, first_weight), range(first_weight, first_weight + sum(map(len, wiring)))
    scalars2, scalars3 = (ti.types.ndarray(dtype=real.scalar, ndim=n) for n in (2, 3))

    @ti.kernel
    def run(
        jobs: ti.i32,
        steps: ti.i32,
        every: ti.i32,
        time_step: real.scalar,
        given: scalars2,
        places: scalars3,
        readings: scalars3,
    ):
        for n in range(jobs):
            px, py, heading = given[n, 0], given[n, 1], given[n, 2]
            l = ti.static(tuple([given[n, c] for c in at_sites]))
            w = ti.static(tuple([given[n, c] for c in at_weights]))
            for t in range(steps + 1):
                if t % every == 0:
                    seen = equations.readings(px, py, l)
                    for j in ti.static(range(sensors)):
                        readings[n, j, t // every] = seen[j]
                    sine, cosine = sine_cosine(heading)
                    places[n, t // every, 0] = cosine * px - sine * py
                    places[n, t // every, 1] = sine * px + cosine * py
                    places[n, t // every, 2] = heading
                px, py, turn = equations.advance(px, py, l, w, wiring, time_step)
                heading = heading + turn

    return run
