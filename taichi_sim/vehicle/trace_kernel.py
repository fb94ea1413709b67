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
    columns, connections = 2 * sensors, sum(map(len, wiring))
    scalars2, scalars3 = (ti.types.ndarray(dtype=real.scalar, ndim=n) for n in (2, 3))

    @ti.kernel
    def run(
        first: ti.i32,
        jobs: ti.i32,
        steps: ti.i32,
        every: ti.i32,
        controllers: ti.i32,
        environments: ti.i32,
        shared: ti.i32,
        time_step: real.scalar,
        sites: scalars2,
        weights: scalars2,
        starts: scalars2,
        places: scalars3,
        readings: scalars3,
    ):
        for n in range(jobs):
            job = first + n
            body = job // (controllers * environments)
            controller = (job // environments) % controllers
            row = controller
            if shared == 0:
                row = body * controllers + controller
            start = job % environments
            px, py, heading = starts[start, 0], starts[start, 1], starts[start, 2]
            l = ti.static(tuple([sites[body, c] for c in range(columns)]))
            w = ti.static(tuple([weights[row, c] for c in range(connections)]))
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
