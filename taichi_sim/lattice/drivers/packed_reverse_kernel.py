"""The reverse of the packed driver: robot by robot, from the last recorded step back to the first.

A step is undone in the opposite order: packs of voxels with their gauges; links, which leave the cotangents of the
poses at their "+" ends in memory; these are fetched as forces are on the way there; then squares, contacts, and what
follows from the channels. Cotangents change in place from those of the state after the step to those before it.
"""

from functools import lru_cache
from typing import Any, NamedTuple

from taichi_sim.autodiff.lanes import (
    Real,
    accumulate_all,
    any_lane,
    consecutive,
    ints,
    load,
    load_all,
    store_all,
)
from taichi_sim.autodiff.tracing import primitive, pull_back, select
from taichi_sim.bundling import kernel_of
from taichi_sim.lattice.drivers import marks as marking
from taichi_sim.lattice.drivers.marks import mark_types
from taichi_sim.lattice.drivers.packed_contact import Record
from taichi_sim.lattice.drivers.packed_lanes import (
    BY_LANE,
    GAUGED,
    GIVE_ROW,
    LINK_ROW,
    MASK,
    SOURCE,
    SPREAD_ROW,
    TO,
    lane_types,
    minus_all,
    of_groups,
    own_pack,
    plus_all,
    pose_slots,
    spread,
    with_lanes,
)
from taichi_sim.lattice.drivers.packed_rests import derive_rests, inverse_rest, rest_ends, rest_places
from taichi_sim.lattice.drivers.packed_reverse_surface import scatter_all, shifted, undo_contacts, undo_squares
from taichi_sim.lattice.laws import group as group_laws
from taichi_sim.lattice.laws import link as laws
from taichi_sim.lattice.stages import columns, memory
from taichi_sim.lattice.stages.columns import Medium, shared_types
from taichi_sim.lattice.stages.gauges import share_slots, strain_cotangents
from taichi_sim.lattice.stages.groups import group_adjoint, recall_groups
from taichi_sim.lattice.stages.link import (
    LINK_WIDTHS,
    axial_slots,
    beam_slot,
    bending_slots,
    end_slots,
    link_axes,
    link_cotangents,
    past_slot,
    recorded_strains,
    rest_slot,
)
from taichi_sim.lattice.stages.undo import Undo, in_parts, take_all
from taichi_sim.lattice.stages.voxel import voxel_adjoint
from taichi_sim.runtime import GRAIN, element, emit, ti

BACK_WIDTH = 10  # of a link pack: cotangents of the poses at its "+" ends, and of their transverse strains
STRAINS = 7


class Launch(NamedTuple):
    """How many robots there are, slots of each in both memories, and the steps to go back from and to."""

    robots: Any
    slots: Any
    group_slots: Any
    high: Any
    low: Any


class Back(NamedTuple):
    """One robot on the way back.

    Attributes:
        u, ug: memories of the step that is undone, of voxels and of groups; keys of the robot.
        memories: see ``Memories``.
        rs: recorded states as scalars.
        i, t, tg, p: as in ``packed_lanes.PackedRobot``.
    """

    u: Any
    ug: Any
    memories: Any
    rs: Any
    i: Any
    t: Any
    tg: Any
    p: Any


class Memories(NamedTuple):
    """Parameters, cotangents, what links leave and seeds of gauges, as reals and as scalars; groups as scalars."""

    m: Any
    ms: Any
    a: Any
    a_scalar: Any
    back: Any
    back_scalar: Any
    gauge: Any
    gauge_scalar: Any
    g: Any
    gs: Any
    g2: Any
    ag: Any
    ag_scalar: Any
    ag2: Any
    upcoming: Any


@ti.func
def undo_gauges(b: ti.template(), v):
    """Leave the cotangents of a pack's strains, each as the share of one link, for its links."""
    u, memories, i, t = ti.static((b.u, b.memories, b.i, b.t))
    for axis in ti.static(range(3)):
        memories.gauge[(i * t.plan[memory.VOXELS] + v) * 3 + axis] = 0.0 * load(u.m, u.k, t.plan[memory.CONSTANT])
    if t.voxel[v * columns.VOXEL_COLUMNS + columns.GAUGE] >= 0:
        seeds = strain_cotangents(u, v, t)
        for axis in ti.static(range(3)):
            paired = t.shape[v * columns.SHAPE_COLUMNS + columns.PAIRED + axis] > 0.5
            half = select(paired, 0.5 * seeds[axis], seeds[axis])
            memories.gauge[(i * t.plan[memory.VOXELS] + v) * 3 + axis] = half


@ti.func
def undo_shares(b: ti.template(), l):
    """Reverse the shares of a link pack in the strains of the voxels at both ends."""
    u, memories, i, t, p = ti.static((b.u, b.memories, b.i, b.t, b.p))
    first = i * t.plan[memory.VOXELS] * 3
    pack = own_pack(l, t) // memory.VOXEL_WIDTH * 3
    axis, _, _ = link_axes(l, t)
    own = load_all(memories.gauge, first, (pack + axis,))
    beyond = plus_all(memories.gauge, memories.gauge_scalar, first, 3, (axis,), own, l, p)
    extension = past_slot(l, t)
    for side in ti.static(range(2)):
        seed = select(p.there[l] > 0.5, (own if ti.static(side == 1) else beyond)[0], 0.0 * own[0])
        inputs = (load(u.record, u.r, u.new + extension),) + load_all(u.m, u.k, share_slots(l, side, t))
        found = ti.static(pull_back(laws.shared_strain, inputs, (), (seed,)))
        accumulate_all(u.a, u.k, (extension,) + share_slots(l, side, t), found)


@primitive
def where_there(there: Any, values: Any) -> tuple[Any, ...]:
    """Values in lanes that have a link, else zero."""
    return tuple(emit(select(there > 0.5, value, 0.0 * value)) for value in values)


@ti.func
def undo_links(b: ti.template(), l):
    """Reverse a link pack; the cotangents of what lies at its "+" ends are left in ``back``."""
    u, memories, rs, i, t, p = ti.static((b.u, b.memories, b.rs, b.i, b.t, b.p))
    if p.links[l * LINK_ROW + GAUGED] != 0:
        undo_shares(b, l)
    there = p.there[l]
    pack = own_pack(l, t)
    before = u.r + u.old + t.plan[memory.VOXEL]
    own = load_all(u.record, before, pose_slots(pack, l, t))
    x, y, z, qw, qa, qb, qc = plus_all(u.record, rs, before, memory.VOXEL_WIDTH, pose_slots(0, l, t), own, l, p)
    length = load(u.m, u.k, rest_slot(l, t))
    x, y, z = select(there > 0.5, x, own[0] + length), select(there > 0.5, y, own[1]), select(there > 0.5, z, own[2])
    force = u.k + t.plan[memory.FORCE]
    axes = link_axes(l, t)
    gained = load_all(u.a, force, end_slots(pack // memory.VOXEL_WIDTH * 6, axes))
    lost = plus_all(u.a, memories.a_scalar, force, 6, end_slots(0, axes), gained, l, p)
    poses = own + (x, y, z, qw, qa, qb, qc)
    given = link_cotangents(u, l, poses, where_there(there, gained), where_there(there, lost), there, t)
    found = ti.static(in_parts(LINK_WIDTHS, where_there(there, given)))
    accumulate_all(u.a, u.k, pose_slots(t.plan[memory.VOXEL] + pack, l, t), found.minus)
    left = (i * (t.plan[memory.LINKS] + 1) + l) * BACK_WIDTH
    store_all(memories.back, left, pose_slots(0, l, t), found.plus)
    store_all(u.a, u.k, consecutive(past_slot(l, t), 6), found.past)
    rest, beam = rest_slot(l, t), beam_slot(l, t)
    accumulate_all(u.a, u.k, axial_slots(rest, beam) + bending_slots(beam), found.axial + found.bending)
    if t.plan[memory.POISSON_ON] != 0:
        strains = recorded_strains(u, l, t)
        shares = ti.static(pull_back(laws.cross_section, strains, (), found.section))
        at = t.plan[memory.STRAIN] + pack // memory.VOXEL_WIDTH * memory.STRAIN_WIDTH + 3
        accumulate_all(u.a, u.k, (at + axes[1], at + axes[2]), shares[:2])
        zero = 0.0 * length
        slots = (STRAINS + axes[0], STRAINS + axes[1], STRAINS + axes[2])
        store_all(memories.back, left, slots, (zero, shares[2], shares[3]))


@ti.func
def fetch_back(b: ti.template(), v):
    """Add to the cotangents of a pack's poses and strains what the links on its "-" sides left."""
    u, memories, i, t, p = ti.static((b.u, b.memories, b.i, b.t, b.p))
    zero = 0.0 * load(u.m, u.k, t.plan[memory.CONSTANT])
    first = i * (t.plan[memory.LINKS] + 1) * BACK_WIDTH
    for axis in ti.static(range(3)):
        found = minus_all(
            memories.back, memories.back_scalar, first, BACK_WIDTH, (0, 1, 2, 3, 4, 5, 6), zero, v, axis, t, p
        )
        accumulate_all(u.a, u.k, consecutive(t.plan[memory.VOXEL] + v * memory.VOXEL_WIDTH, 7), found)
        if t.plan[memory.POISSON_ON] != 0:
            strains = minus_all(memories.back, memories.back_scalar, first, BACK_WIDTH, (7, 8, 9), zero, v, axis, t, p)
            at = t.plan[memory.STRAIN] + v * memory.STRAIN_WIDTH + 3
            accumulate_all(u.a, u.k, consecutive(at, 3), strains)


@ti.func
def collect(b: ti.template(), n):
    """Give one group the cotangents of what a row spread to its lanes, and take them there."""
    u, ug, memories, p = ti.static((b.u, b.ug, b.memories, b.p))
    slot = p.gives[n * GIVE_ROW + TO]
    given = load(u.a, u.k, slot)
    if any_lane(given != 0.0):
        number, source, start = p.gives[n * GIVE_ROW + MASK], p.gives[n * GIVE_ROW + SOURCE], ug.k * p.width
        if number == BY_LANE:
            for j in range(p.width):
                place = start + p.source[source * p.width + j]
                memories.ag_scalar[place] += memories.a_scalar[(u.k + slot) * p.width + j]
            store_all(u.a, u.k, (slot,), (0.0 * given,))
        else:
            mask = p.masks[number]
            memories.ag_scalar[start + source] += sum_of_lanes(given * mask, p.width)
            store_all(u.a, u.k, (slot,), (given * (1.0 - mask),))


@primitive
def sum_of_lanes(v: Any, width: int) -> Any:
    """Sum of a vector's lanes, neighbours first."""
    vector = emit(v)
    parts = [emit(element(vector, i)) for i in range(width)]
    while len(parts) > 1:
        parts = [emit(a + b) for a, b in zip(parts[::2], parts[1::2], strict=True)]
    return parts[0]


@ti.func
def undo_rests(ug: ti.template(), memories: ti.template(), tg: ti.template(), p: ti.template()):
    """Reverse rest lengths: their cotangents go to the sizes of groups."""
    first = (ug.k + tg.plan[memory.CURRENT]) * p.width
    for n in range(p.rests.shape[0] // (2 * p.width)):
        ends = ti.static(rest_ends(memories.gs, ug.k, n, tg, p))
        given = take_all(ug, consecutive(tg.plan[memory.REST] + n * memory.REST_WIDTH, memory.REST_WIDTH))
        found = ti.static(pull_back(group_laws.rest_length, ends, (), given))
        for end in ti.static(range(2)):
            places = ti.static(shifted(rest_places(n, end, p), first))
            scatter_all(memories.ag_scalar, places, (0,), found[end : end + 1], 1)


@ti.func
def undo_step(b: ti.template(), n, log: ti.template()):
    """Reverse step n of the record."""
    u, ug, memories, i, t, tg, p = ti.static((b.u, b.ug, b.memories, b.i, b.t, b.tg, b.p))
    recall_groups(ug.m, ug.k, ug.record, ug.r, ug.new, tg)
    derive_rests(memories.g, memories.gs, ug.k, tg, p)
    for r in range(p.spreads.shape[0] // SPREAD_ROW):
        spread(memories.m, memories.gs, u.k, ug.k, r, p)
    for v in range(t.plan[memory.VOXELS]):
        undo_gauges(b, v)
        voxel_adjoint(u, v, t)
    for l in range(t.plan[memory.LINKS]):
        undo_links(b, l)
    for v in range(t.plan[memory.VOXELS]):
        fetch_back(b, v)
    for q in range(t.plan[memory.SQUARES]):
        undo_squares(b, q)
    first, end = log.start[i, n], log.start[i, n + 1]
    for q in range((end - first + p.width - 1) // p.width):
        undo_contacts(b, first + q * p.width, end, log.contacts)
    for r in range(p.gives.shape[0] // GIVE_ROW):
        collect(b, r)
    undo_rests(ug, memories, tg, p)
    group_adjoint(ug, tg)


@ti.func
def end_run(b: ti.template(), robot, marks: ti.template()):
    """Let a robot's cotangents be those of its last state."""
    u, t, tg, p = ti.static((b.u, b.t, b.tg, b.p))
    w = ti.static(p.width)
    voxels = (u.k + t.plan[memory.VOXEL]) * w
    for v in range(tg.plan[memory.VOXELS]):
        for c in range(memory.STICKS):
            u.a[voxels + p.voxel[v] + c * w] = marks.finals[robot, v, c]


@ti.func
def receive(b: ti.template(), robot, snapshot, step, marks: ti.template()):
    """Add the cotangents of a recorded pose, of the strains of its links and of its rest sizes."""
    u, ug, rs, t, tg, p = ti.static((b.u, b.ug, b.rs, b.t, b.tg, b.p))
    w = ti.static(p.width)
    for v in range(tg.plan[memory.VOXELS]):
        for c in range(7):
            place = (u.k + t.plan[memory.VOXEL] + c) * w + p.voxel[v]
            u.a[place] += marks.poses[robot, snapshot, v, c]
    if step > 0:  # what links remember at the start of a run is given
        for l in range(tg.plan[memory.LINKS]):
            slot, lane = inverse_rest(l, tg)
            seed = marks.strains[robot, snapshot, l]
            u.a[(u.k + t.plan[memory.LINK]) * w + p.link[l]] += seed * ug.m[ug.k + slot, lane]
            ug.a[ug.k + slot, lane] += seed * rs[(u.r + u.new + t.plan[memory.LINK]) * w + p.link[l]]
    marking.receive_sizes(ug, 0, robot, snapshot, step, tg, marks)


@lru_cache
def packed_reverse_kernel(real: Real, medium: Medium, serial: bool) -> Any:
    """The kernel for one kind of real and of surroundings; ``serial`` as for the way there."""

    @ti.func
    def undo(
        launch: ti.template(),
        memories: ti.template(),
        given: ti.template(),
        groups: ti.template(),
        p: ti.template(),
        log: ti.template(),
        marks: ti.template(),
    ):
        ti.loop_config(serialize=serial)
        for n in range(GRAIN * launch.robots):
            if n % GRAIN == 0:
                i = n // GRAIN
                t = ti.static(with_lanes(given, p, log.scalar_states, i))
                tg = ti.static(of_groups(groups, t))
                k, h = i * launch.slots, i * launch.group_slots
                r = i * log.start.shape[1] * t.plan[memory.STATE_SLOTS]
                channels = tg.plan[memory.GROUPS] * columns.CHANNELS_PER_GROUP
                rg = i * log.start.shape[1] * channels - tg.plan[memory.CHANNEL]
                for back in range(launch.high - launch.low + 1):
                    step = launch.high - back
                    row = step - log.first
                    here = row * t.plan[memory.STATE_SLOTS]
                    after = here + t.plan[memory.STATE_SLOTS]
                    # A robot waits until its own last step; one that diverged has no way back.
                    if back > 0 and marks.lanes[i, 0, marking.STATE] == marking.ACTIVE:
                        u = ti.static(Undo(memories.m, k, log.states, r, memories.a, here, after))
                        ug = ti.static(
                            Undo(memories.g, h, log.groups, rg, memories.ag, row * channels, (row + 1) * channels)
                        )
                        undo_step(ti.static(Back(u, ug, memories, log.scalar_states, i, t, tg, p)), row, log)
                    if step == memories.upcoming[i]:
                        recall_groups(memories.g, h, log.groups, rg, row * channels, tg)
                        derive_rests(memories.g, memories.gs, h, tg, p)
                        scalars = ti.static(Undo(memories.ms, k, None, r, memories.a_scalar, here, here))
                        column = ti.static(
                            Undo(memories.g2, h, log.group_column, rg, memories.ag2, row * channels, row * channels)
                        )
                        b = ti.static(Back(scalars, column, memories, log.scalar_states, i, t, tg, p))
                        way = ti.static(marking.Way(column, i, 0, tg, end_run, receive, b))
                        memories.upcoming[i] = marking.meet_events_back(way, step, marks)

    i32, flat, table = ti.i32, real.scalars(1), real.scalars(2)
    both = (real.memory, flat)
    return kernel_of(
        undo,
        Launch(i32, i32, i32, i32, i32),
        Memories(*both, *both, *both, *both, *both, table, *both, table, ints(1)),
        shared_types(real, medium, ("link", "voxel", "start", "time_step", "edge", "gravity", "relief")),
        shared_types(real, medium, ("rest",)),
        lane_types(real)._replace(group=None, outer=None, gives=ints(1), masks=real.memory),
        Record(True, i32, real.memory, flat, real.memory, table, ints(3), ints(2)),
        mark_types(real, back=True),
    )
