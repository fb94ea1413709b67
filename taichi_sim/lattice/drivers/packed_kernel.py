"""The packed driver: one robot at a time, its voxels in native vector lanes, the time loop inside one kernel (CPU).

A step has five parts: what the program does to groups, which is then *spread* to the classes of packs
(lanes of equal groups); contact; pressure on squares; links, which leave their forces in memory; and voxels, which
fetch them from there in the order of their sides, so that sums have the bits of a robot in scalars. Robots are
independent of each other; threads take them one by one. See ``packs`` for how voxels lie.
"""

from functools import lru_cache
from typing import Any, NamedTuple

from taichi_sim.autodiff.lanes import (
    Real,
    any_lane,
    assign_all,
    consecutive,
    ints,
    larger,
    load,
    load_all,
    store_all,
    variables,
    vector,
)
from taichi_sim.autodiff.tracing import primitive, select
from taichi_sim.bundling import kernel_of
from taichi_sim.lattice.drivers import marks as marking
from taichi_sim.lattice.drivers.marks import mark_types
from taichi_sim.lattice.drivers.packed_contact import (
    CHANGING,
    FINISHED,
    FRESH,
    KEPT,
    LOGGED,
    NEXT_MARK,
    RUNNING,
    STATE,
    STEP,
    Pairs,
    Record,
    collide,
    renew_list,
)
from taichi_sim.lattice.drivers.packed_lanes import (
    END_QUANTITY,
    FIRST_QUANTITY,
    FORCE_WIDTH,
    FULL,
    GAUGED,
    LINK_ROW,
    PACK_ROW,
    READY,
    READY_END,
    SHARES,
    SPREAD_ROW,
    Lanes,
    PackedRobot,
    gather_all,
    lane_types,
    minus_all,
    of_groups,
    own_pack,
    plus_all,
    pose_slots,
    spread,
    with_lanes,
)
from taichi_sim.lattice.drivers.packed_rests import derive_rests, inverse_rest
from taichi_sim.lattice.laws import enclosure
from taichi_sim.lattice.laws import link as laws
from taichi_sim.lattice.program import QUANTITY_COUNT
from taichi_sim.lattice.stages import columns, memory
from taichi_sim.lattice.stages.columns import Medium, shared_types
from taichi_sim.lattice.stages.gauges import keep_strains, share_slots
from taichi_sim.lattice.stages.groups import group_stage
from taichi_sim.lattice.stages.link import link_axes, link_forces, past_slot
from taichi_sim.lattice.stages.voxel import voxel_stage
from taichi_sim.runtime import GRAIN, emit, ti


class Memories(NamedTuple):
    """The vector memory as reals and as scalars; that of groups as reals, as scalars, and as scalars [slot, lane]."""

    m: Any
    ms: Any
    g: Any
    gs: Any
    g2: Any


class Launch(NamedTuple):
    """Number of robots, slots of each in both memories, most steps of each, how far lists reach, and where all stop."""

    robots: Any
    slots: Any
    group_slots: Any
    steps: Any
    distance: Any
    until: Any


@ti.func
def link_pack(r: ti.template(), l):
    """Forces of a pack of links, left in FORCE in the order x, y, z."""
    k, m, ms, t, p = ti.static((r.k, r.m, r.ms, r.t, r.p))
    first = k + t.plan[memory.VOXEL]
    own = load_all(m, first, pose_slots(own_pack(l, t), l, t))
    beyond = plus_all(m, ms, first, memory.VOXEL_WIDTH, pose_slots(0, l, t), own, l, p)
    ends = link_forces(m, k, l, own, beyond, p.links[l * LINK_ROW + FULL], t)
    a, b, c = link_axes(l, t)
    place = t.plan[memory.FORCE] + l * FORCE_WIDTH
    for i in ti.static(range(0, 12, 3)):
        store_all(m, k, (place + i + a, place + i + b, place + i + c), ends[i : i + 3])
    if p.links[l * LINK_ROW + GAUGED] != 0:
        extension = load(m, k, past_slot(l, t))
        for side in ti.static(range(2)):
            share = laws.shared_strain(extension, *load_all(m, k, share_slots(l, 1 - side, t)))
            store_all(m, k, (place + SHARES + side,), (share,))


@ti.func
def axis_strain(r: ti.template(), v, axis: ti.template(), zero):
    """Mean of a pack's shares in the strains of its links along an axis."""
    k, m, ms, t, p = ti.static((r.k, r.m, r.ms, r.t, r.p))
    first = k + t.plan[memory.FORCE]
    total = minus_all(m, ms, first, FORCE_WIDTH, (SHARES + 1,), zero, v, axis, t, p)[0]
    l = t.voxel[v * columns.VOXEL_COLUMNS + columns.SIDE_LINK + 2 * axis + 1]
    if l >= 0:
        total = total + m[first + l * FORCE_WIDTH + SHARES]
    return select(t.shape[v * columns.SHAPE_COLUMNS + columns.PAIRED + axis] > 0.5, 0.5 * total, total)


@ti.func
def press(r: ti.template(), q):
    """Forces of the pressure on the corners of a pack of squares."""
    k, h, m, ms, gs, t, p = ti.static((r.k, r.h, r.m, r.ms, r.gs, r.t, r.p))
    given = square_inputs(ms, k + t.plan[memory.VOXEL], gs, h, q, p)
    place = t.plan[memory.PRESSED] + q * memory.PRESSED_WIDTH
    store_all(m, k, consecutive(place, memory.PRESSED_WIDTH), enclosure.pressed_square(*given))


@primitive
def square_inputs(ms: Any, first: Any, gs: Any, h: Any, q: Any, p: Lanes) -> tuple[Any, ...]:
    """Positions of the corners of a pack of squares, and their pressures."""
    w = p.width
    start = emit(h * w)
    found: tuple[Any, ...] = ()
    pressures: tuple[Any, ...] = ()
    for corner in range(columns.SQUARE_COLUMNS):
        row = emit((q * columns.SQUARE_COLUMNS + corner) * w)
        places = [emit(first * w + load(p.square_corner, row, i)) for i in range(w)]
        found += gather_all(ms, places, range(3), w)
        pressures += (vector([load(gs, start, emit(load(p.square_pressure, row, i))) for i in range(w)]),)
    return found + pressures


@ti.func
def spread_news(r: ti.template()):
    """Spread what changes from step to step, or everything after events."""
    i, k, h, m, gs, p, pairs = ti.static((r.i, r.k, r.h, r.m, r.gs, r.p, r.pairs))
    if pairs.info[i, FRESH] == 1:
        pairs.info[i, FRESH] = 0
        for n in range(p.spreads.shape[0] // SPREAD_ROW):
            spread(m, gs, k, h, n, p)
    else:
        for n in range(pairs.info[i, CHANGING]):
            spread(m, gs, k, h, pairs.changing[i, n], p)


@ti.func
def find_changing(r: ti.template()):
    """Note the rows of groups that have a channel which changes from step to step."""
    i, h, g, gs, tg, p, pairs = ti.static((r.i, r.h, r.g, r.gs, r.tg, r.p, r.pairs))
    first = h + tg.plan[memory.CHANNEL] + memory.RATE
    quantities = 0  # a bit for each of which any group's channel changes: most often few do
    for q in range(QUANTITY_COUNT):
        for pack in range(tg.plan[memory.GROUPS]):
            if any_lane(load(g, first, (pack * QUANTITY_COUNT + q) * memory.CHANNEL_WIDTH) != 0.0):
                quantities |= 1 << q
    count = 0
    for n in range(p.spreads.shape[0] // SPREAD_ROW):
        changes = 0
        low, end = p.spreads[n * SPREAD_ROW + FIRST_QUANTITY], p.spreads[n * SPREAD_ROW + END_QUANTITY]
        if (quantities >> low) & ((1 << (end - low)) - 1) != 0:
            for j in range(p.width):
                channels = first * p.width + p.group[n * p.width + j]
                for q in range(low, end):
                    if gs[channels + q * (memory.CHANNEL_WIDTH * p.width)] != 0.0:
                        changes = 1
        if changes == 1:
            pairs.changing[i, count] = n
            count += 1
    pairs.info[i, CHANGING] = count
    pairs.info[i, FRESH] = 1


@ti.func
def handle_marks(r: ti.template(), step, marks: ti.template()):
    """The events and recordings of a robot that are due at a step, and its end; whether channels were set."""
    i, h, g2, tg, pairs = ti.static((r.i, r.h, r.g2, r.tg, r.pairs))
    upcoming = marks.lanes[i, 0, marking.LENGTH]
    e = marks.lanes[i, 0, marking.EVENT]
    due, is_set = 1, 0
    while due == 1:
        due = 0
        if e < marks.lanes[i, 0, marking.END_EVENT]:
            if marks.event[e, 0] <= step:
                if marks.event[e, 1] >= 0:
                    marking.set_channel(g2, h, 0, e, tg, marks)
                    is_set = 1
                else:
                    record_snapshot(r, e, marks.lanes[i, 0, marking.ROBOT], marks)
                e += 1
                due = 1
            else:
                upcoming = ti.min(upcoming, marks.event[e, 0])
    marks.lanes[i, 0, marking.EVENT] = e
    pairs.info[i, NEXT_MARK] = upcoming
    if marks.lanes[i, 0, marking.LENGTH] == step:
        marks.lanes[i, 0, marking.STATE] = marking.ENDED
        marks.lanes[i, 0, marking.STEP] = step
        pairs.info[i, STATE] = FINISHED
    return is_set


@ti.func
def record_snapshot(r: ti.template(), e, robot, marks: ti.template()):
    """Record a robot's pose, strains and rest sizes."""
    k, h, ms, g2, t, tg = ti.static((r.k, r.h, r.ms, r.g2, r.t, r.tg))
    w = ti.static(t.lanes.width)
    snapshot = 0 - marks.event[e, 1] - 1
    marking.record_sizes(g2, h, 0, e, robot, snapshot, tg, marks)
    row = robot * marks.sizes.shape[1] + snapshot
    voxels, links = tg.plan[memory.VOXELS], ti.max(tg.plan[memory.LINKS], 1)
    pose = row * voxels * 7
    for v in range(voxels):
        voxel = (k + t.plan[memory.VOXEL]) * w + t.lanes.voxel[v]
        for c in ti.static(range(7)):
            marks.poses[pose + v * 7 + c] = ms[voxel + c * w]
    for l in range(tg.plan[memory.LINKS]):
        extension = ms[(k + t.plan[memory.LINK]) * w + t.lanes.link[l]]
        slot, lane = inverse_rest(l, tg)
        marks.strains[row * links + l] = extension * g2[h + slot, lane]


@ti.func
def step_voxel(r: ti.template(), v, zero):
    """Sum up the forces on a pack of voxels, integrate it and read its gauges; its new place."""
    i, k, m, ms, t, p, pairs = ti.static((r.i, r.k, r.m, r.ms, r.t, r.p, r.pairs))
    row = v * columns.VOXEL_COLUMNS
    first = k + t.plan[memory.FORCE]
    s = ti.static(variables([zero] * 6))
    for axis in range(3):
        given = minus_all(m, ms, first, FORCE_WIDTH, (6, 7, 8, 9, 10, 11), zero, v, axis, t, p)
        assign_all(s, [s[c] - given[c] for c in ti.static(range(6))])
    for l in range(t.voxel[row + columns.FIRST_LINK], t.voxel[row + columns.END_LINK]):
        own = load_all(m, first, consecutive(l * FORCE_WIDTH, 6))
        assign_all(s, [s[c] + own[c] for c in ti.static(range(6))])
    for corner in range(t.voxel[row + columns.FIRST_CORNER], t.voxel[row + columns.END_CORNER]):
        places = ti.static(corner_places((k + t.plan[memory.PRESSED]) * p.width, corner, p))
        own = gather_all(ms, places, (0, 1, 2), p.width)
        assign_all(s[:3], [s[c] + own[c] for c in ti.static(range(3))])
    cx, cy, cz = zero, zero, zero
    if pairs.touched[i, v] != 0:
        pairs.touched[i, v] = 0
        slots = consecutive(t.plan[memory.CONTACT] + 3 * v, 3)
        cx, cy, cz = load_all(m, k, slots)
        store_all(m, k, slots, (zero, zero, zero))
    x, y, z = voxel_stage(m, k, v, *s, cx, cy, cz, t)
    if t.voxel[row + columns.GAUGE] >= 0:
        ex = axis_strain(r, v, 0, zero)
        ey = axis_strain(r, v, 1, zero)
        ez = axis_strain(r, v, 2, zero)
        keep_strains(m, k, v, ex, ey, ez, t)
    return x, y, z


@primitive
def corner_places(first: Any, row: Any, p: Lanes) -> list[Any]:
    """Places of a row of forces of squares on the voxels of a pack."""
    return [emit(first + load(p.corner, emit(row * p.width), j)) for j in range(p.width)]


@ti.func
def step_robot(r: ti.template(), log: ti.template()):
    """One time step; notes how far voxels have moved since lists were made."""
    i, k, h, m, g, t, tg, p, pairs = ti.static((r.i, r.k, r.h, r.m, r.g, r.t, r.tg, r.p, r.pairs))
    group_stage(g, h, tg)
    derive_rests(g, r.gs, h, tg, p)
    spread_news(r)
    if t.plan[memory.CONTACT_ON] != 0:
        collide(r, log)
    for q in range(t.plan[memory.SQUARES]):
        press(r, q)
    zero = 0.0 * load(m, k, t.plan[memory.CONSTANT])
    moved, drifted = zero, zero
    begun = 0
    for n in range(t.plan[memory.VOXELS]):
        row = n * columns.VOXEL_COLUMNS
        for l in range(t.voxel[row + columns.FIRST_LINK], t.voxel[row + columns.END_LINK]):
            link_pack(r, l)
        end = p.packs[n * PACK_ROW + READY_END]
        for place in range(begun, end):
            v = p.packs[place * PACK_ROW + READY]
            x, y, z = step_voxel(r, v, zero)
            if t.plan[memory.CONTACT_ON] != 0:
                lx, ly, lz = load_all(m, k, consecutive(t.plan[memory.LISTED] + 3 * v, 3))
                dx, dy, dz = x - lx, y - ly, z - lz
                moved = larger(select(p.outer[v] > 0.5, dx * dx + dy * dy + dz * dz, zero), moved)
                first = (i * t.plan[memory.VOXELS] + v) * 3
                dx, dy, dz = x - pairs.seen[first], y - pairs.seen[first + 1], z - pairs.seen[first + 2]
                drifted = larger(dx * dx + dy * dy + dz * dz, drifted)
        begun = end
    store_all(m, k, (t.plan[memory.MONITOR] + memory.MOVED,), (moved,))
    pairs.drift[i] = drifted


@ti.func
def keep(r: ti.template(), step, log: ti.template()):
    """Copy a robot's state before a step to its place in the record."""
    i, k, h, m, g, t, tg, pairs = ti.static((r.i, r.k, r.h, r.m, r.g, r.t, r.tg, r.pairs))
    row = i * log.start.shape[1] + step - log.first
    for slot in range(t.plan[memory.STATE_SLOTS]):
        log.states[row * t.plan[memory.STATE_SLOTS] + slot] = m[k + slot]
    count = tg.plan[memory.GROUPS] * columns.CHANNELS_PER_GROUP
    for slot in range(count):
        log.groups[row * count + slot] = g[h + tg.plan[memory.CHANNEL] + slot]
    log.start[i, step - log.first] = pairs.info[i, LOGGED]


@lru_cache
def packed_kernel(real: Real, recording: bool, medium: Medium, serial: bool) -> Any:
    """The kernel for one kind of real and of surroundings; all else that differs is an argument.

    With ``recording`` it keeps the state before every step from the record's first on, and the contacts of each.
    A ``serial`` one takes robot by robot in the thread that launches it: to wake another one, and to fetch a robot's
    memory into the caches of its core, takes longer than several steps.
    """

    @ti.func
    def run(
        launch: ti.template(),
        memories: ti.template(),
        given: ti.template(),
        groups: ti.template(),
        p: ti.template(),
        pairs: ti.template(),
        marks: ti.template(),
        log: ti.template(),
    ):
        m, ms, g, gs, g2 = ti.static(memories)
        info = ti.static(pairs.info)
        ti.loop_config(serialize=serial)
        for n in range(GRAIN * launch.robots):
            if n % GRAIN == 0:
                i = n // GRAIN
                t = ti.static(with_lanes(given, p, ms, i))
                tg = ti.static(of_groups(groups, t))
                k, h = i * launch.slots, i * launch.group_slots
                r = ti.static(PackedRobot(i, k, h, m, ms, g, gs, g2, t, tg, p, pairs))
                left = launch.steps
                while left > 0 and info[i, STATE] == RUNNING and info[i, STEP] < launch.until:
                    left -= 1
                    step = info[i, STEP]
                    if ti.static(log.kept):
                        if step != info[i, KEPT]:  # before the events of the step, and not again after a halt
                            keep(r, step, log)
                            info[i, KEPT] = step
                    if step == info[i, NEXT_MARK]:
                        if handle_marks(r, step, marks) == 1 or step == 0:  # before it channels may have been set, too
                            find_changing(r)
                    if info[i, STATE] == RUNNING and t.plan[memory.CONTACT_ON] != 0:
                        moved = load(m, k, t.plan[memory.MONITOR] + memory.MOVED)
                        if any_lane(moved > launch.distance * launch.distance):
                            renew_list(r, t.radius)
                    if info[i, STATE] == RUNNING:
                        step_robot(r, log)
                        info[i, STEP] = step + 1
                        if ti.static(log.kept):
                            if step + 1 == launch.until:
                                keep(r, step + 1, log)
                        if any_lane(load(m, k, t.plan[memory.MONITOR] + memory.DIVERGED) > 0.5):
                            marks.lanes[i, 0, marking.STATE] = marking.DIVERGED
                            marks.lanes[i, 0, marking.STEP] = step + 1
                            info[i, STATE] = FINISHED

    i32, scalar, table = ti.i32, real.scalar, ints(2)
    flat = real.scalars(1)
    return kernel_of(
        run,
        Launch(i32, i32, i32, i32, scalar, i32),
        Memories(real.memory, flat, real.memory, flat, real.scalars(2)),
        shared_types(
            real, medium, ("link", "voxel", "excluded", "start", "time_step", "edge", "gravity", "relief", "radius")
        ),
        shared_types(real, medium, ("rest",)),
        lane_types(real),
        Pairs(ints(3), ints(3), *(real.memory,) * 2, flat, real.memory, real.memory, table, table, table),
        mark_types(real)._replace(poses=flat, strains=flat),
        Record(True, i32, real.memory, None, real.memory, None, ints(3), table) if recording else Record(),
    )
