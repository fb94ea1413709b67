"""The fused driver: blocks of robots in native vector lanes, the time loop inside one kernel (CPU).

One pass over the voxels does links and integration together. It may, because voxels are visited in the order of
(x, y, z): when a voxel's own links are done all its links are, and nothing later needs its old state. Forces on
voxels ahead wait in a short ring. Memory traffic, the limit on a CPU, is thus one stream over state and memory.

Robots that end early are parked (copied away, later copied back); a diverged robot is put back to where its run
began, so that it cannot slow the others. Neither touches the other lanes.
"""

from functools import lru_cache
from typing import Any

from taichi_sim.autodiff.lanes import NATIVE_WIDTH, Real, any_lane, larger, load, store
from taichi_sim.lattice.laws import contact
from taichi_sim.lattice.materials import CONSTANT_COLUMNS, EXPANSION
from taichi_sim.lattice.stages import columns
from taichi_sim.lattice.stages import forcing as stages
from taichi_sim.lattice.stages.link import link_stage
from taichi_sim.lattice.stages.memory import (
    AGE,
    BASE,
    CHANNEL,
    CHANNEL_WIDTH,
    CONSTANT,
    CONTACT,
    CONTACT_ON,
    CURRENT,
    CURRENT_WIDTH,
    DIVERGED,
    FORCE,
    GROUPS,
    LINK,
    LINK_WIDTH,
    LINKS,
    MONITOR,
    MOVED,
    RATE,
    REST,
    RING_MASK,
    SIZE,
    SQUARES,
    STATE_SLOTS,
    SURFACE,
    VOXEL,
    VOXEL_WIDTH,
    VOXELS,
)
from taichi_sim.lattice.stages.neighbours import LIST, NOWHERE, rebuild_lane
from taichi_sim.lattice.stages.voxel import gauge_stage, squared_move, voxel_stage
from taichi_sim.runtime import GRAIN, ti

# Columns of the integers of a block; the first three belong to the watch list.
INFO_STEP, INFO_NEXT_MARK, INFO_STATE, INFO_LOGGED, INFO_KEPT = 3, 4, 5, 6, 7
INFO_COLUMNS = 8
RUNNING, FINISHED, OUT_OF_PAIRS = 0, 1, 2

# Columns of the integers of a lane.
LANE_EVENT, LANE_LAST_EVENT, LANE_LENGTH, LANE_STATE, LANE_STEP, LANE_ROBOT = range(6)
LANE_COLUMNS = 6
LANE_ACTIVE, LANE_ENDED, LANE_DIVERGED = 0, 1, 2


@ti.func
def park(ms: ti.template(), parked: ti.template(), block, k, lane, plan: ti.template()):
    """Copy a robot's state away."""
    for slot in range(plan[STATE_SLOTS]):
        parked[block * plan[STATE_SLOTS] + slot, lane] = ms[k + slot, lane]


@ti.func
def apply_event(
    ms: ti.template(),
    k,
    lane,
    e,
    robot,
    plan: ti.template(),
    link_table: ti.template(),
    event: ti.template(),
    event_value: ti.template(),
    edge,
    poses: ti.template(),
    strains: ti.template(),
    sizes: ti.template(),
):
    """Set a channel, or record the robot's pose, strains and rest sizes if the event's target is negative."""
    target = event[e, 1]
    if target >= 0:
        slot = k + plan[CHANNEL] + target * CHANNEL_WIDTH
        ms[slot + BASE, lane] = event_value[e, 0]
        ms[slot + RATE, lane] = event_value[e, 1]
        ms[slot + AGE, lane] = 0.0
    else:
        for v in range(plan[VOXELS]):
            for c in range(7):
                poses[robot, 0 - target - 1, v, c] = ms[k + plan[VOXEL] + v * VOXEL_WIDTH + c, lane]
        for l in range(plan[LINKS]):
            rest = plan[REST] + link_table[l * columns.LINK_COLUMNS + columns.LINK_REST] + 1
            strains[robot, 0 - target - 1, l] = ms[k + plan[LINK] + l * LINK_WIDTH, lane] * ms[k + rest, lane]
        record_sizes(ms, k, lane, robot, 0 - target - 1, event[e, 0], edge, plan, sizes)


@ti.func
def record_sizes(ms: ti.template(), k, lane, robot, slot, t, edge, plan: ti.template(), sizes: ti.template()):
    """Rest sizes of every group: those of the last step, or at the start those with which the first one begins."""
    for g in range(plan[GROUPS]):
        if t > 0:
            for c in ti.static(range(3)):
                sizes[robot, slot, g, c] = ms[k + plan[CURRENT] + g * CURRENT_WIDTH + SIZE + c, lane]
        else:
            channels = k + plan[CHANNEL] + g * columns.CHANNELS_PER_GROUP
            x, y, z = stages.grown_scales(
                ms[k + plan[CONSTANT] + g * CONSTANT_COLUMNS + EXPANSION, lane],
                next_value(ms, channels + columns.TEMPERATURE * CHANNEL_WIDTH, lane),
                next_value(ms, channels + columns.SCALE * CHANNEL_WIDTH, lane),
                next_value(ms, channels + (columns.SCALE + 1) * CHANNEL_WIDTH, lane),
                next_value(ms, channels + (columns.SCALE + 2) * CHANNEL_WIDTH, lane),
            )
            sizes[robot, slot, g, 0] = edge * x
            sizes[robot, slot, g, 1] = edge * y
            sizes[robot, slot, g, 2] = edge * z


@ti.func
def next_value(ms: ti.template(), slot, lane):
    """Value of a channel in the step that is about to begin."""
    return ms[slot + BASE, lane] + ms[slot + RATE, lane] * ms[slot + AGE, lane]


@ti.func
def handle_marks(
    ms: ti.template(),
    block,
    k,
    t,
    width: ti.template(),
    plan: ti.template(),
    link_table: ti.template(),
    lanes: ti.template(),
    info: ti.template(),
    event: ti.template(),
    event_value: ti.template(),
    parked: ti.template(),
    edge,
    poses: ti.template(),
    strains: ti.template(),
    sizes: ti.template(),
):
    """Events due at step t; robots that end here are parked; the block ends with its last robot."""
    upcoming = NOWHERE
    active = 0
    for lane in range(width):
        if lanes[block, lane, LANE_STATE] == LANE_ACTIVE:
            e = lanes[block, lane, LANE_EVENT]
            due = 1
            while due == 1:
                due = 0
                if e < lanes[block, lane, LANE_LAST_EVENT]:
                    if event[e, 0] <= t:
                        apply_event(
                            ms,
                            k,
                            lane,
                            e,
                            lanes[block, lane, LANE_ROBOT],
                            plan,
                            link_table,
                            event,
                            event_value,
                            edge,
                            poses,
                            strains,
                            sizes,
                        )
                        e += 1
                        due = 1
                    else:
                        upcoming = ti.min(upcoming, event[e, 0])
            lanes[block, lane, LANE_EVENT] = e
            if lanes[block, lane, LANE_LENGTH] == t:
                lanes[block, lane, LANE_STATE] = LANE_ENDED
                lanes[block, lane, LANE_STEP] = t
                park(ms, parked, block, k, lane, plan)
            else:
                active += 1
                upcoming = ti.min(upcoming, lanes[block, lane, LANE_LENGTH])
    info[block, INFO_NEXT_MARK] = upcoming
    if active == 0:
        info[block, INFO_STATE] = FINISHED


@ti.func
def collide(
    m: ti.template(),
    block,
    k,
    lane_bits,
    plan: ti.template(),
    surface: ti.template(),
    touched: ti.template(),
    row: ti.template(),
    partner: ti.template(),
    mask: ti.template(),
    info: ti.template(),
    recording: ti.template(),
    log: ti.template(),
):
    """Contact forces of all watched pairs, in the order of the list; pairs that touch are logged if asked for."""
    current = info[block, LIST]
    for s in range(plan[SURFACE]):
        first = row[block, current, s]
        end = row[block, current, s + 1]
        if first < end:
            x, y, z, size = stages.surface_place(m, k, s, plan, surface)
            for q in range(first, end):
                other = partner[block, current, q]
                ox, oy, oz, other_size = stages.surface_place(m, k, other, plan, surface)
                dx = ox - x
                dy = oy - y
                dz = oz - z
                limit = contact.reach(size, other_size)
                near = (dx * dx + dy * dy + dz * dz < limit * limit) & ((lane_bits & mask[block, current, q]) != 0)
                if any_lane(near):
                    fx, fy, fz = stages.contact_force(m, k, s, other, dx, dy, dz, limit, near, plan, surface)
                    add_contact(m, block, k, s, 0.0 - fx, 0.0 - fy, 0.0 - fz, plan, touched)
                    add_contact(m, block, k, other, fx, fy, fz, plan, touched)
                    if ti.static(recording):
                        log_contact(block, s, other, mask[block, current, q], info, log)


@ti.func
def log_contact(block, s, other, bits, info: ti.template(), log: ti.template()):
    """Note two surface voxels that touch and the robots that watch them; what finds no room is counted only."""
    n = info[block, INFO_LOGGED]
    if n < log.shape[1]:
        log[block, n, 0] = s
        log[block, n, 1] = other
        log[block, n, 2] = bits
    info[block, INFO_LOGGED] = n + 1


@ti.func
def keep(
    m: ti.template(),
    block,
    k,
    n,
    plan: ti.template(),
    info: ti.template(),
    states: ti.template(),
    room,
    log_first: ti.template(),
):
    """Copy a block's state to place n of its record."""
    first = (block * room + n) * plan[STATE_SLOTS]
    for slot in range(plan[STATE_SLOTS]):
        states[first + slot] = m[k + slot]
    log_first[block, n] = info[block, INFO_LOGGED]


@ti.func
def add_contact(m: ti.template(), block, k, s, fx, fy, fz, plan: ti.template(), touched: ti.template()):
    """Add a contact force to a surface voxel; sums are cleared when they are used, not in every step."""
    slot = plan[CONTACT] + 3 * s
    if touched[block, s] == 0:
        touched[block, s] = 1
        for c in ti.static(range(3)):
            store(m, k, slot + c, 0.0 * fx)
    store(m, k, slot, load(m, k, slot) + fx)
    store(m, k, slot + 1, load(m, k, slot + 1) + fy)
    store(m, k, slot + 2, load(m, k, slot + 2) + fz)


@ti.func
def add_force(m: ti.template(), k, slot, a, b, c, sign: ti.template(), fx, fy, fz, mx, my, mz):
    """Add a link's force and moment, link axis first, to a voxel's sums, or subtract it."""
    # All loads before the first store, after which the compiler must doubt every address.
    f0, f1, f2 = load(m, k, slot + a), load(m, k, slot + b), load(m, k, slot + c)
    m0, m1, m2 = load(m, k, slot + 3 + a), load(m, k, slot + 3 + b), load(m, k, slot + 3 + c)
    if ti.static(sign > 0):
        f0, f1, f2 = f0 + fx, f1 + fy, f2 + fz
        m0, m1, m2 = m0 + mx, m1 + my, m2 + mz
    else:
        f0, f1, f2 = f0 - fx, f1 - fy, f2 - fz
        m0, m1, m2 = m0 - mx, m1 - my, m2 - mz
    store(m, k, slot + a, f0)
    store(m, k, slot + b, f1)
    store(m, k, slot + c, f2)
    store(m, k, slot + 3 + a, m0)
    store(m, k, slot + 3 + b, m1)
    store(m, k, slot + 3 + c, m2)


@ti.func
def step(
    m: ti.template(),
    block,
    k,
    dt,
    edge,
    gravity,
    lane_bits,
    plan: ti.template(),
    link_table: ti.template(),
    voxel_table: ti.template(),
    rest_table: ti.template(),
    square_table: ti.template(),
    corner_table: ti.template(),
    surface: ti.template(),
    start: ti.template(),
    touched: ti.template(),
    row: ti.template(),
    partner: ti.template(),
    mask: ti.template(),
    info: ti.template(),
    recording: ti.template(),
    log: ti.template(),
    fluid: ti.template(),
):
    """One time step of a block: channels, contact, pressure on squares, then links and integration voxel by voxel."""
    stages.advance_channels(m, k, plan, edge, gravity)
    stages.update_rest_lengths(m, k, plan, rest_table)
    if plan[CONTACT_ON] != 0:
        collide(m, block, k, lane_bits, plan, surface, touched, row, partner, mask, info, recording, log)
    for q in range(plan[SQUARES]):
        stages.square_stage(m, k, q, plan, square_table, voxel_table)
    nought = 0.0 * load(m, k, plan[CONSTANT])
    moved = nought
    for v in range(plan[VOXELS]):
        here = plan[FORCE] + 6 * (v & plan[RING_MASK])
        entry = v * columns.VOXEL_COLUMNS
        for l in range(voxel_table[entry + columns.FIRST_LINK], voxel_table[entry + columns.END_LINK]):
            fx, fy, fz, mx, my, mz, gx, gy, gz, nx, ny, nz = link_stage(
                m, k, l, edge, plan, link_table, voxel_table, fluid
            )
            link = l * columns.LINK_COLUMNS
            a = link_table[link + columns.LINK_ALONG]
            b = link_table[link + columns.LINK_SIDE_1]
            c = link_table[link + columns.LINK_SIDE_2]
            add_force(m, k, here, a, b, c, 1, fx, fy, fz, mx, my, mz)
            there = plan[FORCE] + 6 * (link_table[link + columns.LINK_SECOND] & plan[RING_MASK])
            add_force(m, k, there, a, b, c, -1, gx, gy, gz, nx, ny, nz)
        cx, cy, cz = nought, nought, nought
        s = voxel_table[entry + columns.SURFACE_SLOT]
        if s >= 0:
            if touched[block, s] != 0:
                touched[block, s] = 0
                slot = plan[CONTACT] + 3 * s
                cx, cy, cz = load(m, k, slot), load(m, k, slot + 1), load(m, k, slot + 2)
        fx, fy, fz = stages.add_pressure(
            m, k, v, load(m, k, here), load(m, k, here + 1), load(m, k, here + 2), plan, voxel_table, corner_table
        )
        x, y, z = voxel_stage(
            m,
            k,
            v,
            dt,
            edge,
            fx,
            fy,
            fz,
            load(m, k, here + 3),
            load(m, k, here + 4),
            load(m, k, here + 5),
            cx,
            cy,
            cz,
            plan,
            voxel_table,
            start,
        )
        for c in ti.static(range(6)):
            store(m, k, here + c, nought)
        if voxel_table[entry + columns.GAUGE] >= 0:
            gauge_stage(m, k, v, plan, link_table, voxel_table)
        if s >= 0 and plan[CONTACT_ON] != 0:
            moved = larger(squared_move(m, k, s, x, y, z, plan), moved)
    store(m, k, plan[MONITOR] + MOVED, moved)


@ti.func
def retire_diverged(
    ms: ti.template(),
    block,
    k,
    t,
    width: ti.template(),
    plan: ti.template(),
    lanes: ti.template(),
    info: ti.template(),
    parked: ti.template(),
):
    """Note the step at which robots diverged and put them back to the start of the run, out of the others' way."""
    for lane in range(width):
        if ms[k + plan[MONITOR] + DIVERGED, lane] > 0.5:
            ms[k + plan[MONITOR] + DIVERGED, lane] = 0.0
            if lanes[block, lane, LANE_STATE] == LANE_ACTIVE:
                lanes[block, lane, LANE_STATE] = LANE_DIVERGED
                lanes[block, lane, LANE_STEP] = t + 1
            for slot in range(plan[STATE_SLOTS]):
                ms[k + slot, lane] = parked[block * plan[STATE_SLOTS] + slot, lane]
    info[block, INFO_NEXT_MARK] = t + 1


@ti.func
def refresh_watch(
    ms: ti.template(),
    block,
    k,
    width: ti.template(),
    bunch: ti.template(),
    radius,
    distance,
    plan: ti.template(),
    surface: ti.template(),
    excluded: ti.template(),
    scratch: ti.template(),
    scratch_s: ti.template(),
    near: ti.template(),
    near_s: ti.template(),
    fresh: ti.template(),
    row: ti.template(),
    partner: ti.template(),
    mask: ti.template(),
    info: ti.template(),
    lanes: ti.template(),
):
    """Build the lists of those robots again that have moved too far; halts the block if they do not fit."""
    for lane in range(width):
        moved = k + plan[MONITOR] + MOVED
        if ms[moved, lane] > distance * distance and lanes[block, lane, LANE_STATE] == LANE_ACTIVE:
            fits = rebuild_lane(
                ms,
                block,
                k,
                lane,
                bunch,
                radius * radius,
                plan,
                surface,
                excluded,
                scratch,
                scratch_s,
                near,
                near_s,
                fresh,
                row,
                partner,
                mask,
                info,
            )
            if fits == 0:
                info[block, INFO_STATE] = OUT_OF_PAIRS
            else:
                ms[moved, lane] = 0.0


@lru_cache
def fused_kernel(real: Real, recording: bool, fluid: bool) -> Any:
    """The kernel for one kind of real, on the ground or in a fluid; all else that differs is an argument.

    With ``recording`` it keeps the state before every step from step ``first`` on, and the contacts of each.
    """
    width = real.width
    bunch = NATIVE_WIDTH[real.precision]
    reals = ti.types.ndarray(dtype=real.type, ndim=1)
    bunches = ti.types.ndarray(dtype=ti.types.vector(bunch, real.scalar), ndim=3)
    bits_type = ti.types.ndarray(dtype=ti.i32 if width == 1 else ti.types.vector(width, ti.i32), ndim=1)
    flags = ti.types.ndarray(dtype=ti.types.vector(bunch, ti.i32), ndim=1)
    ints1, ints2, ints3 = (ti.types.ndarray(dtype=ti.i32, ndim=n) for n in (1, 2, 3))
    scalars2, scalars3, scalars4 = (ti.types.ndarray(dtype=real.scalar, ndim=n) for n in (2, 3, 4))

    @ti.kernel
    def run(
        blocks: ti.i32,
        slots: ti.i32,
        steps: ti.i32,
        until: ti.i32,
        dt: real.scalar,
        edge: real.scalar,
        gravity: real.scalar,
        watch_radius: real.scalar,
        rebuild_distance: real.scalar,
        m: reals,
        ms: scalars2,
        parked: scalars2,
        plan: ints1,
        link_table: ints1,
        voxel_table: ints1,
        rest_table: ints2,
        square_table: ints1,
        corner_table: ints1,
        surface: ints1,
        excluded: ints2,
        start: scalars2,
        bits: bits_type,
        scratch: bunches,
        scratch_s: scalars4,
        near: flags,
        near_s: ints2,
        touched: ints2,
        fresh: ints2,
        row: ints3,
        partner: ints3,
        mask: ints3,
        info: ints2,
        lanes: ints3,
        event: ints2,
        event_value: scalars2,
        poses: scalars4,
        strains: scalars3,
        sizes: scalars4,
        first: ti.i32,
        states: reals,
        room: ti.i32,
        log: ints3,
        log_first: ints2,
    ):
        for i in range(GRAIN * blocks):
            if i % GRAIN == 0:
                block = i // GRAIN
                k = block * slots
                left = steps
                while left > 0 and info[block, INFO_STATE] == RUNNING and info[block, INFO_STEP] < until:
                    left -= 1
                    t = info[block, INFO_STEP]
                    if ti.static(recording):
                        if t != info[block, INFO_KEPT]:  # before the events of step t, and not again after a halt
                            keep(m, block, k, t - first, plan, info, states, room, log_first)
                            info[block, INFO_KEPT] = t
                    if t == info[block, INFO_NEXT_MARK]:
                        handle_marks(
                            ms,
                            block,
                            k,
                            t,
                            width,
                            plan,
                            link_table,
                            lanes,
                            info,
                            event,
                            event_value,
                            parked,
                            edge,
                            poses,
                            strains,
                            sizes,
                        )
                    if info[block, INFO_STATE] == RUNNING and plan[CONTACT_ON] != 0:
                        if any_lane(load(m, k, plan[MONITOR] + MOVED) > rebuild_distance * rebuild_distance):
                            refresh_watch(
                                ms,
                                block,
                                k,
                                width,
                                bunch,
                                watch_radius,
                                rebuild_distance,
                                plan,
                                surface,
                                excluded,
                                scratch,
                                scratch_s,
                                near,
                                near_s,
                                fresh,
                                row,
                                partner,
                                mask,
                                info,
                                lanes,
                            )
                    if info[block, INFO_STATE] == RUNNING:
                        step(
                            m,
                            block,
                            k,
                            dt,
                            edge,
                            gravity,
                            bits[0],
                            plan,
                            link_table,
                            voxel_table,
                            rest_table,
                            square_table,
                            corner_table,
                            surface,
                            start,
                            touched,
                            row,
                            partner,
                            mask,
                            info,
                            recording,
                            log,
                            fluid,
                        )
                        info[block, INFO_STEP] = t + 1
                        if ti.static(recording):
                            if t + 1 == until:
                                keep(m, block, k, t + 1 - first, plan, info, states, room, log_first)
                        if any_lane(load(m, k, plan[MONITOR] + DIVERGED) > 0.5):
                            retire_diverged(ms, block, k, t, width, plan, lanes, info, parked)

    return run
