"""Stage of a voxel: floor, pressure, drag and integration; then the gauges that read its strain for the next step."""

from taichi_sim.autodiff.lanes import any_lane, load, load_all, store
from taichi_sim.autodiff.rotations import from_large_rotation_vector, rotate, to_rotation_vector
from taichi_sim.autodiff.tracing import select
from taichi_sim.lattice.laws import floor, fluid, motion
from taichi_sim.lattice.materials import (
    CONTACT_DAMPING,
    INVERSE_INERTIA,
    INVERSE_MASS,
    NU,
    SHARE_MINUS,
    SHARE_PLUS,
    STIFFNESS,
)
from taichi_sim.lattice.stages.columns import (
    ACCELERATION,
    CHANNELS,
    FEELS_PRESSURE,
    FIXED,
    FORCE,
    GAUGE,
    GROUP,
    KINETIC_FRICTION,
    LINK_BEAM,
    LINK_COLUMNS,
    LINK_REST,
    MOMENT,
    NORMAL,
    PRESSURE,
    RESISTANCE,
    ROTATION,
    SIDE_LINK,
    STATIC_FRICTION,
    TRANSLATION,
    VOXEL_COLUMNS,
    WET,
)
from taichi_sim.lattice.stages.forcing import channel_value
from taichi_sim.lattice.stages.memory import (
    BEAM,
    CHANNEL,
    CHANNEL_WIDTH,
    CONSTANT,
    CURRENT,
    DRAG,
    FLOOR_ON,
    FLUID_ON,
    LINK,
    LINK_WIDTH,
    MEAN_SIZE,
    MOMENTUM,
    ORIENTATION,
    POISSON_ON,
    PUSH,
    REST,
    SIZE,
    SPIN,
    SPIN_DRAG,
    STICKS,
    STRAIN,
    VALUE,
    VOXEL,
    VOXEL_WIDTH,
    WATCH,
)
from taichi_sim.runtime import ti


@ti.func
def voxel_stage(
    m: ti.template(),
    k,
    v,
    dt,
    edge,
    fx,
    fy,
    fz,
    mx,
    my,
    mz,
    cx,
    cy,
    cz,
    plan: ti.template(),
    voxel_table: ti.template(),
    start: ti.template(),
):
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
    if plan[FLUID_ON] != 0:
        ax, ay, az = drag_force(m, k, v, px, py, pz, inverse_mass, qw, qx, qy, qz, plan, voxel_table)
        fx, fy, fz = fx + ax, fy + ay, fz + az
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
        fz = fz + select(touches, normal - load(m, k, constant + CONTACT_DAMPING) * vz, 0.0)
        sticks = load(m, k, voxel + STICKS)
        loose = floor.breaks_loose(fx, fy, channel_value(m, k, channels, STATIC_FRICTION), normal)
        rx, ry = floor.sliding_friction(vx, vy, channel_value(m, k, channels, KINETIC_FRICTION), normal)
        slides = touches & (sticks < 0.5)
        rx = select(slides, rx, 0.0)
        ry = select(slides, ry, 0.0)
        px = px + (fx + rx) * dt
        py = py + (fy + ry) * dt
        stuck = select(loose, 0.0, sticks)
        stuck = select(floor.comes_to_rest(px, py, rx, ry, px * step, py * step, inverse_mass), 1.0, stuck)
        stuck = select(touches, stuck, 0.0)
        px = select(stuck > 0.5, 0.0, px)
        py = select(stuck > 0.5, 0.0, py)
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
    bits = voxel_table[row + FIXED]
    if bits != 0:
        nought = 0.0 * inverse_mass
        px, py, pz = held(bits, 1, px, nought), held(bits, 2, py, nought), held(bits, 4, pz, nought)
        sx, sy, sz = held(bits, 8, sx, nought), held(bits, 16, sy, nought), held(bits, 32, sz, nought)
        x = held(bits, 1, x, start[v, 0] + channel_value(m, k, channels, TRANSLATION))
        y = held(bits, 2, y, start[v, 1] + channel_value(m, k, channels, TRANSLATION + 1))
        z = held(bits, 4, z, start[v, 2] + channel_value(m, k, channels, TRANSLATION + 2))
    qw, qx, qy, qz = motion.rotate_by_momentum(qw, qx, qy, qz, sx, sy, sz, dt * inverse_inertia)
    if bits >= 8:
        tx, ty, tz = to_rotation_vector(qw, qx, qy, qz)
        tx = held(bits, 8, tx, channel_value(m, k, channels, ROTATION))
        ty = held(bits, 16, ty, channel_value(m, k, channels, ROTATION + 1))
        tz = held(bits, 32, tz, channel_value(m, k, channels, ROTATION + 2))
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
def held(bits, bit: ti.template(), value, prescribed):
    """What becomes of a degree of freedom: its own value, or the prescribed one where the world holds it."""
    if bits & bit != 0:
        value = prescribed
    return value


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
    gx, gy, gz, hx, hy, hz, nx, ny, nz = gauged_faces(m, k, 0, v, plan, voxel_table)
    size = plan[CURRENT] + voxel_table[row + GROUP] + SIZE
    pressure = channel_value(m, k, plan[CHANNEL] + voxel_table[row + CHANNELS], PRESSURE)
    return motion.pressure_on_faces(
        gx, gy, gz, load(m, k, size), load(m, k, size + 1), load(m, k, size + 2), pressure, hx, hy, hz, nx, ny, nz
    )


@ti.func
def drag_force(
    m: ti.template(), k, v, px, py, pz, inverse_mass, qw, qx, qy, qz, plan: ti.template(), voxel_table: ti.template()
):
    """What the fluid around a voxel of momentum p does to it, world frame."""
    sx, sy, sz, normal, tangential = load_all(m, k, drag_slots(v, plan, voxel_table))
    nx, ny, nz = wet_faces(v, voxel_table)
    return fluid.drag(qw, qx, qy, qz, px, py, pz, inverse_mass, sx, sy, sz, normal, tangential, nx, ny, nz)


@ti.func
def drag_slots(v, plan: ti.template(), voxel_table: ti.template()):
    """Slots of a voxel's rest sizes and of both resistances of the fluid around it."""
    row = v * VOXEL_COLUMNS
    size = plan[CURRENT] + voxel_table[row + GROUP] + SIZE
    resistance = plan[CHANNEL] + voxel_table[row + CHANNELS] + RESISTANCE * CHANNEL_WIDTH + VALUE
    return size, size + 1, size + 2, resistance, resistance + CHANNEL_WIDTH


@ti.func
def wet_faces(v, voxel_table: ti.template()):
    """How many faces along each axis a fluid reaches."""
    wet = voxel_table[v * VOXEL_COLUMNS + WET]
    return ti.cast(wet & 3, float), ti.cast((wet >> 2) & 3, float), ti.cast((wet >> 4) & 3, float)


@ti.func
def gauged_faces(m: ti.template(), k, base, v, plan: ti.template(), voxel_table: ti.template()):
    """Strains of a voxel, half the number of links along each axis, and the normals of its pressurised faces."""
    gauge = base + plan[STRAIN] + voxel_table[v * VOXEL_COLUMNS + GAUGE]
    normal = v * VOXEL_COLUMNS + NORMAL
    return (
        load(m, k, gauge),
        load(m, k, gauge + 1),
        load(m, k, gauge + 2),
        0.5 * ti.cast(link_count(v, 0, voxel_table), float),
        0.5 * ti.cast(link_count(v, 1, voxel_table), float),
        0.5 * ti.cast(link_count(v, 2, voxel_table), float),
        ti.cast(voxel_table[normal], float),
        ti.cast(voxel_table[normal + 1], float),
        ti.cast(voxel_table[normal + 2], float),
    )


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
    ex = axis_strain(m, k, v, 0, plan, link_table, voxel_table)
    ey = axis_strain(m, k, v, 1, plan, link_table, voxel_table)
    ez = axis_strain(m, k, v, 2, plan, link_table, voxel_table)
    store(m, k, gauge, ex)
    store(m, k, gauge + 1, ey)
    store(m, k, gauge + 2, ez)
    if plan[POISSON_ON] != 0:
        nu = load(m, k, plan[CONSTANT] + voxel_table[row + GROUP] + NU)
        tx = in_tension(m, k, v, 0, plan, voxel_table)
        ty = in_tension(m, k, v, 1, plan, voxel_table)
        tz = in_tension(m, k, v, 2, plan, voxel_table)
        ex, ey, ez = motion.poisson_strains(ex, ey, ez, nu, tx, ty, tz)
        store(m, k, gauge + 3, ex)
        store(m, k, gauge + 4, ey)
        store(m, k, gauge + 5, ez)


@ti.func
def axis_strain(
    m: ti.template(),
    k,
    v,
    axis: ti.template(),
    plan: ti.template(),
    link_table: ti.template(),
    voxel_table: ti.template(),
):
    """Mean of a voxel's shares in the strains of its links along an axis."""
    total = 0.0 * load(m, k, plan[CONSTANT])
    for side in ti.static(range(2)):
        l = voxel_table[v * VOXEL_COLUMNS + SIDE_LINK + 2 * axis + side]
        if l >= 0:
            share, rest = gauge_slots(l, side, plan, link_table)
            strain = load(m, k, plan[LINK] + l * LINK_WIDTH) * load(m, k, rest + 1)
            total = total + strain * load(m, k, share)
    if link_count(v, axis, voxel_table) == 2:
        total = 0.5 * total
    return total


@ti.func
def gauge_slots(l, side: ti.template(), plan: ti.template(), link_table: ti.template()):
    """Slots of the share that the voxel on one side has in a link's strain, and of the link's rest length."""
    share = plan[BEAM] + link_table[l * LINK_COLUMNS + LINK_BEAM] + (SHARE_PLUS if side == 0 else SHARE_MINUS)
    return share, plan[REST] + link_table[l * LINK_COLUMNS + LINK_REST]


@ti.func
def in_tension(m: ti.template(), k, v, axis: ti.template(), plan: ti.template(), voxel_table: ti.template()):
    """1 for two links, or one and something to pull against: a held degree of freedom or an external force; else 0."""
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
            tension = select(pull != 0.0, 1.0, tension)
    return tension
