"""What happens to a robot at the marks of its program: events, recordings and its end; forwards and on the way back.

Marks are met robot by robot, so ``ms`` and the other memories here are seen as scalars [slot, lane]. All drivers share
these functions: a robot's integers are ``lanes[block, lane]``, and one of the stepped driver is a lane of block 0.
"""

from typing import Any, NamedTuple

import numpy as np

from taichi_sim.autodiff.lanes import Real, ints
from taichi_sim.autodiff.tracing import primitive, pull_back
from taichi_sim.lattice.laws import group as laws
from taichi_sim.lattice.program import QUANTITY_COUNT
from taichi_sim.lattice.stages import columns, memory
from taichi_sim.lattice.stages.groups import size_slots
from taichi_sim.lattice.stages.link import rest_slot
from taichi_sim.lattice.stages.memory import AGE, BASE, CHANNEL, CHANNEL_WIDTH, RATE
from taichi_sim.lattice.stages.tables import PackedProgram, Tables
from taichi_sim.runtime import element, emit, ti

# Columns of the integers of a lane: its next event, the range of its events, its steps, its state, when it ended.
EVENT, FIRST_EVENT, END_EVENT, LENGTH, STATE, STEP, ROBOT = range(7)
LANE_COLUMNS = 7
ACTIVE, ENDED, DIVERGED, WAITING = range(4)  # waiting, on the way back: beyond its last step
NO_MARK, NOWHERE = -1, 2**30  # steps before the first and beyond the last

Recordings = tuple[np.ndarray, np.ndarray, np.ndarray]


class Marks(NamedTuple):
    """A program and what robots record, as kernels see them.

    Attributes:
        lanes: integers of the lanes, shape (blocks, lanes, columns).
        event: step and target of each mark, see ``tables.PackedProgram``.
        value: base and rate of each.
        poses, strains, sizes: recorded, shapes (B, S, V, 7), (B, S, L), (B, S, G, 3); their cotangents on the way back.
        finals: cotangents of the last states, shape (B, V, 13), on the way back.
        by_value: cotangents of the marks' base and rate, likewise.
    """

    lanes: Any
    event: Any
    value: Any
    poses: Any
    strains: Any
    sizes: Any
    finals: Any = None
    by_value: Any = None


def mark_types(real: Real, back: bool = False) -> Marks:
    """Types of marks in kernels, or in kernels of the way back."""
    forwards = Marks(ints(3), ints(2), real.scalars(2), real.scalars(4), real.scalars(3), real.scalars(4))
    return forwards._replace(finals=real.scalars(3), by_value=real.scalars(2)) if back else forwards


def lane_table(program: PackedProgram, robots: np.ndarray, state: np.ndarray) -> np.ndarray:
    """Integers of lanes that run the program of these robots, at its start, shape of ``robots`` + (columns,)."""
    lanes = np.zeros((*robots.shape, LANE_COLUMNS), np.int32)
    lanes[..., EVENT] = lanes[..., FIRST_EVENT] = program.first[robots]
    lanes[..., END_EVENT], lanes[..., LENGTH] = program.first[robots + 1], program.lengths[robots]
    lanes[..., STATE], lanes[..., ROBOT] = state, robots
    return lanes


def lanes_back(lanes: np.ndarray) -> np.ndarray:
    """The integers of lanes for the way back: robots wait for their last steps, those that diverged do nothing."""
    back = lanes.copy()
    back[..., EVENT] = back[..., END_EVENT]
    back[..., STATE] = np.where(lanes[..., STATE] == DIVERGED, DIVERGED, WAITING)
    return back


def filled(array: np.ndarray, dtype: Any) -> np.ndarray:
    """The array as kernels take it: of one type, in one piece, not empty."""
    given = np.ascontiguousarray(array, dtype)
    return given if given.size else np.zeros((1,) * given.ndim, dtype)


def unrecorded(program: PackedProgram, batch: int, tables: Tables, dtype: Any) -> Recordings:
    """Room for what a program records: poses, strains and sizes of groups, NaN as long as nothing is."""
    slots = max(program.slots, 1)
    links, groups = max(len(tables.link_ends), 1), len(tables.group_region)
    shapes = ((batch, slots, len(tables.group), 7), (batch, slots, links), (batch, slots, groups, 3))
    poses, strains, sizes = (np.full(shape, np.nan, dtype) for shape in shapes)
    return poses, strains, sizes


@ti.func
def meet_events(ms: ti.template(), block, k, lane, step, t: ti.template(), marks: ti.template()):
    """The events and recordings of a robot that are due at a step; returns the step of its next one."""
    upcoming = NOWHERE
    e = marks.lanes[block, lane, EVENT]
    due = 1
    while due == 1:
        due = 0
        if e < marks.lanes[block, lane, END_EVENT]:
            if marks.event[e, 0] <= step:
                apply_event(ms, k, lane, e, marks.lanes[block, lane, ROBOT], t, marks)
                e += 1
                due = 1
            else:
                upcoming = marks.event[e, 0]
    marks.lanes[block, lane, EVENT] = e
    return upcoming


@ti.func
def apply_event(ms: ti.template(), k, lane, e, robot, t: ti.template(), marks: ti.template()):
    """Set a channel, or record the robot's pose, strains and rest sizes if the event's target is negative."""
    target = marks.event[e, 1]
    if target >= 0:
        set_channel(ms, k, lane, e, t, marks)
    else:
        snapshot = 0 - target - 1
        for v in range(t.plan[memory.VOXELS]):
            voxel = k + t.plan[memory.VOXEL] + v * memory.VOXEL_WIDTH
            for c in range(7):
                marks.poses[robot, snapshot, v, c] = ms[voxel + c, lane]
        for l in range(t.plan[memory.LINKS]):
            extension = ms[k + t.plan[memory.LINK] + l * memory.LINK_WIDTH, lane]
            marks.strains[robot, snapshot, l] = extension * ms[k + rest_slot(l, t) + 1, lane]
        record_sizes(ms, k, lane, e, robot, snapshot, t, marks)


@ti.func
def record_sizes(ms: ti.template(), k, lane, e, robot, snapshot, t: ti.template(), marks: ti.template()):
    """Record the rest sizes of a robot's groups."""
    for g in range(marks.sizes.shape[2]):
        if marks.event[e, 0] > 0:
            pack, place = of_group(g, lane, t)
            for c in ti.static(range(3)):
                marks.sizes[robot, snapshot, g, c] = ms[k + current_size(pack, t) + c, place]
        else:
            scales = laws.grown_scales(*first_sizes(ms, k, lane, g, t))
            for c in ti.static(range(3)):
                marks.sizes[robot, snapshot, g, c] = t.edge * scales[c]


@ti.func
def set_channel(ms: ti.template(), k, lane, e, t: ti.template(), marks: ti.template()):
    """Set a channel to what an event says."""
    slot, place = channel_of(marks.event[e, 1], lane, t)
    ms[k + slot + BASE, place] = marks.value[e, 0]
    ms[k + slot + RATE, place] = marks.value[e, 1]
    ms[k + slot + AGE, place] = 0.0


@primitive
def of_group(g: Any, lane: Any, t: columns.Shared) -> tuple[Any, Any]:
    """Item of a group in the sections of groups, and its lane: the robot's, or in packs of groups its own."""
    if not t.packed:
        return g, lane
    return emit(g // t.lanes.width), emit(g % t.lanes.width)


@primitive
def channel_of(target: Any, lane: Any, t: columns.Shared) -> tuple[Any, Any]:
    """Slot of a channel, and its lane, of the number that a mark gives: of the group, then of the quantity."""
    group = emit(target // QUANTITY_COUNT)
    pack, place = of_group(group, lane, t)
    number = target - group * QUANTITY_COUNT + pack * QUANTITY_COUNT
    return emit(element(t.plan, CHANNEL) + number * CHANNEL_WIDTH), place


@ti.func
def current_size(g, t: ti.template()):
    """Slot of the rest sizes that group g had in the last step."""
    return t.plan[memory.CURRENT] + g * memory.CURRENT_WIDTH + memory.SIZE


@ti.func
def first_sizes(ms: ti.template(), k, lane, g, t: ti.template()):
    """Thermal expansion, temperature and scales with which the first step of a run begins."""
    pack, place = of_group(g, lane, t)
    swells, warm, x, y, z = size_slots(t.plan[CHANNEL] + pack * columns.CHANNELS_PER_GROUP, pack, t)
    temperature, scale_x = next_value(ms, k + warm, place), next_value(ms, k + x, place)
    return ms[k + swells, place], temperature, scale_x, next_value(ms, k + y, place), next_value(ms, k + z, place)


@ti.func
def next_value(ms: ti.template(), slot, lane):
    """Value of a channel in the step that is about to begin."""
    return laws.channel_value(ms[slot + BASE, lane], ms[slot + RATE, lane], ms[slot + AGE, lane])


class Way(NamedTuple):
    """One robot on the way back through its marks, in any driver.

    Attributes:
        u: scalars of the groups' channels; its records are those before and after the step.
        block, lane: where the robot's integers stand.
        t: tables of the groups.
        end: function that makes the cotangents those of the last state, of a driver's own and the robot.
        receive: function that adds the cotangents of a recording, of a driver's own, the robot, snapshot and step.
        own: what a driver's two functions work on.
    """

    u: Any
    block: Any
    lane: Any
    t: Any
    end: Any
    receive: Any
    own: Any


@ti.func
def meet_events_back(way: ti.template(), step, marks: ti.template()):
    """Meet a step's marks on the way back: a run that ends here begins, events take cotangents, recordings give theirs.

    Returns the step before this one at which the robot has something to do again.
    """
    u, i, lane, t = ti.static((way.u, way.block, way.lane, way.t))
    upcoming = NO_MARK
    robot = marks.lanes[i, lane, ROBOT]
    if marks.lanes[i, lane, STATE] == WAITING:
        if marks.lanes[i, lane, LENGTH] == step:
            marks.lanes[i, lane, STATE] = ACTIVE
            way.end(way.own, robot, marks)
        else:
            upcoming = marks.lanes[i, lane, LENGTH]
    if marks.lanes[i, lane, STATE] == ACTIVE:
        e = marks.lanes[i, lane, EVENT]
        if step == 0:
            recall_start(u, lane, marks.lanes[i, lane, FIRST_EVENT], e, t, marks)
        due = 1
        while due == 1:
            due = 0
            if e > marks.lanes[i, lane, FIRST_EVENT]:
                if marks.event[e - 1, 0] >= step:
                    e -= 1
                    due = 1
                    if marks.event[e, 0] == step:
                        if marks.event[e, 1] >= 0:
                            take_event(u, lane, e, t, marks)
                        else:
                            way.receive(way.own, robot, 0 - marks.event[e, 1] - 1, step, marks)
                else:
                    upcoming = marks.event[e - 1, 0]
        marks.lanes[i, lane, EVENT] = e
    return upcoming


@ti.func
def take_event(u: ti.template(), lane, e, t: ti.template(), marks: ti.template()):
    """Move the cotangents of what an event set to the event."""
    slot, place = channel_of(marks.event[e, 1], lane, t)
    for c in ti.static((BASE, RATE)):
        marks.by_value[e, c] = u.a[u.k + slot + c, place]
        u.a[u.k + slot + c, place] = 0.0


@ti.func
def recall_start(u: ti.template(), lane, first, end, t: ti.template(), marks: ti.template()):
    """Put a robot's channels into the state in which its first step begins: as recorded, then set by its events."""
    first, count = lane, 1
    if ti.static(t.packed):
        count = t.lanes.width
    for place in range(first, first + count):
        for i in range(t.plan[memory.GROUPS] * QUANTITY_COUNT):
            slot = t.plan[CHANNEL] + i * CHANNEL_WIDTH
            for c in ti.static((BASE, RATE, AGE)):
                u.m[u.k + slot + c, place] = u.record[u.r + u.new + slot + c, place]
    for e in range(first, end):
        if marks.event[e, 0] == 0 and marks.event[e, 1] >= 0:
            set_channel(u.m, u.k, lane, e, t, marks)


@ti.func
def receive_sizes(u: ti.template(), lane, robot, snapshot, step, t: ti.template(), marks: ti.template()):
    """Add the cotangents of recorded rest sizes."""
    for g in range(marks.sizes.shape[2]):
        if step > 0:
            pack, place = of_group(g, lane, t)
            for c in ti.static(range(3)):
                u.a[u.k + current_size(pack, t) + c, place] += marks.sizes[robot, snapshot, g, c]
        else:
            receive_first_sizes(u, lane, robot, snapshot, g, t, marks)


@ti.func
def receive_first_sizes(u: ti.template(), lane, robot, snapshot, g, t: ti.template(), marks: ti.template()):
    """Add the cotangents of the sizes of group g with which a run begins."""
    inputs = first_sizes(u.m, u.k, lane, g, t)
    seeds = ti.static(tuple([t.edge * marks.sizes[robot, snapshot, g, c] for c in range(3)]))
    cotangents = ti.static(pull_back(laws.grown_scales, inputs, (), seeds))
    pack, place = of_group(g, lane, t)
    slots = size_slots(t.plan[CHANNEL] + pack * columns.CHANNELS_PER_GROUP, pack, t)
    u.a[u.k + slots[0], place] += cotangents[0]
    for i in ti.static(range(1, 5)):
        channel = u.k + slots[i]
        u.a[channel + BASE, place] += cotangents[i]
        u.a[channel + RATE, place] += cotangents[i] * u.m[channel + AGE, place]
