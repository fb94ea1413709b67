"""The stages of one time step: load reals, apply a law, store. Both drivers run exactly these.

``m`` is the memory of all robots and k a robot's or block's key to it (see ``lanes.load``); ``plan`` says where the
sections lie (see ``memory``). The integer tables are shared by all robots; they hold slots relative to a section.
"""

from taichi_sim.lanes import all_lanes, any_lane, larger, load, store
from taichi_sim.lattice import beams, contact, floor, motion
from taichi_sim.lattice.materials import (
    AXIAL, BEAM_COLUMNS, CONSTANT_COLUMNS, CONTACT_DAMPING, CRITICAL_ROTATION, CRITICAL_TRANSLATION, DAMP_MINUS,
    DAMP_PLUS, EXPANSION, INVERSE_INERTIA, INVERSE_MASS, MASS, NU, SHARE_MINUS, SHARE_PLUS, STIFF, STIFFNESS, TRANSVERSE,
    TWIST, TWIST_ROOT,
)  # fmt: skip
from taichi_sim.lattice.memory import (
    AGE, BASE, BEAM, CHANNEL, CHANNEL_WIDTH, CONSTANT, CURRENT, CURRENT_WIDTH, DIVERGED, DRAG, FLOOR_ON, GROUPS,
    LINK, LINK_WIDTH, MEAN_SIZE, MOMENTUM, MONITOR, ORIENTATION, POISSON_ON, PUSH, RATE, REGIME, REST, REST_WIDTH, RESTS,
    SIZE, SPIN, SPIN_DRAG, STICKS, STRAIN, STRAIN_WIDTH, VALUE, VOXEL, VOXEL_WIDTH, WATCH,
)  # fmt: skip
from taichi_sim.lattice.program import QUANTITY_COUNT, Quantity
from taichi_sim.rotations import (
    apply,
    from_large_rotation_vector,
    matrix,
    multiply,
    multiply_conjugate,
    rotate,
    rotate_back,
    rotation_vector_factor,
    to_rotation_vector,
)
from taichi_sim.runtime import ti

# Columns of the table of links: slots of the two voxels in VOXEL, of the beam in BEAM and of the rest length in REST;
# the components along and across the link's axis; whether both ends are damped alike; numbers of the two voxels.
(LINK_MINUS, LINK_PLUS, LINK_BEAM, LINK_REST, LINK_ALONG, LINK_SIDE_1, LINK_SIDE_2, LINK_SYMMETRIC, LINK_FIRST,
 LINK_SECOND) = range(10)  # fmt: skip
LINK_COLUMNS = 10

# Columns of the table of voxels: slots of the group in CONSTANT/CURRENT (both 9 wide) and of its channels; the surface
# slot and the gauge's slot in STRAIN (-1 without); bits of fixed degrees of freedom; the voxel's own links; the link
# on each side (-1 without); sum of the normals of pressurised faces, and whether there are any.
(GROUP, CHANNELS, SURFACE_SLOT, GAUGE, FIXED, FIRST_LINK, END_LINK, SIDE_LINK) = range(8)
NORMAL, FEELS_PRESSURE = 13, 16
VOXEL_COLUMNS = 17
REST_MINUS, REST_PLUS, REST_AXIS = range(3)

# Columns of the table of surface voxels: slots of the voxel in VOXEL and of its group in CONSTANT/CURRENT.
SURFACE_VOXEL, SURFACE_GROUP = range(2)
SURFACE_COLUMNS = 2

CHANNELS_PER_GROUP = QUANTITY_COUNT * CHANNEL_WIDTH
ACCELERATION, FORCE, MOMENT = int(Quantity.ACCELERATION), int(Quantity.FORCE), int(Quantity.MOMENT)
TRANSLATION, ROTATION, SCALE = int(Quantity.TRANSLATION), int(Quantity.ROTATION), int(Quantity.SCALE)
TEMPERATURE, PRESSURE, GLOBAL_DAMPING = int(Quantity.TEMPERATURE), int(Quantity.PRESSURE), int(Quantity.GLOBAL_DAMPING)
STATIC_FRICTION, KINETIC_FRICTION = int(Quantity.STATIC_FRICTION), int(Quantity.KINETIC_FRICTION)


@ti.func
def channel_value(m: ti.template(), k, channels, quantity):
    """Value in this step of one of the channels that begin at a slot."""
    return load(m, k, channels + quantity * CHANNEL_WIDTH + VALUE)


@ti.func
def advance_channels(m: ti.template(), k, plan: ti.template(), edge, gravity):
    """Evaluate every channel for this step and what follows from it: sizes, external force and damping of the groups."""
    channel = plan[CHANNEL]
    for i in range(plan[GROUPS] * QUANTITY_COUNT):
        slot = channel + i * CHANNEL_WIDTH
        age = load(m, k, slot + AGE)
        store(m, k, slot + VALUE, load(m, k, slot + BASE) + load(m, k, slot + RATE) * age)
        store(m, k, slot + AGE, age + 1.0)
    for g in range(plan[GROUPS]):
        channels = channel + g * CHANNELS_PER_GROUP
        constant = plan[CONSTANT] + g * CONSTANT_COLUMNS
        current = plan[CURRENT] + g * CURRENT_WIDTH
        warmth = 1.0 + load(m, k, constant + EXPANSION) * channel_value(m, k, channels, TEMPERATURE)
        total = 0.0 * warmth
        for a in ti.static(range(3)):
            scale = channel_value(m, k, channels, SCALE + a) * warmth
            store(m, k, current + SIZE + a, edge * scale)
            total = total + scale
        # Exactly h for unit scales: a voxel that starts on the floor must touch it, or it would not stick.
        store(m, k, current + MEAN_SIZE, edge * (total / 3.0))
        mass = load(m, k, constant + MASS)
        for a in ti.static(range(3)):
            pull = channel_value(m, k, channels, ACCELERATION + a)
            if ti.static(a == 2):
                pull = pull - gravity
            store(m, k, current + PUSH + a, mass * pull + channel_value(m, k, channels, FORCE + a))
        zeta = channel_value(m, k, channels, GLOBAL_DAMPING)
        store(m, k, current + DRAG, zeta * load(m, k, constant + CRITICAL_TRANSLATION))
        store(m, k, current + SPIN_DRAG, zeta * load(m, k, constant + CRITICAL_ROTATION))


@ti.func
def update_rest_lengths(m: ti.template(), k, plan: ti.template(), rest_table: ti.template()):
    """L0 = (r- + r+)/2 for every pair of groups that a link joins."""
    for r in range(plan[RESTS]):
        side = plan[CURRENT] + SIZE + rest_table[r, REST_AXIS]
        minus = load(m, k, side + rest_table[r, REST_MINUS] * CURRENT_WIDTH)
        plus = load(m, k, side + rest_table[r, REST_PLUS] * CURRENT_WIDTH)
        length = 0.5 * (minus + plus)
        store(m, k, plan[REST] + r * REST_WIDTH, length)
        store(m, k, plan[REST] + r * REST_WIDTH + 1, 1.0 / length)


@ti.func
def link_stage(m: ti.template(), k, l, edge, plan: ti.template(), link_table: ti.template(), voxel_table: ti.template()):
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
    """The beam between voxels of relative position (x, y, z) and orientation q, frame of the "-" voxel: (F, M, G, N)."""
    memory = plan[LINK] + l * LINK_WIDTH
    rest = load(m, k, plan[REST] + link_table[l * LINK_COLUMNS + LINK_REST])
    before = load(m, k, memory + REGIME)
    fx = x; fy = x; fz = x; mx = x; my = x; mz = x  # noqa: E702
    gx = x; gy = x; gz = x; nx = x; ny = x; nz = x  # noqa: E702
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
def axial_force(m: ti.template(), k, l, extension, plan: ti.template(), link_table: ti.template(), voxel_table: ti.template()):
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


@ti.func
def surface_place(m: ti.template(), k, s, plan: ti.template(), surface: ti.template()):
    """Position and mean size of a surface voxel."""
    voxel = plan[VOXEL] + surface[SURFACE_COLUMNS * s + SURFACE_VOXEL]
    size = load(m, k, plan[CURRENT] + surface[SURFACE_COLUMNS * s + SURFACE_GROUP] + MEAN_SIZE)
    return load(m, k, voxel), load(m, k, voxel + 1), load(m, k, voxel + 2), size


@ti.func
def contact_force(m: ti.template(), k, s1, s2, dx, dy, dz, limit, near: ti.template(), plan: ti.template(), surface: ti.template()):
    """Force on the second of two surface voxels that touch where ``near``; the first feels the opposite."""
    p1 = plan[VOXEL] + surface[SURFACE_COLUMNS * s1 + SURFACE_VOXEL] + MOMENTUM
    p2 = plan[VOXEL] + surface[SURFACE_COLUMNS * s2 + SURFACE_VOXEL] + MOMENTUM
    c1 = plan[CONSTANT] + surface[SURFACE_COLUMNS * s1 + SURFACE_GROUP]
    c2 = plan[CONSTANT] + surface[SURFACE_COLUMNS * s2 + SURFACE_GROUP]
    w1 = load(m, k, c1 + INVERSE_MASS)
    w2 = load(m, k, c2 + INVERSE_MASS)
    distance = ti.sqrt(dx * dx + dy * dy + dz * dz)
    inverse = 1.0 / larger(distance, 1e-12)
    approach = (
        (w1 * load(m, k, p1) - w2 * load(m, k, p2)) * dx
        + (w1 * load(m, k, p1 + 1) - w2 * load(m, k, p2 + 1)) * dy
        + (w1 * load(m, k, p1 + 2) - w2 * load(m, k, p2 + 2)) * dz
    ) * inverse
    force = contact.repulsion(
        limit - distance, approach, load(m, k, c1 + STIFFNESS), load(m, k, c2 + STIFFNESS),
        load(m, k, c1 + CONTACT_DAMPING), load(m, k, c2 + CONTACT_DAMPING),
    )  # fmt: skip
    scale = ti.select(near, force * inverse, 0.0)
    return scale * dx, scale * dy, scale * dz


@ti.func
def voxel_stage(
    m: ti.template(), k, v, dt, edge, fx, fy, fz, mx, my, mz, cx, cy, cz,
    plan: ti.template(), voxel_table: ti.template(), start: ti.template(),
):  # fmt: skip
    """Integrate voxel v under the forces F and moments M of its links and the contact force c, world; its new place."""
    row = v * VOXEL_COLUMNS
    voxel = plan[VOXEL] + v * VOXEL_WIDTH
    current = plan[CURRENT] + voxel_table[row + GROUP]
    constant = plan[CONSTANT] + voxel_table[row + GROUP]
    channels = plan[CHANNEL] + voxel_table[row + CHANNELS]
    qw = load(m, k, voxel + ORIENTATION)
    qx = load(m, k, voxel + ORIENTATION + 1)
    qy = load(m, k, voxel + ORIENTATION + 2)
    qz = load(m, k, voxel + ORIENTATION + 3)
    if voxel_table[row + FEELS_PRESSURE] != 0:
        ax, ay, az = pressure_force(m, k, v, plan, voxel_table)
        ax, ay, az = rotate(qw, qx, qy, qz, ax, ay, az)
        fx, fy, fz = fx + ax, fy + ay, fz + az
    inverse_mass = load(m, k, constant + INVERSE_MASS)
    drag = load(m, k, current + DRAG)
    px = load(m, k, voxel + MOMENTUM)
    py = load(m, k, voxel + MOMENTUM + 1)
    pz = load(m, k, voxel + MOMENTUM + 2)
    vx = px * inverse_mass
    vy = py * inverse_mass
    vz = pz * inverse_mass
    fx = fx + load(m, k, current + PUSH) - drag * vx + cx
    fy = fy + load(m, k, current + PUSH + 1) - drag * vy + cy
    fz = fz + load(m, k, current + PUSH + 2) - drag * vz + cz
    step = dt * inverse_mass
    x = load(m, k, voxel)
    y = load(m, k, voxel + 1)
    z = load(m, k, voxel + 2)
    depth = floor.penetration(load(m, k, current + MEAN_SIZE), edge, z)
    stuck = 0.0 * inverse_mass
    on_floor = plan[FLOOR_ON] != 0
    if on_floor:
        on_floor = any_lane(depth >= 0.0)
    if on_floor:
        touches = depth >= 0.0
        normal = load(m, k, constant + STIFFNESS) * depth
        fz = fz + ti.select(touches, normal - load(m, k, constant + CONTACT_DAMPING) * vz, 0.0)
        sticks = load(m, k, voxel + STICKS)
        loose = floor.breaks_loose(fx, fy, channel_value(m, k, channels, STATIC_FRICTION), normal)
        rx, ry = floor.sliding_friction(vx, vy, channel_value(m, k, channels, KINETIC_FRICTION), normal)
        slides = touches & (sticks < 0.5)
        rx = ti.select(slides, rx, 0.0)
        ry = ti.select(slides, ry, 0.0)
        px = px + (fx + rx) * dt
        py = py + (fy + ry) * dt
        stuck = ti.select(loose, 0.0, sticks)
        stuck = ti.select(floor.comes_to_rest(px, py, rx, ry, px * step, py * step, inverse_mass), 1.0, stuck)
        stuck = ti.select(touches, stuck, 0.0)
        px = ti.select(stuck > 0.5, 0.0, px)
        py = ti.select(stuck > 0.5, 0.0, py)
    else:
        px = px + fx * dt
        py = py + fy * dt
    pz = pz + fz * dt
    store(m, k, voxel + STICKS, stuck)
    x = x + px * step
    y = y + py * step
    z = z + pz * step
    inverse_inertia = load(m, k, constant + INVERSE_INERTIA)
    drag = load(m, k, current + SPIN_DRAG) * inverse_inertia
    sx = load(m, k, voxel + SPIN)
    sy = load(m, k, voxel + SPIN + 1)
    sz = load(m, k, voxel + SPIN + 2)
    sx = sx + (mx + channel_value(m, k, channels, MOMENT) - sx * drag) * dt
    sy = sy + (my + channel_value(m, k, channels, MOMENT + 1) - sy * drag) * dt
    sz = sz + (mz + channel_value(m, k, channels, MOMENT + 2) - sz * drag) * dt
    qw, qx, qy, qz = motion.rotate_by_momentum(qw, qx, qy, qz, sx, sy, sz, dt * inverse_inertia)
    if voxel_table[row + FIXED] != 0:
        bits = voxel_table[row + FIXED]
        x, px = held(bits & 1, x, px, start[v, 0] + channel_value(m, k, channels, TRANSLATION))
        y, py = held(bits & 2, y, py, start[v, 1] + channel_value(m, k, channels, TRANSLATION + 1))
        z, pz = held(bits & 4, z, pz, start[v, 2] + channel_value(m, k, channels, TRANSLATION + 2))
        if bits >= 8:
            tx, ty, tz = to_rotation_vector(qw, qx, qy, qz)
            tx, sx = held(bits & 8, tx, sx, channel_value(m, k, channels, ROTATION))
            ty, sy = held(bits & 16, ty, sy, channel_value(m, k, channels, ROTATION + 1))
            tz, sz = held(bits & 32, tz, sz, channel_value(m, k, channels, ROTATION + 2))
            qw, qx, qy, qz = from_large_rotation_vector(tx, ty, tz)
    store(m, k, voxel, x)
    store(m, k, voxel + 1, y)
    store(m, k, voxel + 2, z)
    store(m, k, voxel + ORIENTATION, qw)
    store(m, k, voxel + ORIENTATION + 1, qx)
    store(m, k, voxel + ORIENTATION + 2, qy)
    store(m, k, voxel + ORIENTATION + 3, qz)
    store(m, k, voxel + MOMENTUM, px)
    store(m, k, voxel + MOMENTUM + 1, py)
    store(m, k, voxel + MOMENTUM + 2, pz)
    store(m, k, voxel + SPIN, sx)
    store(m, k, voxel + SPIN + 1, sy)
    store(m, k, voxel + SPIN + 2, sz)
    return x, y, z


@ti.func
def held(bit, value, momentum, prescribed):
    """A degree of freedom that the world holds takes its prescribed value and loses its momentum."""
    if bit != 0:
        value = prescribed
        momentum = 0.0 * prescribed
    return value, momentum


@ti.func
def squared_move(m: ti.template(), k, slot, x, y, z, plan: ti.template()):
    """Squared distance of a surface voxel from where it was when the watch list was built."""
    watch = plan[WATCH] + 3 * slot
    dx = x - load(m, k, watch)
    dy = y - load(m, k, watch + 1)
    dz = z - load(m, k, watch + 2)
    return dx * dx + dy * dy + dz * dz


@ti.func
def pressure_force(m: ti.template(), k, v, plan: ti.template(), voxel_table: ti.template()):
    """Pressure times the deformed area of the voxel's pressurised faces, in the voxel frame."""
    row = v * VOXEL_COLUMNS
    size = plan[CURRENT] + voxel_table[row + GROUP] + SIZE
    pressure = channel_value(m, k, plan[CHANNEL] + voxel_table[row + CHANNELS], PRESSURE)
    ex = load(m, k, size) * (1.0 + half_stretch(m, k, v, 0, plan, voxel_table))
    ey = load(m, k, size + 1) * (1.0 + half_stretch(m, k, v, 1, plan, voxel_table))
    ez = load(m, k, size + 2) * (1.0 + half_stretch(m, k, v, 2, plan, voxel_table))
    return (
        pressure * (ey * ez) * ti.cast(voxel_table[row + NORMAL], float),
        pressure * (ez * ex) * ti.cast(voxel_table[row + NORMAL + 1], float),
        pressure * (ex * ey) * ti.cast(voxel_table[row + NORMAL + 2], float),
    )


@ti.func
def half_stretch(m: ti.template(), k, v, axis: ti.template(), plan: ti.template(), voxel_table: ti.template()):
    """(share- + share+)/2 of the corners along an axis; a side without a link does not stretch."""
    gauge = plan[STRAIN] + voxel_table[v * VOXEL_COLUMNS + GAUGE]
    return load(m, k, gauge + axis) * (0.5 * ti.cast(link_count(v, axis, voxel_table), float))


@ti.func
def link_count(v, axis: ti.template(), voxel_table: ti.template()):
    """How many of a voxel's two sides along an axis have a link."""
    side = v * VOXEL_COLUMNS + SIDE_LINK + 2 * axis
    return ti.cast(voxel_table[side] >= 0, ti.i32) + ti.cast(voxel_table[side + 1] >= 0, ti.i32)


@ti.func
def gauge_stage(m: ti.template(), k, v, plan: ti.template(), link_table: ti.template(), voxel_table: ti.template()):
    """Strains of a voxel whose links are all done, for the next step's pressure and Poisson's effect."""
    row = v * VOXEL_COLUMNS
    gauge = plan[STRAIN] + voxel_table[row + GAUGE]
    nu = load(m, k, plan[CONSTANT] + voxel_table[row + GROUP] + NU)
    stretched = 0.0 * nu
    for axis in ti.static(range(3)):
        total = 0.0 * nu
        for side in ti.static(range(2)):
            l = voxel_table[row + SIDE_LINK + 2 * axis + side]
            if l >= 0:
                share = plan[BEAM] + link_table[l * LINK_COLUMNS + LINK_BEAM] + (SHARE_PLUS if side == 0 else SHARE_MINUS)
                rest = plan[REST] + link_table[l * LINK_COLUMNS + LINK_REST]
                strain = load(m, k, plan[LINK] + l * LINK_WIDTH) * load(m, k, rest + 1)
                total = total + strain * load(m, k, share)
        mean = total
        if link_count(v, axis, voxel_table) == 2:
            mean = 0.5 * total
        store(m, k, gauge + axis, mean)
        if plan[POISSON_ON] != 0:
            stretched = stretched + ti.select(in_tension(m, k, v, axis, plan, voxel_table), mean, 0.0)
    if plan[POISSON_ON] != 0:
        squeezed = motion.power(1.0 + stretched, 0.0 - nu) - 1.0
        for axis in ti.static(range(3)):
            pulled = in_tension(m, k, v, axis, plan, voxel_table)
            store(m, k, gauge + 3 + axis, ti.select(pulled, load(m, k, gauge + axis), squeezed))


@ti.func
def in_tension(m: ti.template(), k, v, axis: ti.template(), plan: ti.template(), voxel_table: ti.template()):
    """Two links, or one and something to pull against: a held degree of freedom or an external force."""
    row = v * VOXEL_COLUMNS
    channels = plan[CHANNEL] + voxel_table[row + CHANNELS]
    pull = channel_value(m, k, channels, FORCE + axis) + channel_value(m, k, channels, ACCELERATION + axis)
    tension = 0.0 * pull
    count = link_count(v, axis, voxel_table)
    if count == 2:
        tension = tension + 1.0
    elif count == 1:
        if voxel_table[row + FIXED] & (1 << axis) != 0:
            tension = tension + 1.0
        else:
            tension = ti.select(pull != 0.0, 1.0, tension)
    return tension > 0.5
