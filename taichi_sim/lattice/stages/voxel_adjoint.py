"""Reverse of the stage of a voxel and of its gauges. See ``link_adjoint`` for what the arguments hold.

What a voxel did in a step is known from the states before and after it: its forces are not needed, as they enter
linearly. Whether it stuck or slid is as recorded.
"""

from taichi_sim.autodiff.lanes import accumulate, accumulate_all, any_lane, load, load_all, select_all, store_all
from taichi_sim.autodiff.rotations import from_large_rotation_vector, rotate, to_rotation_vector
from taichi_sim.autodiff.tracing import law, pull_back, select
from taichi_sim.lattice.laws import floor, fluid, motion
from taichi_sim.lattice.materials import CONTACT_DAMPING, INVERSE_INERTIA, INVERSE_MASS, NU, STIFFNESS
from taichi_sim.lattice.stages.columns import (
    CHANNELS,
    FEELS_PRESSURE,
    FIXED,
    GAUGE,
    GROUP,
    KINETIC_FRICTION,
    MOMENT,
    PRESSURE,
    ROTATION,
    SIDE_LINK,
    TRANSLATION,
    VOXEL_COLUMNS,
)
from taichi_sim.lattice.stages.memory import (
    CHANNEL,
    CHANNEL_WIDTH,
    CONSTANT,
    CURRENT,
    DRAG,
    FLOOR_ON,
    FLUID_ON,
    FORCE,
    LINK,
    LINK_WIDTH,
    MEAN_SIZE,
    MOMENTUM,
    ORIENTATION,
    POISSON_ON,
    PUSH,
    SIZE,
    SPIN,
    SPIN_DRAG,
    STICKS,
    STRAIN,
    VALUE,
    VOXEL,
    VOXEL_WIDTH,
)
from taichi_sim.lattice.stages.voxel import (
    drag_slots,
    gauge_slots,
    gauged_faces,
    held,
    in_tension,
    link_count,
    wet_faces,
)
from taichi_sim.runtime import ti


@law
def pushed(
    px,
    py,
    pz,
    fx,
    fy,
    fz,
    inverse_mass,
    drag,
    z,
    mean_size,
    stiffness,
    contact_damping,
    kinetic_friction,
    dt,
    edge,
    sticks,
    stuck,
    floor_near,
):
    """New momentum of a voxel under the force F of all but floor and drag; sticking before and after are known."""
    vx = px * inverse_mass
    vy = py * inverse_mass
    vz = pz * inverse_mass
    fx = fx - drag * vx
    fy = fy - drag * vy
    fz = fz - drag * vz
    if floor_near:
        depth = floor.penetration(mean_size, edge, z)
        touches = depth >= 0.0
        normal = stiffness * depth
        fz = fz + select(touches, normal - contact_damping * vz, 0.0)
        rx, ry = floor.sliding_friction(vx, vy, kinetic_friction, normal)
        slides = touches & (sticks < 0.5)
        fx = fx + select(slides, rx, 0.0)
        fy = fy + select(slides, ry, 0.0)
    free = stuck < 0.5
    return select(free, px + fx * dt, 0.0), select(free, py + fy * dt, 0.0), pz + fz * dt


@law
def turned(sx, sy, sz, mx, my, mz, inverse_inertia, drag, dt):
    """New angular momentum under the moment M of all but drag."""
    rate = drag * inverse_inertia
    return sx + (mx - sx * rate) * dt, sy + (my - sy * rate) * dt, sz + (mz - sz * rate) * dt


@law
def placed(x, y, z, qw, qx, qy, qz, px, py, pz, sx, sy, sz, inverse_mass, inverse_inertia, dt):
    """New position and orientation, from the new momenta."""
    step = dt * inverse_mass
    qw, qx, qy, qz = motion.rotate_by_momentum(qw, qx, qy, qz, sx, sy, sz, dt * inverse_inertia)
    return x + px * step, y + py * step, z + pz * step, qw, qx, qy, qz


@law
def pressed(qw, qx, qy, qz, gx, gy, gz, size_x, size_y, size_z, pressure, hx, hy, hz, nx, ny, nz):
    """Force of the pressure, world frame."""
    fx, fy, fz = motion.pressure_on_faces(gx, gy, gz, size_x, size_y, size_z, pressure, hx, hy, hz, nx, ny, nz)
    return rotate(qw, qx, qy, qz, fx, fy, fz)


@law
def held_rotation(qw, qx, qy, qz, rx, ry, rz, hold_x, hold_y, hold_z):
    """Orientation with the prescribed components r of its rotation vector where the world holds them."""
    tx, ty, tz = to_rotation_vector(qw, qx, qy, qz)
    return from_large_rotation_vector(
        select(hold_x > 0.5, rx, tx), select(hold_y > 0.5, ry, ty), select(hold_z > 0.5, rz, tz)
    )


@ti.func
def channel_slots(v, quantity: ti.template(), plan: ti.template(), voxel_table: ti.template()):
    """Slots of three consecutive channels of a voxel's group."""
    slot = plan[CHANNEL] + voxel_table[v * VOXEL_COLUMNS + CHANNELS] + quantity * CHANNEL_WIDTH + VALUE
    return slot, slot + CHANNEL_WIDTH, slot + 2 * CHANNEL_WIDTH


@ti.func
def three(slot):
    """A slot and the two after it."""
    return slot, slot + 1, slot + 2


@ti.func
def voxel_adjoint(
    m: ti.template(),
    k,
    rec: ti.template(),
    kr,
    old,
    new,
    a: ti.template(),
    v,
    dt,
    edge,
    plan: ti.template(),
    voxel_table: ti.template(),
):
    """Reverse voxel v: from the cotangents of its new state to those of its old one and of its force and moment."""
    row = v * VOXEL_COLUMNS
    voxel = plan[VOXEL] + v * VOXEL_WIDTH
    before, after = old + voxel, new + voxel
    constant = plan[CONSTANT] + voxel_table[row + GROUP]
    inverse_mass = load(m, k, constant + INVERSE_MASS)
    inverse_inertia = load(m, k, constant + INVERSE_INERTIA)
    bits = voxel_table[row + FIXED]
    cx, cy, cz, cw, ca, cb, cc = load_all(a, k, three(voxel) + quaternion(voxel))
    gx, gy, gz = load_all(a, k, three(voxel + MOMENTUM))
    sx, sy, sz = load_all(a, k, three(voxel + SPIN))
    old_pose = load_all(rec, kr, three(before) + quaternion(before))
    new_momenta = load_all(rec, kr, three(after + MOMENTUM) + three(after + SPIN))
    if bits != 0:
        nought = 0.0 * inverse_mass
        accumulate_all(
            a,
            k,
            channel_slots(v, TRANSLATION, plan, voxel_table),
            (
                held(bits, 1, nought, cx),
                held(bits, 2, nought, cy),
                held(bits, 4, nought, cz),
            ),
        )
        cx, cy, cz = held(bits, 1, cx, nought), held(bits, 2, cy, nought), held(bits, 4, cz, nought)
        if bits >= 8:
            cw, ca, cb, cc = rotation_adjoint(
                m, k, a, v, dt * inverse_inertia, bits, plan, voxel_table, old_pose, new_momenta, (cw, ca, cb, cc)
            )
    p = ti.static(
        pull_back(placed, old_pose + new_momenta + (inverse_mass, inverse_inertia), (dt,), (cx, cy, cz, cw, ca, cb, cc))
    )
    gx, gy, gz = gx + p[7], gy + p[8], gz + p[9]
    sx, sy, sz = sx + p[10], sy + p[11], sz + p[12]
    if bits != 0:
        nought = 0.0 * inverse_mass
        gx, gy, gz = held(bits, 1, gx, nought), held(bits, 2, gy, nought), held(bits, 4, gz, nought)
        sx, sy, sz = held(bits, 8, sx, nought), held(bits, 16, sy, nought), held(bits, 32, sz, nought)
    accumulate_all(a, k, (constant + INVERSE_MASS, constant + INVERSE_INERTIA), p[13:])
    spin_adjoint(m, k, rec, kr, old, a, v, dt, plan, voxel_table, (sx, sy, sz))
    store_all(a, k, three(voxel) + quaternion(voxel), p[:7])
    momentum_adjoint(m, k, rec, kr, old, new, a, v, dt, edge, plan, voxel_table, (gx, gy, gz))
    if voxel_table[row + FEELS_PRESSURE] != 0:
        pressure_adjoint(m, k, rec, kr, old, a, v, plan, voxel_table)
    if plan[FLUID_ON] != 0:
        drag_adjoint(m, k, rec, kr, old, a, v, plan, voxel_table)


@ti.func
def quaternion(voxel):
    """Slots of an orientation."""
    return voxel + ORIENTATION, voxel + ORIENTATION + 1, voxel + ORIENTATION + 2, voxel + ORIENTATION + 3


@ti.func
def rotation_adjoint(
    m: ti.template(),
    k,
    a: ti.template(),
    v,
    step,
    bits,
    plan: ti.template(),
    voxel_table: ti.template(),
    pose: ti.template(),
    momenta: ti.template(),
    seeds: ti.template(),
):
    """Reverse the hold on a voxel's rotation; the cotangents of its free orientation."""
    free = motion.rotate_by_momentum(pose[3], pose[4], pose[5], pose[6], momenta[3], momenta[4], momenta[5], step)
    slots = channel_slots(v, ROTATION, plan, voxel_table)
    nought = 0.0 * step
    one = 1.0 + nought
    holds = (held(bits, 8, nought, one), held(bits, 16, nought, one), held(bits, 32, nought, one))
    g = ti.static(pull_back(held_rotation, free + load_all(m, k, slots), holds, seeds))
    accumulate_all(a, k, slots, g[4:])
    return g[0], g[1], g[2], g[3]


@ti.func
def spin_adjoint(
    m: ti.template(),
    k,
    rec: ti.template(),
    kr,
    old,
    a: ti.template(),
    v,
    dt,
    plan: ti.template(),
    voxel_table: ti.template(),
    seeds: ti.template(),
):
    """Reverse the change of angular momentum; gives the cotangents of the moment."""
    voxel = plan[VOXEL] + v * VOXEL_WIDTH
    inverse_inertia = plan[CONSTANT] + voxel_table[v * VOXEL_COLUMNS + GROUP] + INVERSE_INERTIA
    drag = plan[CURRENT] + voxel_table[v * VOXEL_COLUMNS + GROUP] + SPIN_DRAG
    spin = load_all(rec, kr, three(old + voxel + SPIN))
    nought = 0.0 * spin[0]
    g = ti.static(
        pull_back(turned, spin + (nought, nought, nought) + load_all(m, k, (inverse_inertia, drag)), (dt,), seeds)
    )
    store_all(a, k, three(voxel + SPIN), g[:3])
    store_all(a, k, three(plan[FORCE] + 6 * v + 3), g[3:6])
    accumulate_all(a, k, channel_slots(v, MOMENT, plan, voxel_table), g[3:6])
    accumulate_all(a, k, (inverse_inertia, drag), g[6:])


@ti.func
def momentum_adjoint(
    m: ti.template(),
    k,
    rec: ti.template(),
    kr,
    old,
    new,
    a: ti.template(),
    v,
    dt,
    edge,
    plan: ti.template(),
    voxel_table: ti.template(),
    seeds: ti.template(),
):
    """Reverse the change of momentum, floor and friction included; gives the cotangents of the force."""
    voxel = plan[VOXEL] + v * VOXEL_WIDTH
    group = voxel_table[v * VOXEL_COLUMNS + GROUP]
    constant, current = plan[CONSTANT] + group, plan[CURRENT] + group
    z = load(rec, kr, old + voxel + 2)
    floor_near = plan[FLOOR_ON] != 0
    touches = floor.penetration(load(m, k, current + MEAN_SIZE), edge, z) >= 0.0
    if floor_near:
        floor_near = any_lane(touches)
    momentum = load_all(rec, kr, three(old + voxel + MOMENTUM))
    nought = 0.0 * z
    slots = (
        constant + INVERSE_MASS,
        current + DRAG,
        current + MEAN_SIZE,
        constant + STIFFNESS,
        constant + CONTACT_DAMPING,
        channel_slots(v, KINETIC_FRICTION, plan, voxel_table)[0],
    )
    mass, drag, size, stiffness, damping, friction = load_all(m, k, slots)
    inputs = momentum + (nought, nought, nought, mass, drag, z, size, stiffness, damping, friction)
    sticks, stuck = load(rec, kr, old + voxel + STICKS), load(rec, kr, new + voxel + STICKS)
    g = ti.static(pull_back(pushed, inputs, (dt, edge, sticks, stuck, False), seeds))
    if floor_near:  # on the floor terms add in another order, so lanes above it keep their own
        p = ti.static(pull_back(pushed, inputs, (dt, edge, sticks, stuck, True), seeds))
        t = select_all(touches, p, g)
        accumulate(a, k, voxel + 2, t[8])
        accumulate_all(a, k, slots, t[6:8] + t[9:])
        give_force(a, k, v, plan, voxel_table, t[:6])
    else:
        accumulate_all(a, k, slots[:2], g[6:8])
        give_force(a, k, v, plan, voxel_table, g[:6])


@ti.func
def give_force(a: ti.template(), k, v, plan: ti.template(), voxel_table: ti.template(), g: ti.template()):
    """Store the cotangents of momentum and force; those of the external force add to its group's."""
    store_all(a, k, three(plan[VOXEL] + v * VOXEL_WIDTH + MOMENTUM), g[:3])
    store_all(a, k, three(plan[FORCE] + 6 * v), g[3:])
    accumulate_all(a, k, three(plan[CURRENT] + voxel_table[v * VOXEL_COLUMNS + GROUP] + PUSH), g[3:])


@ti.func
def pressure_adjoint(
    m: ti.template(),
    k,
    rec: ti.template(),
    kr,
    old,
    a: ti.template(),
    v,
    plan: ti.template(),
    voxel_table: ti.template(),
):
    """Reverse the force of the pressure on a voxel's faces."""
    voxel = plan[VOXEL] + v * VOXEL_WIDTH
    gauge = plan[STRAIN] + voxel_table[v * VOXEL_COLUMNS + GAUGE]
    faces = gauged_faces(rec, kr, old, v, plan, voxel_table)
    slots = three(plan[CURRENT] + voxel_table[v * VOXEL_COLUMNS + GROUP] + SIZE) + (
        channel_slots(v, PRESSURE, plan, voxel_table)[0],
    )
    inputs = load_all(rec, kr, quaternion(old + voxel)) + faces[:3] + load_all(m, k, slots)
    seeds = load_all(a, k, three(plan[FORCE] + 6 * v))
    g = ti.static(pull_back(pressed, inputs, faces[3:], seeds))
    accumulate_all(a, k, quaternion(voxel) + three(gauge) + slots, g)


@ti.func
def drag_adjoint(
    m: ti.template(),
    k,
    rec: ti.template(),
    kr,
    old,
    a: ti.template(),
    v,
    plan: ti.template(),
    voxel_table: ti.template(),
):
    """Reverse the drag of a fluid."""
    voxel = plan[VOXEL] + v * VOXEL_WIDTH
    inverse_mass = plan[CONSTANT] + voxel_table[v * VOXEL_COLUMNS + GROUP] + INVERSE_MASS
    motion_slots = quaternion(voxel) + three(voxel + MOMENTUM)
    slots = (inverse_mass,) + drag_slots(v, plan, voxel_table)
    inputs = load_all(rec, kr, quaternion(old + voxel) + three(old + voxel + MOMENTUM)) + load_all(m, k, slots)
    seeds = load_all(a, k, three(plan[FORCE] + 6 * v))
    g = ti.static(pull_back(fluid.drag, inputs, wet_faces(v, voxel_table), seeds))
    accumulate_all(a, k, motion_slots + slots, g)


@ti.func
def gauge_adjoint(
    m: ti.template(),
    k,
    rec: ti.template(),
    kr,
    new,
    a: ti.template(),
    v,
    plan: ti.template(),
    link_table: ti.template(),
    voxel_table: ti.template(),
):
    """Reverse a voxel's gauges: takes the cotangents of its new strains to those of its links' new memory."""
    row = v * VOXEL_COLUMNS
    gauge = plan[STRAIN] + voxel_table[row + GAUGE]
    gx, gy, gz = load_all(a, k, three(gauge))
    nought = 0.0 * load(m, k, plan[CONSTANT])
    store_all(a, k, three(gauge), (nought, nought, nought))
    if plan[POISSON_ON] != 0:
        nu = plan[CONSTANT] + voxel_table[row + GROUP] + NU
        tension = (
            in_tension(m, k, v, 0, plan, voxel_table),
            in_tension(m, k, v, 1, plan, voxel_table),
            in_tension(m, k, v, 2, plan, voxel_table),
        )
        g = ti.static(
            pull_back(
                motion.poisson_strains,
                load_all(rec, kr, three(new + gauge)) + (load(m, k, nu),),
                tension,
                load_all(a, k, three(gauge + 3)),
            )
        )
        gx, gy, gz = gx + g[0], gy + g[1], gz + g[2]
        accumulate(a, k, nu, g[3])
        store_all(a, k, three(gauge + 3), (nought, nought, nought))
    axis_adjoint(m, k, rec, kr, new, a, v, 0, gx, plan, link_table, voxel_table)
    axis_adjoint(m, k, rec, kr, new, a, v, 1, gy, plan, link_table, voxel_table)
    axis_adjoint(m, k, rec, kr, new, a, v, 2, gz, plan, link_table, voxel_table)


@ti.func
def axis_adjoint(
    m: ti.template(),
    k,
    rec: ti.template(),
    kr,
    new,
    a: ti.template(),
    v,
    axis: ti.template(),
    seed,
    plan: ti.template(),
    link_table: ti.template(),
    voxel_table: ti.template(),
):
    """Reverse :func:`voxel_stage.axis_strain`."""
    if link_count(v, axis, voxel_table) == 2:
        seed = 0.5 * seed
    for side in ti.static(range(2)):
        l = voxel_table[v * VOXEL_COLUMNS + SIDE_LINK + 2 * axis + side]
        if l >= 0:
            share, rest = gauge_slots(l, side, plan, link_table)
            link = plan[LINK] + l * LINK_WIDTH
            extension = load(rec, kr, new + link)
            inverse = load(m, k, rest + 1)
            weight = load(m, k, share)
            accumulate(a, k, link, seed * inverse * weight)
            accumulate(a, k, rest + 1, seed * extension * weight)
            accumulate(a, k, share, seed * extension * inverse)
