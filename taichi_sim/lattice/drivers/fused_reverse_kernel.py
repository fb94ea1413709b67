"""The reverse of the fused driver: blocks of robots in lanes, from the last recorded step back to the first.

A step is undone in the opposite order: voxel by voxel from the last to the first, each with its gauges and its own
links, then pressure on squares, contacts, then what follows from the channels. Cotangents change in place from those
of the state after the step to those of the state before it.
"""

from functools import lru_cache
from typing import Any

from taichi_sim.autodiff.lanes import Real
from taichi_sim.autodiff.tracing import pull_back
from taichi_sim.lattice.drivers.fused_kernel import next_value
from taichi_sim.lattice.materials import CONSTANT_COLUMNS, EXPANSION
from taichi_sim.lattice.program import QUANTITY_COUNT
from taichi_sim.lattice.stages import columns
from taichi_sim.lattice.stages import forcing_adjoint as adjoint
from taichi_sim.lattice.stages.forcing import grown_scales
from taichi_sim.lattice.stages.link_adjoint import link_adjoint
from taichi_sim.lattice.stages.memory import (
    AGE,
    BASE,
    CHANNEL,
    CHANNEL_WIDTH,
    CONSTANT,
    CURRENT,
    CURRENT_WIDTH,
    GROUPS,
    LINK,
    LINK_WIDTH,
    LINKS,
    RATE,
    REST,
    SIZE,
    SQUARES,
    STATE_SLOTS,
    VOXEL,
    VOXEL_WIDTH,
    VOXELS,
)
from taichi_sim.lattice.stages.voxel_adjoint import gauge_adjoint, voxel_adjoint
from taichi_sim.runtime import GRAIN, ti

# Columns of the integers of a lane.
LANE_EVENT, LANE_FIRST_EVENT, LANE_LENGTH, LANE_STATE, LANE_ROBOT = range(5)
LANE_COLUMNS = 5
LANE_WAITING, LANE_ACTIVE, LANE_DEAD = 0, 1, 2  # beyond its last step; within its run; without a run
NO_MARK = -1


@ti.func
def undo_step(
    m: ti.template(),
    k,
    rec: ti.template(),
    kr,
    old,
    new,
    a: ti.template(),
    block,
    n,
    dt,
    edge,
    gravity,
    lane_bits,
    plan: ti.template(),
    link_table: ti.template(),
    voxel_table: ti.template(),
    rest_table: ti.template(),
    square_table: ti.template(),
    surface: ti.template(),
    log: ti.template(),
    log_first: ti.template(),
    fluid: ti.template(),
):
    """Reverse the step from the record at ``old`` to the one at ``new``."""
    adjoint.recall_channels(m, k, rec, kr, new, plan, rest_table, edge, gravity)
    for i in range(plan[VOXELS]):
        v = plan[VOXELS] - 1 - i
        entry = v * columns.VOXEL_COLUMNS
        if voxel_table[entry + columns.GAUGE] >= 0:
            gauge_adjoint(m, k, rec, kr, new, a, v, plan, link_table, voxel_table)
        voxel_adjoint(m, k, rec, kr, old, new, a, v, dt, edge, plan, voxel_table)
        for l in range(voxel_table[entry + columns.FIRST_LINK], voxel_table[entry + columns.END_LINK]):
            link_adjoint(m, k, rec, kr, old, a, l, edge, plan, link_table, voxel_table, fluid)
    for q in range(plan[SQUARES]):
        adjoint.square_adjoint(m, k, rec, kr, old, a, q, plan, square_table, voxel_table)
    for q in range(log_first[block, n], log_first[block, n + 1]):
        s1, s2 = log[block, q, 0], log[block, q, 1]
        near = adjoint.are_near(m, k, rec, kr, old, s1, s2, plan, surface) & ((lane_bits & log[block, q, 2]) != 0)
        adjoint.contact_adjoint(m, k, rec, kr, old, a, s1, s2, near, plan, surface)
    adjoint.group_adjoint(m, k, rec, kr, new, a, plan, rest_table, edge, gravity)


@ti.func
def receive_pose(
    asc: ti.template(),
    k,
    lane,
    ms: ti.template(),
    recs: ti.template(),
    kr,
    base,
    robot,
    slot,
    t,
    plan: ti.template(),
    link_table: ti.template(),
    poses: ti.template(),
    strains: ti.template(),
):
    """Add the cotangents of a recorded pose and of the strains of its links."""
    for v in range(plan[VOXELS]):
        for c in range(7):
            asc[k + plan[VOXEL] + v * VOXEL_WIDTH + c, lane] += poses[robot, slot, v, c]
    if t > 0:  # what links remember at the start of a run is given
        for l in range(plan[LINKS]):
            rest = k + plan[REST] + link_table[l * columns.LINK_COLUMNS + columns.LINK_REST] + 1
            link = plan[LINK] + l * LINK_WIDTH
            asc[k + link, lane] += strains[robot, slot, l] * ms[rest, lane]
            asc[rest, lane] += strains[robot, slot, l] * recs[kr + base + link, lane]


@ti.func
def receive_sizes(
    ms: ti.template(), asc: ti.template(), k, lane, robot, slot, t, edge, plan: ti.template(), sizes: ti.template()
):
    """Add the cotangents of recorded rest sizes to those of the last step; at the start, to the channels'."""
    for g in range(plan[GROUPS]):
        if t > 0:
            for c in ti.static(range(3)):
                asc[k + plan[CURRENT] + g * CURRENT_WIDTH + SIZE + c, lane] += sizes[robot, slot, g, c]
        else:
            swells = k + plan[CONSTANT] + g * CONSTANT_COLUMNS + EXPANSION
            channels = k + plan[CHANNEL] + g * columns.CHANNELS_PER_GROUP
            warm = channels + columns.TEMPERATURE * CHANNEL_WIDTH
            x = channels + columns.SCALE * CHANNEL_WIDTH
            y, z = x + CHANNEL_WIDTH, x + 2 * CHANNEL_WIDTH
            inputs = (
                ms[swells, lane],
                next_value(ms, warm, lane),
                next_value(ms, x, lane),
                next_value(ms, y, lane),
                next_value(ms, z, lane),
            )
            seeds = (
                edge * sizes[robot, slot, g, 0],
                edge * sizes[robot, slot, g, 1],
                edge * sizes[robot, slot, g, 2],
            )
            cotangents = ti.static(pull_back(grown_scales, inputs, (), seeds))
            asc[swells, lane] += cotangents[0]
            for i, channel in ti.static(enumerate((warm, x, y, z))):
                asc[channel + BASE, lane] += cotangents[i + 1]
                asc[channel + RATE, lane] += cotangents[i + 1] * ms[channel + AGE, lane]


@ti.func
def begin_channels(
    ms: ti.template(),
    recs: ti.template(),
    k,
    kr,
    base,
    lane,
    first,
    last,
    plan: ti.template(),
    event: ti.template(),
    given: ti.template(),
):
    """Put a robot's channels into the state in which its first step begins: as recorded, then set by its events."""
    for i in range(plan[GROUPS] * QUANTITY_COUNT):
        slot = plan[CHANNEL] + i * CHANNEL_WIDTH
        for c in ti.static((BASE, RATE, AGE)):
            ms[k + slot + c, lane] = recs[kr + base + slot + c, lane]
    for e in range(first, last):
        if event[e, 0] == 0 and event[e, 1] >= 0:
            slot = k + plan[CHANNEL] + event[e, 1] * CHANNEL_WIDTH
            ms[slot + BASE, lane] = given[e, 0]
            ms[slot + RATE, lane] = given[e, 1]
            ms[slot + AGE, lane] = 0.0


@ti.func
def meet_marks(
    ms: ti.template(),
    asc: ti.template(),
    recs: ti.template(),
    block,
    lane,
    k,
    kr,
    base,
    t,
    slots,
    edge,
    plan: ti.template(),
    link_table: ti.template(),
    lanes: ti.template(),
    event: ti.template(),
    event_given: ti.template(),
    event_value: ti.template(),
    poses: ti.template(),
    strains: ti.template(),
    sizes: ti.template(),
    finals: ti.template(),
):
    """A robot whose run ends at step t begins; events of step t take their cotangents; recorded poses give theirs.

    Returns the step before t at which the robot has something to do again.
    """
    upcoming = NO_MARK
    robot = lanes[block, lane, LANE_ROBOT]
    if lanes[block, lane, LANE_STATE] == LANE_WAITING:
        if lanes[block, lane, LANE_LENGTH] == t:
            lanes[block, lane, LANE_STATE] = LANE_ACTIVE
            for slot in range(slots):
                asc[k + slot, lane] = 0.0
            for v in range(plan[VOXELS]):
                for c in range(VOXEL_WIDTH - 1):
                    asc[k + plan[VOXEL] + v * VOXEL_WIDTH + c, lane] = finals[robot, v, c]
        else:
            upcoming = lanes[block, lane, LANE_LENGTH]
    if lanes[block, lane, LANE_STATE] == LANE_ACTIVE:
        e = lanes[block, lane, LANE_EVENT]
        if t == 0:
            begin_channels(
                ms, recs, k, kr, base, lane, lanes[block, lane, LANE_FIRST_EVENT], e, plan, event, event_given
            )
        due = 1
        while due == 1:
            due = 0
            if e > lanes[block, lane, LANE_FIRST_EVENT]:
                if event[e - 1, 0] >= t:
                    e -= 1
                    due = 1
                    target = event[e, 1]
                    if event[e, 0] == t and target >= 0:
                        slot = k + plan[CHANNEL] + target * CHANNEL_WIDTH
                        event_value[e, 0] = asc[slot + BASE, lane]
                        event_value[e, 1] = asc[slot + RATE, lane]
                        asc[slot + BASE, lane] = 0.0
                        asc[slot + RATE, lane] = 0.0
                    if event[e, 0] == t and target < 0:
                        receive_pose(
                            asc, k, lane, ms, recs, kr, base, robot, 0 - target - 1, t, plan, link_table, poses, strains
                        )
                        receive_sizes(ms, asc, k, lane, robot, 0 - target - 1, t, edge, plan, sizes)
                else:
                    upcoming = event[e - 1, 0]
        lanes[block, lane, LANE_EVENT] = e
    return upcoming


@lru_cache
def reverse_kernel(real: Real, fluid: bool) -> Any:
    """The kernel for one kind of real, on the ground or in a fluid."""
    width = real.width
    reals = ti.types.ndarray(dtype=real.type, ndim=1)
    bits_type = ti.types.ndarray(dtype=ti.i32 if width == 1 else ti.types.vector(width, ti.i32), ndim=1)
    ints1, ints2, ints3 = (ti.types.ndarray(dtype=ti.i32, ndim=n) for n in (1, 2, 3))
    scalars2, scalars3, scalars4 = (ti.types.ndarray(dtype=real.scalar, ndim=n) for n in (2, 3, 4))

    @ti.kernel
    def undo(
        blocks: ti.i32,
        slots: ti.i32,
        high: ti.i32,
        low: ti.i32,
        first: ti.i32,
        room: ti.i32,
        dt: real.scalar,
        edge: real.scalar,
        gravity: real.scalar,
        m: reals,
        ms: scalars2,
        a: reals,
        asc: scalars2,
        rec: reals,
        recs: scalars2,
        plan: ints1,
        link_table: ints1,
        voxel_table: ints1,
        rest_table: ints2,
        square_table: ints1,
        surface: ints1,
        bits: bits_type,
        log: ints3,
        log_first: ints2,
        lanes: ints3,
        info: ints1,
        event: ints2,
        event_given: scalars2,
        event_value: scalars2,
        poses: scalars4,
        strains: scalars3,
        sizes: scalars4,
        finals: scalars3,
    ):
        for i in range(GRAIN * blocks):
            if i % GRAIN == 0:
                block = i // GRAIN
                k = block * slots
                kr = block * room * plan[STATE_SLOTS]
                for back in range(high - low + 1):
                    t = high - back
                    base = (t - first) * plan[STATE_SLOTS]
                    if back > 0:
                        undo_step(
                            m,
                            k,
                            rec,
                            kr,
                            base,
                            base + plan[STATE_SLOTS],
                            a,
                            block,
                            t - first,
                            dt,
                            edge,
                            gravity,
                            bits[0],
                            plan,
                            link_table,
                            voxel_table,
                            rest_table,
                            square_table,
                            surface,
                            log,
                            log_first,
                            fluid,
                        )
                    if t == info[block]:
                        adjoint.recall_channels(m, k, rec, kr, base, plan, rest_table, edge, gravity)
                        upcoming = NO_MARK
                        for lane in range(width):
                            mark = meet_marks(
                                ms,
                                asc,
                                recs,
                                block,
                                lane,
                                k,
                                kr,
                                base,
                                t,
                                slots,
                                edge,
                                plan,
                                link_table,
                                lanes,
                                event,
                                event_given,
                                event_value,
                                poses,
                                strains,
                                sizes,
                                finals,
                            )
                            upcoming = ti.max(upcoming, mark)
                        info[block] = upcoming

    return undo
