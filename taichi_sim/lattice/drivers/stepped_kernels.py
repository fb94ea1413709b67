"""The kernels of the stepped driver: one thread per robot and link, voxel or surface voxel; a loop per stage.

A kernel is a whole step: each of its loops is a launch on the device, but only one from Python, which takes longer.

The stages and their order are those of the packed driver, and every sum runs in the same order, so that on a CPU the
two drivers agree to the last bit.
"""

from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any, NamedTuple

from taichi_sim.autodiff.lanes import Real, consecutive, ints, load, load_all, store, store_all
from taichi_sim.autodiff.tracing import primitive
from taichi_sim.bundling import kernel_of
from taichi_sim.lattice.drivers import marks as marking
from taichi_sim.lattice.drivers.marks import ACTIVE, STATE, mark_types
from taichi_sim.lattice.laws import contact
from taichi_sim.lattice.program import QUANTITY_COUNT
from taichi_sim.lattice.stages import columns, memory
from taichi_sim.lattice.stages.columns import Medium, shared_types
from taichi_sim.lattice.stages.contact import contact_force, listed_slots, place_slots, squared_move, surface_place
from taichi_sim.lattice.stages.enclosure import add_pressure, square_stage
from taichi_sim.lattice.stages.gauges import gauge_stage
from taichi_sim.lattice.stages.groups import derive_group, derive_rest, evaluate_channel
from taichi_sim.lattice.stages.link import end_slots, link_axes, link_stage
from taichi_sim.lattice.stages.memory import CONTACT_ON, FORCE, LINKS, MONITOR, PAIRS, SQUARES, STATE_SLOTS, SURFACE
from taichi_sim.lattice.stages.voxel import voxel_stage
from taichi_sim.runtime import ti

FAR = 1e30  # stands in MOVED for: farther than REBUILD_DISTANCE
FEWEST_THREADS, MOST_THREADS = 1 << 9, 1 << 17  # of a launch; Taichi launches the most where it knows no number


def threads_for(items: int) -> int | None:
    """Threads to launch for so many items on a device; None leaves it to Taichi.

    Over SPIR-V, Taichi launches ``MOST_THREADS`` for any loop whose length it learns at run time. For a small body most
    of them are idle, and a software device spends all its time on them. Few numbers are chosen from, as kernels are
    compiled for each.
    """
    threads = FEWEST_THREADS
    while threads < items:
        threads *= 8
    return threads if threads < MOST_THREADS else None


@primitive
def spread(threads: int | None, items: Any) -> Any:
    """Iterations of a kernel's loop over items: their number, or that of threads, which is at least as large."""
    return threads or items


class Near(NamedTuple):
    """Neighbours of the surface voxels.

    Attributes:
        partner: those of each, in ascending order, shape (room, surface voxels, B).
        count: how many each has, shape (surface voxels, B).
        full: whether one had more than there is room for, shape (1,).
    """

    partner: Any
    count: Any
    full: Any


class Record(NamedTuple):
    """States of the robots before each of the steps from ``first`` on, and the contacts of each, on the device.

    Attributes:
        first: step of the first state.
        states: shape (room * state slots, B).
        log: touching pairs of surface voxels, shape (room, contacts, B, 2).
        logged: number of contacts of each step, shape (room, B).
    """

    first: Any
    states: Any
    log: Any
    logged: Any


@ti.func
def list_voxel(m: ti.template(), r, s, radius_squared, again: ti.template(), t: ti.template(), near: ti.template()):
    """List the surface voxels near surface voxel s, in ascending order; voxels of the plan's PAIRS have room."""
    x, y, z = place(m, r, s, again, t)
    found = 0
    for other in range(t.plan[SURFACE]):
        ox, oy, oz = place(m, r, other, again, t)
        if other > s:  # the difference as the packed driver takes it: later minus earlier
            ox, oy, oz = ox - x, oy - y, oz - z
        else:
            ox, oy, oz = x - ox, y - oy, z - oz
        within = ox * ox + oy * oy + oz * oz <= radius_squared
        if within and t.excluded[s, other // 32] & (1 << (other % 32)) == 0:
            if found < t.plan[PAIRS]:
                near.partner[found, s, r] = other
            found += 1
    near.count[s, r] = ti.min(found, t.plan[PAIRS])
    if found > t.plan[PAIRS]:
        near.full[0] = 1


@ti.func
def place(m: ti.template(), r, s, again: ti.template(), t: ti.template()):
    """Where a surface voxel is, or was when the list was last built."""
    return load_all(m, r, listed_slots(s, t) if ti.static(again) else place_slots(s, t))


@ti.func
def gather_contacts(m: ti.template(), r, s, t: ti.template(), lists: ti.template()):
    """Sum of the contact forces on a surface voxel, partners in ascending order; how many later ones touch it."""
    x, y, z, size = surface_place(m, r, s, t)
    fx, fy, fz = 0.0 * size, 0.0 * size, 0.0 * size
    touching = 0
    for q in range(lists.count[s, r]):
        other = lists.partner[q, s, r]
        ox, oy, oz, other_size = surface_place(m, r, other, t)
        limit = contact.reach(size, other_size)
        if other > s:
            dx, dy, dz = ox - x, oy - y, oz - z
            near = dx * dx + dy * dy + dz * dz < limit * limit
            if near:
                gx, gy, gz = contact_force(m, r, s, other, dx, dy, dz, limit, near, t)
                fx, fy, fz = fx - gx, fy - gy, fz - gz
                touching += 1
        else:
            dx, dy, dz = x - ox, y - oy, z - oz
            near = dx * dx + dy * dy + dz * dz < limit * limit
            if near:
                gx, gy, gz = contact_force(m, r, other, s, dx, dy, dz, limit, near, t)
                fx, fy, fz = fx + gx, fy + gy, fz + gz
    return fx, fy, fz, touching


@ti.func
def log_contacts(m: ti.template(), r, s, step, count, t: ti.template(), lists: ti.template(), record: ti.template()):
    """Log the later surface voxels that touch surface voxel s, ``count`` of them.

    They take their places in the log all at once: threads rarely meet so, and Mesa 22.3's software device loses count
    of atomic additions in a loop.
    """
    place_in_log = ti.atomic_add(record.logged[step, r], count)
    x, y, z, size = surface_place(m, r, s, t)
    for q in range(lists.count[s, r]):
        other = lists.partner[q, s, r]
        ox, oy, oz, other_size = surface_place(m, r, other, t)
        limit = contact.reach(size, other_size)
        dx, dy, dz = ox - x, oy - y, oz - z
        if other > s and dx * dx + dy * dy + dz * dz < limit * limit:
            if place_in_log < record.log.shape[1]:
                record.log[step, place_in_log, r, 0] = s
                record.log[step, place_in_log, r, 1] = other
            place_in_log += 1


@ti.func
def gather_links(m: ti.template(), r, v, t: ti.template()):
    """Sum of what a voxel's links give and take: those on the negative sides first, as in the packed driver."""
    fx = 0.0 * load(m, r, t.plan[memory.CURRENT] + memory.MEAN_SIZE)
    fy, fz, mx, my, mz = fx, fx, fx, fx, fx
    side = v * columns.VOXEL_COLUMNS + columns.SIDE_LINK
    for axis in ti.static(range(3)):
        l = t.voxel[side + 2 * axis]
        if l >= 0:
            gx, gy, gz, nx, ny, nz = load_all(m, r, consecutive(t.plan[FORCE] + 12 * l + 6, 6))
            fx, fy, fz = fx - gx, fy - gy, fz - gz
            mx, my, mz = mx - nx, my - ny, mz - nz
    for axis in ti.static(range(3)):
        l = t.voxel[side + 2 * axis + 1]
        if l >= 0:
            gx, gy, gz, nx, ny, nz = load_all(m, r, consecutive(t.plan[FORCE] + 12 * l, 6))
            fx, fy, fz = fx + gx, fy + gy, fz + gz
            mx, my, mz = mx + nx, my + ny, mz + nz
    return fx, fy, fz, mx, my, mz


@ti.func
def link_forces(m: ti.template(), r, l, t: ti.template()):
    """Keep the forces and moments of a link."""
    ends = link_stage(m, r, l, t)
    slot, axes = t.plan[FORCE] + 12 * l, link_axes(l, t)
    store_all(m, r, end_slots(slot, axes) + end_slots(slot + 6, axes), ends)


@ti.func
def move_voxel(m: ti.template(), r, v, t: ti.template()):
    """Integrate a voxel; strains for the next step; how far surface voxels have moved."""
    fx, fy, fz, mx, my, mz = gather_links(m, r, v, t)
    fx, fy, fz = add_pressure(m, r, v, fx, fy, fz, t)
    s = t.voxel[v * columns.VOXEL_COLUMNS + columns.SURFACE_SLOT]
    zero = 0.0 * load(m, r, t.plan[memory.CURRENT] + memory.MEAN_SIZE)
    cx, cy, cz = zero, zero, zero
    if s >= 0 and t.plan[CONTACT_ON] != 0:
        cx, cy, cz = load_all(m, r, consecutive(t.plan[memory.CONTACT] + 3 * s, 3))
    x, y, z = voxel_stage(m, r, v, fx, fy, fz, mx, my, mz, cx, cy, cz, t)
    if t.voxel[v * columns.VOXEL_COLUMNS + columns.GAUGE] >= 0:
        gauge_stage(m, r, v, t)
    if s >= 0 and t.plan[CONTACT_ON] != 0:
        limit = contact.REBUILD_DISTANCE * t.edge
        if squared_move(m, r, s, x, y, z, t) > limit * limit:
            store(m, r, t.plan[MONITOR] + memory.MOVED, FAR)  # by several threads, all the same


def for_every(count: int, stage: Any) -> Any:
    """A stage of all items of active robots; ``count`` is the place of their number in the plan."""

    @ti.func
    def run(threads: ti.template(), m: ti.template(), t: ti.template(), lanes: ti.template()):
        for n in range(spread(threads, t.plan[count] * m.shape[1])):
            i, r = n // m.shape[1], n % m.shape[1]
            if i < t.plan[count] and lanes[0, r, STATE] == ACTIVE:
                stage(m, r, i, t)

    return run


@ti.func
def begin(threads: ti.template(), step: ti.template(), m: ti.template(), t: ti.template(), marks: ti.template()):
    """Events due at a step, ends and divergence."""
    for r in range(spread(threads, m.shape[1])):
        if r < m.shape[1]:
            if marks.lanes[0, r, STATE] == ACTIVE and load(m, r, t.plan[MONITOR] + memory.DIVERGED) > 0.5:
                marks.lanes[0, r, STATE] = marking.DIVERGED
                marks.lanes[0, r, marking.STEP] = step
            if marks.lanes[0, r, STATE] == ACTIVE:
                marking.meet_events(m, 0, 0, r, step, t, marks)
                if marks.lanes[0, r, marking.LENGTH] == step:
                    marks.lanes[0, r, STATE] = marking.ENDED
                    marks.lanes[0, r, marking.STEP] = step


@ti.func
def evaluate_group(m: ti.template(), r, g, t: ti.template()):
    """Channels of a group for this step, and what follows from them."""
    for q in range(QUANTITY_COUNT):
        evaluate_channel(m, r, g * QUANTITY_COUNT + q, t)
    derive_group(m, r, g, t)


@ti.func
def list_neighbours(
    threads: ti.template(), m: ti.template(), t: ti.template(), lanes: ti.template(), near: ti.template()
):
    """Build the lists of robots that have moved too far."""
    for n in range(spread(threads, t.plan[SURFACE] * m.shape[1])):
        s, r = n // m.shape[1], n % m.shape[1]
        if s < t.plan[SURFACE] and lanes[0, r, STATE] == ACTIVE:
            if load(m, r, t.plan[MONITOR] + memory.MOVED) > 0.0:
                list_voxel(m, r, s, t.radius * t.radius, False, t, near)
                store_all(m, r, listed_slots(s, t), place(m, r, s, False, t))


@ti.func
def list_again(threads: ti.template(), m: ti.template(), t: ti.template(), near: ti.template()):
    """Build all lists again, from where they were built last."""
    for n in range(spread(threads, t.plan[SURFACE] * m.shape[1])):
        s, r = n // m.shape[1], n % m.shape[1]
        if s < t.plan[SURFACE]:
            list_voxel(m, r, s, t.radius * t.radius, True, t, near)


@ti.func
def keep(n: ti.template(), m: ti.template(), t: ti.template(), record: ti.template()):
    """Copy the state to place n of a record."""
    for slot, r in ti.ndrange(t.plan[STATE_SLOTS], m.shape[1]):
        record.states[n * t.plan[STATE_SLOTS] + slot, r] = m[slot, r]
        if slot == 0:
            record.logged[n, r] = 0


@ti.func
def collide(
    threads: ti.template(),
    step: ti.template(),
    m: ti.template(),
    t: ti.template(),
    lanes: ti.template(),
    near: ti.template(),
    record: ti.template(),
):
    """Contact forces, and no moves yet; contacts are logged in a record if the step has a place there (>= 0)."""
    for n in range(spread(threads, t.plan[SURFACE] * m.shape[1])):
        s, r = n // m.shape[1], n % m.shape[1]
        if s < t.plan[SURFACE] and lanes[0, r, STATE] == ACTIVE:
            if s == 0:
                store(m, r, t.plan[MONITOR] + memory.MOVED, 0.0)
            fx, fy, fz, touching = gather_contacts(m, r, s, t, near)
            store_all(m, r, consecutive(t.plan[memory.CONTACT] + 3 * s, 3), (fx, fy, fz))
            if step >= 0 and touching > 0:
                log_contacts(m, r, s, step, touching, t, near, record)


group_stages = for_every(memory.GROUPS, evaluate_group)
rest_stages = for_every(memory.RESTS, derive_rest)
link_stages = for_every(LINKS, link_forces)
square_stages = for_every(SQUARES, square_stage)
voxel_stages = for_every(memory.VOXELS, move_voxel)


@ti.func
def take_step(
    threads: ti.template(),
    has: ti.template(),
    step: ti.template(),
    n: ti.template(),
    m: ti.template(),
    t: ti.template(),
    marks: ti.template(),
    near: ti.template(),
    record: ti.template(),
):
    """One time step of all robots; its contacts are logged in place n of a record if that is not negative."""
    begin(threads, step, m, t, marks)
    group_stages(threads, m, t, marks.lanes)
    rest_stages(threads, m, t, marks.lanes)
    if ti.static(has.contacts):
        list_neighbours(threads, m, t, marks.lanes, near)
        collide(threads, n, m, t, marks.lanes, near, record)
    link_stages(threads, m, t, marks.lanes)
    if ti.static(has.squares):
        square_stages(threads, m, t, marks.lanes)
    voxel_stages(threads, m, t, marks.lanes)


class Has(NamedTuple):
    """Which stages a step has, known when kernels are compiled: those of contacts, and of squares under pressure."""

    contacts: bool
    squares: bool


@dataclass(frozen=True)
class SteppedKernels:
    """A step, and what may be done between steps: build all lists again, keep the state in a record."""

    step: Any
    list_again: Any
    keep: Any


@lru_cache
def stepped_kernels(real: Real, medium: Medium, threads: int | None, has: Has) -> SteppedKernels:
    """Kernels for one precision, kind of surroundings and of step, and so many threads (see ``threads_for``)."""
    m, i32 = real.scalars(2), ti.i32
    near, no_list = Near(ints(3), ints(2), ints(1)), Near(None, None, None)
    kept, logged = Record(None, m, None, ints(2)), Record(None, None, ints(4), ints(2))
    read = ["link", "voxel", "rest", "corner", "start", "time_step", "edge", "gravity", "relief"]
    read += ["surface", "excluded", "radius"] if has.contacts else []
    read += ["square"] if has.squares else []
    lists = near if has.contacts else no_list
    log = logged if has.contacts else logged._replace(log=None, logged=None)
    every = m, shared_types(real, medium, read), mark_types(real), lists, log
    again = m, shared_types(real, medium, ("surface", "excluded", "radius")), near

    return SteppedKernels(
        partial(kernel_of(take_step, threads, has, i32, i32, *every), threads, has),
        partial(kernel_of(list_again, threads, *again), threads),
        kernel_of(keep, i32, m, shared_types(real, medium, ()), kept),
    )
