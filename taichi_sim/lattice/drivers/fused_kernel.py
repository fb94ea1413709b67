"""The fused driver: blocks of robots in native vector lanes, the time loop inside one kernel (CPU).

One pass over the voxels does links and integration together. It may, because voxels are visited in the order of
(x, y, z): when a voxel's own links are done all its links are, and nothing later needs its old state. Forces on
voxels ahead wait in a short ring. Memory traffic, the limit on a CPU, is thus one stream over state and memory.

Robots that end early are parked (copied away, later copied back); a diverged robot is put back to where its run
began, so that it cannot slow the others. Neither touches the other lanes.
"""

from functools import lru_cache
from typing import Any, NamedTuple

from taichi_sim.autodiff.lanes import Real, any_lane, consecutive, ints, larger, load, load_all, store_all
from taichi_sim.lattice.drivers import marks as marking
from taichi_sim.lattice.drivers.marks import mark_types
from taichi_sim.lattice.laws import contact
from taichi_sim.lattice.stages import columns, memory
from taichi_sim.lattice.stages.columns import in_variables, shared_types
from taichi_sim.lattice.stages.contact import contact_force, squared_move, surface_place
from taichi_sim.lattice.stages.enclosure import add_pressure, square_stage
from taichi_sim.lattice.stages.groups import group_stage
from taichi_sim.lattice.stages.link import end_slots, link_axes, link_stage
from taichi_sim.lattice.stages.memory import FORCE, MONITOR, STATE_SLOTS
from taichi_sim.lattice.stages.neighbours import LIST, NOWHERE, list_types, rebuild_lane
from taichi_sim.lattice.stages.voxel import gauge_stage, voxel_stage
from taichi_sim.runtime import GRAIN, kernel_of, ti

# Columns of the integers of a block; the first three belong to the neighbour list.
STEP, NEXT_MARK, STATE, LOGGED, KEPT = 3, 4, 5, 6, 7
INFO_COLUMNS = 8
RUNNING, FINISHED, OUT_OF_PAIRS = 0, 1, 2


class Record(NamedTuple):
    """States of the blocks before each of the steps ``first`` to ``first`` + room - 2, and the contacts of each.

    Attributes:
        kept: whether there is a record; known when a kernel is compiled.
        first: step of the first state.
        states, scalar_states: shape (blocks * room * state slots, lanes), as reals and as scalars.
        room: states a block.
        contacts: touching pairs (surface voxel, surface voxel, bits of lanes), shape (blocks, contacts, 3).
        start: first contact of each step, shape (blocks, room).
    """

    kept: bool = False
    first: Any = None
    states: Any = None
    scalar_states: Any = None
    room: Any = None
    contacts: Any = None
    start: Any = None


@ti.func
def park(ms: ti.template(), parked: ti.template(), block, k, lane, t: ti.template()):
    """Copy a robot's state away."""
    for slot in range(t.plan[STATE_SLOTS]):
        parked[block * t.plan[STATE_SLOTS] + slot, lane] = ms[k + slot, lane]


@ti.func
def handle_marks(
    ms: ti.template(),
    parked: ti.template(),
    block,
    k,
    step,
    width: ti.template(),
    t: ti.template(),
    marks: ti.template(),
    info: ti.template(),
):
    """Events due at a step; robots that end here are parked; the block ends with its last robot."""
    upcoming = NOWHERE
    active = 0
    for lane in range(width):
        if marks.lanes[block, lane, marking.STATE] == marking.ACTIVE:
            upcoming = ti.min(upcoming, marking.meet_events(ms, block, k, lane, step, t, marks))
            if marks.lanes[block, lane, marking.LENGTH] == step:
                marks.lanes[block, lane, marking.STATE] = marking.ENDED
                marks.lanes[block, lane, marking.STEP] = step
                park(ms, parked, block, k, lane, t)
            else:
                active += 1
                upcoming = ti.min(upcoming, marks.lanes[block, lane, marking.LENGTH])
    info[block, NEXT_MARK] = upcoming
    if active == 0:
        info[block, STATE] = FINISHED


@ti.func
def collide(m: ti.template(), block, k, t: ti.template(), lists: ti.template(), log: ti.template()):
    """Contact forces of all listed pairs, in the order of the list; pairs that touch are logged if asked for."""
    current = lists.info[block, LIST]
    for s in range(t.plan[memory.SURFACE]):
        first = lists.row[block, current, s]
        end = lists.row[block, current, s + 1]
        if first < end:
            x, y, z, size = surface_place(m, k, s, t)
            for q in range(first, end):
                other = lists.partner[block, current, q]
                ox, oy, oz, other_size = surface_place(m, k, other, t)
                dx = ox - x
                dy = oy - y
                dz = oz - z
                limit = contact.reach(size, other_size)
                bits = lists.mask[block, current, q]
                near = (dx * dx + dy * dy + dz * dz < limit * limit) & ((lists.bits[0] & bits) != 0)
                if any_lane(near):
                    fx, fy, fz = contact_force(m, k, s, other, dx, dy, dz, limit, near, t)
                    add_contact(m, block, k, s, 0.0 - fx, 0.0 - fy, 0.0 - fz, t, lists.touched)
                    add_contact(m, block, k, other, fx, fy, fz, t, lists.touched)
                    if ti.static(log.kept):
                        log_contact(block, s, other, bits, lists.info, log)


@ti.func
def log_contact(block, s, other, bits, info: ti.template(), log: ti.template()):
    """Note two surface voxels that touch and the robots that list them; what finds no room is counted only."""
    n = info[block, LOGGED]
    if n < log.contacts.shape[1]:
        log.contacts[block, n, 0] = s
        log.contacts[block, n, 1] = other
        log.contacts[block, n, 2] = bits
    info[block, LOGGED] = n + 1


@ti.func
def keep(m: ti.template(), block, k, step, t: ti.template(), info: ti.template(), log: ti.template()):
    """Copy a block's state before a step to its place in the record."""
    first = (block * log.room + step - log.first) * t.plan[STATE_SLOTS]
    for slot in range(t.plan[STATE_SLOTS]):
        log.states[first + slot] = m[k + slot]
    log.start[block, step - log.first] = info[block, LOGGED]


@ti.func
def add_contact(m: ti.template(), block, k, s, fx, fy, fz, t: ti.template(), touched: ti.template()):
    """Add a contact force to a surface voxel; sums are cleared when they are used, not in every step."""
    slots = consecutive(t.plan[memory.CONTACT] + 3 * s, 3)
    if touched[block, s] == 0:
        touched[block, s] = 1
        store_all(m, k, slots, (0.0 * fx, 0.0 * fy, 0.0 * fz))
    # All loads before the first store, after which the compiler must doubt every address.
    cx, cy, cz = load_all(m, k, slots)
    store_all(m, k, slots, (cx + fx, cy + fy, cz + fz))


@ti.func
def add_force(m: ti.template(), k, slots: ti.template(), sign: ti.template(), given: ti.template()):
    """Add a link's force and moment to a voxel's sums, or subtract them."""
    sums = load_all(m, k, slots)
    if ti.static(sign > 0):
        store_all(m, k, slots, ti.static(tuple([sums[i] + given[i] for i in range(6)])))
    else:
        store_all(m, k, slots, ti.static(tuple([sums[i] - given[i] for i in range(6)])))


@ti.func
def step_block(m: ti.template(), block, k, t: ti.template(), lists: ti.template(), log: ti.template()):
    """One time step of a block: channels, contact, pressure on squares, then links and integration voxel by voxel."""
    group_stage(m, k, t)
    if t.plan[memory.CONTACT_ON] != 0:
        collide(m, block, k, t, lists, log)
    for q in range(t.plan[memory.SQUARES]):
        square_stage(m, k, q, t)
    zero = 0.0 * load(m, k, t.plan[memory.CONSTANT])
    moved = zero
    for v in range(t.plan[memory.VOXELS]):
        here = t.plan[FORCE] + 6 * (v & t.plan[memory.RING_MASK])
        row = v * columns.VOXEL_COLUMNS
        for l in range(t.voxel[row + columns.FIRST_LINK], t.voxel[row + columns.END_LINK]):
            ends = link_stage(m, k, l, t)
            axes = link_axes(l, t)
            second = t.link[l * columns.LINK_COLUMNS + columns.LINK_SECOND] & t.plan[memory.RING_MASK]
            add_force(m, k, end_slots(here, axes), 1, ends[:6])
            add_force(m, k, end_slots(t.plan[FORCE] + 6 * second, axes), -1, ends[6:])
        cx, cy, cz = zero, zero, zero
        s = t.voxel[row + columns.SURFACE_SLOT]
        if s >= 0:
            if lists.touched[block, s] != 0:
                lists.touched[block, s] = 0
                cx, cy, cz = load_all(m, k, consecutive(t.plan[memory.CONTACT] + 3 * s, 3))
        fx, fy, fz, mx, my, mz = load_all(m, k, consecutive(here, 6))
        fx, fy, fz = add_pressure(m, k, v, fx, fy, fz, t)
        x, y, z = voxel_stage(m, k, v, fx, fy, fz, mx, my, mz, cx, cy, cz, t)
        store_all(m, k, consecutive(here, 6), (zero, zero, zero, zero, zero, zero))
        if t.voxel[row + columns.GAUGE] >= 0:
            gauge_stage(m, k, v, t)
        if s >= 0 and t.plan[memory.CONTACT_ON] != 0:
            moved = larger(squared_move(m, k, s, x, y, z, t), moved)
    store_all(m, k, (t.plan[MONITOR] + memory.MOVED,), (moved,))


@ti.func
def retire_diverged(
    ms: ti.template(),
    parked: ti.template(),
    block,
    k,
    step,
    width: ti.template(),
    t: ti.template(),
    lanes: ti.template(),
    info: ti.template(),
):
    """Note the step at which robots diverged and put them back to the start of the run, out of the others' way."""
    for lane in range(width):
        if ms[k + t.plan[MONITOR] + memory.DIVERGED, lane] > 0.5:
            ms[k + t.plan[MONITOR] + memory.DIVERGED, lane] = 0.0
            if lanes[block, lane, marking.STATE] == marking.ACTIVE:
                lanes[block, lane, marking.STATE] = marking.DIVERGED
                lanes[block, lane, marking.STEP] = step + 1
            for slot in range(t.plan[STATE_SLOTS]):
                ms[k + slot, lane] = parked[block * t.plan[STATE_SLOTS] + slot, lane]
    info[block, NEXT_MARK] = step + 1


@ti.func
def refresh_lists(
    ms: ti.template(),
    block,
    k,
    width: ti.template(),
    radius,
    distance,
    t: ti.template(),
    lists: ti.template(),
    lanes: ti.template(),
):
    """Build the lists of those robots again that have moved too far; halts the block if they do not fit."""
    for lane in range(width):
        moved = k + t.plan[MONITOR] + memory.MOVED
        if ms[moved, lane] > distance * distance and lanes[block, lane, marking.STATE] == marking.ACTIVE:
            fits = rebuild_lane(ms, block, k, lane, radius * radius, t, lists)
            if fits == 0:
                lists.info[block, STATE] = OUT_OF_PAIRS
            else:
                ms[moved, lane] = 0.0


class Memories(NamedTuple):
    """The blocks' memories as reals and as scalars, and the states of robots that are parked."""

    m: Any
    ms: Any
    parked: Any


class Launch(NamedTuple):
    """How many blocks there are, slots of each, most steps of each in this launch, and where all stop."""

    blocks: Any
    slots: Any
    steps: Any
    until: Any
    radius: Any
    distance: Any


@lru_cache
def fused_kernel(real: Real, recording: bool, fluid: bool) -> Any:
    """The kernel for one kind of real, on the ground or in a fluid; all else that differs is an argument.

    With ``recording`` it keeps the state before every step from the record's first on, and the contacts of each.
    """
    width = real.width

    @ti.func
    def run(
        launch: ti.template(),
        memories: ti.template(),
        given: ti.template(),
        lists: ti.template(),
        marks: ti.template(),
        log: ti.template(),
    ):
        m, ms, parked = ti.static(memories)
        plan, lanes, info = ti.static((given.plan, marks.lanes, lists.info))
        for i in range(GRAIN * launch.blocks):
            if i % GRAIN == 0:
                t = ti.static(in_variables(given))
                block = i // GRAIN
                k = block * launch.slots
                left = launch.steps
                while left > 0 and info[block, STATE] == RUNNING and info[block, STEP] < launch.until:
                    left -= 1
                    step = info[block, STEP]
                    if ti.static(log.kept):
                        if step != info[block, KEPT]:  # before the events of the step, and not again after a halt
                            keep(m, block, k, step, t, info, log)
                            info[block, KEPT] = step
                    if step == info[block, NEXT_MARK]:
                        handle_marks(ms, parked, block, k, step, width, t, marks, info)
                    if info[block, STATE] == RUNNING and plan[memory.CONTACT_ON] != 0:
                        if any_lane(load(m, k, plan[MONITOR] + memory.MOVED) > launch.distance * launch.distance):
                            refresh_lists(ms, block, k, width, launch.radius, launch.distance, t, lists, lanes)
                    if info[block, STATE] == RUNNING:
                        step_block(m, block, k, t, lists, log)
                        info[block, STEP] = step + 1
                        if ti.static(log.kept):
                            if step + 1 == launch.until:
                                keep(m, block, k, step + 1, t, info, log)
                        if any_lane(load(m, k, plan[MONITOR] + memory.DIVERGED) > 0.5):
                            retire_diverged(ms, parked, block, k, step, width, t, lanes, info)

    i32, scalar = ti.i32, real.scalar
    return kernel_of(
        run,
        Launch(i32, i32, i32, i32, scalar, scalar),
        Memories(real.memory, real.scalars(2), real.scalars(2)),
        shared_types(real, fluid),
        list_types(real),
        mark_types(real),
        Record(True, i32, real.memory, None, i32, ints(3), ints(2)) if recording else Record(),
    )
