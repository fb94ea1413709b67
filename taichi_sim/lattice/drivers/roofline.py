"""How far the lattice could go: arithmetic per voxel-step and the measured peak of one core."""

import time

import numpy as np

from taichi_sim import runtime
from taichi_sim.autodiff.lanes import NATIVE_WIDTH, Real
from taichi_sim.runtime import ti

# Counted by hand in the laws for the published robot (2.3 links a voxel, all small): about 200 a link, 120 a voxel.
FLOPS_PER_VOXEL_STEP = 580

_CHAINS = 12  # independent sums, more than the latency of an addition times the width of the machine


@runtime.exclusive
def measure_peak(precision: str, seconds: float = 0.3) -> float:
    """Additions and multiplications per second that one core does on native vectors, without memory traffic.

    Without fused multiply-add, as the laws are compiled: it would round differently in different lanes.
    """
    runtime.start("cpu", precision, 1)
    real = Real(precision, NATIVE_WIDTH[precision])
    array = ti.types.ndarray(dtype=real.type, ndim=1)

    @ti.kernel
    def work(a: array, count: ti.i32):
        ti.loop_config(serialize=True)
        for k in range(1):
            a0, a1, a2, a3, a4, a5 = a[0], a[1], a[2], a[3], a[4], a[5]
            b0, b1, b2, b3, b4, b5 = a[6], a[7], a[8], a[9], a[10], a[11]
            for _ in range(count):
                a0, a1, a2 = a0 * 0.999, a1 * 0.999, a2 * 0.999
                a3, a4, a5 = a3 * 0.999, a4 * 0.999, a5 * 0.999
                b0, b1, b2 = b0 + 0.5, b1 + 0.5, b2 + 0.5
                b3, b4, b5 = b3 + 0.5, b4 + 0.5, b5 + 0.5
            a[k] = a0 + a1 + a2 + a3 + a4 + a5 + b0 + b1 + b2 + b3 + b4 + b5

    buffer = real.array((_CHAINS,), 1.0)
    count, best = 100_000, 0.0
    work(buffer, 1)
    end = time.perf_counter() + seconds
    while time.perf_counter() < end:
        started = time.process_time()
        work(buffer, count)
        best = max(best, _CHAINS * real.width * count / max(time.process_time() - started, 1e-9))
        buffer[...] = np.ones_like(buffer)
    return best
