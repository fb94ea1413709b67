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
from taichi_sim.lattice.drivers.marks import Marks, mark_types
from taichi_sim.lattice.laws import contact
from taichi_sim.lattice.stages import columns, memory
from taichi_sim.lattice.stages.columns import in_variables, shared_types
from taichi_sim.lattice.stages.contact import contact_force, squared_move, surface_place
from taichi_sim.lattice.stages.enclosure import add_pressure, square_stage
from taichi_sim.lattice.stages.groups import group_stage
from taichi_sim.lattice.stages.link import end_slots, link_axes, link_stage
from taichi_sim.lattice.stages.memory import FORCE, MONITOR, STATE_SLOTS
from taichi_sim.lattice.stages.neighbours import LIST, NOWHERE, Lists, list_types, rebuild_lane
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


class Block(NamedTuple):
    """A block of robots in a kernel.

    Attributes:
        m, ms, parked: memories as reals and as scalars, and the states of parked robots.
        number, k, width: of the block; its first slot; its lanes.
        lists: neighbours of all blocks.
        marks: programs and recordings of all blocks.
        log: the record, if any.
    """

    m: Any
    ms: Any
    parked: Any
    number: Any
    k: Any
    width: int
    lists: Lists
    marks: Marks
    log: Record


@ti.func
def park(b: ti.template(), lane, t: ti.template()):
    """Copy a robot's state away."""
    for slot in range(t.plan[STATE_SLOTS]):
        b.parked[b.number * t.plan[STATE_SLOTS] + slot, lane] = b.ms[b.k + slot, lane]


@ti.func
def handle_marks(b: ti.template(), step, t: ti.template()):
    """Events due at a step; robots that end here are parked; the block ends with its last robot."""
    lanes, info = ti.static((b.marks.lanes, b.lists.info))
    upcoming = NOWHERE
    active = 0
    for lane in range(b.width):
        if lanes[b.number, lane, marking.STATE] == marking.ACTIVE:
            upcoming = ti.min(upcoming, marking.meet_events(b.ms, b.number, b.k, lane, step, t, b.marks))
            if lanes[b.number, lane, marking.LENGTH] == step:
                lanes[b.number, lane, marking.STATE] = marking.ENDED
                lanes[b.number, lane, marking.STEP] = step
                park(b, lane, t)
            else:
                active += 1
                upcoming = ti.min(upcoming, lanes[b.number, lane, marking.LENGTH])
    info[b.number, NEXT_MARK] = upcoming
    if active == 0:
        info[b.number, STATE] = FINISHED


@ti.func
def collide(b: ti.template(), t: ti.template()):
    """Contact forces of all listed pairs, in the order of the list; pairs that touch are logged if asked for."""
    lists = ti.static(b.lists)
    current = lists.info[b.number, LIST]
    for s in range(t.plan[memory.SURFACE]):
        first = lists.row[b.number, current, s]
        end = lists.row[b.number, current, s + 1]
        if first < end:
            x, y, z, size = surface_place(b.m, b.k, s, t)
            for q in range(first, end):
                other = lists.partner[b.number, current, q]
                ox, oy, oz, other_size = surface_place(b.m, b.k, other, t)
                dx = ox - x
                dy = oy - y
                dz = oz - z
                limit = contact.reach(size, other_size)
                bits = lists.mask[b.number, current, q]
                near = (dx * dx + dy * dy + dz * dz < limit * limit) & ((lists.bits[0] & bits) != 0)
                if any_lane(near):
                    fx, fy, fz = contact_force(b.m, b.k, s, other, dx, dy, dz, limit, near, t)
                    add_contact(b, s, 0.0 - fx, 0.0 - fy, 0.0 - fz, t)
                    add_contact(b, other, fx, fy, fz, t)
                    if ti.static(b.log.kept):
                        log_contact(b, s, other, bits)


@ti.func
def log_contact(b: ti.template(), s, other, bits):
    """Note two surface voxels that touch and the robots that list them; what finds no room is counted only."""
    n = b.lists.info[b.number, LOGGED]
    if n < b.log.contacts.shape[1]:
        b.log.contacts[b.number, n, 0] = s
        b.log.contacts[b.number, n, 1] = other
        b.log.contacts[b.number, n, 2] = bits
    b.lists.info[b.number, LOGGED] = n + 1


@ti.func
def keep(b: ti.template(), step, t: ti.template()):
    """Copy a block's state before a step to its place in the record."""
    first = (b.number * b.log.room + step - b.log.first) * t.plan[STATE_SLOTS]
    for slot in range(t.plan[STATE_SLOTS]):
        b.log.states[first + slot] = b.m[b.k + slot]
    b.log.start[b.number, step - b.log.first] = b.lists.info[b.number, LOGGED]


@ti.func
def add_contact(b: ti.template(), s, fx, fy, fz, t: ti.template()):
    """Add a contact force to a surface voxel; sums are cleared when they are used, not in every step."""
    slots = consecutive(t.plan[memory.CONTACT] + 3 * s, 3)
    if b.lists.touched[b.number, s] == 0:
        b.lists.touched[b.number, s] = 1
        store_all(b.m, b.k, slots, (0.0 * fx, 0.0 * fy, 0.0 * fz))
    # All loads before the first store, after which the compiler must doubt every address.
    cx, cy, cz = load_all(b.m, b.k, slots)
    store_all(b.m, b.k, slots, (cx + fx, cy + fy, cz + fz))


@ti.func
def add_force(m: ti.template(), k, slots: ti.template(), sign: ti.template(), given: ti.template()):
    """Add a link's force and moment to a voxel's sums, or subtract them."""
    sums = load_all(m, k, slots)
    if ti.static(sign > 0):
        store_all(m, k, slots, ti.static(tuple([sums[i] + given[i] for i in range(6)])))
    else:
        store_all(m, k, slots, ti.static(tuple([sums[i] - given[i] for i in range(6)])))


@ti.func
def step_block(b: ti.template(), t: ti.template()):
    """One time step of a block: channels, contact, pressure on squares, then links and integration voxel by voxel."""
    m, k, touched = ti.static((b.m, b.k, b.lists.touched))
    group_stage(m, k, t)
    if t.plan[memory.CONTACT_ON] != 0:
        collide(b, t)
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
            if touched[b.number, s] != 0:
                touched[b.number, s] = 0
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
def retire_diverged(b: ti.template(), step, t: ti.template()):
    """Note the step at which robots diverged and put them back to the start of the run, out of the others' way."""
    lanes, diverged = ti.static((b.marks.lanes, b.k + t.plan[MONITOR] + memory.DIVERGED))
    for lane in range(b.width):
        if b.ms[diverged, lane] > 0.5:
            b.ms[diverged, lane] = 0.0
            if lanes[b.number, lane, marking.STATE] == marking.ACTIVE:
                lanes[b.number, lane, marking.STATE] = marking.DIVERGED
                lanes[b.number, lane, marking.STEP] = step + 1
            for slot in range(t.plan[STATE_SLOTS]):
                b.ms[b.k + slot, lane] = b.parked[b.number * t.plan[STATE_SLOTS] + slot, lane]
    b.lists.info[b.number, NEXT_MARK] = step + 1


@ti.func
def refresh_lists(b: ti.template(), radius, distance, t: ti.template()):
    """Build the lists of those robots again that have moved too far; halts the block if they do not fit."""
    moved = b.k + t.plan[MONITOR] + memory.MOVED
    for lane in range(b.width):
        active = b.marks.lanes[b.number, lane, marking.STATE] == marking.ACTIVE
        if b.ms[moved, lane] > distance * distance and active:
            if rebuild_lane(b.ms, b.number, b.k, lane, radius * radius, t, b.lists) == 0:
                b.lists.info[b.number, STATE] = OUT_OF_PAIRS
            else:
                b.ms[moved, lane] = 0.0


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

    @ti.func
    def run(
        launch: ti.template(),
        memories: ti.template(),
        given: ti.template(),
        lists: ti.template(),
        marks: ti.template(),
        log: ti.template(),
    ):
        info = ti.static(lists.info)
        for i in range(GRAIN * launch.blocks):
            if i % GRAIN == 0:
                t = ti.static(in_variables(given))
                block = i // GRAIN
                k = block * launch.slots
                b = ti.static(Block(memories.m, memories.ms, memories.parked, block, k, real.width, lists, marks, log))
                left = launch.steps
                while left > 0 and info[block, STATE] == RUNNING and info[block, STEP] < launch.until:
                    left -= 1
                    step = info[block, STEP]
                    if ti.static(recording):
                        if step != info[block, KEPT]:  # before the events of the step, and not again after a halt
                            keep(b, step, t)
                            info[block, KEPT] = step
                    if step == info[block, NEXT_MARK]:
                        handle_marks(b, step, t)
                    if info[block, STATE] == RUNNING and t.plan[memory.CONTACT_ON] != 0:
                        moved = load(b.m, k, t.plan[MONITOR] + memory.MOVED)
                        if any_lane(moved > launch.distance * launch.distance):
                            refresh_lists(b, launch.radius, launch.distance, t)
                    if info[block, STATE] == RUNNING:
                        step_block(b, t)
                        info[block, STEP] = step + 1
                        if ti.static(recording):
                            if step + 1 == launch.until:
                                keep(b, step + 1, t)
                        if any_lane(load(b.m, k, t.plan[MONITOR] + memory.DIVERGED) > 0.5):
                            retire_diverged(b, step, t)

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
