"""The stages of one time step: load reals, apply a law, store. Both drivers run exactly these.

Arrays of reals (see ``lanes.load`` for the two layouts; b is a block of lanes or one robot):

    voxel     [b, V, 14]  position 3, orientation 4, momentum 3, angular momentum 3, sticking to the floor
    link      [b, L, 7]   damping memory (offset and rotations of the last step) 6, state
    channel   [b, 23 G, 4] base, rate, age, value of every channel of every group
    current   [b, G, 9]   what follows from the channels in this step
    constant  [b, G, 9]   materials.voxel_constants of every group
    beam      [b, C, 16]  materials.beam_constants of every pair of materials
    rest      [b, R, 2]   rest length and its inverse of every pair of groups and axis
    strain    [b, N, 6]   strain per axis of gauged voxels, and with Poisson's effect
    contact   [b, S, 3]   contact force on surface voxels
    watch     [b, S, 3]   positions of surface voxels when the watch list was built
    monitor   [b, 1, 2]   largest squared distance from there; 1 once diverged

Groups are the regions of a body, split where a region mixes materials.
"""

from taichi_sim.lanes import all_lanes, any_lane, load, store
from taichi_sim.lattice import beams, contact, floor, motion
from taichi_sim.lattice.materials import (
    A2, AXIAL, B1, B2, B3, CONTACT_DAMPING, CRITICAL_ROTATION, CRITICAL_TRANSLATION, DAMPING_MINUS, DAMPING_PLUS,
    EXPANSION, INVERSE_INERTIA, INVERSE_MASS, MASS, NU, ROOT_A1, ROOT_A2, ROOT_B1, ROOT_B2, ROOT_B3, SHARE_MINUS,
    SHARE_PLUS, STIFFNESS, TRANSVERSE,
)  # fmt: skip
from taichi_sim.lattice.program import QUANTITY_COUNT, Quantity
from taichi_sim.rotations import (
    from_large_rotation_vector,
    multiply,
    rotate,
    rotate_back,
    rotation_vector_factor,
    to_rotation_vector,
)
from taichi_sim.runtime import ti

VOXEL_WIDTH, LINK_WIDTH, CHANNEL_WIDTH, CURRENT_WIDTH, STRAIN_WIDTH = 14, 7, 4, 9, 6
MOMENTUM, SPIN, STICKS = 7, 10, 13
LINK_STATE = 6
BASE, RATE, AGE, VALUE = range(4)
SIZE, MEAN_SIZE, WEIGHT, DRAG, SPIN_DRAG = 0, 3, 4, 7, 8  # columns of ``current``
MOVED, DIVERGED = 0, 1

# Columns of the integer tables that the robots of a batch share.
LINK_MINUS, LINK_PLUS, LINK_AXIS, LINK_BEAM, LINK_REST = range(5)
LINK_COLUMNS = 5
GROUP, SURFACE_SLOT, STRAIN_SLOT, FIXED, FIRST_LINK, END_LINK, SIDE_LINK = 0, 1, 2, 3, 4, 5, 6
NORMAL, FEELS_PRESSURE = 12, 15
VOXEL_COLUMNS = 16
REST_MINUS, REST_PLUS, REST_AXIS = range(3)

ACCELERATION, FORCE, MOMENT = int(Quantity.ACCELERATION), int(Quantity.FORCE), int(Quantity.MOMENT)
TRANSLATION, ROTATION, SCALE = int(Quantity.TRANSLATION), int(Quantity.ROTATION), int(Quantity.SCALE)
TEMPERATURE, PRESSURE, GLOBAL_DAMPING = int(Quantity.TEMPERATURE), int(Quantity.PRESSURE), int(Quantity.GLOBAL_DAMPING)
STATIC_FRICTION, KINETIC_FRICTION = int(Quantity.STATIC_FRICTION), int(Quantity.KINETIC_FRICTION)


@ti.func
def channel_value(channel: ti.template(), b, g, quantity):
    """Value of a group's channel in this step."""
    return load(channel, b, g * QUANTITY_COUNT + quantity, VALUE)


@ti.func
def advance_channels(b, group_count, edge, gravity, channel: ti.template(), constant: ti.template(), current: ti.template()):
    """Evaluate every channel for this step and what follows from it: sizes, weight and damping of the groups."""
    for i in range(group_count * QUANTITY_COUNT):
        age = load(channel, b, i, AGE)
        store(channel, b, i, VALUE, load(channel, b, i, BASE) + load(channel, b, i, RATE) * age)
        store(channel, b, i, AGE, age + 1.0)
    for g in range(group_count):
        warmth = 1.0 + load(constant, b, g, EXPANSION) * channel_value(channel, b, g, TEMPERATURE)
        total = 0.0 * warmth
        for a in ti.static(range(3)):
            scale = channel_value(channel, b, g, SCALE + a) * warmth
            store(current, b, g, SIZE + a, edge * scale)
            total = total + scale
        # Exactly h for unit scales: a voxel that starts on the floor must touch it, or it would not stick.
        store(current, b, g, MEAN_SIZE, edge * (total / 3.0))
        mass = load(constant, b, g, MASS)
        for a in ti.static(range(3)):
            pull = channel_value(channel, b, g, ACCELERATION + a)
            if ti.static(a == 2):
                pull = pull - gravity
            store(current, b, g, WEIGHT + a, mass * pull + channel_value(channel, b, g, FORCE + a))
        zeta = channel_value(channel, b, g, GLOBAL_DAMPING)
        store(current, b, g, DRAG, zeta * load(constant, b, g, CRITICAL_TRANSLATION))
        store(current, b, g, SPIN_DRAG, zeta * load(constant, b, g, CRITICAL_ROTATION))


@ti.func
def update_rest_lengths(b, rest_count, rest_table: ti.template(), current: ti.template(), rest: ti.template()):
    """L0 = (r- + r+)/2 for every pair of groups that a link joins."""
    for r in range(rest_count):
        axis = rest_table[r, REST_AXIS]
        size_minus = load(current, b, rest_table[r, REST_MINUS], SIZE + axis)
        length = 0.5 * (size_minus + load(current, b, rest_table[r, REST_PLUS], SIZE + axis))
        store(rest, b, r, 0, length)
        store(rest, b, r, 1, 1.0 / length)


@ti.func
def poisson_state(b, l, link_table: ti.template(), voxel_table: ti.template(), strain: ti.template()):
    """Mean transverse strain sum and mean relative cross-section of a link's two voxels, from the last step."""
    axis = link_table[l, LINK_AXIS]
    s1 = voxel_table[link_table[l, LINK_MINUS], STRAIN_SLOT]
    s2 = voxel_table[link_table[l, LINK_PLUS], STRAIN_SLOT]
    c1 = 3 + (axis + 1) % 3
    c2 = 3 + (axis + 2) % 3
    e1 = load(strain, b, s1, c1)
    e2 = load(strain, b, s1, c2)
    f1 = load(strain, b, s2, c1)
    f2 = load(strain, b, s2, c2)
    return 0.5 * ((e1 + e2) + (f1 + f2)), 0.5 * ((1.0 + e1) * (1.0 + e2) + (1.0 + f1) * (1.0 + f2))


@ti.func
def link_stage(
    b, l, poisson, edge,
    link_table: ti.template(), voxel_table: ti.template(), voxel: ti.template(), link: ti.template(),
    beam: ti.template(), rest: ti.template(), strain: ti.template(), monitor: ti.template(),
):  # fmt: skip
    """Forces and moments on both ends of link l, each in its voxel's frame, link axis first: (F-, M-, F+, M+)."""
    v1 = link_table[l, LINK_MINUS]
    v2 = link_table[l, LINK_PLUS]
    axis = link_table[l, LINK_AXIS]
    k = link_table[l, LINK_BEAM]
    r = link_table[l, LINK_REST]
    c1 = (axis + 1) % 3
    c2 = (axis + 2) % 3
    rest_length = load(rest, b, r, 0)
    x, y, z, qw, qx, qy, qz = beams.relative_pose(
        load(voxel, b, v2, axis) - load(voxel, b, v1, axis),
        load(voxel, b, v2, c1) - load(voxel, b, v1, c1),
        load(voxel, b, v2, c2) - load(voxel, b, v1, c2),
        load(voxel, b, v1, 3), load(voxel, b, v1, 4 + axis), load(voxel, b, v1, 4 + c1), load(voxel, b, v1, 4 + c2),
        load(voxel, b, v2, 3), load(voxel, b, v2, 4 + axis), load(voxel, b, v2, 4 + c1), load(voxel, b, v2, 4 + c2),
    )  # fmt: skip
    before = load(link, b, l, LINK_STATE)
    small = beams.angle_regime(x, y, z, rest_length, before)
    fx = x; fy = x; fz = x; mx = x; my = x; mz = x  # noqa: E702
    gx = x; gy = x; gz = x; nx = x; ny = x; nz = x  # noqa: E702
    extension = x - rest_length
    # Most links of a healthy robot are small and were small; a block in which all lanes agree takes the short way.
    if all_lanes((small > 0.5) & (before == beams.SMALL)):
        factor = rotation_vector_factor(qw)
        t2x, t2y, t2z = factor * qx, factor * qy, factor * qz
        hx, h1, h2, h3, h4, h5 = remember(b, l, 0.5, extension, y, z, t2x, t2y, t2z, link)
        pull = axial_force(b, l, extension * load(rest, b, r, 1), edge, poisson, link_table, voxel_table, beam, strain, monitor)
        fx, fy, fz, mx, my, mz, gx, gy, gz, nx, ny, nz = beam_forces(
            b, k, pull, y, z, 0.0, 0.0, t2x, t2y, t2z, hx, h1, h2, 0.0, 0.0, h3, h4, h5, beam, False
        )
        gx, gy, gz = rotate_back(qw, qx, qy, qz, gx, gy, gz)
        nx, ny, nz = rotate_back(qw, qx, qy, qz, nx, ny, nz)
    else:
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
        extension = ti.select(is_small, extension, length - rest_length)
        # A switch of regime invalidates the memory: no damping in this step.
        half = ti.select(before == small, 0.5 + 0.0 * x, 0.0)
        hx, h1, h2, h3, h4, h5 = remember(
            b, l, half, extension, ti.select(is_small, y, t1y), ti.select(is_small, z, t1z), t2x, t2y, t2z, link
        )
        store(link, b, l, LINK_STATE, small)
        pull = axial_force(b, l, extension * load(rest, b, r, 1), edge, poisson, link_table, voxel_table, beam, strain, monitor)
        fx, fy, fz, mx, my, mz, gx, gy, gz, nx, ny, nz = beam_forces(
            b, k, pull, ti.select(is_small, y, 0.0), ti.select(is_small, z, 0.0), t1y, t1z, t2x, t2y, t2z,
            hx, ti.select(is_small, h1, 0.0), ti.select(is_small, h2, 0.0),
            ti.select(is_small, 0.0, h1), ti.select(is_small, 0.0, h2), h3, h4, h5, beam, True,
        )  # fmt: skip
        fx, fy, fz = rotate_back(w, 0.0 * w, by, bz, fx, fy, fz)
        mx, my, mz = rotate_back(w, 0.0 * w, by, bz, mx, my, mz)
        gx, gy, gz = rotate_back(qw, qx, qy, qz, gx, gy, gz)
        nx, ny, nz = rotate_back(qw, qx, qy, qz, nx, ny, nz)
    return fx, fy, fz, mx, my, mz, gx, gy, gz, nx, ny, nz


@ti.func
def remember(b, l, half, d0, d1, d2, d3, d4, d5, link: ti.template()):
    """Half the change of a link's offset and rotations since the last step, and their new memory."""
    h0 = half * (d0 - load(link, b, l, 0))
    h1 = half * (d1 - load(link, b, l, 1))
    h2 = half * (d2 - load(link, b, l, 2))
    h3 = half * (d3 - load(link, b, l, 3))
    h4 = half * (d4 - load(link, b, l, 4))
    h5 = half * (d5 - load(link, b, l, 5))
    store(link, b, l, 0, d0)
    store(link, b, l, 1, d1)
    store(link, b, l, 2, d2)
    store(link, b, l, 3, d3)
    store(link, b, l, 4, d4)
    store(link, b, l, 5, d5)
    return h0, h1, h2, h3, h4, h5


@ti.func
def axial_force(
    b, l, strained, edge, poisson, link_table: ti.template(), voxel_table: ti.template(), beam: ti.template(),
    strain: ti.template(), monitor: ti.template(),
):  # fmt: skip
    """Stress times cross-section of a link [N]; an absurd strain marks the robot as diverged."""
    if not all_lanes(strained <= beams.DIVERGED_STRAIN):
        seen = load(monitor, b, 0, DIVERGED)
        store(monitor, b, 0, DIVERGED, ti.select(strained <= beams.DIVERGED_STRAIN, seen, 1.0))
    k = link_table[l, LINK_BEAM]
    force = load(beam, b, k, AXIAL) * strained * (edge * edge)
    if poisson != 0:
        tau, area = poisson_state(b, l, link_table, voxel_table, strain)
        force = (load(beam, b, k, AXIAL) * strained + load(beam, b, k, TRANSVERSE) * tau) * (edge * edge * area)
    return force


@ti.func
def beam_forces(
    b, k, pull, dy, dz, t1y, t1z, t2x, t2y, t2z, hx, hy, hz, h1y, h1z, h2x, h2y, h2z,
    beam: ti.template(), bent: ti.template(),
):  # fmt: skip
    """Elastic and damping forces of link constants k for offset d, rotations t1, t2 and their half changes h."""
    fy, fz = beams.shear(load(beam, b, k, B1), load(beam, b, k, B2), dy, dz, t1y, t1z, t2y, t2z, bent)
    mx, my, mz, nx, ny, nz = beams.end_moments(
        load(beam, b, k, A2), load(beam, b, k, B2), load(beam, b, k, B3), dy, dz, t1y, t1z, t2x, t2y, t2z, bent
    )
    # Damping obeys the same law, with the roots of the stiffnesses and the changes in place of the strains.
    g1 = load(beam, b, k, DAMPING_MINUS)
    g2 = load(beam, b, k, DAMPING_PLUS)
    dfx = load(beam, b, k, ROOT_A1) * hx
    dfy, dfz = beams.shear(load(beam, b, k, ROOT_B1), load(beam, b, k, ROOT_B2), hy, hz, h1y, h1z, h2y, h2z, bent)
    dmx, dmy, dmz, dnx, dny, dnz = beams.end_moments(
        load(beam, b, k, ROOT_A2), load(beam, b, k, ROOT_B2), load(beam, b, k, ROOT_B3),
        hy, hz, h1y, h1z, h2x, h2y, h2z, bent,
    )  # fmt: skip
    k1 = 0.5 * g1
    k2 = 0.5 * g2
    return (
        pull + g1 * dfx, fy + g1 * dfy, fz + g1 * dfz, mx + k1 * dmx, my + k1 * dmy, mz + k1 * dmz,
        0.0 - pull - g2 * dfx, 0.0 - fy - g2 * dfy, 0.0 - fz - g2 * dfz, nx + k2 * dnx, ny + k2 * dny, nz + k2 * dnz,
    )  # fmt: skip


@ti.func
def contact_stage(
    b, v1, v2, watched: ti.template(), voxel_table: ti.template(), voxel: ti.template(),
    current: ti.template(), constant: ti.template(),
):  # fmt: skip
    """Force on the first of two watched voxels (the second feels the opposite): (touches, x, y, z)."""
    g1 = voxel_table[v1, GROUP]
    g2 = voxel_table[v2, GROUP]
    dx = load(voxel, b, v2, 0) - load(voxel, b, v1, 0)
    dy = load(voxel, b, v2, 1) - load(voxel, b, v1, 1)
    dz = load(voxel, b, v2, 2) - load(voxel, b, v1, 2)
    distance_squared = dx * dx + dy * dy + dz * dz
    limit = contact.reach(load(current, b, g1, MEAN_SIZE), load(current, b, g2, MEAN_SIZE))
    near = (distance_squared < limit * limit) & watched
    touches = any_lane(near)
    fx = 0.0 * dx
    fy = fx
    fz = fx
    if touches:
        distance = ti.sqrt(distance_squared)
        inverse = 1.0 / ti.max(distance, 1e-12)
        w1 = load(constant, b, g1, INVERSE_MASS)
        w2 = load(constant, b, g2, INVERSE_MASS)
        approach = (
            (w1 * load(voxel, b, v1, 7) - w2 * load(voxel, b, v2, 7)) * dx
            + (w1 * load(voxel, b, v1, 8) - w2 * load(voxel, b, v2, 8)) * dy
            + (w1 * load(voxel, b, v1, 9) - w2 * load(voxel, b, v2, 9)) * dz
        ) * inverse
        force = contact.repulsion(
            limit - distance, approach, load(constant, b, g1, STIFFNESS), load(constant, b, g2, STIFFNESS),
            load(constant, b, g1, CONTACT_DAMPING), load(constant, b, g2, CONTACT_DAMPING),
        )  # fmt: skip
        scale = ti.select(near, (0.0 - force) * inverse, 0.0)
        fx = scale * dx
        fy = scale * dy
        fz = scale * dz
    return touches, fx, fy, fz


@ti.func
def voxel_stage(
    b, v, dt, edge, floor_on, fx, fy, fz, mx, my, mz, cx, cy, cz,
    voxel_table: ti.template(), start: ti.template(), voxel: ti.template(), strain: ti.template(),
    channel: ti.template(), current: ti.template(), constant: ti.template(),
):  # fmt: skip
    """Integrate voxel v under the link forces F and moments M (voxel frame) and the contact force c (world)."""
    g = voxel_table[v, GROUP]
    qw = load(voxel, b, v, 3)
    qx = load(voxel, b, v, 4)
    qy = load(voxel, b, v, 5)
    qz = load(voxel, b, v, 6)
    if voxel_table[v, FEELS_PRESSURE] != 0:
        px, py, pz = pressure_force(b, v, g, voxel_table, strain, channel, current)
        fx, fy, fz = fx + px, fy + py, fz + pz
    fx, fy, fz = rotate(qw, qx, qy, qz, fx, fy, fz)
    mx, my, mz = rotate(qw, qx, qy, qz, mx, my, mz)
    inverse_mass = load(constant, b, g, INVERSE_MASS)
    drag = load(current, b, g, DRAG)
    px = load(voxel, b, v, 7)
    py = load(voxel, b, v, 8)
    pz = load(voxel, b, v, 9)
    vx = px * inverse_mass
    vy = py * inverse_mass
    vz = pz * inverse_mass
    fx = fx + load(current, b, g, WEIGHT) - drag * vx + cx
    fy = fy + load(current, b, g, WEIGHT + 1) - drag * vy + cy
    fz = fz + load(current, b, g, WEIGHT + 2) - drag * vz + cz
    step = dt * inverse_mass
    depth = floor.penetration(load(current, b, g, MEAN_SIZE), edge, load(voxel, b, v, 2))
    stuck = 0.0 * depth
    if floor_on != 0 and any_lane(depth >= 0.0):
        touches = depth >= 0.0
        normal = load(constant, b, g, STIFFNESS) * depth
        fz = fz + ti.select(touches, normal - load(constant, b, g, CONTACT_DAMPING) * vz, 0.0)
        sticks = load(voxel, b, v, STICKS) > 0.5
        loose = floor.breaks_loose(fx, fy, channel_value(channel, b, g, STATIC_FRICTION), normal)
        rx, ry = floor.sliding_friction(vx, vy, channel_value(channel, b, g, KINETIC_FRICTION), normal)
        slides = touches & (load(voxel, b, v, STICKS) < 0.5)
        rx = ti.select(slides, rx, 0.0)
        ry = ti.select(slides, ry, 0.0)
        px = px + (fx + rx) * dt
        py = py + (fy + ry) * dt
        stuck = ti.select(loose, 0.0, ti.select(sticks, 1.0 + stuck, 0.0))
        rests = floor.comes_to_rest(px, py, rx, ry, px * step, py * step, inverse_mass)
        stuck = ti.select(rests, 1.0, stuck)
        stuck = ti.select(touches, stuck, 0.0)
        px = ti.select(stuck > 0.5, 0.0, px)
        py = ti.select(stuck > 0.5, 0.0, py)
    else:
        px = px + fx * dt
        py = py + fy * dt
    pz = pz + fz * dt
    store(voxel, b, v, STICKS, stuck)
    x = load(voxel, b, v, 0) + px * step
    y = load(voxel, b, v, 1) + py * step
    z = load(voxel, b, v, 2) + pz * step
    spin = load(constant, b, g, INVERSE_INERTIA)
    drag = load(current, b, g, SPIN_DRAG) * spin
    sx = load(voxel, b, v, 10)
    sy = load(voxel, b, v, 11)
    sz = load(voxel, b, v, 12)
    sx = sx + (mx + channel_value(channel, b, g, MOMENT) - sx * drag) * dt
    sy = sy + (my + channel_value(channel, b, g, MOMENT + 1) - sy * drag) * dt
    sz = sz + (mz + channel_value(channel, b, g, MOMENT + 2) - sz * drag) * dt
    qw, qx, qy, qz = motion.rotate_by_momentum(qw, qx, qy, qz, sx, sy, sz, dt * spin)
    if voxel_table[v, FIXED] != 0:
        bits = voxel_table[v, FIXED]
        x, px = held(bits & 1, x, px, start[v, 0] + channel_value(channel, b, g, TRANSLATION))
        y, py = held(bits & 2, y, py, start[v, 1] + channel_value(channel, b, g, TRANSLATION + 1))
        z, pz = held(bits & 4, z, pz, start[v, 2] + channel_value(channel, b, g, TRANSLATION + 2))
        if bits >= 8:
            tx, ty, tz = to_rotation_vector(qw, qx, qy, qz)
            tx, sx = held(bits & 8, tx, sx, channel_value(channel, b, g, ROTATION))
            ty, sy = held(bits & 16, ty, sy, channel_value(channel, b, g, ROTATION + 1))
            tz, sz = held(bits & 32, tz, sz, channel_value(channel, b, g, ROTATION + 2))
            qw, qx, qy, qz = from_large_rotation_vector(tx, ty, tz)
    store(voxel, b, v, 0, x)
    store(voxel, b, v, 1, y)
    store(voxel, b, v, 2, z)
    store(voxel, b, v, 3, qw)
    store(voxel, b, v, 4, qx)
    store(voxel, b, v, 5, qy)
    store(voxel, b, v, 6, qz)
    store(voxel, b, v, 7, px)
    store(voxel, b, v, 8, py)
    store(voxel, b, v, 9, pz)
    store(voxel, b, v, 10, sx)
    store(voxel, b, v, 11, sy)
    store(voxel, b, v, 12, sz)
    return x, y, z


@ti.func
def held(bit, value, momentum, prescribed):
    """A degree of freedom that the world holds takes its prescribed value and loses its momentum."""
    if bit != 0:
        value = prescribed
        momentum = 0.0 * prescribed
    return value, momentum


@ti.func
def pressure_force(
    b, v, g, voxel_table: ti.template(), strain: ti.template(), channel: ti.template(), current: ti.template()
):
    """Pressure times the deformed area of the voxel's pressurised faces, in the voxel frame."""
    slot = voxel_table[v, STRAIN_SLOT]
    pressure = channel_value(channel, b, g, PRESSURE)
    ex = load(current, b, g, SIZE) * (1.0 + half_stretch(b, v, slot, 0, voxel_table, strain))
    ey = load(current, b, g, SIZE + 1) * (1.0 + half_stretch(b, v, slot, 1, voxel_table, strain))
    ez = load(current, b, g, SIZE + 2) * (1.0 + half_stretch(b, v, slot, 2, voxel_table, strain))
    return (
        pressure * (ey * ez) * ti.cast(voxel_table[v, NORMAL], float),
        pressure * (ez * ex) * ti.cast(voxel_table[v, NORMAL + 1], float),
        pressure * (ex * ey) * ti.cast(voxel_table[v, NORMAL + 2], float),
    )




@ti.func
def half_stretch(b, v, slot, axis: ti.template(), voxel_table: ti.template(), strain: ti.template()):
    """(share- + share+)/2 of the corners along an axis; a side without a link does not stretch."""
    count = 0.0
    if voxel_table[v, SIDE_LINK + 2 * axis] >= 0:
        count += 0.5
    if voxel_table[v, SIDE_LINK + 2 * axis + 1] >= 0:
        count += 0.5
    return load(strain, b, slot, axis) * count


@ti.func
def gauge_stage(
    b, v, poisson, link_table: ti.template(), voxel_table: ti.template(), link: ti.template(), beam: ti.template(),
    rest: ti.template(), strain: ti.template(), channel: ti.template(), constant: ti.template(),
):  # fmt: skip
    """Strains of a voxel whose links are all done, for the next step's pressure and Poisson's effect."""
    slot = voxel_table[v, STRAIN_SLOT]
    g = voxel_table[v, GROUP]
    stretched = load(constant, b, g, NU) * 0.0
    for axis in ti.static(range(3)):
        total = 0.0 * stretched
        count = 0.0
        for side in ti.static(range(2)):
            l = voxel_table[v, SIDE_LINK + 2 * axis + side]
            if l >= 0:
                share = load(beam, b, link_table[l, LINK_BEAM], SHARE_PLUS if side == 0 else SHARE_MINUS)
                total = total + load(link, b, l, 0) * load(rest, b, link_table[l, LINK_REST], 1) * share
                count += 1.0
        mean = total / ti.max(count, 1.0)
        store(strain, b, slot, axis, mean)
        if poisson != 0:
            pulled = in_tension(b, v, g, axis, count, voxel_table, channel)
            stretched = stretched + ti.select(pulled, mean, 0.0)
    if poisson != 0:
        squeezed = motion.power(1.0 + stretched, 0.0 - load(constant, b, g, NU)) - 1.0
        for axis in ti.static(range(3)):
            count = 0.0
            for side in ti.static(range(2)):
                if voxel_table[v, SIDE_LINK + 2 * axis + side] >= 0:
                    count += 1.0
            pulled = in_tension(b, v, g, axis, count, voxel_table, channel)
            store(strain, b, slot, 3 + axis, ti.select(pulled, load(strain, b, slot, axis), squeezed))


@ti.func
def in_tension(b, v, g, axis: ti.template(), count, voxel_table: ti.template(), channel: ti.template()):
    """Two links, or one and something to pull against: a held degree of freedom or an external force."""
    pull = channel_value(channel, b, g, FORCE + axis) + channel_value(channel, b, g, ACCELERATION + axis)
    tension = 0.0 * pull
    if count > 1.5:
        tension = tension + 1.0
    elif count > 0.5:
        if voxel_table[v, FIXED] & (1 << axis) != 0:
            tension = tension + 1.0
        else:
            tension = ti.select(pull != 0.0, 1.0, tension)
    return tension > 0.5
