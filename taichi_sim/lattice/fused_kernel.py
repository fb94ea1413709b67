"""The fused driver: blocks of robots in native vector lanes, the time loop inside one kernel (CPU).

One pass over the voxels does links and integration together. It may, because voxels are visited in the order of
(x, y, z): when a voxel's own links are done all its links are, and nothing later needs its old state. Forces on
voxels ahead wait in a short ring. Memory traffic, the limit on a CPU, is thus one stream over state and memory.

Robots that end early are parked (copied away, later copied back); a diverged robot is put back to where its run
began, so that it cannot slow the others. Neither touches the other lanes.
"""

from functools import lru_cache
from typing import Any

from taichi_sim.lanes import NATIVE_WIDTH, Real, any_lane, load, store
from taichi_sim.lattice import stages
from taichi_sim.lattice.watch import LIST, NOWHERE, rebuild_lane
from taichi_sim.runtime import ti

# Columns of the integers of a block; the first three belong to the watch list.
INFO_STEP, INFO_NEXT_MARK, INFO_STATE = 3, 4, 5
INFO_COLUMNS = 6
RUNNING, FINISHED, OUT_OF_PAIRS = 0, 1, 2

# Columns of the integers of a lane.
LANE_EVENT, LANE_LAST_EVENT, LANE_LENGTH, LANE_STATE, LANE_STEP, LANE_ROBOT = range(6)
LANE_COLUMNS = 6
LANE_ACTIVE, LANE_ENDED, LANE_DIVERGED = 0, 1, 2

# Columns of the counts and switches that kernels read.
(SIZE_VOXELS, SIZE_GROUPS, SIZE_RESTS, SIZE_SURFACE, SIZE_PAIRS, USES_FLOOR, USES_CONTACT, USES_POISSON,
 RING_MASK) = range(9)  # fmt: skip
SIZES = 9

# Taichi runs an outer loop of at most this many iterations on one thread, so each block gets as many.
GRAIN = 512


@ti.func
def copy_lane(source: ti.template(), target: ti.template(), k, lane):
    """Copy one robot's part of an array of scalars [block, item, component, lane]."""
    for i in range(source.shape[1]):
        for c in range(source.shape[2]):
            target[k, i, c, lane] = source[k, i, c, lane]


@ti.func
def apply_event(k, lane, e, robot, event: ti.template(), event_value: ti.template(), channel: ti.template(),
                voxel: ti.template(), link: ti.template(), rest: ti.template(), link_table: ti.template(),
                poses: ti.template(), strains: ti.template(), sizes: ti.template()):  # fmt: skip
    """Set a channel, or record the robot's pose if the event's target is negative."""
    target = event[e, 1]
    if target >= 0:
        channel[k, target, stages.BASE, lane] = event_value[e, 0]
        channel[k, target, stages.RATE, lane] = event_value[e, 1]
        channel[k, target, stages.AGE, lane] = 0.0
    else:
        slot = 0 - target - 1
        for v in range(sizes[SIZE_VOXELS]):
            for c in range(7):
                poses[robot, slot, v, c] = voxel[k, v, c, lane]
        for l in range(strains.shape[2]):
            strains[robot, slot, l] = link[k, l, 0, lane] * rest[k, link_table[l, stages.LINK_REST], 1, lane]


@ti.func
def handle_marks(k, t, width: ti.template(), sizes: ti.template(), lanes: ti.template(), info: ti.template(), event: ti.template(),
                 event_value: ti.template(), link_table: ti.template(), channel_s: ti.template(),
                 voxel_s: ti.template(), link_s: ti.template(), strain_s: ti.template(), rest_s: ti.template(),
                 parked_voxel: ti.template(), parked_link: ti.template(), parked_strain: ti.template(),
                 parked_channel: ti.template(), poses: ti.template(), strains: ti.template()):  # fmt: skip
    """Events due at step t; robots that end here are parked; the block ends with its last robot."""
    upcoming = NOWHERE
    active = 0
    for lane in range(width):
        if lanes[k, lane, LANE_STATE] == LANE_ACTIVE:
            e = lanes[k, lane, LANE_EVENT]
            due = 1
            while due == 1:
                due = 0
                if e < lanes[k, lane, LANE_LAST_EVENT]:
                    if event[e, 0] <= t:
                        apply_event(k, lane, e, lanes[k, lane, LANE_ROBOT], event, event_value, channel_s, voxel_s,
                                    link_s, rest_s, link_table, poses, strains, sizes)  # fmt: skip
                        e += 1
                        due = 1
                    else:
                        upcoming = ti.min(upcoming, event[e, 0])
            lanes[k, lane, LANE_EVENT] = e
            if lanes[k, lane, LANE_LENGTH] == t:
                lanes[k, lane, LANE_STATE] = LANE_ENDED
                lanes[k, lane, LANE_STEP] = t
                copy_lane(voxel_s, parked_voxel, k, lane)
                copy_lane(link_s, parked_link, k, lane)
                copy_lane(strain_s, parked_strain, k, lane)
                copy_lane(channel_s, parked_channel, k, lane)
            else:
                active += 1
                upcoming = ti.min(upcoming, lanes[k, lane, LANE_LENGTH])
    info[k, INFO_NEXT_MARK] = upcoming
    if active == 0:
        info[k, INFO_STATE] = FINISHED


@ti.func
def collide(k, lane_bits, sizes: ti.template(), voxel_table: ti.template(), surface: ti.template(),
            voxel: ti.template(), current: ti.template(), constant: ti.template(), contact: ti.template(),
            touched: ti.template(), row: ti.template(), partner: ti.template(), mask: ti.template(),
            info: ti.template()):  # fmt: skip
    """Contact forces of all watched pairs, in the order of the list."""
    for s in range(sizes[SIZE_SURFACE]):
        for q in range(row[k, info[k, LIST], s], row[k, info[k, LIST], s + 1]):
            other = partner[k, info[k, LIST], q]
            watched = (lane_bits & mask[k, info[k, LIST], q]) != 0
            touches, fx, fy, fz = stages.contact_stage(
                k, surface[s], surface[other], watched, voxel_table, voxel, current, constant
            )
            if touches:
                add_contact(k, s, 1.0, fx, fy, fz, contact, touched)
                add_contact(k, other, -1.0, fx, fy, fz, contact, touched)


@ti.func
def add_contact(k, slot, sign, fx, fy, fz, contact: ti.template(), touched: ti.template()):
    """Add a contact force to a surface voxel; sums are cleared when they are used, not in every step."""
    if touched[k, slot] == 0:
        touched[k, slot] = 1
        for c in ti.static(range(3)):
            store(contact, k, slot, c, 0.0 * fx)
    store(contact, k, slot, 0, load(contact, k, slot, 0) + sign * fx)
    store(contact, k, slot, 1, load(contact, k, slot, 1) + sign * fy)
    store(contact, k, slot, 2, load(contact, k, slot, 2) + sign * fz)


@ti.func
def add_force(k, slot, axis, fx, fy, fz, mx, my, mz, ring: ti.template()):
    """Add a link's force and moment, link axis first, to a voxel's sums."""
    c1 = (axis + 1) % 3
    c2 = (axis + 2) % 3
    store(ring, k, slot, axis, load(ring, k, slot, axis) + fx)
    store(ring, k, slot, c1, load(ring, k, slot, c1) + fy)
    store(ring, k, slot, c2, load(ring, k, slot, c2) + fz)
    store(ring, k, slot, 3 + axis, load(ring, k, slot, 3 + axis) + mx)
    store(ring, k, slot, 3 + c1, load(ring, k, slot, 3 + c1) + my)
    store(ring, k, slot, 3 + c2, load(ring, k, slot, 3 + c2) + mz)


@ti.func
def step(k, t, dt, edge, gravity, lane_bits, sizes: ti.template(), link_table: ti.template(),
         voxel_table: ti.template(), rest_table: ti.template(), surface: ti.template(), start: ti.template(),
         voxel: ti.template(), link: ti.template(), channel: ti.template(), current: ti.template(),
         constant: ti.template(), beam: ti.template(), rest: ti.template(), strain: ti.template(),
         contact: ti.template(), watch: ti.template(), monitor: ti.template(), ring: ti.template(),
         touched: ti.template(), row: ti.template(), partner: ti.template(), mask: ti.template(),
         info: ti.template()):  # fmt: skip
    """One time step of a block: channels, contact forces, then links and integration voxel by voxel."""
    poisson = sizes[USES_POISSON]
    stages.advance_channels(k, sizes[SIZE_GROUPS], edge, gravity, channel, constant, current)
    stages.update_rest_lengths(k, sizes[SIZE_RESTS], rest_table, current, rest)
    if sizes[USES_CONTACT] != 0:
        collide(k, lane_bits, sizes, voxel_table, surface, voxel, current, constant, contact, touched, row, partner,
                mask, info)  # fmt: skip
    nought = 0.0 * load(constant, k, 0, 0)
    moved = nought
    for v in range(sizes[SIZE_VOXELS]):
        here = v & sizes[RING_MASK]
        for l in range(voxel_table[v, stages.FIRST_LINK], voxel_table[v, stages.END_LINK]):
            fx, fy, fz, mx, my, mz, gx, gy, gz, nx, ny, nz = stages.link_stage(
                k, l, poisson, edge, link_table, voxel_table, voxel, link, beam, rest, strain, monitor
            )
            add_force(k, here, link_table[l, stages.LINK_AXIS], fx, fy, fz, mx, my, mz, ring)
            there = link_table[l, stages.LINK_PLUS] & sizes[RING_MASK]
            add_force(k, there, link_table[l, stages.LINK_AXIS], gx, gy, gz, nx, ny, nz, ring)
        cx, cy, cz = nought, nought, nought
        slot = voxel_table[v, stages.SURFACE_SLOT]
        if slot >= 0:
            if touched[k, slot] != 0:
                touched[k, slot] = 0
                cx, cy, cz = load(contact, k, slot, 0), load(contact, k, slot, 1), load(contact, k, slot, 2)
        x, y, z = stages.voxel_stage(
            k, v, dt, edge, sizes[USES_FLOOR], load(ring, k, here, 0), load(ring, k, here, 1), load(ring, k, here, 2),
            load(ring, k, here, 3), load(ring, k, here, 4), load(ring, k, here, 5), cx, cy, cz,
            voxel_table, start, voxel, strain, channel, current, constant,
        )  # fmt: skip
        for c in ti.static(range(6)):
            store(ring, k, here, c, nought)
        if voxel_table[v, stages.STRAIN_SLOT] >= 0:
            stages.gauge_stage(k, v, poisson, link_table, voxel_table, link, beam, rest, strain, channel, constant)
        if slot >= 0 and sizes[USES_CONTACT] != 0:
            dx = x - load(watch, k, slot, 0)
            dy = y - load(watch, k, slot, 1)
            dz = z - load(watch, k, slot, 2)
            moved = ti.max(moved, dx * dx + dy * dy + dz * dz)
    store(monitor, k, 0, stages.MOVED, moved)


@ti.func
def retire_diverged(k, t, width: ti.template(), lanes: ti.template(), info: ti.template(), monitor_s: ti.template(),
                    parked_voxel: ti.template(), parked_link: ti.template(), parked_strain: ti.template(),
                    parked_channel: ti.template(), voxel_s: ti.template(), link_s: ti.template(),
                    strain_s: ti.template(), channel_s: ti.template()):  # fmt: skip
    """Note the step at which robots diverged and put them back to the start of the run, out of the others' way."""
    for lane in range(width):
        if monitor_s[k, 0, stages.DIVERGED, lane] > 0.5:
            monitor_s[k, 0, stages.DIVERGED, lane] = 0.0
            if lanes[k, lane, LANE_STATE] == LANE_ACTIVE:
                lanes[k, lane, LANE_STATE] = LANE_DIVERGED
                lanes[k, lane, LANE_STEP] = t + 1
            copy_lane(parked_voxel, voxel_s, k, lane)
            copy_lane(parked_link, link_s, k, lane)
            copy_lane(parked_strain, strain_s, k, lane)
            copy_lane(parked_channel, channel_s, k, lane)
    info[k, INFO_NEXT_MARK] = t + 1


@ti.func
def refresh_watch(k, width: ti.template(), bunch: ti.template(), radius, distance, sizes: ti.template(),
                  surface: ti.template(), excluded: ti.template(), voxel_s: ti.template(), watch_s: ti.template(),
                  monitor_s: ti.template(), scratch: ti.template(), scratch_s: ti.template(), fresh: ti.template(),
                  row: ti.template(), partner: ti.template(), mask: ti.template(), info: ti.template(),
                  lanes: ti.template()):  # fmt: skip
    """Build the lists of those robots again that have moved too far; halts the block if they do not fit."""
    for lane in range(width):
        if monitor_s[k, 0, stages.MOVED, lane] > distance * distance and lanes[k, lane, LANE_STATE] == LANE_ACTIVE:
            fits = rebuild_lane(
                k, lane, width, bunch, sizes[SIZE_SURFACE], sizes[SIZE_PAIRS], radius * radius, surface, excluded,
                voxel_s, watch_s, scratch, scratch_s, fresh, row, partner, mask, info,
            )  # fmt: skip
            if fits == 0:
                info[k, INFO_STATE] = OUT_OF_PAIRS
            else:
                monitor_s[k, 0, stages.MOVED, lane] = 0.0


@lru_cache
def fused_kernel(real: Real) -> Any:
    """The kernel for one kind of real. Everything that differs between bodies and runs is an argument."""
    width = real.width
    bunch = NATIVE_WIDTH[real.precision]
    reals = ti.types.ndarray(dtype=real.type, ndim=3)
    scalars = ti.types.ndarray(dtype=real.scalar, ndim=4)
    bunches = ti.types.ndarray(dtype=ti.types.vector(bunch, real.scalar), ndim=3)
    bits_type = ti.types.ndarray(dtype=ti.i32 if width == 1 else ti.types.vector(width, ti.i32), ndim=1)
    ints1, ints2, ints3 = (ti.types.ndarray(dtype=ti.i32, ndim=n) for n in (1, 2, 3))
    scalars2, scalars3 = (ti.types.ndarray(dtype=real.scalar, ndim=n) for n in (2, 3))

    @ti.kernel
    def run(blocks: ti.i32, steps: ti.i32, dt: real.scalar, edge: real.scalar, gravity: real.scalar,
            watch_radius: real.scalar, rebuild_distance: real.scalar,
            sizes: ints1, link_table: ints2, voxel_table: ints2, rest_table: ints2, surface: ints1, excluded: ints2,
            start: scalars2, bits: bits_type, voxel: reals, link: reals, channel: reals, current: reals, constant: reals,
            beam: reals, rest: reals, strain: reals, contact: reals, watch: reals, monitor: reals, ring: reals,
            voxel_s: scalars, link_s: scalars, channel_s: scalars, rest_s: scalars, strain_s: scalars, watch_s: scalars,
            monitor_s: scalars, parked_voxel: scalars, parked_link: scalars, parked_strain: scalars,
            parked_channel: scalars, scratch: bunches, scratch_s: scalars, touched: ints2, fresh: ints2, row: ints3,
            partner: ints3, mask: ints3, info: ints2, lanes: ints3, event: ints2, event_value: scalars2,
            poses: scalars, strains: scalars3):  # fmt: skip
        for i in range(GRAIN * blocks):
            if i % GRAIN == 0:
                k = i // GRAIN
                left = steps
                while left > 0 and info[k, INFO_STATE] == RUNNING:
                    left -= 1
                    t = info[k, INFO_STEP]
                    if t == info[k, INFO_NEXT_MARK]:
                        handle_marks(k, t, width, sizes, lanes, info, event, event_value, link_table, channel_s, voxel_s,
                                     link_s, strain_s, rest_s, parked_voxel, parked_link, parked_strain, parked_channel,
                                     poses, strains)  # fmt: skip
                    if info[k, INFO_STATE] == RUNNING and sizes[USES_CONTACT] != 0:
                        if any_lane(load(monitor, k, 0, stages.MOVED) > rebuild_distance * rebuild_distance):
                            refresh_watch(k, width, bunch, watch_radius, rebuild_distance, sizes, surface, excluded,
                                          voxel_s, watch_s, monitor_s, scratch, scratch_s, fresh, row, partner, mask,
                                          info, lanes)  # fmt: skip
                    if info[k, INFO_STATE] == RUNNING:
                        step(k, t, dt, edge, gravity, bits[0], sizes, link_table, voxel_table, rest_table, surface, start,
                             voxel, link, channel, current, constant, beam, rest, strain, contact, watch, monitor, ring,
                             touched, row, partner, mask, info)  # fmt: skip
                        info[k, INFO_STEP] = t + 1
                        if any_lane(load(monitor, k, 0, stages.DIVERGED) > 0.5):
                            retire_diverged(k, t, width, lanes, info, monitor_s, parked_voxel, parked_link, parked_strain,
                                            parked_channel, voxel_s, link_s, strain_s, channel_s)  # fmt: skip

    return run
