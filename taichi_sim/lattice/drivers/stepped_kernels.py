"""The kernels of the stepped driver: one thread per robot and link, voxel or surface voxel; a kernel per stage.

The stages and their order are those of the fused driver, and every sum runs in the same order, so that on a CPU the
two drivers agree to the last bit.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from taichi_sim.autodiff.lanes import Real, load, store
from taichi_sim.lattice.drivers.fused_kernel import (
    LANE_ACTIVE,
    LANE_DIVERGED,
    LANE_ENDED,
    LANE_EVENT,
    LANE_LAST_EVENT,
    LANE_LENGTH,
    LANE_STATE,
    LANE_STEP,
    apply_event,
)
from taichi_sim.lattice.laws import contact
from taichi_sim.lattice.stages import columns
from taichi_sim.lattice.stages import forcing as stages
from taichi_sim.lattice.stages.columns import SURFACE_COLUMNS, SURFACE_VOXEL
from taichi_sim.lattice.stages.link import link_stage
from taichi_sim.lattice.stages.memory import (
    CONTACT,
    CONTACT_ON,
    CURRENT,
    DIVERGED,
    FORCE,
    LINKS,
    MEAN_SIZE,
    MONITOR,
    MOVED,
    PAIRS,
    SQUARES,
    STATE_SLOTS,
    SURFACE,
    VOXEL,
    VOXELS,
    WATCH,
)
from taichi_sim.lattice.stages.voxel import gauge_stage, squared_move, voxel_stage
from taichi_sim.runtime import ti


@dataclass(frozen=True)
class SteppedKernels:
    """The kernels of a step, in the order in which they run."""

    begin: Any
    watch: Any
    keep: Any
    collide: Any
    links: Any
    squares: Any
    voxels: Any


@ti.func
def rebuild_voxel(
    m: ti.template(),
    r,
    s,
    radius_squared,
    from_watch: ti.template(),
    plan: ti.template(),
    surface: ti.template(),
    excluded: ti.template(),
    partner: ti.template(),
    count: ti.template(),
    full: ti.template(),
):
    """List the surface voxels near surface voxel s, in ascending order; voxels of the plan's PAIRS have room."""
    x, y, z = place(m, r, s, from_watch, plan, surface)
    found = 0
    for other in range(plan[SURFACE]):
        ox, oy, oz = place(m, r, other, from_watch, plan, surface)
        if other > s:  # the difference as the fused driver takes it: later minus earlier
            ox, oy, oz = ox - x, oy - y, oz - z
        else:
            ox, oy, oz = x - ox, y - oy, z - oz
        near = ox * ox + oy * oy + oz * oz <= radius_squared
        if near and excluded[s, other // 32] & (1 << (other % 32)) == 0:
            if found < plan[PAIRS]:
                partner[found, s, r] = other
            found += 1
    count[s, r] = ti.min(found, plan[PAIRS])
    if found > plan[PAIRS]:
        full[0] = 1


@ti.func
def place(m: ti.template(), r, s, from_watch: ti.template(), plan: ti.template(), surface: ti.template()):
    """Where a surface voxel is, or was when the list was last built."""
    slot = plan[VOXEL] + surface[SURFACE_COLUMNS * s + SURFACE_VOXEL]
    if ti.static(from_watch):
        slot = plan[WATCH] + 3 * s
    return load(m, r, slot), load(m, r, slot + 1), load(m, r, slot + 2)


@ti.func
def gather_contacts(
    m: ti.template(),
    r,
    s,
    plan: ti.template(),
    surface: ti.template(),
    partner: ti.template(),
    count: ti.template(),
    n,
    log: ti.template(),
    logged: ti.template(),
):
    """Sum of the contact forces on a surface voxel, partners in ascending order; logs pairs that touch if n >= 0."""
    x, y, z, size = stages.surface_place(m, r, s, plan, surface)
    fx = 0.0 * size
    fy = fx
    fz = fx
    for q in range(count[s, r]):
        other = partner[q, s, r]
        ox, oy, oz, other_size = stages.surface_place(m, r, other, plan, surface)
        limit = contact.reach(size, other_size)
        if other > s:
            dx, dy, dz = ox - x, oy - y, oz - z
            near = dx * dx + dy * dy + dz * dz < limit * limit
            if near:
                gx, gy, gz = stages.contact_force(m, r, s, other, dx, dy, dz, limit, near, plan, surface)
                fx, fy, fz = fx - gx, fy - gy, fz - gz
                if n >= 0:
                    place_in_log = ti.atomic_add(logged[n, r], 1)
                    if place_in_log < log.shape[1]:
                        log[n, place_in_log, r, 0] = s
                        log[n, place_in_log, r, 1] = other
        else:
            dx, dy, dz = x - ox, y - oy, z - oz
            near = dx * dx + dy * dy + dz * dz < limit * limit
            if near:
                gx, gy, gz = stages.contact_force(m, r, other, s, dx, dy, dz, limit, near, plan, surface)
                fx, fy, fz = fx + gx, fy + gy, fz + gz
    return fx, fy, fz


@ti.func
def gather_links(m: ti.template(), r, v, plan: ti.template(), voxel_table: ti.template()):
    """Sum of what a voxel's links give and take: those on the negative sides first, as the fused driver meets them."""
    fx = 0.0 * load(m, r, plan[CURRENT] + MEAN_SIZE)
    fy = fx
    fz = fx
    mx = fx
    my = fx
    mz = fx
    side = v * columns.VOXEL_COLUMNS + columns.SIDE_LINK
    for axis in ti.static(range(3)):
        l = voxel_table[side + 2 * axis]
        if l >= 0:
            slot = plan[FORCE] + 12 * l + 6
            fx, fy, fz = fx - load(m, r, slot), fy - load(m, r, slot + 1), fz - load(m, r, slot + 2)
            mx, my, mz = mx - load(m, r, slot + 3), my - load(m, r, slot + 4), mz - load(m, r, slot + 5)
    for axis in ti.static(range(3)):
        l = voxel_table[side + 2 * axis + 1]
        if l >= 0:
            slot = plan[FORCE] + 12 * l
            fx, fy, fz = fx + load(m, r, slot), fy + load(m, r, slot + 1), fz + load(m, r, slot + 2)
            mx, my, mz = mx + load(m, r, slot + 3), my + load(m, r, slot + 4), mz + load(m, r, slot + 5)
    return fx, fy, fz, mx, my, mz


@lru_cache
def stepped_kernels(real: Real, fluid: bool) -> SteppedKernels:
    """Kernels for one precision, on the ground or in a fluid; all else that differs is an argument."""
    memory = ti.types.ndarray(dtype=real.scalar, ndim=2)
    ints1, ints2, ints3, ints4 = (ti.types.ndarray(dtype=ti.i32, ndim=n) for n in (1, 2, 3, 4))
    scalars3, scalars4 = (ti.types.ndarray(dtype=real.scalar, ndim=n) for n in (3, 4))

    @ti.kernel
    def begin(
        t: ti.i32,
        edge: real.scalar,
        gravity: real.scalar,
        m: memory,
        plan: ints1,
        link_table: ints1,
        rest_table: ints2,
        lanes: ints2,
        event: ints2,
        event_value: memory,
        poses: scalars4,
        strains: scalars3,
        sizes: scalars4,
    ):
        """Events due at step t, ends and divergence; then this step's channels and rest lengths."""
        for r in range(m.shape[1]):
            if lanes[r, LANE_STATE] == LANE_ACTIVE and load(m, r, plan[MONITOR] + DIVERGED) > 0.5:
                lanes[r, LANE_STATE] = LANE_DIVERGED
                lanes[r, LANE_STEP] = t
            if lanes[r, LANE_STATE] == LANE_ACTIVE:
                e = lanes[r, LANE_EVENT]
                due = 1
                while due == 1:
                    due = 0
                    if e < lanes[r, LANE_LAST_EVENT]:
                        if event[e, 0] <= t:
                            apply_event(
                                m, 0, r, e, r, plan, link_table, event, event_value, edge, poses, strains, sizes
                            )
                            e += 1
                            due = 1
                lanes[r, LANE_EVENT] = e
                if lanes[r, LANE_LENGTH] == t:
                    lanes[r, LANE_STATE] = LANE_ENDED
                    lanes[r, LANE_STEP] = t
            if lanes[r, LANE_STATE] == LANE_ACTIVE:
                stages.advance_channels(m, r, plan, edge, gravity)
                stages.update_rest_lengths(m, r, plan, rest_table)

    @ti.kernel
    def watch(
        radius: real.scalar,
        limit: real.scalar,
        from_watch: ti.i32,
        m: memory,
        plan: ints1,
        surface: ints1,
        excluded: ints2,
        lanes: ints2,
        partner: ints3,
        count: ints2,
        full: ints1,
    ):
        """Build the lists of robots that have moved too far; or all lists, from where they were built last."""
        for s, r in ti.ndrange(plan[SURFACE], m.shape[1]):
            if from_watch != 0:
                rebuild_voxel(m, r, s, radius * radius, True, plan, surface, excluded, partner, count, full)
            elif lanes[r, LANE_STATE] == LANE_ACTIVE and load(m, r, plan[MONITOR] + MOVED) > limit * limit:
                rebuild_voxel(m, r, s, radius * radius, False, plan, surface, excluded, partner, count, full)
                x, y, z = place(m, r, s, False, plan, surface)
                store(m, r, plan[WATCH] + 3 * s, x)
                store(m, r, plan[WATCH] + 3 * s + 1, y)
                store(m, r, plan[WATCH] + 3 * s + 2, z)

    @ti.kernel
    def keep(n: ti.i32, m: memory, plan: ints1, states: memory, logged: ints2):
        """Copy the state to place n of a record."""
        for slot, r in ti.ndrange(plan[STATE_SLOTS], m.shape[1]):
            states[n * plan[STATE_SLOTS] + slot, r] = m[slot, r]
            if slot == 0:
                logged[n, r] = 0

    @ti.kernel
    def collide(
        m: memory,
        plan: ints1,
        surface: ints1,
        lanes: ints2,
        partner: ints3,
        count: ints2,
        n: ti.i32,
        log: ints4,
        logged: ints2,
    ):
        """Contact forces; those of a recorded step (n >= 0) are logged."""
        for s, r in ti.ndrange(plan[SURFACE], m.shape[1]):
            if lanes[r, LANE_STATE] == LANE_ACTIVE:
                fx, fy, fz = gather_contacts(m, r, s, plan, surface, partner, count, n, log, logged)
                store(m, r, plan[CONTACT] + 3 * s, fx)
                store(m, r, plan[CONTACT] + 3 * s + 1, fy)
                store(m, r, plan[CONTACT] + 3 * s + 2, fz)

    @ti.kernel
    def links(edge: real.scalar, m: memory, plan: ints1, link_table: ints1, voxel_table: ints1, lanes: ints2):
        """Forces and moments of links."""
        for l, r in ti.ndrange(ti.max(plan[LINKS], 1), m.shape[1]):
            if lanes[r, LANE_STATE] == LANE_ACTIVE:
                if l == 0:
                    store(m, r, plan[MONITOR] + MOVED, 0.0)
                if l < plan[LINKS]:
                    fx, fy, fz, mx, my, mz, gx, gy, gz, nx, ny, nz = link_stage(
                        m, r, l, edge, plan, link_table, voxel_table, fluid
                    )
                    slot = plan[FORCE] + 12 * l
                    a = slot + link_table[l * columns.LINK_COLUMNS + columns.LINK_ALONG]
                    b = slot + link_table[l * columns.LINK_COLUMNS + columns.LINK_SIDE_1]
                    c = slot + link_table[l * columns.LINK_COLUMNS + columns.LINK_SIDE_2]
                    store(m, r, a, fx)
                    store(m, r, b, fy)
                    store(m, r, c, fz)
                    store(m, r, a + 3, mx)
                    store(m, r, b + 3, my)
                    store(m, r, c + 3, mz)
                    store(m, r, a + 6, gx)
                    store(m, r, b + 6, gy)
                    store(m, r, c + 6, gz)
                    store(m, r, a + 9, nx)
                    store(m, r, b + 9, ny)
                    store(m, r, c + 9, nz)

    @ti.kernel
    def squares(m: memory, plan: ints1, square_table: ints1, voxel_table: ints1, lanes: ints2):
        """Pressure on the squares of closed surfaces."""
        for q, r in ti.ndrange(plan[SQUARES], m.shape[1]):
            if lanes[r, LANE_STATE] == LANE_ACTIVE:
                stages.square_stage(m, r, q, plan, square_table, voxel_table)

    @ti.kernel
    def voxels(
        dt: real.scalar,
        edge: real.scalar,
        m: memory,
        plan: ints1,
        link_table: ints1,
        voxel_table: ints1,
        corner_table: ints1,
        start: memory,
        lanes: ints2,
    ):
        """Integration of voxels; strains for the next step; how far surface voxels have moved."""
        for v, r in ti.ndrange(plan[VOXELS], m.shape[1]):
            if lanes[r, LANE_STATE] == LANE_ACTIVE:
                fx, fy, fz, mx, my, mz = gather_links(m, r, v, plan, voxel_table)
                fx, fy, fz = stages.add_pressure(m, r, v, fx, fy, fz, plan, voxel_table, corner_table)
                s = voxel_table[v * columns.VOXEL_COLUMNS + columns.SURFACE_SLOT]
                cx = 0.0 * load(m, r, plan[CURRENT] + MEAN_SIZE)
                cy = cx
                cz = cx
                if s >= 0 and plan[CONTACT_ON] != 0:
                    slot = plan[CONTACT] + 3 * s
                    cx, cy, cz = load(m, r, slot), load(m, r, slot + 1), load(m, r, slot + 2)
                x, y, z = voxel_stage(m, r, v, dt, edge, fx, fy, fz, mx, my, mz, cx, cy, cz, plan, voxel_table, start)
                if voxel_table[v * columns.VOXEL_COLUMNS + columns.GAUGE] >= 0:
                    gauge_stage(m, r, v, plan, link_table, voxel_table)
                if s >= 0 and plan[CONTACT_ON] != 0:
                    ti.atomic_max(m[plan[MONITOR] + MOVED, r], squared_move(m, r, s, x, y, z, plan))

    return SteppedKernels(begin, watch, keep, collide, links, squares, voxels)
