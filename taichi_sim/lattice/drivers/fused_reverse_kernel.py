"""The reverse of the fused driver: blocks of robots in lanes, from the last recorded step back to the first.

A step is undone in the opposite order: voxel by voxel from the last to the first, each with its gauges and its own
links, then pressure on squares, contacts, then what follows from the channels. Cotangents change in place from those
of the state after the step to those of the state before it.
"""

from functools import lru_cache
from typing import Any

from taichi_sim.autodiff.lanes import Real
from taichi_sim.lattice.drivers import marks as marking
from taichi_sim.lattice.drivers.marks import Marks
from taichi_sim.lattice.stages import columns
from taichi_sim.lattice.stages.columns import Shared, Undo
from taichi_sim.lattice.stages.contact import contact_adjoint, were_near
from taichi_sim.lattice.stages.enclosure import square_adjoint
from taichi_sim.lattice.stages.groups import group_adjoint, recall_groups
from taichi_sim.lattice.stages.link import link_adjoint
from taichi_sim.lattice.stages.memory import SQUARES, STATE_SLOTS, VOXELS
from taichi_sim.lattice.stages.voxel_adjoint import gauge_adjoint, voxel_adjoint
from taichi_sim.runtime import GRAIN, ti


@ti.func
def undo_step(u: ti.template(), block, n, bits, t: ti.template(), contacts: ti.template(), start: ti.template()):
    """Reverse step n of the record."""
    recall_groups(u.m, u.k, u.record, u.r, u.new, t)
    for i in range(t.plan[VOXELS]):
        v = t.plan[VOXELS] - 1 - i
        row = v * columns.VOXEL_COLUMNS
        if t.voxel[row + columns.GAUGE] >= 0:
            gauge_adjoint(u, v, t)
        voxel_adjoint(u, v, t)
        for l in range(t.voxel[row + columns.FIRST_LINK], t.voxel[row + columns.END_LINK]):
            link_adjoint(u, l, t)
    for q in range(t.plan[SQUARES]):
        square_adjoint(u, q, t)
    for q in range(start[block, n], start[block, n + 1]):
        s1, s2 = contacts[block, q, 0], contacts[block, q, 1]
        near = were_near(u, s1, s2, t) & ((bits & contacts[block, q, 2]) != 0)
        contact_adjoint(u, s1, s2, near, t)
    group_adjoint(u, t)


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
        time_step: real.scalar,
        voxel_size: real.scalar,
        acceleration: real.scalar,
        m: reals,
        ms: scalars2,
        a: reals,
        a_scalar: scalars2,
        record: reals,
        record_scalar: scalars2,
        plan: ints1,
        link: ints1,
        voxel: ints1,
        rest: ints2,
        square: ints1,
        corner: ints1,
        surface: ints1,
        excluded: ints2,
        start: scalars2,
        bits: bits_type,
        contacts: ints3,
        contact_start: ints2,
        upcoming: ints1,
        lanes: ints3,
        event: ints2,
        value: scalars2,
        poses: scalars4,
        strains: scalars3,
        sizes: scalars4,
        finals: scalars3,
        by_value: scalars2,
    ):
        marks = ti.static(Marks(lanes, event, value, poses, strains, sizes, finals, by_value))
        for i in range(GRAIN * blocks):
            if i % GRAIN == 0:
                # As variables: what a kernel is given is read again after every store.
                dt, edge, gravity = time_step, voxel_size, acceleration
                world = ti.static((dt, edge, gravity, fluid))
                t = ti.static(Shared(plan, link, voxel, rest, square, corner, surface, excluded, start, *world))
                block = i // GRAIN
                k = block * slots
                r = block * room * plan[STATE_SLOTS]
                for back in range(high - low + 1):
                    step = high - back
                    here = (step - first) * plan[STATE_SLOTS]
                    after = here + plan[STATE_SLOTS]
                    if back > 0:
                        u = ti.static(Undo(m, k, record, r, a, here, after))
                        undo_step(u, block, step - first, bits[0], t, contacts, contact_start)
                    if step == upcoming[block]:
                        recall_groups(m, k, record, r, here, t)
                        scalars = ti.static(Undo(ms, k, record_scalar, r, a_scalar, here, here))
                        next_step = marking.NO_MARK
                        for lane in range(width):
                            found = marking.meet_events_back(scalars, block, lane, step, slots, t, marks)
                            next_step = ti.max(next_step, found)
                        upcoming[block] = next_step

    return undo
