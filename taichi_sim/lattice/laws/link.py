"""The link law: forces and moments of the Euler-Bernoulli beam between two voxels.

Everything is in the link frame, whose x axis points from the "-" voxel to the "+" voxel. The beam is isotropic
across its axis, so turning the voxel frame onto the link frame is a cyclic exchange of components.

Source: Hiller & Lipson 2014 (section "Beam model"), with the angle regimes and the damping of Voxelyze.
"""

from taichi_sim.autodiff.lanes import absolute, any_lane, larger
from taichi_sim.autodiff.rotations import (
    apply,
    cross,
    matrix,
    multiply_conjugate,
    multiply_turn,
    rotation_vector_factor,
    turn_back,
)
from taichi_sim.autodiff.tracing import law, select, sqrt
from taichi_sim.runtime import ti

# States of a link; a new one is small but remembers nothing yet.
LARGE, SMALL, NEW = 0.0, 1.0, 2.0

# Hysteresis of the small-angle regime: turn = (|dy| + |dz|)/dx and extension |1 - dx/L0|.
TURN_ENTER, TURN_LEAVE = 0.05, 0.06
EXTENSION_ENTER, EXTENSION_LEAVE = 0.5, 0.6
STRAIGHT = 1.732e-2  # slopes below this use the first-order rotation onto the axis
NEARLY_STRAIGHT = 1.74e-2  # above it by more than rounding

DIVERGED_STRAIN = 100.0


@law
def stays_small(x, y, z, rest):
    """Whether a link in the small-angle regime remains there."""
    turn = absolute(y) + absolute(z)
    return (turn <= TURN_LEAVE * x) & (absolute(rest - x) <= EXTENSION_LEAVE * rest)


@law
def becomes_small(x, y, z, rest):
    """Whether a link in the large-angle regime leaves it."""
    turn = absolute(y) + absolute(z)
    return (turn < TURN_ENTER * x) & (absolute(rest - x) < EXTENSION_ENTER * rest)


@law
def turn_onto_axis(x, y, z, length, small):
    """Quaternion (w, 0, y, z) that turns the offset (x, y, z) onto +x; none where angles are small (``small`` is 1)."""
    inverse = 1.0 / length
    w = sqrt(larger(0.5 * (1.0 + x * inverse), 1e-12))
    k = 0.5 * inverse / w
    by = z * k
    bz = 0.0 - y * k
    limit = NEARLY_STRAIGHT * absolute(x)
    if any_lane((small < 0.5) & (absolute(y) < limit) & (absolute(z) < limit)):  # stretched far: rare
        slope_y = y / x
        slope_z = z / x
        straight = (absolute(slope_y) < STRAIGHT) & (absolute(slope_z) < STRAIGHT)
        sy = 0.5 * slope_z
        sz = -0.5 * slope_y
        w = select(straight, 1.0 - 0.5 * (sy * sy + sz * sz), w)
        by = select(straight, sy, by)
        bz = select(straight, sz, bz)
    is_small = small > 0.5
    return select(is_small, 1.0, w), select(is_small, 0.0, by), select(is_small, 0.0, bz)


@law
def end_forces(edge, stiff, minus, plus, pull, twist, turning, hx, strains, halves, alike, bent: ti.template()):
    """Force F and moment M on the "-" end; force G and moment N that the "+" end gives up; link frame.

    The stiffnesses of a square beam of length and width h are b1 = k, b2 = k h/2, b3 = k h^2/6 with k = E h, and the
    damping roots have the same proportions: B1 = s, B2 = s h/2, B3 = s h^2/6 with s = sqrt(E h). So the combinations
    of strains and those of their half changes are the same, with the weights k and g s (half of it for moments).

    Args:
        edge: of a voxel [m].
        stiff, minus, plus: k, and g s at either end.
        pull, twist, turning: axial force [N], twisting moment [N m], and half its change.
        hx: half the change of the extension.
        strains, halves: offset across the axis and rotations of both ends, (dy, dz, t1y, t1z, t2y, t2z); half their
            changes.
        alike: 1 if both ends are known to be damped alike, so that G is F; else 0.
        bent: whether the "-" end turns; else t1 is not read.
    """
    ey, ez, ay, az, by, bz = shear_and_bending(edge, *strains, bent)
    vy, vz, cy, cz, ry, rz = shear_and_bending(edge, *halves, bent)
    half_minus = 0.5 * minus
    half_plus = 0.5 * plus
    ey = stiff * ey
    ez = stiff * ez
    fx = pull + minus * hx
    fy = ey + minus * vy
    fz = ez + minus * vz
    moment = twist + minus * turning, 0.0 - (stiff * ay + half_minus * cy), stiff * az + half_minus * cz
    given_moment = twist + plus * turning, stiff * by + half_plus * ry, stiff * bz + half_plus * rz
    gx = fx
    gy = fy
    gz = fz
    if alike == 0:
        gx = pull + plus * hx
        gy = ey + plus * vy
        gz = ez + plus * vz
    return (fx, fy, fz) + moment + (gx, gy, gz) + given_moment


@law
def shear_and_bending(edge, dy, dz, t1y, t1z, t2y, t2z, bent: ti.template()):
    """Strains as the shear force and the moments at the "-" and "+" ends weight them before stiffness, y and z each."""
    arm = 0.5 * edge
    lever = (1 / 6) * edge * edge
    ty = t2y
    tz = t2z
    uy = lever * t2y
    uz = lever * t2z
    vy = uy + uy
    vz = uz + uz
    if ti.static(bent):
        ty = t1y + t2y
        tz = t1z + t2z
        wy = lever * t1y
        wz = lever * t1z
        uy = 2.0 * wy + uy
        uz = 2.0 * wz + uz
        vy = wy + vy
        vz = wz + vz
    sy = arm * dz
    sz = arm * dy
    return dy - arm * tz, dz + arm * ty, sy + uy, sz - uz, sy + vy, vz - sz


@law
def relative_pose(x1, y1, z1, w1, a1, b1, c1, x2, y2, z2, w2, a2, b2, c2):
    """Offset and orientation (w, x, y, z) of the "+" voxel in the frame of the "-" voxel."""
    xx, xy, xz, yx, yy, yz, zx, zy, zz = matrix(w1, a1, b1, c1)
    x, y, z = apply(xx, yx, zx, xy, yy, zy, xz, yz, zz, x2 - x1, y2 - y1, z2 - z1)
    qw, qx, qy, qz = multiply_conjugate(w1, a1, b1, c1, w2, a2, b2, c2)
    return x, y, z, qw, qx, qy, qz


@law
def cross_section(e1, e2, f1, f2):
    """Mean over two voxels of the sum of their transverse strains, and of the product of one plus each."""
    return 0.5 * ((e1 + e2) + (f1 + f2)), 0.5 * ((1.0 + e1) * (1.0 + e2) + (1.0 + f1) * (1.0 + f2))


@law
def straight_strains(x, y, z, qw, qx, qy, qz, rest):
    """Offset and rotation vector of a link that is and was in the small-angle regime; its next memory."""
    factor = rotation_vector_factor(qw)
    return x - rest, y, z, factor * qx, factor * qy, factor * qz


@law
def turned_strains(x, y, z, qw, qx, qy, qz, rest, before):
    """Offset and rotation vector of a link of any regime, its new regime, the rotation (w, 0, y, z) onto its axis."""
    stays = select(stays_small(x, y, z, rest), SMALL + 0.0 * before, LARGE)
    enters = select(becomes_small(x, y, z, rest), SMALL + 0.0 * before, LARGE)
    small = select(before > 0.5, stays, enters)
    is_small = small > 0.5
    length = sqrt(x * x + y * y + z * z)
    w, by, bz = turn_onto_axis(x, y, z, length, small)
    qw, qx, qy, qz = multiply_turn(w, by, bz, qw, qx, qy, qz)
    k1 = rotation_vector_factor(w)
    k2 = rotation_vector_factor(qw)
    dx = select(is_small, x, length) - rest
    return dx, select(is_small, y, k1 * by), select(is_small, z, k1 * bz), k2 * qx, k2 * qy, k2 * qz, small, w, by, bz


@law
def strain(extension, inverse_rest):
    """Extension of a link over its rest length."""
    return extension * inverse_rest


@law
def shared_strain(extension, inverse_rest, share):
    """The share in a link's strain of the voxel at one of its ends."""
    return strain(extension, inverse_rest) * share


@law
def axial_force(tension, axial, transverse, squeeze, area, poisson: ti.template()):
    """Stress times cross-section of a link [N] whose strain is ``tension``.

    Args:
        tension: strain along the link.
        axial, transverse: stiffnesses, see ``materials``.
        squeeze, area: of :func:`cross_section`.
        poisson: whether Poisson's effect adds to the force; else the last three are not read.
    """
    force = axial * tension
    if ti.static(poisson):
        force = (force + transverse * squeeze) * area
    return force


@law
def half_changes(half, d0, d1, d2, d3, d4, d5, m0, m1, m2, m3, m4, m5):
    """Half the change of a link's offset and rotation from m to d; ``half`` is 0 where the memory m is not valid."""
    return half * (d0 - m0), half * (d1 - m1), half * (d2 - m2), half * (d3 - m3), half * (d4 - m4), half * (d5 - m5)


@law
def memory_weight(before, small):
    """The factor of :func:`half_changes`: a switch of regime invalidates the memory, so there is no damping then."""
    return select(before == small, 0.5 + 0.0 * before, 0.0)


@law
def straight_forces(edge, stiff, minus, plus, twist, root, pull, d1, d2, d3, d4, d5, h0, h1, h2, h3, h4, h5, alike):
    """:func:`end_forces` of a link that is and was in the small-angle regime.

    Args:
        edge: of a voxel [m].
        stiff, minus, plus, twist, root: constants of the beam, see ``materials``.
        pull: axial force [N].
        d1, d2, d3, d4, d5: offset across the axis and rotation.
        h0, h1, h2, h3, h4, h5: half their changes, those of the extension first.
        alike: see :func:`end_forces`.
    """
    strains, halves = (d1, d2, 0.0, 0.0, d4, d5), (h1, h2, 0.0, 0.0, h4, h5)
    return end_forces(edge, stiff, minus, plus, pull, twist * d3, 0.5 * root * h3, h0, strains, halves, alike, False)


@law
def turned_forces(
    edge, stiff, minus, plus, twist, root, pull, d1, d2, d3, d4, d5, h0, h1, h2, h3, h4, h5, small, w, by, bz, alike
):
    """:func:`end_forces` of a link of any regime, turned from its axis into the frame of the "-" voxel.

    ``small``, w, by and bz are of :func:`turned_strains`, the others as in :func:`straight_forces`.
    """
    strains = beside_or_turned(small > 0.5, d1, d2) + (d4, d5)
    halves = beside_or_turned(small > 0.5, h1, h2) + (h4, h5)
    ends = end_forces(edge, stiff, minus, plus, pull, twist * d3, 0.5 * root * h3, h0, strains, halves, alike, True)
    fx, fy, fz = turn_back(w, by, bz, *ends[:3])
    mx, my, mz = turn_back(w, by, bz, *ends[3:6])
    gx, gy, gz = fx, fy, fz
    if alike == 0:
        gx, gy, gz = turn_back(w, by, bz, *ends[6:9])
    nx, ny, nz = turn_back(w, by, bz, *ends[9:])
    return fx, fy, fz, mx, my, mz, gx, gy, gz, nx, ny, nz


@law
def beside_or_turned(is_small, y, z):
    """A deviation across the axis as an offset where angles are small, else as a rotation of the "-" end."""
    return select(is_small, y, 0.0), select(is_small, z, 0.0), select(is_small, 0.0, y), select(is_small, 0.0, z)


@law
def in_world(w, x, y, z, fx, fy, fz, mx, my, mz, gx, gy, gz, nx, ny, nz, alike):
    """A link's (F, M, G, N), turned from the frame of the "-" voxel of this orientation; see :func:`end_forces`."""
    xx, xy, xz, yx, yy, yz, zx, zy, zz = matrix(w, x, y, z)
    fx, fy, fz = apply(xx, xy, xz, yx, yy, yz, zx, zy, zz, fx, fy, fz)
    mx, my, mz = apply(xx, xy, xz, yx, yy, yz, zx, zy, zz, mx, my, mz)
    hx, hy, hz = fx, fy, fz
    if alike == 0:
        hx, hy, hz = apply(xx, xy, xz, yx, yy, yz, zx, zy, zz, gx, gy, gz)
    nx, ny, nz = apply(xx, xy, xz, yx, yy, yz, zx, zy, zz, nx, ny, nz)
    return fx, fy, fz, mx, my, mz, hx, hy, hz, nx, ny, nz


@law
def balanced(rx, ry, rz, fx, fy, fz, mx, my, mz, gx, gy, gz, nx, ny, nz):
    """A link's (F, M, G, N), corrected so that they neither push nor turn its two voxels as a whole; in any one frame.

    r is the offset of the "+" voxel, on which -G and -N act. A beam without mass is in equilibrium, as in Crisfield's
    co-rotational beams (Comput. Methods Appl. Mech. Eng. 81(2), 1990): F = G, and about the "-" voxel M - N = r x G.
    The published law breaks the first where the ends are damped unlike, the second to second order in the strains: its
    levers are voxel edges, and tension has none. Each end bears half of what is missing.
    """
    fx, fy, fz = 0.5 * (fx + gx), 0.5 * (fy + gy), 0.5 * (fz + gz)
    tx, ty, tz = cross(rx, ry, rz, fx, fy, fz)
    sx, sy, sz = mx + nx, my + ny, mz + nz
    mx, my, mz = 0.5 * (sx + tx), 0.5 * (sy + ty), 0.5 * (sz + tz)
    nx, ny, nz = 0.5 * (sx - tx), 0.5 * (sy - ty), 0.5 * (sz - tz)
    return fx, fy, fz, mx, my, mz, fx, fy, fz, nx, ny, nz
