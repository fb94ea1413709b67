"""The kernels of the stepped driver: one thread per robot and link, voxel or surface voxel; a kernel per stage.

The stages and their order are those of the fused driver, and every sum runs in the same order, so that on a CPU the
two drivers agree to the last bit.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from taichi_sim.autodiff.lanes import Real, consecutive, load, load_all, store, store_all
from taichi_sim.lattice.drivers import marks as marking
from taichi_sim.lattice.drivers.marks import ACTIVE, STATE, Marks
from taichi_sim.lattice.laws import contact
from taichi_sim.lattice.stages import columns, memory
from taichi_sim.lattice.stages.columns import Shared
from taichi_sim.lattice.stages.contact import (
    contact_force,
    listed_slots,
    place_slots,
    squared_move,
    surface_place,
)
from taichi_sim.lattice.stages.enclosure import add_pressure, square_stage
from taichi_sim.lattice.stages.groups import group_stage
from taichi_sim.lattice.stages.link import end_slots, link_axes, link_stage
from taichi_sim.lattice.stages.memory import CONTACT_ON, FORCE, LINKS, MONITOR, PAIRS, SQUARES, STATE_SLOTS, SURFACE
from taichi_sim.lattice.stages.voxel import gauge_stage, voxel_stage
from taichi_sim.runtime import ti


@dataclass(frozen=True)
class SteppedKernels:
    """The kernels of a step, in the order in which they run."""

    begin: Any
    list_neighbours: Any
    keep: Any
    collide: Any
    links: Any
    squares: Any
    voxels: Any


@ti.func
def list_voxel(
    m: ti.template(),
    r,
    s,
    radius_squared,
    again: ti.template(),
    t: ti.template(),
    partner: ti.template(),
    count: ti.template(),
    full: ti.template(),
):
    """List the surface voxels near surface voxel s, in ascending order; voxels of the plan's PAIRS have room."""
    x, y, z = place(m, r, s, again, t)
    found = 0
    for other in range(t.plan[SURFACE]):
        ox, oy, oz = place(m, r, other, again, t)
        if other > s:  # the difference as the fused driver takes it: later minus earlier
            ox, oy, oz = ox - x, oy - y, oz - z
        else:
            ox, oy, oz = x - ox, y - oy, z - oz
        near = ox * ox + oy * oy + oz * oz <= radius_squared
        if near and t.excluded[s, other // 32] & (1 << (other % 32)) == 0:
            if found < t.plan[PAIRS]:
                partner[found, s, r] = other
            found += 1
    count[s, r] = ti.min(found, t.plan[PAIRS])
    if found > t.plan[PAIRS]:
        full[0] = 1


@ti.func
def place(m: ti.template(), r, s, again: ti.template(), t: ti.template()):
    """Where a surface voxel is, or was when the list was last built."""
    return load_all(m, r, listed_slots(s, t) if ti.static(again) else place_slots(s, t))


@ti.func
def gather_contacts(
    m: ti.template(),
    r,
    s,
    n,
    t: ti.template(),
    partner: ti.template(),
    count: ti.template(),
    log: ti.template(),
    logged: ti.template(),
):
    """Sum of the contact forces on a surface voxel, partners in ascending order; logs pairs that touch if n >= 0."""
    x, y, z, size = surface_place(m, r, s, t)
    fx, fy, fz = 0.0 * size, 0.0 * size, 0.0 * size
    for q in range(count[s, r]):
        other = partner[q, s, r]
        ox, oy, oz, other_size = surface_place(m, r, other, t)
        limit = contact.reach(size, other_size)
        if other > s:
            dx, dy, dz = ox - x, oy - y, oz - z
            near = dx * dx + dy * dy + dz * dz < limit * limit
            if near:
                gx, gy, gz = contact_force(m, r, s, other, dx, dy, dz, limit, near, t)
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
                gx, gy, gz = contact_force(m, r, other, s, dx, dy, dz, limit, near, t)
                fx, fy, fz = fx + gx, fy + gy, fz + gz
    return fx, fy, fz


@ti.func
def gather_links(m: ti.template(), r, v, t: ti.template()):
    """Sum of what a voxel's links give and take: those on the negative sides first, as the fused driver meets them."""
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


@lru_cache
def stepped_kernels(real: Real, fluid: bool) -> SteppedKernels:
    """Kernels for one precision, on the ground or in a fluid; all else that differs is an argument."""
    reals = ti.types.ndarray(dtype=real.scalar, ndim=2)
    ints1, ints2, ints3, ints4 = (ti.types.ndarray(dtype=ti.i32, ndim=n) for n in (1, 2, 3, 4))
    scalars3, scalars4 = (ti.types.ndarray(dtype=real.scalar, ndim=n) for n in (3, 4))

    @ti.kernel
    def begin(
        step: ti.i32,
        edge: real.scalar,
        gravity: real.scalar,
        m: reals,
        plan: ints1,
        link: ints1,
        rest: ints2,
        lanes: ints3,
        event: ints2,
        value: reals,
        poses: scalars4,
        strains: scalars3,
        sizes: scalars4,
    ):
        """Events due at a step, ends and divergence; then this step's channels and rest lengths."""
        t = ti.static(Shared(plan, link=link, rest=rest, edge=edge, gravity=gravity))
        marks = ti.static(Marks(lanes, event, value, poses, strains, sizes))
        for r in range(m.shape[1]):
            if lanes[0, r, STATE] == ACTIVE and load(m, r, plan[MONITOR] + memory.DIVERGED) > 0.5:
                lanes[0, r, STATE] = marking.DIVERGED
                lanes[0, r, marking.STEP] = step
            if lanes[0, r, STATE] == ACTIVE:
                marking.meet_events(m, 0, 0, r, step, t, marks)
                if lanes[0, r, marking.LENGTH] == step:
                    lanes[0, r, STATE] = marking.ENDED
                    lanes[0, r, marking.STEP] = step
            if lanes[0, r, STATE] == ACTIVE:
                group_stage(m, r, t)

    @ti.kernel
    def list_neighbours(
        radius: real.scalar,
        limit: real.scalar,
        again: ti.i32,
        m: reals,
        plan: ints1,
        surface: ints1,
        excluded: ints2,
        lanes: ints3,
        partner: ints3,
        count: ints2,
        full: ints1,
    ):
        """Build the lists of robots that have moved too far; or all lists again, from where they were built last."""
        t = ti.static(Shared(plan, surface=surface, excluded=excluded))
        for s, r in ti.ndrange(plan[SURFACE], m.shape[1]):
            if again != 0:
                list_voxel(m, r, s, radius * radius, True, t, partner, count, full)
            elif lanes[0, r, STATE] == ACTIVE and load(m, r, plan[MONITOR] + memory.MOVED) > limit * limit:
                list_voxel(m, r, s, radius * radius, False, t, partner, count, full)
                store_all(m, r, listed_slots(s, t), place(m, r, s, False, t))

    @ti.kernel
    def keep(n: ti.i32, m: reals, plan: ints1, states: reals, logged: ints2):
        """Copy the state to place n of a record."""
        for slot, r in ti.ndrange(plan[STATE_SLOTS], m.shape[1]):
            states[n * plan[STATE_SLOTS] + slot, r] = m[slot, r]
            if slot == 0:
                logged[n, r] = 0

    @ti.kernel
    def collide(
        m: reals,
        plan: ints1,
        surface: ints1,
        lanes: ints3,
        partner: ints3,
        count: ints2,
        n: ti.i32,
        log: ints4,
        logged: ints2,
    ):
        """Contact forces; those of a recorded step (n >= 0) are logged."""
        t = ti.static(Shared(plan, surface=surface))
        for s, r in ti.ndrange(plan[SURFACE], m.shape[1]):
            if lanes[0, r, STATE] == ACTIVE:
                force = gather_contacts(m, r, s, n, t, partner, count, log, logged)
                store_all(m, r, consecutive(plan[memory.CONTACT] + 3 * s, 3), force)

    @ti.kernel
    def links(edge: real.scalar, m: reals, plan: ints1, link: ints1, voxel: ints1, lanes: ints3):
        """Forces and moments of links."""
        t = ti.static(Shared(plan, link, voxel, edge=edge, fluid=fluid))
        for l, r in ti.ndrange(ti.max(plan[LINKS], 1), m.shape[1]):
            if lanes[0, r, STATE] == ACTIVE:
                if l == 0:
                    store(m, r, plan[MONITOR] + memory.MOVED, 0.0)
                if l < plan[LINKS]:
                    ends = link_stage(m, r, l, t)
                    slot, axes = plan[FORCE] + 12 * l, link_axes(l, t)
                    store_all(m, r, end_slots(slot, axes) + end_slots(slot + 6, axes), ends)

    @ti.kernel
    def squares(m: reals, plan: ints1, square: ints1, voxel: ints1, lanes: ints3):
        """Pressure on the squares of closed surfaces."""
        t = ti.static(Shared(plan, square=square, voxel=voxel))
        for q, r in ti.ndrange(plan[SQUARES], m.shape[1]):
            if lanes[0, r, STATE] == ACTIVE:
                square_stage(m, r, q, t)

    @ti.kernel
    def voxels(
        dt: real.scalar,
        edge: real.scalar,
        m: reals,
        plan: ints1,
        link: ints1,
        voxel: ints1,
        corner: ints1,
        start: reals,
        lanes: ints3,
    ):
        """Integration of voxels; strains for the next step; how far surface voxels have moved."""
        t = ti.static(Shared(plan, link, voxel, corner=corner, start=start, time_step=dt, edge=edge))
        for v, r in ti.ndrange(plan[memory.VOXELS], m.shape[1]):
            if lanes[0, r, STATE] == ACTIVE:
                fx, fy, fz, mx, my, mz = gather_links(m, r, v, t)
                fx, fy, fz = add_pressure(m, r, v, fx, fy, fz, t)
                s = voxel[v * columns.VOXEL_COLUMNS + columns.SURFACE_SLOT]
                zero = 0.0 * load(m, r, plan[memory.CURRENT] + memory.MEAN_SIZE)
                cx, cy, cz = zero, zero, zero
                if s >= 0 and plan[CONTACT_ON] != 0:
                    cx, cy, cz = load_all(m, r, consecutive(plan[memory.CONTACT] + 3 * s, 3))
                x, y, z = voxel_stage(m, r, v, fx, fy, fz, mx, my, mz, cx, cy, cz, t)
                if voxel[v * columns.VOXEL_COLUMNS + columns.GAUGE] >= 0:
                    gauge_stage(m, r, v, t)
                if s >= 0 and plan[CONTACT_ON] != 0:
                    ti.atomic_max(m[plan[MONITOR] + memory.MOVED, r], squared_move(m, r, s, x, y, z, t))

    return SteppedKernels(begin, list_neighbours, keep, collide, links, squares, voxels)
