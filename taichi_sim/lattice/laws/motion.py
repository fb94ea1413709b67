"""Motion of a voxel: symplectic Euler on momenta, degrees of freedom that the world holds, strains, face pressure."""

from taichi_sim.autodiff.lanes import larger
from taichi_sim.autodiff.rotations import (
    from_large_rotation_vector,
    from_rotation_vector,
    multiply,
    renormalise,
    rotate,
    to_rotation_vector,
)
from taichi_sim.autodiff.tracing import law, select, sqrt
from taichi_sim.runtime import ti


@law
def damped_force(fx, fy, fz, px, py, pz, inverse_mass, drag, cx, cy, cz):
    """Force F less the drag against the world at momentum p, with the contact force c."""
    return (
        fx - drag * (px * inverse_mass) + cx,
        fy - drag * (py * inverse_mass) + cy,
        fz - drag * (pz * inverse_mass) + cz,
    )


@law
def accelerated(px, py, pz, fx, fy, fz, dt):
    """Momentum after a step under force F, or angular momentum under a moment."""
    return px + fx * dt, py + fy * dt, pz + fz * dt


@law
def damped_moment(mx, my, mz, lx, ly, lz, inverse_inertia, drag):
    """Moment M less the drag against the world at angular momentum l."""
    rate = drag * inverse_inertia
    return mx - lx * rate, my - ly * rate, mz - lz * rate


@law
def placed(x, y, z, qw, qx, qy, qz, px, py, pz, lx, ly, lz, inverse_mass, inverse_inertia, dt):
    """Position and orientation after a step, from the new momentum p and angular momentum l."""
    step = dt * inverse_mass
    qw, qx, qy, qz = rotate_by_momentum(qw, qx, qy, qz, lx, ly, lz, dt * inverse_inertia)
    return x + px * step, y + py * step, z + pz * step, qw, qx, qy, qz


@law
def held_rotation(qw, qx, qy, qz, rx, ry, rz, hold_x, hold_y, hold_z):
    """Orientation with the prescribed components r of its rotation vector where the world holds them (hold = 1).

    Of the two quaternions of an orientation it is the one nearer to the old where some turn is free, so that a voxel
    may turn right round: neighbours of unlike signs would be a whole turn apart. Where all are held, it is that of r.
    """
    tx, ty, tz = to_rotation_vector(qw, qx, qy, qz)
    w, x, y, z = from_large_rotation_vector(
        select(hold_x > 0.5, rx, tx), select(hold_y > 0.5, ry, ty), select(hold_z > 0.5, rz, tz)
    )
    turned = (w * qw + x * qx + y * qy + z * qz < 0.0) & (hold_x + hold_y + hold_z < 2.5)
    w, x = select(turned, 0.0 - w, w), select(turned, 0.0 - x, x)
    y, z = select(turned, 0.0 - y, y), select(turned, 0.0 - z, z)
    # Where nothing is held, the orientation stays as it is, to the last bit.
    held = hold_x + hold_y + hold_z > 0.5
    return select(held, w, qw), select(held, x, qx), select(held, y, qy), select(held, z, qz)


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
    """Pressure times the deformed area of a voxel's faces times n, the way that it pushes, voxel frame.

    The edges are those between the corners: a side without a link does not stretch, so strains g count by h, half the
    number of links along the axis.
    """
    ex = size_x * (1.0 + gx * hx)
    ey = size_y * (1.0 + gy * hy)
    ez = size_z * (1.0 + gz * hz)
    return pressure * (ey * ez) * nx, pressure * (ez * ex) * ny, pressure * (ex * ey) * nz


@law
def face_force(qw, qx, qy, qz, gx, gy, gz, size_x, size_y, size_z, pressure, hx, hy, hz, nx, ny, nz):
    """:func:`pressure_on_faces` of a voxel of orientation q, world frame."""
    fx, fy, fz = pressure_on_faces(gx, gy, gz, size_x, size_y, size_z, pressure, hx, hy, hz, nx, ny, nz)
    return rotate(qw, qx, qy, qz, fx, fy, fz)


@law
def poisson_strains(ex, ey, ez, nu, tx, ty, tz):
    """Strains of a voxel with Poisson's effect: an axis that is not in tension (t = 0) gives way to those that are."""
    stretched = 1.0 + select(tx > 0.5, ex, 0.0) + select(ty > 0.5, ey, 0.0) + select(tz > 0.5, ez, 0.0)
    squeezed = power(stretched, 0.0 - nu) - 1.0
    return select(tx > 0.5, ex, squeezed), select(ty > 0.5, ey, squeezed), select(tz > 0.5, ez, squeezed)
