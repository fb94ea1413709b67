"""Forward-mode derivatives of rollouts: tangents move along with the state.

The Jacobian of a step is what the laws' own reverse pass gives for each of its two results (``tracing.pull_back``), so
nothing is derived by hand.
"""

from functools import lru_cache
from typing import Any

from taichi_sim.autodiff.lanes import Real, load, load_all, store
from taichi_sim.autodiff.tracing import pull_back, select
from taichi_sim.runtime import ti
from taichi_sim.vehicle import equations
from taichi_sim.vehicle.task import Wiring

# Slots of a block: where the light is seen, the smallest squared distance so far; then sites and weights; then for each
# of these the tangents of x and y and of the smallest squared distance.
PX, PY, CLOSEST, PARAMETERS = range(4)


def slot_count(sensors: int, connections: int) -> int:
    """Reals of a block's memory."""
    return PARAMETERS + 4 * (2 * sensors + connections)


@lru_cache
def gradient_kernel(real: Real, sensors: int, wiring: Wiring, grain: int) -> Any:
    """The kernel for one kind of real, number of sensors and wiring."""
    count = 2 * sensors + sum(map(len, wiring))
    slots = slot_count(sensors, count - 2 * sensors)
    at_parameters = tuple(range(PARAMETERS, PARAMETERS + count))
    tangents = PARAMETERS + count
    reals = ti.types.ndarray(dtype=real.type, ndim=1)

    def step(px, py, *others):
        parameters, time_step = others[:-1], others[-1]
        x, y, _ = equations.advance(px, py, parameters[: 2 * sensors], parameters[2 * sensors :], wiring, time_step)
        return x, y

    @ti.kernel
    def run(blocks: ti.i32, steps: ti.i32, time_step: real.scalar, m: reals):
        for i in range(grain * blocks):
            if i % grain == 0:
                k = i // grain * slots
                px, py, closest = load(m, k, PX), load(m, k, PY), load(m, k, CLOSEST)
                p = ti.static(load_all(m, k, at_parameters))
                one = 0.0 * px + 1.0
                h = 0.0 * px + time_step
                for _ in range(steps):
                    inputs = ti.static((px, py) + p)
                    to_x = ti.static(pull_back(step, inputs, (h,), (one, None)))
                    to_y = ti.static(pull_back(step, inputs, (h,), (None, one)))
                    px, py, _turn = equations.advance(px, py, p[: 2 * sensors], p[2 * sensors :], wiring, h)
                    distance = px * px + py * py
                    closer = distance < closest
                    closest = select(closer, distance, closest)
                    for c in ti.static(range(count)):
                        x, y = load(m, k, tangents + 3 * c), load(m, k, tangents + 3 * c + 1)
                        dx = to_x[0] * x + to_x[1] * y + to_x[2 + c]
                        dy = to_y[0] * x + to_y[1] * y + to_y[2 + c]
                        store(m, k, tangents + 3 * c, dx)
                        store(m, k, tangents + 3 * c + 1, dy)
                        least = select(closer, 2.0 * (px * dx + py * dy), load(m, k, tangents + 3 * c + 2))
                        store(m, k, tangents + 3 * c + 2, least)
                store(m, k, PX, px)
                store(m, k, PY, py)
                store(m, k, CLOSEST, closest)

    return run
