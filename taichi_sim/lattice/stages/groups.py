"""Channels, what follows from them for every group of voxels, and rest lengths: the first stage of a step, and back.

A stage loads reals, applies laws and stores; all drivers run the same ones. ``m`` is the memory of all robots and k a
robot's or block's key to it (see ``lanes.load``); ``t`` is what the robots share (see ``columns.Shared``). Slots are
given by functions that a stage and its reverse share. The reverse of a stage takes ``u``, see ``columns.Undo``.
"""

from taichi_sim.autodiff.lanes import accumulate_all, consecutive, load, load_all, store, store_all
from taichi_sim.autodiff.tracing import pull_back
from taichi_sim.lattice.laws import group as laws
from taichi_sim.lattice.materials import CONSTANT_COLUMNS, CRITICAL_ROTATION, CRITICAL_TRANSLATION, EXPANSION, MASS
from taichi_sim.lattice.program import QUANTITY_COUNT
from taichi_sim.lattice.stages import columns, memory
from taichi_sim.lattice.stages.memory import AGE, BASE, CHANNEL, CHANNEL_WIDTH, CURRENT, CURRENT_WIDTH, RATE, VALUE
from taichi_sim.runtime import ti


@ti.func
def channel_slot(v, quantity: ti.template(), t: ti.template()):
    """Slot of the value of a channel of voxel v's group."""
    channels = t.voxel[v * columns.VOXEL_COLUMNS + columns.CHANNELS]
    return t.plan[CHANNEL] + channels + quantity * CHANNEL_WIDTH + VALUE


@ti.func
def size_slots(channel, g, t: ti.template()):
    """Slots of what the rest sizes of group g follow from, see ``laws.grown_scales``, from those of its channels."""
    return (
        t.plan[memory.CONSTANT] + g * CONSTANT_COLUMNS + EXPANSION,
        channel + columns.TEMPERATURE * CHANNEL_WIDTH,
        channel + columns.SCALE * CHANNEL_WIDTH,
        channel + (columns.SCALE + 1) * CHANNEL_WIDTH,
        channel + (columns.SCALE + 2) * CHANNEL_WIDTH,
    )


@ti.func
def group_slots(g, t: ti.template()):
    """Slots of the numbers from which the state of group g follows, see ``laws.group_state``."""
    constant = t.plan[memory.CONSTANT] + g * CONSTANT_COLUMNS
    value = t.plan[CHANNEL] + g * columns.CHANNELS_PER_GROUP + VALUE
    return size_slots(value, g, t) + (
        constant + MASS,
        value + columns.ACCELERATION * CHANNEL_WIDTH,
        value + (columns.ACCELERATION + 1) * CHANNEL_WIDTH,
        value + (columns.ACCELERATION + 2) * CHANNEL_WIDTH,
        value + columns.FORCE * CHANNEL_WIDTH,
        value + (columns.FORCE + 1) * CHANNEL_WIDTH,
        value + (columns.FORCE + 2) * CHANNEL_WIDTH,
        value + columns.GLOBAL_DAMPING * CHANNEL_WIDTH,
        constant + CRITICAL_TRANSLATION,
        constant + CRITICAL_ROTATION,
    )


@ti.func
def rest_slots(i, t: ti.template()):
    """Slots of the sizes of the two groups whose rest length is number i."""
    side = t.plan[CURRENT] + memory.SIZE + t.rest[i, columns.REST_AXIS]
    minus, plus = t.rest[i, columns.REST_MINUS], t.rest[i, columns.REST_PLUS]
    return side + minus * CURRENT_WIDTH, side + plus * CURRENT_WIDTH


@ti.func
def group_stage(m: ti.template(), k, t: ti.template()):
    """Evaluate every channel for this step, and what follows from it."""
    for i in range(t.plan[memory.GROUPS] * QUANTITY_COUNT):
        slot = t.plan[CHANNEL] + i * CHANNEL_WIDTH
        base, rate, age = load_all(m, k, (slot + BASE, slot + RATE, slot + AGE))
        store(m, k, slot + VALUE, laws.channel_value(base, rate, age))
        store(m, k, slot + AGE, age + 1.0)
    derive(m, k, t)


@ti.func
def derive(m: ti.template(), k, t: ti.template()):
    """Sizes, external force and damping of every group, and rest lengths, from the values of its channels."""
    for g in range(t.plan[memory.GROUPS]):
        values = load_all(m, k, group_slots(g, t))
        state = laws.group_state(*values, t.edge, t.gravity)
        store_all(m, k, consecutive(t.plan[CURRENT] + g * CURRENT_WIDTH, CURRENT_WIDTH), state)
    for i in range(t.plan[memory.RESTS]):
        minus, plus = load_all(m, k, rest_slots(i, t))
        length = laws.rest_length(minus, plus)
        store_all(m, k, consecutive(t.plan[memory.REST] + i * memory.REST_WIDTH, memory.REST_WIDTH), length)


@ti.func
def recall_groups(m: ti.template(), k, record: ti.template(), r, new, t: ti.template()):
    """Put the parameters' memory into the state that it had in the step that led to the record at ``new``."""
    for i in range(t.plan[memory.GROUPS] * QUANTITY_COUNT):
        slot = t.plan[CHANNEL] + i * CHANNEL_WIDTH + VALUE
        store(m, k, slot, load(record, r, new + slot))
    derive(m, k, t)


@ti.func
def group_adjoint(u: ti.template(), t: ti.template()):
    """Reverse the stage; adds to the cotangents of the channels' bases and rates."""
    for i in range(t.plan[memory.RESTS]):
        slots = rest_slots(i, t)
        given = take_all(u, consecutive(t.plan[memory.REST] + i * memory.REST_WIDTH, memory.REST_WIDTH))
        accumulate_all(u.a, u.k, slots, ti.static(pull_back(laws.rest_length, load_all(u.m, u.k, slots), (), given)))
    for g in range(t.plan[memory.GROUPS]):
        slots = group_slots(g, t)
        given = take_all(u, consecutive(t.plan[CURRENT] + g * CURRENT_WIDTH, CURRENT_WIDTH))
        values = load_all(u.m, u.k, slots)
        accumulate_all(u.a, u.k, slots, ti.static(pull_back(laws.group_state, values, (t.edge, t.gravity), given)))
    for i in range(t.plan[memory.GROUPS] * QUANTITY_COUNT):
        slot = t.plan[CHANNEL] + i * CHANNEL_WIDTH
        age = load(u.record, u.r, u.new + slot + AGE) - 1.0  # it is counted on at once
        inputs = load_all(u.record, u.r, (u.new + slot + BASE, u.new + slot + RATE))
        given = take_all(u, (slot + VALUE,))
        accumulate_all(
            u.a, u.k, (slot + BASE, slot + RATE), ti.static(pull_back(laws.channel_value, inputs, (age,), given))
        )


@ti.func
def take_all(u: ti.template(), slots: ti.template()):
    """Cotangents of slots that a step computes anew, and that nothing else depends on: they are zero afterwards."""
    given = load_all(u.a, u.k, slots)
    for i in ti.static(range(len(slots))):
        store(u.a, u.k, slots[i], 0.0 * given[i])
    return given
