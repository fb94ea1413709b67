"""The stages of a step that come before links and voxels: channels, rest lengths, contact, pressure on squares.

A stage loads reals, applies a law and stores; both drivers run exactly the same ones. ``m`` is the memory of all robots
and k a robot's or block's key to it (see ``lanes.load``); ``plan`` says where the sections lie (see ``memory``). The
integer tables are shared by all robots and hold slots relative to a section (see ``columns``).
"""

from taichi_sim.autodiff.lanes import load, load_all, store, store_all
from taichi_sim.autodiff.tracing import law
from taichi_sim.lattice.laws import contact, enclosure
from taichi_sim.lattice.materials import (
    CONSTANT_COLUMNS,
    CONTACT_DAMPING,
    CRITICAL_ROTATION,
    CRITICAL_TRANSLATION,
    EXPANSION,
    INVERSE_MASS,
    MASS,
    STIFFNESS,
)
from taichi_sim.lattice.program import QUANTITY_COUNT
from taichi_sim.lattice.stages.columns import (
    ACCELERATION,
    CHANNELS,
    CHANNELS_PER_GROUP,
    END_CORNER,
    FIRST_CORNER,
    FORCE,
    GLOBAL_DAMPING,
    PRESSURE,
    REST_AXIS,
    REST_MINUS,
    REST_PLUS,
    SCALE,
    SQUARE_COLUMNS,
    SURFACE_COLUMNS,
    SURFACE_GROUP,
    SURFACE_VOXEL,
    TEMPERATURE,
    VOXEL_COLUMNS,
)
from taichi_sim.lattice.stages.memory import (
    AGE,
    BASE,
    CHANNEL,
    CHANNEL_WIDTH,
    CONSTANT,
    CURRENT,
    CURRENT_WIDTH,
    DRAG,
    GROUPS,
    MEAN_SIZE,
    MOMENTUM,
    PRESSED,
    PRESSED_WIDTH,
    PUSH,
    RATE,
    REST,
    REST_WIDTH,
    RESTS,
    SIZE,
    SPIN_DRAG,
    VALUE,
    VOXEL,
    VOXEL_WIDTH,
)
from taichi_sim.runtime import ti


@ti.func
def channel_value(m: ti.template(), k, channels, quantity):
    """Value in this step of one of the channels that begin at a slot."""
    return load(m, k, channels + quantity * CHANNEL_WIDTH + VALUE)


@ti.func
def advance_channels(m: ti.template(), k, plan: ti.template(), edge, gravity):
    """Evaluate every channel for this step and what follows from it."""
    for i in range(plan[GROUPS] * QUANTITY_COUNT):
        slot = plan[CHANNEL] + i * CHANNEL_WIDTH
        age = load(m, k, slot + AGE)
        store(m, k, slot + VALUE, load(m, k, slot + BASE) + load(m, k, slot + RATE) * age)
        store(m, k, slot + AGE, age + 1.0)
    derive_current(m, k, plan, edge, gravity)


@ti.func
def derive_current(m: ti.template(), k, plan: ti.template(), edge, gravity):
    """Sizes, external force and damping of every group, from the values of its channels."""
    for g in range(plan[GROUPS]):
        ex, temp, sx, sy, sz, mass, ax, ay, az, fx, fy, fz, zeta, ct, cr = load_all(m, k, group_slots(g, plan))
        rx, ry, rz, mean, px, py, pz, drag, spin = group_state(
            ex, temp, sx, sy, sz, mass, ax, ay, az, fx, fy, fz, zeta, ct, cr, edge, gravity
        )
        current = plan[CURRENT] + g * CURRENT_WIDTH
        store(m, k, current + SIZE, rx)
        store(m, k, current + SIZE + 1, ry)
        store(m, k, current + SIZE + 2, rz)
        store(m, k, current + MEAN_SIZE, mean)
        store(m, k, current + PUSH, px)
        store(m, k, current + PUSH + 1, py)
        store(m, k, current + PUSH + 2, pz)
        store(m, k, current + DRAG, drag)
        store(m, k, current + SPIN_DRAG, spin)


@ti.func
def group_slots(g, plan: ti.template()):
    """Slots of the 15 numbers from which the state of a group follows, see :func:`group_state`."""
    constant = plan[CONSTANT] + g * CONSTANT_COLUMNS
    value = plan[CHANNEL] + g * CHANNELS_PER_GROUP + VALUE
    return (
        constant + EXPANSION,
        value + TEMPERATURE * CHANNEL_WIDTH,
        value + SCALE * CHANNEL_WIDTH,
        value + (SCALE + 1) * CHANNEL_WIDTH,
        value + (SCALE + 2) * CHANNEL_WIDTH,
        constant + MASS,
        value + ACCELERATION * CHANNEL_WIDTH,
        value + (ACCELERATION + 1) * CHANNEL_WIDTH,
        value + (ACCELERATION + 2) * CHANNEL_WIDTH,
        value + FORCE * CHANNEL_WIDTH,
        value + (FORCE + 1) * CHANNEL_WIDTH,
        value + (FORCE + 2) * CHANNEL_WIDTH,
        value + GLOBAL_DAMPING * CHANNEL_WIDTH,
        constant + CRITICAL_TRANSLATION,
        constant + CRITICAL_ROTATION,
    )


@law
def grown_scales(expansion, temperature, scale_x, scale_y, scale_z):
    """Rest sizes in voxel edges of a material that its temperature swells."""
    warmth = 1.0 + expansion * temperature
    return scale_x * warmth, scale_y * warmth, scale_z * warmth


@law
def group_state(
    expansion,
    temperature,
    scale_x,
    scale_y,
    scale_z,
    mass,
    ax,
    ay,
    az,
    fx,
    fy,
    fz,
    zeta,
    critical_translation,
    critical_rotation,
    edge,
    gravity,
):
    """Rest sizes and their mean, external force on a voxel, damping coefficients."""
    sx, sy, sz = grown_scales(expansion, temperature, scale_x, scale_y, scale_z)
    # Exactly h for unit scales: a voxel that starts on the floor must touch it, or it would not stick.
    mean = edge * ((sx + sy + sz) / 3.0)
    return (
        edge * sx,
        edge * sy,
        edge * sz,
        mean,
        mass * ax + fx,
        mass * ay + fy,
        mass * (az - gravity) + fz,
        zeta * critical_translation,
        zeta * critical_rotation,
    )


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
def surface_place(m: ti.template(), k, s, plan: ti.template(), surface: ti.template()):
    """Position and mean size of a surface voxel."""
    voxel = plan[VOXEL] + surface[SURFACE_COLUMNS * s + SURFACE_VOXEL]
    size = load(m, k, plan[CURRENT] + surface[SURFACE_COLUMNS * s + SURFACE_GROUP] + MEAN_SIZE)
    return load(m, k, voxel), load(m, k, voxel + 1), load(m, k, voxel + 2), size


@ti.func
def contact_slots(s1, s2, plan: ti.template(), surface: ti.template()):
    """Slots of inverse masses, stiffnesses and damping coefficients of two surface voxels."""
    c1 = plan[CONSTANT] + surface[SURFACE_COLUMNS * s1 + SURFACE_GROUP]
    c2 = plan[CONSTANT] + surface[SURFACE_COLUMNS * s2 + SURFACE_GROUP]
    return (
        c1 + INVERSE_MASS,
        c2 + INVERSE_MASS,
        c1 + STIFFNESS,
        c2 + STIFFNESS,
        c1 + CONTACT_DAMPING,
        c2 + CONTACT_DAMPING,
    )


@ti.func
def motion_slots(base, s, plan: ti.template(), surface: ti.template()):
    """Slots of position and momentum of a surface voxel."""
    voxel = base + plan[VOXEL] + surface[SURFACE_COLUMNS * s + SURFACE_VOXEL]
    return voxel, voxel + 1, voxel + 2, voxel + MOMENTUM, voxel + MOMENTUM + 1, voxel + MOMENTUM + 2


@ti.func
def contact_force(
    m: ti.template(), k, s1, s2, dx, dy, dz, limit, near: ti.template(), plan: ti.template(), surface: ti.template()
):
    """Force on the second of two surface voxels that touch where ``near``; the first feels the opposite."""
    _, _, _, px, py, pz = load_all(m, k, motion_slots(0, s1, plan, surface))
    _, _, _, qx, qy, qz = load_all(m, k, motion_slots(0, s2, plan, surface))
    w1, w2, k1, k2, c1, c2 = load_all(m, k, contact_slots(s1, s2, plan, surface))
    return contact.force_between(dx, dy, dz, limit, px, py, pz, qx, qy, qz, w1, w2, k1, k2, c1, c2, near)


@ti.func
def square_places(base, q, plan: ti.template(), square_table: ti.template()):
    """Slots of the positions of the corners of a square."""
    v = base + plan[VOXEL]
    a = v + square_table[q * SQUARE_COLUMNS] * VOXEL_WIDTH
    b = v + square_table[q * SQUARE_COLUMNS + 1] * VOXEL_WIDTH
    c = v + square_table[q * SQUARE_COLUMNS + 2] * VOXEL_WIDTH
    d = v + square_table[q * SQUARE_COLUMNS + 3] * VOXEL_WIDTH
    return a, a + 1, a + 2, b, b + 1, b + 2, c, c + 1, c + 2, d, d + 1, d + 2


@ti.func
def square_pressures(q, plan: ti.template(), square_table: ti.template(), voxel_table: ti.template()):
    """Slots of the pressures of the corners of a square."""
    p = plan[CHANNEL] + PRESSURE * CHANNEL_WIDTH + VALUE
    return (
        p + voxel_table[square_table[q * SQUARE_COLUMNS] * VOXEL_COLUMNS + CHANNELS],
        p + voxel_table[square_table[q * SQUARE_COLUMNS + 1] * VOXEL_COLUMNS + CHANNELS],
        p + voxel_table[square_table[q * SQUARE_COLUMNS + 2] * VOXEL_COLUMNS + CHANNELS],
        p + voxel_table[square_table[q * SQUARE_COLUMNS + 3] * VOXEL_COLUMNS + CHANNELS],
    )


@ti.func
def square_stage(m: ti.template(), k, q, plan: ti.template(), square_table: ti.template(), voxel_table: ti.template()):
    """Forces of the pressure on the corners of a square."""
    x0, y0, z0, x1, y1, z1, x2, y2, z2, x3, y3, z3 = load_all(m, k, square_places(0, q, plan, square_table))
    p0, p1, p2, p3 = load_all(m, k, square_pressures(q, plan, square_table, voxel_table))
    forces = enclosure.pressed_square(x0, y0, z0, x1, y1, z1, x2, y2, z2, x3, y3, z3, p0, p1, p2, p3)
    first = plan[PRESSED] + q * PRESSED_WIDTH
    store_all(m, k, ti.static([first + i for i in range(PRESSED_WIDTH)]), forces)


@ti.func
def add_pressure(
    m: ti.template(), k, v, fx, fy, fz, plan: ti.template(), voxel_table: ti.template(), corner_table: ti.template()
):
    """A force on voxel v, and that of the pressure on the squares around it, in ascending order."""
    row = v * VOXEL_COLUMNS
    for i in range(voxel_table[row + FIRST_CORNER], voxel_table[row + END_CORNER]):
        slot = plan[PRESSED] + corner_table[i]
        fx, fy, fz = fx + load(m, k, slot), fy + load(m, k, slot + 1), fz + load(m, k, slot + 2)
    return fx, fy, fz
