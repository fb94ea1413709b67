"""Integration of a voxel: symplectic Euler on momenta, and the degrees of freedom that the world holds."""

from taichi_sim.autodiff.lanes import larger
from taichi_sim.autodiff.rotations import from_rotation_vector, multiply, renormalise
from taichi_sim.autodiff.tracing import law, select, sqrt
from taichi_sim.runtime import ti


@law
def rotate_by_momentum(w, x, y, z, lx, ly, lz, k):
    """Orientation after one step: quat(k L) q with k = dt / I."""
    tw, tx, ty, tz = from_rotation_vector(k * lx, k * ly, k * lz)
    w, x, y, z = multiply(tw, tx, ty, tz, w, x, y, z)
    return renormalise(w, x, y, z)


@law
def power(base, exponent):
    """base ** exponent for 0.01 < base < 100 and |exponent| <= 0.5, without transcendental functions.

    log by the series of atanh after four square roots, exp by its series after halving four times.
    """
    root = sqrt(sqrt(sqrt(sqrt(larger(base, 1e-2)))))
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


@law
def pressure_on_faces(gx, gy, gz, size_x, size_y, size_z, pressure, hx, hy, hz, nx, ny, nz):
    """Pressure times the deformed area of a voxel's faces of outward normal n, voxel frame.

    The edges are those between the corners: a side without a link does not stretch, so strains g count by h, half the
    number of links along the axis.
    """
    ex = size_x * (1.0 + gx * hx)
    ey = size_y * (1.0 + gy * hy)
    ez = size_z * (1.0 + gz * hz)
    return pressure * (ey * ez) * nx, pressure * (ez * ex) * ny, pressure * (ex * ey) * nz


@law
def poisson_strains(ex, ey, ez, nu, tx, ty, tz):
    """Strains of a voxel with Poisson's effect: an axis that is not in tension (t = 0) gives way to those that are."""
    stretched = 1.0 + select(tx > 0.5, ex, 0.0) + select(ty > 0.5, ey, 0.0) + select(tz > 0.5, ez, 0.0)
    squeezed = power(stretched, 0.0 - nu) - 1.0
    return select(tx > 0.5, ex, squeezed), select(ty > 0.5, ey, squeezed), select(tz > 0.5, ez, squeezed)
