"""Reverse of the other stages of a step: contact, pressure on squares, rest lengths, groups, channels.

See ``link_adjoint`` for what the arguments hold.
"""

from taichi_sim.autodiff.lanes import accumulate, accumulate_all, load, load_all, store
from taichi_sim.autodiff.tracing import Condition, law, pull_back
from taichi_sim.lattice.laws import contact, enclosure
from taichi_sim.lattice.program import QUANTITY_COUNT
from taichi_sim.lattice.stages import forcing as stages
from taichi_sim.lattice.stages.columns import (
    REST_AXIS,
    REST_MINUS,
    REST_PLUS,
    SQUARE_COLUMNS,
    SURFACE_COLUMNS,
    SURFACE_GROUP,
    SURFACE_VOXEL,
)
from taichi_sim.lattice.stages.memory import (
    AGE,
    BASE,
    CHANNEL,
    CHANNEL_WIDTH,
    CURRENT,
    CURRENT_WIDTH,
    FORCE,
    GROUPS,
    MEAN_SIZE,
    RATE,
    REST,
    REST_WIDTH,
    RESTS,
    SIZE,
    VALUE,
    VOXEL_WIDTH,
)
from taichi_sim.runtime import ti


@law
def touching(x1, y1, z1, px, py, pz, x2, y2, z2, qx, qy, qz, size1, size2, w1, w2, k1, k2, c1, c2, near):
    """Force on the second of two surface voxels, from positions and momenta of both."""
    limit = contact.reach(size1, size2)
    return contact.force_between(x2 - x1, y2 - y1, z2 - z1, limit, px, py, pz, qx, qy, qz, w1, w2, k1, k2, c1, c2, near)


@ti.func
def contact_adjoint(
    m: ti.template(),
    k,
    rec: ti.template(),
    kr,
    base,
    a: ti.template(),
    s1,
    s2,
    near,
    plan: ti.template(),
    surface: ti.template(),
):
    """Reverse the contact of two surface voxels in the lanes where they are near."""
    f1 = force_slots(s1, plan, surface)
    f2 = force_slots(s2, plan, surface)
    u = load_all(a, k, f1)
    w = load_all(a, k, f2)
    seeds = (w[0] - u[0], w[1] - u[1], w[2] - u[2])
    constants = stages.contact_slots(s1, s2, plan, surface)
    sizes = (
        plan[CURRENT] + surface[SURFACE_COLUMNS * s1 + SURFACE_GROUP] + MEAN_SIZE,
        plan[CURRENT] + surface[SURFACE_COLUMNS * s2 + SURFACE_GROUP] + MEAN_SIZE,
    )
    inputs = (
        load_all(rec, kr, stages.motion_slots(base, s1, plan, surface))
        + load_all(rec, kr, stages.motion_slots(base, s2, plan, surface))
        + load_all(m, k, sizes)
        + load_all(m, k, constants)
    )
    g = ti.static(pull_back(touching, inputs, (Condition(near),), seeds))
    slots = stages.motion_slots(0, s1, plan, surface) + stages.motion_slots(0, s2, plan, surface) + sizes + constants
    accumulate_all(a, k, slots, g)


@ti.func
def are_near(m: ti.template(), k, rec: ti.template(), kr, base, s1, s2, plan: ti.template(), surface: ti.template()):
    """Where two surface voxels touch, decided as in the step itself."""
    x1, y1, z1, _, _, _ = load_all(rec, kr, stages.motion_slots(base, s1, plan, surface))
    x2, y2, z2, _, _, _ = load_all(rec, kr, stages.motion_slots(base, s2, plan, surface))
    size1 = load(m, k, plan[CURRENT] + surface[SURFACE_COLUMNS * s1 + SURFACE_GROUP] + MEAN_SIZE)
    size2 = load(m, k, plan[CURRENT] + surface[SURFACE_COLUMNS * s2 + SURFACE_GROUP] + MEAN_SIZE)
    limit = contact.reach(size1, size2)
    dx = x2 - x1
    dy = y2 - y1
    dz = z2 - z1
    return dx * dx + dy * dy + dz * dz < limit * limit


@ti.func
def force_slots(s, plan: ti.template(), surface: ti.template()):
    """Slots of the cotangents of the force on a surface voxel."""
    slot = plan[FORCE] + 6 * (surface[SURFACE_COLUMNS * s + SURFACE_VOXEL] // VOXEL_WIDTH)
    return slot, slot + 1, slot + 2


@ti.func
def square_adjoint(
    m: ti.template(),
    k,
    rec: ti.template(),
    kr,
    base,
    a: ti.template(),
    q,
    plan: ti.template(),
    square_table: ti.template(),
    voxel_table: ti.template(),
):
    """Reverse the pressure on a square."""
    pressures = stages.square_pressures(q, plan, square_table, voxel_table)
    places = load_all(rec, kr, stages.square_places(base, q, plan, square_table))
    seeds = load_all(a, k, square_forces(q, plan, square_table))
    g = ti.static(pull_back(enclosure.pressed_square, places + load_all(m, k, pressures), (), seeds))
    accumulate_all(a, k, stages.square_places(0, q, plan, square_table) + pressures, g)


@ti.func
def square_forces(q, plan: ti.template(), square_table: ti.template()):
    """Slots of the cotangents of the forces on the corners of a square."""
    f = plan[FORCE]
    i = f + 6 * square_table[q * SQUARE_COLUMNS]
    j = f + 6 * square_table[q * SQUARE_COLUMNS + 1]
    n = f + 6 * square_table[q * SQUARE_COLUMNS + 2]
    o = f + 6 * square_table[q * SQUARE_COLUMNS + 3]
    return i, i + 1, i + 2, j, j + 1, j + 2, n, n + 1, n + 2, o, o + 1, o + 2


@ti.func
def recall_channels(
    m: ti.template(), k, rec: ti.template(), kr, new, plan: ti.template(), rest_table: ti.template(), edge, gravity
):
    """Put the parameters' memory into the state that it had in the step that led to the record at ``new``."""
    for i in range(plan[GROUPS] * QUANTITY_COUNT):
        slot = plan[CHANNEL] + i * CHANNEL_WIDTH + VALUE
        store(m, k, slot, load(rec, kr, new + slot))
    stages.derive_current(m, k, plan, edge, gravity)
    stages.update_rest_lengths(m, k, plan, rest_table)


@ti.func
def group_adjoint(
    m: ti.template(),
    k,
    rec: ti.template(),
    kr,
    new,
    a: ti.template(),
    plan: ti.template(),
    rest_table: ti.template(),
    edge,
    gravity,
):
    """Reverse what follows from the channels; adds to the cotangents of their bases and rates."""
    for r in range(plan[RESTS]):
        slot = plan[REST] + r * REST_WIDTH
        inverse = load(m, k, slot + 1)
        g = 0.5 * (load(a, k, slot) - load(a, k, slot + 1) * inverse * inverse)
        side = plan[CURRENT] + SIZE + rest_table[r, REST_AXIS]
        accumulate(a, k, side + rest_table[r, REST_MINUS] * CURRENT_WIDTH, g)
        accumulate(a, k, side + rest_table[r, REST_PLUS] * CURRENT_WIDTH, g)
        store(a, k, slot, 0.0 * g)
        store(a, k, slot + 1, 0.0 * g)
    for g in range(plan[GROUPS]):
        current = plan[CURRENT] + g * CURRENT_WIDTH
        seeds = load_all(a, k, ti.static([current + i for i in range(CURRENT_WIDTH)]))
        slots = stages.group_slots(g, plan)
        accumulate_all(
            a, k, slots, ti.static(pull_back(stages.group_state, load_all(m, k, slots), (edge, gravity), seeds))
        )
        for i in ti.static(range(CURRENT_WIDTH)):
            store(a, k, current + i, 0.0 * seeds[i])
    for i in range(plan[GROUPS] * QUANTITY_COUNT):
        slot = plan[CHANNEL] + i * CHANNEL_WIDTH
        g = load(a, k, slot + VALUE)
        age = load(rec, kr, new + slot + AGE) - 1.0  # it is counted on at once
        accumulate(a, k, slot + BASE, g)
        accumulate(a, k, slot + RATE, g * age)
        store(a, k, slot + VALUE, 0.0 * g)
