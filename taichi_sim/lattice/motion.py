"""Integration of a voxel: symplectic Euler on momenta, and the degrees of freedom that the world holds."""

from taichi_sim.lanes import larger
from taichi_sim.rotations import from_rotation_vector, multiply, renormalise
from taichi_sim.runtime import ti


@ti.func
def rotate_by_momentum(w, x, y, z, lx, ly, lz, k):
    """Orientation after one step: quat(k L) q with k = dt / I."""
    tw, tx, ty, tz = from_rotation_vector(k * lx, k * ly, k * lz)
    w, x, y, z = multiply(tw, tx, ty, tz, w, x, y, z)
    return renormalise(w, x, y, z)


@ti.func
def power(base, exponent):
    """base ** exponent for 0.01 < base < 100 and |exponent| <= 0.5, without transcendental functions.

    log by the series of atanh after four square roots, exp by its series after halving four times.
    """
    root = ti.sqrt(ti.sqrt(ti.sqrt(ti.sqrt(larger(base, 1e-2)))))
    z = (root - 1.0) / (root + 1.0)
    zz = z * z
    series = 1 / 15 + 0.0 * zz
    for i in ti.static(range(6, -1, -1)):
        series = series * zz + 1 / (2 * i + 1)
    u = exponent * 2.0 * z * series  # exponent * log(base) / 16
    result = 1.0 + 0.0 * u
    for i in ti.static(range(12, 0, -1)):
        result = 1.0 + u * result / i
    for _ in ti.static(range(4)):
        result = result * result
    return result
