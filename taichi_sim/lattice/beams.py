"""The link law: forces and moments of the Euler-Bernoulli beam between two voxels.

Everything is in the link frame, whose x axis points from the "-" voxel to the "+" voxel. The beam is isotropic
across its axis, so turning the voxel frame onto the link frame is a cyclic exchange of components.

Source: Hiller & Lipson 2014 (section "Beam model"), with the angle regimes and the damping of Voxelyze.
"""

from taichi_sim.lanes import absolute, any_lane
from taichi_sim.rotations import multiply, multiply_conjugate, rotate_back, rotation_vector_factor
from taichi_sim.runtime import ti

# States of a link; a new one is small but remembers nothing yet.
LARGE, SMALL, NEW = 0.0, 1.0, 2.0

# Hysteresis of the small-angle regime: turn = (|dy| + |dz|)/dx and extension |1 - dx/L0|.
TURN_ENTER, TURN_LEAVE = 0.05, 0.06
EXTENSION_ENTER, EXTENSION_LEAVE = 0.5, 0.6
STRAIGHT = 1.732e-2  # slopes below this use the first-order rotation onto the axis

DIVERGED_STRAIN = 100.0


@ti.func
def relative_pose(dx, dy, dz, aw, ax, ay, az, bw, bx, by, bz):
    """Offset d and orientation of the "+" voxel in the frame of the "-" voxel."""
    x, y, z = rotate_back(aw, ax, ay, az, dx, dy, dz)
    rw, rx, ry, rz = multiply_conjugate(aw, ax, ay, az, bw, bx, by, bz)
    return x, y, z, rw, rx, ry, rz


@ti.func
def angle_regime(x, y, z, rest, state):
    """1 where the link is in the small-angle regime in this step, else 0."""
    turn = absolute(y) + absolute(z)
    extension = absolute(rest - x)
    enters = ti.select((turn < TURN_ENTER * x) & (extension < EXTENSION_ENTER * rest), SMALL + 0.0 * state, LARGE)
    stays = ti.select((turn > TURN_LEAVE * x) | (extension > EXTENSION_LEAVE * rest), LARGE + 0.0 * state, SMALL)
    return ti.select(state > 0.5, stays, enters)


@ti.func
def turn_onto_axis(x, y, z, length):
    """Quaternion (w, 0, y, z) that turns the offset (x, y, z) onto +x."""
    inverse = 1.0 / length
    w = ti.sqrt(ti.max(0.5 * (1.0 + x * inverse), 1e-12))
    k = 0.5 * inverse / w
    slope_y = y / x
    slope_z = z / x
    straight = ti.max(absolute(slope_y), absolute(slope_z)) < STRAIGHT
    sy = 0.5 * slope_z
    sz = -0.5 * slope_y
    return (
        ti.select(straight, 1.0 - 0.5 * (sy * sy + sz * sz), w),
        ti.select(straight, sy, z * k),
        ti.select(straight, sz, 0.0 - y * k),
    )


@ti.func
def shear(b1, b2, dy, dz, t1y, t1z, t2y, t2z, bent: ti.template()):
    """Transverse forces (b1 dy - b2 (t1z + t2z), b1 dz + b2 (t1y + t2y)); with bent = False t1 is zero, not read."""
    ty = t2y
    tz = t2z
    if ti.static(bent):
        ty = t1y + ty
        tz = t1z + tz
    return b1 * dy - b2 * tz, b1 * dz + b2 * ty


@ti.func
def end_moments(a2, b2, b3, dy, dz, t1y, t1z, t2x, t2y, t2z, bent: ti.template()):
    """Moments on the two ends: (M-, M+); with bent = False t1 is zero and not read."""
    mx = a2 * t2x
    sy = b2 * dz
    sz = b2 * dy
    uy = t2y
    uz = t2z
    vy = 2.0 * t2y
    vz = 2.0 * t2z
    if ti.static(bent):
        uy = 2.0 * t1y + uy
        uz = 2.0 * t1z + uz
        vy = t1y + vy
        vz = t1z + vz
    return mx, 0.0 - sy - b3 * uy, sz - b3 * uz, 0.0 - mx, 0.0 - sy - b3 * vy, sz - b3 * vz
