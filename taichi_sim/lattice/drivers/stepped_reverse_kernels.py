"""The kernels of the reverse of the stepped driver: scalars, a kernel per stage of a step.

The stages are those of the reverse of the fused driver. Where several threads add to the same cotangent they do so
atomically, so on a GPU the last digits of a gradient depend on their order.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from taichi_sim.autodiff.lanes import Real
from taichi_sim.lattice.drivers.marks import ACTIVE, STATE, Marks, meet_events_back
from taichi_sim.lattice.stages import columns
from taichi_sim.lattice.stages.columns import Shared, Undo
from taichi_sim.lattice.stages.contact import contact_adjoint
from taichi_sim.lattice.stages.enclosure import square_adjoint
from taichi_sim.lattice.stages.groups import group_adjoint, recall_groups
from taichi_sim.lattice.stages.link import link_adjoint
from taichi_sim.lattice.stages.memory import LINKS, SQUARES, STATE_SLOTS, VOXELS
from taichi_sim.lattice.stages.voxel_adjoint import gauge_adjoint, voxel_adjoint
from taichi_sim.runtime import ti


@dataclass(frozen=True)
class ReverseKernels:
    """The kernels of a step undone, in the order in which they run."""

    recall: Any
    voxels: Any
    links: Any
    squares: Any
    contacts: Any
    groups: Any
    marks: Any


@lru_cache
def reverse_kernels(real: Real, fluid: bool) -> ReverseKernels:
    """Kernels for one precision, on the ground or in a fluid; n is the place in the record before the step."""
    reals = ti.types.ndarray(dtype=real.scalar, ndim=2)
    ints1, ints2, ints3, ints4 = (ti.types.ndarray(dtype=ti.i32, ndim=n) for n in (1, 2, 3, 4))
    scalars3, scalars4 = (ti.types.ndarray(dtype=real.scalar, ndim=n) for n in (3, 4))

    @ti.kernel
    def recall(n: ti.i32, edge: real.scalar, gravity: real.scalar, m: reals, record: reals, plan: ints1, rest: ints2):
        """Parameters of the step that led to record n."""
        t = ti.static(Shared(plan, rest=rest, edge=edge, gravity=gravity))
        for r in range(m.shape[1]):
            recall_groups(m, r, record, r, n * plan[STATE_SLOTS], t)

    @ti.kernel
    def voxels(
        n: ti.i32,
        dt: real.scalar,
        edge: real.scalar,
        m: reals,
        record: reals,
        a: reals,
        plan: ints1,
        link: ints1,
        voxel: ints1,
        lanes: ints3,
    ):
        """Gauges and integration."""
        t = ti.static(Shared(plan, link, voxel, time_step=dt, edge=edge))
        for v, r in ti.ndrange(plan[VOXELS], m.shape[1]):
            if lanes[0, r, STATE] == ACTIVE:
                old = n * plan[STATE_SLOTS]
                new = old + plan[STATE_SLOTS]
                u = ti.static(Undo(m, r, record, r, a, old, new))
                if voxel[v * columns.VOXEL_COLUMNS + columns.GAUGE] >= 0:
                    gauge_adjoint(u, v, t)
                voxel_adjoint(u, v, t)

    @ti.kernel
    def links(
        n: ti.i32,
        edge: real.scalar,
        m: reals,
        record: reals,
        a: reals,
        plan: ints1,
        link: ints1,
        voxel: ints1,
        lanes: ints3,
    ):
        """Beams."""
        t = ti.static(Shared(plan, link, voxel, edge=edge, fluid=fluid))
        for l, r in ti.ndrange(plan[LINKS], m.shape[1]):
            if lanes[0, r, STATE] == ACTIVE:
                old = n * plan[STATE_SLOTS]
                new = old + plan[STATE_SLOTS]
                u = ti.static(Undo(m, r, record, r, a, old, new))
                link_adjoint(u, l, t)

    @ti.kernel
    def squares(n: ti.i32, m: reals, record: reals, a: reals, plan: ints1, square: ints1, voxel: ints1, lanes: ints3):
        """Pressure on the squares of closed surfaces."""
        t = ti.static(Shared(plan, square=square, voxel=voxel))
        for q, r in ti.ndrange(plan[SQUARES], m.shape[1]):
            if lanes[0, r, STATE] == ACTIVE:
                old = n * plan[STATE_SLOTS]
                new = old + plan[STATE_SLOTS]
                u = ti.static(Undo(m, r, record, r, a, old, new))
                square_adjoint(u, q, t)

    @ti.kernel
    def contacts(
        n: ti.i32,
        m: reals,
        record: reals,
        a: reals,
        plan: ints1,
        surface: ints1,
        lanes: ints3,
        log: ints4,
        logged: ints2,
    ):
        """Contacts between voxels."""
        t = ti.static(Shared(plan, surface=surface))
        for q, r in ti.ndrange(log.shape[1], m.shape[1]):
            if q < logged[n, r] and lanes[0, r, STATE] == ACTIVE:
                old = n * plan[STATE_SLOTS]
                new = old + plan[STATE_SLOTS]
                u = ti.static(Undo(m, r, record, r, a, old, new))
                contact_adjoint(u, log[n, q, r, 0], log[n, q, r, 1], True, t)

    @ti.kernel
    def groups(
        n: ti.i32,
        edge: real.scalar,
        gravity: real.scalar,
        m: reals,
        record: reals,
        a: reals,
        plan: ints1,
        rest: ints2,
        lanes: ints3,
    ):
        """Rest lengths, groups and channels."""
        t = ti.static(Shared(plan, rest=rest, edge=edge, gravity=gravity))
        for r in range(m.shape[1]):
            if lanes[0, r, STATE] == ACTIVE:
                old = n * plan[STATE_SLOTS]
                new = old + plan[STATE_SLOTS]
                u = ti.static(Undo(m, r, record, r, a, old, new))
                group_adjoint(u, t)

    @ti.kernel
    def marks(
        n: ti.i32,
        step: ti.i32,
        slots: ti.i32,
        edge: real.scalar,
        m: reals,
        record: reals,
        a: reals,
        plan: ints1,
        link: ints1,
        lanes: ints3,
        event: ints2,
        value: reals,
        poses: scalars4,
        strains: scalars3,
        sizes: scalars4,
        finals: scalars3,
        by_value: reals,
    ):
        """Ends of runs, events and recordings of a step, n being its place in the record."""
        t = ti.static(Shared(plan, link, edge=edge))
        met = ti.static(Marks(lanes, event, value, poses, strains, sizes, finals, by_value))
        for r in range(m.shape[1]):
            here = n * plan[STATE_SLOTS]
            u = ti.static(Undo(m, 0, record, 0, a, here, here))
            meet_events_back(u, 0, r, step, slots, t, met)

    return ReverseKernels(recall, voxels, links, squares, contacts, groups, marks)
