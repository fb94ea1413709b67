"""Uneven ground: its height, normal and friction under a place, and how forces turn into its plane and back.

Ground is given on a grid of nodes; every cell is two flat triangles. A voxel, or a ball that stands for a part of a
rigid body, touches the plane of the triangle under or over its centre, where the laws of the level floor hold. Level
ground has their very bits. As triangles are flat, forces on what sticks stay linear in what the rest does, which the
way back relies on.

The plane changes where the centre passes an edge: onto a steeper one a ball of radius r is lifted by up to
r (1/nz' - 1/nz), though a real one would have touched it before. Bodies should be small beside what the ground has.
"""

from taichi_sim.autodiff.lanes import absolute, larger, smaller
from taichi_sim.autodiff.rotations import rotate_back
from taichi_sim.autodiff.tracing import law, select, sqrt

DRAGGED = 0.37
# Tolerance at the sides of a cell [cells]: rounding may put a place just outside the cell that was found for it.
NEAR = 1e-3
FIRM = 1e30  # N/m^3: stress per depth of ground that does not yield
LEAST = 1e-36  # (N s)^2: squares of momenta below have no direction


@law
def ground(x, y, x0, y0, h, h_low, h_right, h_top, h_left, f, f_low, f_right, f_top, f_left, per_cell):
    """Height [m], unit normal (3) and factor of friction at (x, y), of the cell with its first corner at (x0, y0).

    The values of both are h at that corner; they grow by h_low along the lower side of the cell and then by h_right up
    its right side, or by h_left up its left side and then by h_top along the upper side, where the diagonal parts the
    triangles. Beyond the grid they go on as at its edge. ``per_cell`` is the inverse width of a cell [1/m].
    """
    u, v = (x - x0) * per_cell, (y - y0) * per_cell
    along, across = (u >= -NEAR) & (u <= 1.0 + NEAR), (v >= -NEAR) & (v <= 1.0 + NEAR)
    u, v = smaller(larger(u, 0.0 * u), 1.0 + 0.0 * u), smaller(larger(v, 0.0 * v), 1.0 + 0.0 * v)
    below = u >= v
    hu, hv = select(below, h_low, h_top), select(below, h_right, h_left)
    height = h + hu * u + hv * v
    friction = f + select(below, f_low, f_top) * u + select(below, f_right, f_left) * v
    rise_x, rise_y = select(along, hu * per_cell, 0.0), select(across, hv * per_cell, 0.0)
    nz = 1.0 / sqrt(1.0 + rise_x * rise_x + rise_y * rise_y)
    return height, 0.0 - rise_x * nz, 0.0 - rise_y * nz, nz, friction


@law
def penetration(mean_size, edge, z, height, nz):
    """Depth [m] of a voxel of centre height z below ground that rises by ``height`` over the floor z = -edge/2."""
    return 0.5 * mean_size - 0.5 * edge * nz - (z - height) * nz


@law
def outer_share(qw, qx, qy, qz, x, y, z, nx, ny, nz, ox, oy, oz):
    """Share of the section of a voxel of orientation q that its outer faces close off in direction (x, y, z), 0 to 1.

    n counts its outer faces along each of its own axes, o is the sum of their normals. Of every face that looks that
    way the square of its normal's component counts, 1 of one straight ahead. So a whole body has its front alone,
    however fine its voxels; faces aslant have less stress, much as in the resistive force theory of granular media (its
    generic alpha_z of a plate pushed down is 0.87 cos^2 + 0.13); and a voxel alone has as much whatever its way.
    """
    ux, uy, uz = rotate_back(qw, qx, qy, qz, x, y, z)
    along = (nx * ux + ox * absolute(ux)) * ux + (ny * uy + oy * absolute(uy)) * uy
    return 0.5 * (along + (nz * uz + oz * absolute(uz)) * uz)


@law
def leading_share(px, py, qw, qx, qy, qz, mx, my, mz, nx, ny, nz, ox, oy, oz):
    """:func:`outer_share` in the direction of a momentum p along ground of normal m; without one, 0."""
    size = sqrt(larger(px * px + py * py, LEAST + 0.0 * px))
    x, y, z = out_of_plane(px / size, py / size, 0.0 * px, mx, my, mz)
    return outer_share(qw, qx, qy, qz, x, y, z, nx, ny, nz, ox, oy, oz)


@law
def giving_way(size, depth, pressed, stiffness, yield_per_depth, outer):
    """Normal force [N] of granular ground, the most it bears, and how deep a voxel has pressed it now [m].

    Ground that is pressed bears a stress that grows in proportion to depth, ``yield_per_depth`` [N/m^3], under a voxel
    of this size; pressed harder, it gives way, and stays pressed. The stress is that on a plate that is pushed straight
    down, in the resistive force theory of granular media (Li, Zhang, Goldman, Science 339, 2013). A voxel takes its
    print along, until it leaves the ground. Only what it has of outer faces downwards bears, the share ``outer``.
    Ground of ``FIRM`` never yields, bears any voxel, and has the floor's bits.
    """
    whole = yield_per_depth * size * size * larger(depth, 0.0 * depth)
    most = select(yield_per_depth + 0.0 * outer < FIRM, outer * whole, whole)
    now = larger(pressed, depth - most / stiffness)
    return larger(stiffness * (depth - now), 0.0 * depth), most, now


@law
def granular_push(normal, most, vz, contact_damping, yield_per_depth):
    """Force along the normal [N] of ground that, if it yields, neither pulls nor bears more than ``most``."""
    damped = normal - contact_damping * vz
    bounded = smaller(larger(damped, 0.0 * damped), most)
    return select(yield_per_depth < FIRM, bounded, damped)


@law
def granular_hold(friction, size, depth, yield_per_depth, outer):
    """Most force sideways [N] of ground with so much friction under a voxel: with ploughing, if it yields.

    Ploughing takes 0.37 of the stress downwards, at the depths of the buried part of the voxel's leading side: that on
    a plate upright which is dragged flat side first (the generic coefficients C11, C01 and C-11 of Li, Zhang, Goldman,
    2013). ``outer`` is the share of that side that is an outer face: what is behind others ploughs nothing.
    """
    above = larger(depth - size, 0.0 * depth)
    ploughing = 0.5 * DRAGGED * yield_per_depth * size * outer * (depth * depth - above * above)
    return select(yield_per_depth < FIRM, friction + ploughing, friction)


@law
def slid(px, py, stuck, qx, qy, impulse, yield_per_depth):
    """Momentum sideways after a step on ground that yields, and whether the voxel sticks; as given on firm ground.

    Friction and ploughing, that take an ``impulse`` [N s] at most, work against the momentum q that the voxel would
    have without them, and never turn it round. So sticking and slipping are one continuous law, of one coefficient.
    """
    size = sqrt(larger(qx * qx + qy * qy, LEAST + 0.0 * qx))
    kept = larger(1.0 - impulse / size, 0.0 * size)
    yields = yield_per_depth + 0.0 * px < FIRM
    sticks = select(kept > 0.0, 0.0 * px, 1.0 + 0.0 * px)
    return select(yields, kept * qx, px), select(yields, kept * qy, py), select(yields, sticks, stuck)


@law
def without_friction(px, py, impulse):
    """Inverse of :func:`slid` on ground that yields: momentum q of which friction has left p; 0 where it left none."""
    grown = 1.0 + impulse / sqrt(larger(px * px + py * py, LEAST + 0.0 * px))
    return grown * px, grown * py


@law
def into_plane(x, y, z, nx, ny, nz):
    """Components of a vector in axes that are turned, the shortest way, so that the third is the normal n."""
    k = 1.0 / (1.0 + nz)
    a, b, c = k * nx * nx, k * nx * ny, k * ny * ny
    return (1.0 - a) * x - b * y - nx * z, (1.0 - c) * y - b * x - ny * z, nx * x + ny * y + nz * z


@law
def out_of_plane(x, y, z, nx, ny, nz):
    """Inverse of :func:`into_plane`."""
    k = 1.0 / (1.0 + nz)
    a, b, c = k * nx * nx, k * nx * ny, k * ny * ny
    return (1.0 - a) * x - b * y + nx * z, (1.0 - c) * y - b * x + ny * z, nz * z - nx * x - ny * y
