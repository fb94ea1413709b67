"""Stage of a link: the beam between two voxels, from their poses to the forces on both."""

from taichi_sim.autodiff.lanes import all_lanes, load, load_all, store
from taichi_sim.autodiff.rotations import apply, matrix
from taichi_sim.autodiff.tracing import select
from taichi_sim.lattice.laws import link as beams
from taichi_sim.lattice.materials import AXIAL, DAMP_MINUS, DAMP_PLUS, STIFF, TRANSVERSE, TWIST, TWIST_ROOT
from taichi_sim.lattice.stages.columns import (
    GAUGE,
    LINK_ALONG,
    LINK_BEAM,
    LINK_COLUMNS,
    LINK_FIRST,
    LINK_MINUS,
    LINK_PLUS,
    LINK_REST,
    LINK_SECOND,
    LINK_SIDE_1,
    LINK_SIDE_2,
    LINK_SYMMETRIC,
    VOXEL_COLUMNS,
)
from taichi_sim.lattice.stages.memory import (
    BEAM,
    DIVERGED,
    LINK,
    LINK_WIDTH,
    MONITOR,
    ORIENTATION,
    POISSON_ON,
    REGIME,
    REST,
    STRAIN,
    VOXEL,
)
from taichi_sim.runtime import ti


@ti.func
def pose_slots(base, l, plan: ti.template(), link_table: ti.template()):
    """Slots of the positions and orientations of a link's two voxels, components along its axis first."""
    row = l * LINK_COLUMNS
    p1 = base + plan[VOXEL] + link_table[row + LINK_MINUS]
    p2 = base + plan[VOXEL] + link_table[row + LINK_PLUS]
    a = link_table[row + LINK_ALONG]
    b = link_table[row + LINK_SIDE_1]
    c = link_table[row + LINK_SIDE_2]
    q1, q2 = p1 + ORIENTATION, p2 + ORIENTATION
    return (
        p1 + a,
        p1 + b,
        p1 + c,
        q1,
        q1 + 1 + a,
        q1 + 1 + b,
        q1 + 1 + c,
        p2 + a,
        p2 + b,
        p2 + c,
        q2,
        q2 + 1 + a,
        q2 + 1 + b,
        q2 + 1 + c,
    )


@ti.func
def is_straight(before, x, y, z, rest):
    """In which lanes a link is and was in the small-angle regime."""
    return beams.stays_small(x, y, z, rest) & (before == beams.SMALL)


@ti.func
def stays_straight(before, x, y, z, rest):
    """Whether it is so in every lane: most links of a healthy robot."""
    return all_lanes(is_straight(before, x, y, z, rest))


@ti.func
def link_stage(
    m: ti.template(),
    k,
    l,
    edge,
    plan: ti.template(),
    link_table: ti.template(),
    voxel_table: ti.template(),
    fluid: ti.template(),
):
    """What link l adds to its "-" voxel, force F and moment M, and takes from its "+" voxel, G and N: (F, M, G, N).

    World frame, components along the link's axis first.
    """
    x1, y1, z1, w, qa, qb, qc, x2, y2, z2, w2, a2, b2, c2 = load_all(m, k, pose_slots(0, l, plan, link_table))
    x, y, z, qw, qx, qy, qz = beams.relative_pose(x1, y1, z1, w, qa, qb, qc, x2, y2, z2, w2, a2, b2, c2)
    fx, fy, fz, mx, my, mz, gx, gy, gz, nx, ny, nz = bend(
        m, k, l, edge, plan, link_table, voxel_table, x, y, z, qw, qx, qy, qz
    )
    xx, xy, xz, yx, yy, yz, zx, zy, zz = matrix(w, qa, qb, qc)
    fx, fy, fz = apply(xx, xy, xz, yx, yy, yz, zx, zy, zz, fx, fy, fz)
    mx, my, mz = apply(xx, xy, xz, yx, yy, yz, zx, zy, zz, mx, my, mz)
    nx, ny, nz = apply(xx, xy, xz, yx, yy, yz, zx, zy, zz, nx, ny, nz)
    if link_table[l * LINK_COLUMNS + LINK_SYMMETRIC] != 0:
        gx, gy, gz = fx, fy, fz
    else:
        gx, gy, gz = apply(xx, xy, xz, yx, yy, yz, zx, zy, zz, gx, gy, gz)
    if ti.static(fluid):  # nothing else holds a floating body; on the ground all is as published
        fx, fy, fz, mx, my, mz, gx, gy, gz, nx, ny, nz = beams.balanced(
            x2 - x1, y2 - y1, z2 - z1, fx, fy, fz, mx, my, mz, gx, gy, gz, nx, ny, nz
        )
    return fx, fy, fz, mx, my, mz, gx, gy, gz, nx, ny, nz


@ti.func
def bend(
    m: ti.template(),
    k,
    l,
    edge,
    plan: ti.template(),
    link_table: ti.template(),
    voxel_table: ti.template(),
    x,
    y,
    z,
    qw,
    qx,
    qy,
    qz,
):
    """The beam to a voxel at (x, y, z) with orientation q, all in the frame of the "-" voxel: (F, M, G, N)."""
    memory = plan[LINK] + l * LINK_WIDTH
    beam = plan[BEAM] + link_table[l * LINK_COLUMNS + LINK_BEAM]
    rest = load(m, k, plan[REST] + link_table[l * LINK_COLUMNS + LINK_REST])
    before = load(m, k, memory + REGIME)
    fx, fy, fz, mx, my, mz, gx, gy, gz, nx, ny, nz = x, x, x, x, x, x, x, x, x, x, x, x
    if stays_straight(before, x, y, z, rest):
        d0, d1, d2, d3, d4, d5 = beams.straight_strains(x, y, z, qw, qx, qy, qz, rest)
        h0, h1, h2, h3, h4, h5 = remember(m, k, memory, 0.5, d0, d1, d2, d3, d4, d5)
        pull = axial_force(m, k, l, d0, plan, link_table, voxel_table)
        fx, fy, fz, mx, my, mz, gx, gy, gz, nx, ny, nz = beams.end_forces(
            edge,
            load(m, k, beam + STIFF),
            load(m, k, beam + DAMP_MINUS),
            load(m, k, beam + DAMP_PLUS),
            pull,
            load(m, k, beam + TWIST) * d3,
            0.5 * load(m, k, beam + TWIST_ROOT) * h3,
            h0,
            d1,
            d2,
            h1,
            h2,
            0.0,
            0.0,
            d4,
            d5,
            0.0,
            0.0,
            h4,
            h5,
            False,
        )
    else:
        d0, d1, d2, d3, d4, d5, small, w, by, bz = beams.turned_strains(x, y, z, qw, qx, qy, qz, rest, before)
        # A switch of regime invalidates the memory: no damping in this step.
        half = select(before == small, 0.5 + 0.0 * x, 0.0)
        h0, h1, h2, h3, h4, h5 = remember(m, k, memory, half, d0, d1, d2, d3, d4, d5)
        store(m, k, memory + REGIME, small)
        pull = axial_force(m, k, l, d0, plan, link_table, voxel_table)
        fx, fy, fz, mx, my, mz, gx, gy, gz, nx, ny, nz = beams.turned_forces(
            edge,
            load(m, k, beam + STIFF),
            load(m, k, beam + DAMP_MINUS),
            load(m, k, beam + DAMP_PLUS),
            pull,
            load(m, k, beam + TWIST) * d3,
            0.5 * load(m, k, beam + TWIST_ROOT) * h3,
            small,
            w,
            by,
            bz,
            d1,
            d2,
            d4,
            d5,
            h0,
            h1,
            h2,
            h4,
            h5,
        )
    return fx, fy, fz, mx, my, mz, gx, gy, gz, nx, ny, nz


@ti.func
def remember(m: ti.template(), k, memory, half, d0, d1, d2, d3, d4, d5):
    """Half the change of a link's offset and rotations since the last step, and their new memory."""
    h0 = half * (d0 - load(m, k, memory))
    h1 = half * (d1 - load(m, k, memory + 1))
    h2 = half * (d2 - load(m, k, memory + 2))
    h3 = half * (d3 - load(m, k, memory + 3))
    h4 = half * (d4 - load(m, k, memory + 4))
    h5 = half * (d5 - load(m, k, memory + 5))
    store(m, k, memory, d0)
    store(m, k, memory + 1, d1)
    store(m, k, memory + 2, d2)
    store(m, k, memory + 3, d3)
    store(m, k, memory + 4, d4)
    store(m, k, memory + 5, d5)
    return h0, h1, h2, h3, h4, h5


@ti.func
def axial_force(
    m: ti.template(), k, l, extension, plan: ti.template(), link_table: ti.template(), voxel_table: ti.template()
):
    """Stress times cross-section of a link [N]; an absurd strain marks the robot as diverged."""
    row = l * LINK_COLUMNS
    strain = extension * load(m, k, plan[REST] + link_table[row + LINK_REST] + 1)
    if not all_lanes(strain <= beams.DIVERGED_STRAIN):
        seen = load(m, k, plan[MONITOR] + DIVERGED)
        store(m, k, plan[MONITOR] + DIVERGED, select(strain <= beams.DIVERGED_STRAIN, seen, 1.0))
    beam = plan[BEAM] + link_table[row + LINK_BEAM]
    force = load(m, k, beam + AXIAL) * strain
    if plan[POISSON_ON] != 0:
        e1, e2, f1, f2 = transverse_slots(0, l, plan, link_table, voxel_table)
        squeeze, area = beams.cross_section(load(m, k, e1), load(m, k, e2), load(m, k, f1), load(m, k, f2))
        force = (force + load(m, k, beam + TRANSVERSE) * squeeze) * area
    return force


@ti.func
def transverse_slots(base, l, plan: ti.template(), link_table: ti.template(), voxel_table: ti.template()):
    """Slots of the two transverse strains of either voxel of a link."""
    row = l * LINK_COLUMNS
    s1 = base + plan[STRAIN] + voxel_table[link_table[row + LINK_FIRST] * VOXEL_COLUMNS + GAUGE] + 3
    s2 = base + plan[STRAIN] + voxel_table[link_table[row + LINK_SECOND] * VOXEL_COLUMNS + GAUGE] + 3
    b = link_table[row + LINK_SIDE_1]
    c = link_table[row + LINK_SIDE_2]
    return s1 + b, s1 + c, s2 + b, s2 + c
