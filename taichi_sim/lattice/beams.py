"""The link law: forces and moments of the Euler-Bernoulli beam between two voxels.

Everything is in the link frame, whose x axis points from the "-" voxel to the "+" voxel. The beam is isotropic
across its axis, so turning the voxel frame onto the link frame is a cyclic exchange of components.

Source: Hiller & Lipson 2014 (section "Beam model"), with the angle regimes and the damping of Voxelyze.
"""

from taichi_sim.lanes import absolute, larger
from taichi_sim.runtime import ti

# States of a link; a new one is small but remembers nothing yet.
LARGE, SMALL, NEW = 0.0, 1.0, 2.0

# Hysteresis of the small-angle regime: turn = (|dy| + |dz|)/dx and extension |1 - dx/L0|.
TURN_ENTER, TURN_LEAVE = 0.05, 0.06
EXTENSION_ENTER, EXTENSION_LEAVE = 0.5, 0.6
STRAIGHT = 1.732e-2  # slopes below this use the first-order rotation onto the axis

DIVERGED_STRAIN = 100.0


@ti.func
def stays_small(x, y, z, rest):
    """Whether a link in the small-angle regime remains there."""
    turn = absolute(y) + absolute(z)
    return (turn <= TURN_LEAVE * x) & (absolute(rest - x) <= EXTENSION_LEAVE * rest)


@ti.func
def becomes_small(x, y, z, rest):
    """Whether a link in the large-angle regime leaves it."""
    turn = absolute(y) + absolute(z)
    return (turn < TURN_ENTER * x) & (absolute(rest - x) < EXTENSION_ENTER * rest)


@ti.func
def turn_onto_axis(x, y, z, length):
    """Quaternion (w, 0, y, z) that turns the offset (x, y, z) onto +x."""
    inverse = 1.0 / length
    w = ti.sqrt(larger(0.5 * (1.0 + x * inverse), 1e-12))
    k = 0.5 * inverse / w
    slope_y = y / x
    slope_z = z / x
    straight = (absolute(slope_y) < STRAIGHT) & (absolute(slope_z) < STRAIGHT)
    sy = 0.5 * slope_z
    sz = -0.5 * slope_y
    return (
        ti.select(straight, 1.0 - 0.5 * (sy * sy + sz * sz), w),
        ti.select(straight, sy, z * k),
        ti.select(straight, sz, 0.0 - y * k),
    )


@ti.func
def end_forces(
    edge, k, damping, pull, twist, hx, dy, dz, hy, hz, t1y, t1z, t2y, t2z, h1y, h1z, h2y, h2z, bent: ti.template()
):
    """Force F on the "-" end, its moment M, and the moment N that the "+" end gives up: (F, M, N), link frame.

    The stiffnesses of a square beam of length and width h are b1 = k, b2 = k h/2, b3 = k h^2/6 with k = E h, and the
    damping roots have the same proportions: B1 = s, B2 = s h/2, B3 = s h^2/6 with s = sqrt(E h). So strains and their
    half changes (h...) are joined first, with the weights k and g s (half of it for moments), and bent once.

    With bent = False the rotation t1 is zero and not read.
    """
    arm = 0.5 * edge
    ty = t2y
    tz = t2z
    gy = h2y
    gz = h2z
    if ti.static(bent):
        ty = t1y + ty
        tz = t1z + tz
        gy = h1y + gy
        gz = h1z + gz
    fx = pull + damping * hx
    fy = (k * dy + damping * hy) - arm * (k * tz + damping * gz)
    fz = (k * dz + damping * hz) + arm * (k * ty + damping * gy)
    half = 0.5 * damping
    lever = (1 / 6) * edge * edge
    sy = arm * (k * dz + half * hz)
    sz = arm * (k * dy + half * hy)
    uy = lever * (k * t2y + half * h2y)
    uz = lever * (k * t2z + half * h2z)
    vy = uy + uy
    vz = uz + uz
    if ti.static(bent):
        wy = lever * (k * t1y + half * h1y)
        wz = lever * (k * t1z + half * h1z)
        uy = 2.0 * wy + uy
        uz = 2.0 * wz + uz
        vy = wy + vy
        vz = wz + vz
    return fx, fy, fz, twist, 0.0 - (sy + uy), sz - uz, twist, sy + vy, vz - sz
