"""Reverse of the stage of a link: from the cotangents of its forces and new memory to those of what they came from.

``m`` holds the step's parameters, ``rec`` the recorded states (``base`` shifts to the one before the step), ``a`` the
cotangents, laid out as a robot's memory: those of the state, and sums over time of those of the constants.
"""

from taichi_sim.autodiff.lanes import accumulate_all, all_lanes, load, load_all, select_all, store_all
from taichi_sim.autodiff.rotations import apply, matrix
from taichi_sim.autodiff.tracing import law, pull_back, select
from taichi_sim.lattice.laws import link as beams
from taichi_sim.lattice.materials import AXIAL, DAMP_MINUS, DAMP_PLUS, STIFF, TRANSVERSE, TWIST, TWIST_ROOT
from taichi_sim.lattice.stages.columns import (
    LINK_ALONG,
    LINK_BEAM,
    LINK_COLUMNS,
    LINK_FIRST,
    LINK_REST,
    LINK_SECOND,
    LINK_SIDE_1,
    LINK_SIDE_2,
)
from taichi_sim.lattice.stages.link import is_straight, pose_slots, transverse_slots
from taichi_sim.lattice.stages.memory import BEAM, FORCE, LINK, LINK_WIDTH, POISSON_ON, REGIME, REST
from taichi_sim.runtime import ti


@law
def straight_link(
    x1,
    y1,
    z1,
    w1,
    a1,
    b1,
    c1,
    x2,
    y2,
    z2,
    w2,
    a2,
    b2,
    c2,
    m0,
    m1,
    m2,
    m3,
    m4,
    m5,
    rest,
    inverse_rest,
    axial,
    transverse,
    stiff,
    minus,
    plus,
    twist,
    twist_root,
    squeeze,
    area,
    edge,
    fluid: ti.template(),
):
    """What the stage computes, as one law, for a link that is and was in the small-angle regime."""
    x, y, z, qw, qx, qy, qz = beams.relative_pose(x1, y1, z1, w1, a1, b1, c1, x2, y2, z2, w2, a2, b2, c2)
    d0, d1, d2, d3, d4, d5 = beams.straight_strains(x, y, z, qw, qx, qy, qz, rest)
    pull = (axial * (d0 * inverse_rest) + transverse * squeeze) * area
    turning = 0.5 * twist_root * (0.5 * (d3 - m3))
    forces = beams.end_forces(
        edge,
        stiff,
        minus,
        plus,
        pull,
        twist * d3,
        turning,
        0.5 * (d0 - m0),
        d1,
        d2,
        0.5 * (d1 - m1),
        0.5 * (d2 - m2),
        0.0,
        0.0,
        d4,
        d5,
        0.0,
        0.0,
        0.5 * (d4 - m4),
        0.5 * (d5 - m5),
        False,
    )
    ends = to_world(w1, a1, b1, c1, x2 - x1, y2 - y1, z2 - z1, fluid, *forces)
    return ends + (d0, d1, d2, d3, d4, d5)


@law
def turned_link(
    x1,
    y1,
    z1,
    w1,
    a1,
    b1,
    c1,
    x2,
    y2,
    z2,
    w2,
    a2,
    b2,
    c2,
    m0,
    m1,
    m2,
    m3,
    m4,
    m5,
    rest,
    inverse_rest,
    axial,
    transverse,
    stiff,
    minus,
    plus,
    twist,
    twist_root,
    squeeze,
    area,
    edge,
    before,
    fluid: ti.template(),
):
    """The same for a link of any regime; ``before`` is its last one."""
    x, y, z, qw, qx, qy, qz = beams.relative_pose(x1, y1, z1, w1, a1, b1, c1, x2, y2, z2, w2, a2, b2, c2)
    d0, d1, d2, d3, d4, d5, small, w, by, bz = beams.turned_strains(x, y, z, qw, qx, qy, qz, rest, before)
    pull = (axial * (d0 * inverse_rest) + transverse * squeeze) * area
    half = select(before == small, 0.5 + 0.0 * before, 0.0)
    turning = 0.5 * twist_root * (half * (d3 - m3))
    forces = beams.turned_forces(
        edge,
        stiff,
        minus,
        plus,
        pull,
        twist * d3,
        turning,
        small,
        w,
        by,
        bz,
        d1,
        d2,
        d4,
        d5,
        half * (d0 - m0),
        half * (d1 - m1),
        half * (d2 - m2),
        half * (d4 - m4),
        half * (d5 - m5),
    )
    ends = to_world(w1, a1, b1, c1, x2 - x1, y2 - y1, z2 - z1, fluid, *forces)
    return ends + (d0, d1, d2, d3, d4, d5)


@law
def to_world(w, a, b, c, dx, dy, dz, fluid: ti.template(), fx, fy, fz, mx, my, mz, gx, gy, gz, nx, ny, nz):
    """F, M, G and N turned from the frame of the "-" voxel; in a fluid balanced, the other end being d away."""
    xx, xy, xz, yx, yy, yz, zx, zy, zz = matrix(w, a, b, c)
    fx, fy, fz = apply(xx, xy, xz, yx, yy, yz, zx, zy, zz, fx, fy, fz)
    mx, my, mz = apply(xx, xy, xz, yx, yy, yz, zx, zy, zz, mx, my, mz)
    gx, gy, gz = apply(xx, xy, xz, yx, yy, yz, zx, zy, zz, gx, gy, gz)
    nx, ny, nz = apply(xx, xy, xz, yx, yy, yz, zx, zy, zz, nx, ny, nz)
    if ti.static(fluid):
        fx, fy, fz, mx, my, mz, gx, gy, gz, nx, ny, nz = beams.balanced(
            dx, dy, dz, fx, fy, fz, mx, my, mz, gx, gy, gz, nx, ny, nz
        )
    return fx, fy, fz, mx, my, mz, gx, gy, gz, nx, ny, nz


@ti.func
def force_seeds(a: ti.template(), k, l, plan: ti.template(), link_table: ti.template()):
    """Cotangents of (F, M, G, N): the "-" voxel gains F and M, the "+" voxel loses G and N."""
    row = l * LINK_COLUMNS
    f1 = plan[FORCE] + 6 * link_table[row + LINK_FIRST]
    f2 = plan[FORCE] + 6 * link_table[row + LINK_SECOND]
    u = link_table[row + LINK_ALONG]
    v = link_table[row + LINK_SIDE_1]
    w = link_table[row + LINK_SIDE_2]
    return (
        load(a, k, f1 + u),
        load(a, k, f1 + v),
        load(a, k, f1 + w),
        load(a, k, f1 + 3 + u),
        load(a, k, f1 + 3 + v),
        load(a, k, f1 + 3 + w),
        0.0 - load(a, k, f2 + u),
        0.0 - load(a, k, f2 + v),
        0.0 - load(a, k, f2 + w),
        0.0 - load(a, k, f2 + 3 + u),
        0.0 - load(a, k, f2 + 3 + v),
        0.0 - load(a, k, f2 + 3 + w),
    )


@ti.func
def memory_slots(base, l, plan: ti.template()):
    """Slots of what a link remembers of the last step."""
    slot = base + plan[LINK] + l * LINK_WIDTH
    return slot, slot + 1, slot + 2, slot + 3, slot + 4, slot + 5


@ti.func
def constant_slots(l, plan: ti.template(), link_table: ti.template()):
    """Slots of a link's rest length and its inverse, and of the constants of its beam."""
    rest = plan[REST] + link_table[l * LINK_COLUMNS + LINK_REST]
    beam = plan[BEAM] + link_table[l * LINK_COLUMNS + LINK_BEAM]
    return (
        rest,
        rest + 1,
        beam + AXIAL,
        beam + TRANSVERSE,
        beam + STIFF,
        beam + DAMP_MINUS,
        beam + DAMP_PLUS,
        beam + TWIST,
        beam + TWIST_ROOT,
    )


@ti.func
def link_adjoint(
    m: ti.template(),
    k,
    rec: ti.template(),
    kr,
    base,
    a: ti.template(),
    l,
    edge,
    plan: ti.template(),
    link_table: ti.template(),
    voxel_table: ti.template(),
    fluid: ti.template(),
):
    """Reverse link l: reads the cotangents of its voxels' forces (FORCE) and of its new memory (LINK)."""
    poses = load_all(rec, kr, pose_slots(base, l, plan, link_table))
    memory = load_all(rec, kr, memory_slots(base, l, plan))
    constants = load_all(m, k, constant_slots(l, plan, link_table))
    seeds = force_seeds(a, k, l, plan, link_table) + load_all(a, k, memory_slots(0, l, plan))
    squeeze = 0.0 * constants[0]
    area = 1.0 + squeeze
    if plan[POISSON_ON] != 0:
        strains = load_all(rec, kr, transverse_slots(base, l, plan, link_table, voxel_table))
        squeeze, area = beams.cross_section(strains[0], strains[1], strains[2], strains[3])
    inputs = poses + memory + constants + (squeeze, area)
    before = load(rec, kr, base + plan[LINK] + l * LINK_WIDTH + REGIME)
    x, y, z, _, _, _, _ = relative_pose_of(poses)
    straight = is_straight(before, x, y, z, constants[0])
    g = ti.static(pull_back(straight_link, inputs, (edge, fluid), seeds))
    if all_lanes(straight):
        give(a, k, rec, kr, base, l, plan, link_table, voxel_table, g)
    else:  # the laws agree on straight links, but their reverses add in other orders: each lane must have its own
        t = ti.static(pull_back(turned_link, inputs, (edge, before, fluid), seeds))
        give(a, k, rec, kr, base, l, plan, link_table, voxel_table, select_all(straight, g, t))


@ti.func
def relative_pose_of(p: ti.template()):
    """:func:`beams.relative_pose` of the poses in a tuple."""
    return beams.relative_pose(p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], p[8], p[9], p[10], p[11], p[12], p[13])


@ti.func
def give(
    a: ti.template(),
    k,
    rec: ti.template(),
    kr,
    base,
    l,
    plan: ti.template(),
    link_table: ti.template(),
    voxel_table: ti.template(),
    cotangents: ti.template(),
):
    """Add the cotangents of a link's inputs to those of state and constants."""
    accumulate_all(a, k, pose_slots(0, l, plan, link_table), cotangents[:14])
    store_all(a, k, memory_slots(0, l, plan), cotangents[14:20])  # those of the new memory have been taken
    accumulate_all(a, k, constant_slots(l, plan, link_table), cotangents[20:29])
    if plan[POISSON_ON] != 0:
        strains = load_all(rec, kr, transverse_slots(base, l, plan, link_table, voxel_table))
        accumulate_all(
            a,
            k,
            transverse_slots(0, l, plan, link_table, voxel_table),
            ti.static(pull_back(beams.cross_section, strains, (), cotangents[29:])),
        )
