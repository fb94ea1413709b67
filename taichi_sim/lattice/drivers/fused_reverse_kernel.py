"""The reverse of the fused driver: blocks of robots in lanes, from the last recorded step back to the first.

A step is undone in the opposite order: voxel by voxel from the last to the first, each with its gauges and its own
links, then pressure on squares, contacts, then what follows from the channels. Cotangents change in place from those
of the state after the step to those of the state before it.
"""

from functools import lru_cache
from typing import Any, NamedTuple

from taichi_sim.autodiff.lanes import Real, ints
from taichi_sim.lattice.drivers import marks as marking
from taichi_sim.lattice.drivers.fused_kernel import Record
from taichi_sim.lattice.drivers.marks import mark_types
from taichi_sim.lattice.stages import columns
from taichi_sim.lattice.stages.columns import in_variables, shared_types
from taichi_sim.lattice.stages.contact import contact_adjoint, were_near
from taichi_sim.lattice.stages.enclosure import square_adjoint
from taichi_sim.lattice.stages.groups import group_adjoint, recall_groups
from taichi_sim.lattice.stages.link import link_adjoint
from taichi_sim.lattice.stages.memory import SQUARES, STATE_SLOTS, VOXELS
from taichi_sim.lattice.stages.undo import Undo
from taichi_sim.lattice.stages.voxel_adjoint import gauge_adjoint, voxel_adjoint
from taichi_sim.runtime import GRAIN, kernel_of, ti


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


class Launch(NamedTuple):
    """How many blocks there are, slots of each, and the steps to go back from and to."""

    blocks: Any
    slots: Any
    high: Any
    low: Any


class Memories(NamedTuple):
    """Parameters and cotangents, as reals and as scalars."""

    m: Any
    ms: Any
    a: Any
    a_scalar: Any


class Turns(NamedTuple):
    """The bit of every lane, and the next step of every block at which a lane has something to do."""

    bits: Any
    upcoming: Any


@lru_cache
def reverse_kernel(real: Real, fluid: bool) -> Any:
    """The kernel for one kind of real, on the ground or in a fluid."""

    @ti.func
    def undo(
        launch: ti.template(),
        memories: ti.template(),
        given: ti.template(),
        turns: ti.template(),
        log: ti.template(),
        marks: ti.template(),
    ):
        m, ms, a, a_scalar = ti.static(memories)
        for i in range(GRAIN * launch.blocks):
            if i % GRAIN == 0:
                t = ti.static(in_variables(given))
                block = i // GRAIN
                k = block * launch.slots
                r = block * log.room * t.plan[STATE_SLOTS]
                for back in range(launch.high - launch.low + 1):
                    step = launch.high - back
                    here = (step - log.first) * t.plan[STATE_SLOTS]
                    after = here + t.plan[STATE_SLOTS]
                    if back > 0:
                        u = ti.static(Undo(m, k, log.states, r, a, here, after))
                        undo_step(u, block, step - log.first, turns.bits[0], t, log.contacts, log.start)
                    if step == turns.upcoming[block]:
                        recall_groups(m, k, log.states, r, here, t)
                        scalars = ti.static(Undo(ms, k, log.scalar_states, r, a_scalar, here, here))
                        next_step = marking.NO_MARK
                        for lane in range(real.width):
                            found = marking.meet_events_back(scalars, block, lane, step, launch.slots, t, marks)
                            next_step = ti.max(next_step, found)
                        turns.upcoming[block] = next_step

    i32, scalars = ti.i32, real.scalars(2)
    return kernel_of(
        undo,
        Launch(i32, i32, i32, i32),
        Memories(real.memory, scalars, real.memory, scalars),
        shared_types(real, fluid),
        Turns(ints(1, real.width), ints(1)),
        Record(True, i32, real.memory, scalars, i32, ints(3), ints(2)),
        mark_types(real, back=True),
    )
