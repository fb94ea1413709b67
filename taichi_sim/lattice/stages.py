"""The stages of a step that come before links and voxels: channels, rest lengths and contact between voxels.

A stage loads reals, applies a law and stores; both drivers run exactly the same ones. ``m`` is the memory of all robots
and k a robot's or block's key to it (see ``lanes.load``); ``plan`` says where the sections lie (see ``memory``). The
integer tables are shared by all robots and hold slots relative to a section (see ``columns``).
"""

from taichi_sim.lanes import larger, load, store
from taichi_sim.lattice import contact
from taichi_sim.lattice.columns import (
    ACCELERATION,
    CHANNELS_PER_GROUP,
    FORCE,
    GLOBAL_DAMPING,
    REST_AXIS,
    REST_MINUS,
    REST_PLUS,
    SCALE,
    SURFACE_COLUMNS,
    SURFACE_GROUP,
    SURFACE_VOXEL,
    TEMPERATURE,
)
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
from taichi_sim.lattice.memory import (
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
    PUSH,
    RATE,
    REST,
    REST_WIDTH,
    RESTS,
    SIZE,
    SPIN_DRAG,
    VALUE,
    VOXEL,
)
from taichi_sim.lattice.program import QUANTITY_COUNT
from taichi_sim.runtime import ti


@ti.func
def channel_value(m: ti.template(), k, channels, quantity):
    """Value in this step of one of the channels that begin at a slot."""
    return load(m, k, channels + quantity * CHANNEL_WIDTH + VALUE)


@ti.func
def advance_channels(m: ti.template(), k, plan: ti.template(), edge, gravity):
    """Evaluate every channel for this step and what follows from it: sizes, external force and damping."""
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
def surface_place(m: ti.template(), k, s, plan: ti.template(), surface: ti.template()):
    """Position and mean size of a surface voxel."""
    voxel = plan[VOXEL] + surface[SURFACE_COLUMNS * s + SURFACE_VOXEL]
    size = load(m, k, plan[CURRENT] + surface[SURFACE_COLUMNS * s + SURFACE_GROUP] + MEAN_SIZE)
    return load(m, k, voxel), load(m, k, voxel + 1), load(m, k, voxel + 2), size


@ti.func
def contact_force(
    m: ti.template(), k, s1, s2, dx, dy, dz, limit, near: ti.template(), plan: ti.template(), surface: ti.template()
):
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
