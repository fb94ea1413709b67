"""Channels, what follows from them for every group of voxels, and rest lengths: the first stage of a step, and back.

A stage loads reals, applies laws and stores; all drivers run the same ones. ``m`` is the memory of all robots and k a
robot's or block's key to it (see ``lanes.load``); ``t`` is what the robots share (see ``columns.Shared``). Slots are
given by functions that a stage and its reverse share. The reverse of a stage takes ``u``, see ``undo.Undo``.
"""

from taichi_sim.autodiff.lanes import consecutive, load, load_all, slots_at, store, store_all
from taichi_sim.lattice.laws import group as laws
from taichi_sim.lattice.materials import CONSTANT_COLUMNS, CRITICAL_ROTATION, CRITICAL_TRANSLATION, EXPANSION, MASS
from taichi_sim.lattice.program import QUANTITY_COUNT
from taichi_sim.lattice.stages import columns, memory
from taichi_sim.lattice.stages.memory import AGE, BASE, CHANNEL, CHANNEL_WIDTH, CURRENT, CURRENT_WIDTH, RATE, VALUE
from taichi_sim.lattice.stages.undo import after, reverse, take_all
from taichi_sim.runtime import ti


@ti.func
def channels_of(v, t: ti.template()):
    """Slot of the value of the first channel of voxel v's group."""
    return t.plan[CHANNEL] + t.voxel[v * columns.VOXEL_COLUMNS + columns.CHANNELS] + VALUE


@ti.func
def size_slots(channel, g, t: ti.template()):
    """Slots of the numbers that ``laws.grown_scales`` takes for group g, whose channels begin at a slot."""
    return (t.plan[memory.CONSTANT] + g * CONSTANT_COLUMNS + EXPANSION,) + slots_at(channel, columns.SIZING)


@ti.func
def group_slots(g, t: ti.template()):
    """Slots of the numbers from which the state of group g follows, see ``laws.group_state``."""
    constant = t.plan[memory.CONSTANT] + g * CONSTANT_COLUMNS
    value = t.plan[CHANNEL] + g * columns.CHANNELS_PER_GROUP + VALUE
    loads = (constant + MASS,) + slots_at(value, columns.LOADING)
    return size_slots(value, g, t) + loads + slots_at(constant, (CRITICAL_TRANSLATION, CRITICAL_ROTATION))


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
        evaluate_channel(m, k, i, t)
    derive(m, k, t)


@ti.func
def evaluate_channel(m: ti.template(), k, i, t: ti.template()):
    """Evaluate channel i of all groups' channels for this step."""
    slot = t.plan[CHANNEL] + i * CHANNEL_WIDTH
    base, rate, age = load_all(m, k, (slot + BASE, slot + RATE, slot + AGE))
    store(m, k, slot + VALUE, laws.channel_value(base, rate, age))
    store(m, k, slot + AGE, age + 1.0)


@ti.func
def derive(m: ti.template(), k, t: ti.template()):
    """Compute all that follows from the values of all channels."""
    for g in range(t.plan[memory.GROUPS]):
        derive_group(m, k, g, t)
    for i in range(t.plan[memory.RESTS]):
        derive_rest(m, k, i, t)


@ti.func
def derive_group(m: ti.template(), k, g, t: ti.template()):
    """Sizes, external force and damping of group g from the values of its channels."""
    values = load_all(m, k, group_slots(g, t))
    state = laws.group_state(*values, t.edge, t.gravity)
    store_all(m, k, consecutive(t.plan[CURRENT] + g * CURRENT_WIDTH, CURRENT_WIDTH), state)


@ti.func
def derive_rest(m: ti.template(), k, i, t: ti.template()):
    """Rest length number i from the sizes of its groups."""
    minus, plus = load_all(m, k, rest_slots(i, t))
    length = laws.rest_length(minus, plus)
    store_all(m, k, consecutive(t.plan[memory.REST] + i * memory.REST_WIDTH, memory.REST_WIDTH), length)


@ti.func
def recall_groups(m: ti.template(), k, record: ti.template(), r, new, t: ti.template()):
    """Put the parameters' memory into the state that it had in the step that led to the record at ``new``."""
    for i in range(t.plan[memory.GROUPS] * QUANTITY_COUNT):
        recall_channel(m, k, i, record, r, new, t)
    derive(m, k, t)


@ti.func
def recall_channel(m: ti.template(), k, i, record: ti.template(), r, new, t: ti.template()):
    """Put the value of channel i into the state that it had in the step that led to the record at ``new``."""
    slot = t.plan[CHANNEL] + i * CHANNEL_WIDTH + VALUE
    store(m, k, slot, load(record, r, new + slot))


@ti.func
def group_adjoint(u: ti.template(), t: ti.template()):
    """Reverse the stage; adds to the cotangents of the channels' bases and rates."""
    rests_adjoint(u, t)
    for g in range(t.plan[memory.GROUPS]):
        state_adjoint(u, g, t)
    for i in range(t.plan[memory.GROUPS] * QUANTITY_COUNT):
        channel_adjoint(u, i, t)


@ti.func
def rests_adjoint(u: ti.template(), t: ti.template()):
    """Reverse all rest lengths, one after the other: several add to the cotangents of one size."""
    for i in range(t.plan[memory.RESTS]):
        given = take_all(u, consecutive(t.plan[memory.REST] + i * memory.REST_WIDTH, memory.REST_WIDTH))
        reverse(u, laws.rest_length, (), rest_slots(i, t), (), given)


@ti.func
def state_adjoint(u: ti.template(), g, t: ti.template()):
    """Reverse the state of group g."""
    given = take_all(u, consecutive(t.plan[CURRENT] + g * CURRENT_WIDTH, CURRENT_WIDTH))
    reverse(u, laws.group_state, (), group_slots(g, t), (t.edge, t.gravity), given)


@ti.func
def channel_adjoint(u: ti.template(), i, t: ti.template()):
    """Reverse the value of channel i of all groups' channels."""
    slot = t.plan[CHANNEL] + i * CHANNEL_WIDTH
    (later,) = after(u, (slot + AGE,))
    age = later - 1.0  # it is counted on at once
    given = take_all(u, (slot + VALUE,))
    reverse(ti.static(u._replace(old=u.new)), laws.channel_value, (slot + BASE, slot + RATE), (), (age,), given)
