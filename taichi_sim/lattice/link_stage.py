"""Stage of a link: the beam between two voxels, from their poses to the forces on both."""

from taichi_sim.lanes import all_lanes, load, store
from taichi_sim.lattice import beams
from taichi_sim.lattice.columns import (
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
from taichi_sim.lattice.materials import AXIAL, DAMP_MINUS, DAMP_PLUS, STIFF, TRANSVERSE, TWIST, TWIST_ROOT
from taichi_sim.lattice.memory import (
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
from taichi_sim.rotations import apply, matrix, multiply, multiply_conjugate, rotate_back, rotation_vector_factor
from taichi_sim.runtime import ti


@ti.func
def link_stage(
    m: ti.template(), k, l, edge, plan: ti.template(), link_table: ti.template(), voxel_table: ti.template()
):
    """What link l adds to its "-" voxel, force F and moment M, and takes from its "+" voxel, G and N: (F, M, G, N).

    World frame, components along the link's axis first.
    """
    row = l * LINK_COLUMNS
    p1 = plan[VOXEL] + link_table[row + LINK_MINUS]
    p2 = plan[VOXEL] + link_table[row + LINK_PLUS]
    a = link_table[row + LINK_ALONG]
    b = link_table[row + LINK_SIDE_1]
    c = link_table[row + LINK_SIDE_2]
    q1, q2 = p1 + ORIENTATION + 1, p2 + ORIENTATION + 1
    w, qa, qb, qc = load(m, k, p1 + ORIENTATION), load(m, k, q1 + a), load(m, k, q1 + b), load(m, k, q1 + c)
    xx, xy, xz, yx, yy, yz, zx, zy, zz = matrix(w, qa, qb, qc)
    x, y, z = apply(
        xx, yx, zx, xy, yy, zy, xz, yz, zz,  # transposed: into the frame of the "-" voxel
        load(m, k, p2 + a) - load(m, k, p1 + a),
        load(m, k, p2 + b) - load(m, k, p1 + b),
        load(m, k, p2 + c) - load(m, k, p1 + c),
    )  # fmt: skip
    qw, qx, qy, qz = multiply_conjugate(
        w, qa, qb, qc, load(m, k, p2 + ORIENTATION), load(m, k, q2 + a), load(m, k, q2 + b), load(m, k, q2 + c)
    )
    fx, fy, fz, mx, my, mz, gx, gy, gz, nx, ny, nz = bend(
        m, k, l, edge, plan, link_table, voxel_table, x, y, z, qw, qx, qy, qz
    )
    fx, fy, fz = apply(xx, xy, xz, yx, yy, yz, zx, zy, zz, fx, fy, fz)
    mx, my, mz = apply(xx, xy, xz, yx, yy, yz, zx, zy, zz, mx, my, mz)
    nx, ny, nz = apply(xx, xy, xz, yx, yy, yz, zx, zy, zz, nx, ny, nz)
    if link_table[row + LINK_SYMMETRIC] != 0:
        gx, gy, gz = fx, fy, fz
    else:
        gx, gy, gz = apply(xx, xy, xz, yx, yy, yz, zx, zy, zz, gx, gy, gz)
    return fx, fy, fz, mx, my, mz, gx, gy, gz, nx, ny, nz


@ti.func
def bend(
    m: ti.template(), k, l, edge, plan: ti.template(), link_table: ti.template(), voxel_table: ti.template(),
    x, y, z, qw, qx, qy, qz,
):  # fmt: skip
    """The beam to a voxel at (x, y, z) with orientation q, all in the frame of the "-" voxel: (F, M, G, N)."""
    memory = plan[LINK] + l * LINK_WIDTH
    rest = load(m, k, plan[REST] + link_table[l * LINK_COLUMNS + LINK_REST])
    before = load(m, k, memory + REGIME)
    fx = x
    fy = x
    fz = x
    mx = x
    my = x
    mz = x
    gx = x
    gy = x
    gz = x
    nx = x
    ny = x
    nz = x
    # Most links of a healthy robot are small and were small; a block in which all lanes agree takes the short way.
    if all_lanes(beams.stays_small(x, y, z, rest) & (before == beams.SMALL)):
        factor = rotation_vector_factor(qw)
        t2x, t2y, t2z = factor * qx, factor * qy, factor * qz
        hx, h1, h2, h3, h4, h5 = remember(m, k, memory, 0.5, x - rest, y, z, t2x, t2y, t2z)
        fx, fy, fz, mx, my, mz, gx, gy, gz, nx, ny, nz = beam_forces(
            m, k, l, edge, plan, link_table, voxel_table, x - rest, y, z, 0.0, 0.0, t2x, t2y, t2z,
            hx, h1, h2, 0.0, 0.0, h3, h4, h5, False,
        )  # fmt: skip
    else:
        stays = ti.select(beams.stays_small(x, y, z, rest), beams.SMALL + 0.0 * before, beams.LARGE)
        enters = ti.select(beams.becomes_small(x, y, z, rest), beams.SMALL + 0.0 * before, beams.LARGE)
        small = ti.select(before > 0.5, stays, enters)
        is_small = small > 0.5
        length = ti.sqrt(x * x + y * y + z * z)
        w, by, bz = beams.turn_onto_axis(x, y, z, length)
        w = ti.select(is_small, 1.0, w)
        by = ti.select(is_small, 0.0, by)
        bz = ti.select(is_small, 0.0, bz)
        qw, qx, qy, qz = multiply(w, 0.0 * w, by, bz, qw, qx, qy, qz)
        k1 = rotation_vector_factor(w)
        t1y, t1z = k1 * by, k1 * bz
        k2 = rotation_vector_factor(qw)
        t2x, t2y, t2z = k2 * qx, k2 * qy, k2 * qz
        extension = ti.select(is_small, x, length) - rest
        # A switch of regime invalidates the memory: no damping in this step.
        half = ti.select(before == small, 0.5 + 0.0 * x, 0.0)
        hx, h1, h2, h3, h4, h5 = remember(
            m, k, memory, half, extension, ti.select(is_small, y, t1y), ti.select(is_small, z, t1z), t2x, t2y, t2z
        )
        store(m, k, memory + REGIME, small)
        fx, fy, fz, mx, my, mz, gx, gy, gz, nx, ny, nz = beam_forces(
            m, k, l, edge, plan, link_table, voxel_table, extension,
            ti.select(is_small, y, 0.0), ti.select(is_small, z, 0.0), t1y, t1z, t2x, t2y, t2z,
            hx, ti.select(is_small, h1, 0.0), ti.select(is_small, h2, 0.0),
            ti.select(is_small, 0.0, h1), ti.select(is_small, 0.0, h2), h3, h4, h5, True,
        )  # fmt: skip
        fx, fy, fz = rotate_back(w, 0.0 * w, by, bz, fx, fy, fz)
        mx, my, mz = rotate_back(w, 0.0 * w, by, bz, mx, my, mz)
        gx, gy, gz = rotate_back(w, 0.0 * w, by, bz, gx, gy, gz)
        nx, ny, nz = rotate_back(w, 0.0 * w, by, bz, nx, ny, nz)
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
def beam_forces(
    m: ti.template(), k, l, edge, plan: ti.template(), link_table: ti.template(), voxel_table: ti.template(),
    dx, dy, dz, t1y, t1z, t2x, t2y, t2z, hx, hy, hz, h1y, h1z, h2x, h2y, h2z, bent: ti.template(),
):  # fmt: skip
    """(F, M, G, N) for offset d, rotations t1, t2 and their half changes h, link frame."""
    beam = plan[BEAM] + link_table[l * LINK_COLUMNS + LINK_BEAM]
    pull = axial_force(m, k, l, dx, plan, link_table, voxel_table)
    stiff = load(m, k, beam + STIFF)
    damping = load(m, k, beam + DAMP_MINUS)
    turned = load(m, k, beam + TWIST) * t2x
    turning = 0.5 * load(m, k, beam + TWIST_ROOT) * h2x
    fx, fy, fz, mx, my, mz, nx, ny, nz = beams.end_forces(
        edge, stiff, damping, pull, turned + damping * turning, hx, dy, dz, hy, hz,
        t1y, t1z, t2y, t2z, h1y, h1z, h2y, h2z, bent,
    )  # fmt: skip
    gx, gy, gz = fx, fy, fz
    if link_table[l * LINK_COLUMNS + LINK_SYMMETRIC] == 0:
        other = load(m, k, beam + DAMP_PLUS)
        gx, gy, gz, _, _, _, nx, ny, nz = beams.end_forces(
            edge, stiff, other, pull, turned + other * turning, hx, dy, dz, hy, hz,
            t1y, t1z, t2y, t2z, h1y, h1z, h2y, h2z, bent,
        )  # fmt: skip
    return fx, fy, fz, mx, my, mz, gx, gy, gz, nx, ny, nz


@ti.func
def axial_force(
    m: ti.template(), k, l, extension, plan: ti.template(), link_table: ti.template(), voxel_table: ti.template()
):
    """Stress times cross-section of a link [N]; an absurd strain marks the robot as diverged."""
    row = l * LINK_COLUMNS
    strain = extension * load(m, k, plan[REST] + link_table[row + LINK_REST] + 1)
    if not all_lanes(strain <= beams.DIVERGED_STRAIN):
        seen = load(m, k, plan[MONITOR] + DIVERGED)
        store(m, k, plan[MONITOR] + DIVERGED, ti.select(strain <= beams.DIVERGED_STRAIN, seen, 1.0))
    beam = plan[BEAM] + link_table[row + LINK_BEAM]
    force = load(m, k, beam + AXIAL) * strain
    if plan[POISSON_ON] != 0:
        squeeze, area = poisson_state(m, k, l, plan, link_table, voxel_table)
        force = (force + load(m, k, beam + TRANSVERSE) * squeeze) * area
    return force


@ti.func
def poisson_state(m: ti.template(), k, l, plan: ti.template(), link_table: ti.template(), voxel_table: ti.template()):
    """Mean transverse strain sum and mean relative cross-section of a link's two voxels, from the last step."""
    row = l * LINK_COLUMNS
    s1 = plan[STRAIN] + voxel_table[link_table[row + LINK_FIRST] * VOXEL_COLUMNS + GAUGE] + 3
    s2 = plan[STRAIN] + voxel_table[link_table[row + LINK_SECOND] * VOXEL_COLUMNS + GAUGE] + 3
    b = link_table[row + LINK_SIDE_1]
    c = link_table[row + LINK_SIDE_2]
    e1 = load(m, k, s1 + b)
    e2 = load(m, k, s1 + c)
    f1 = load(m, k, s2 + b)
    f2 = load(m, k, s2 + c)
    return 0.5 * ((e1 + e2) + (f1 + f2)), 0.5 * ((1.0 + e1) * (1.0 + e2) + (1.0 + f1) * (1.0 + f2))
