"""The kernels of the reverse of the stepped driver: scalars, a kernel per stage of a step.

The stages are those of the reverse of the packed driver. Where several threads add to the same cotangent they do so
atomically, so on a GPU the last digits of a gradient depend on their order.
"""

from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any

from taichi_sim.autodiff.lanes import Real, ints
from taichi_sim.autodiff.tracing import primitive
from taichi_sim.lattice.drivers.marks import ACTIVE, STATE, mark_types, meet_events_back
from taichi_sim.lattice.drivers.stepped_kernels import Record, spread
from taichi_sim.lattice.stages import columns
from taichi_sim.lattice.stages.columns import Medium, Shared, shared_types
from taichi_sim.lattice.stages.contact import contact_adjoint
from taichi_sim.lattice.stages.enclosure import square_adjoint
from taichi_sim.lattice.stages.groups import group_adjoint, recall_groups
from taichi_sim.lattice.stages.link import link_adjoint
from taichi_sim.lattice.stages.memory import LINKS, SQUARES, STATE_SLOTS, VOXELS
from taichi_sim.lattice.stages.undo import Undo
from taichi_sim.lattice.stages.voxel_adjoint import gauge_adjoint, voxel_adjoint
from taichi_sim.runtime import element, emit, kernel_of, ti


@primitive
def step_of(memories: Undo, n: Any, r: Any, t: Shared) -> Undo:
    """The memories with the keys to robot r and to the step from record n to the next."""
    slots = element(t.plan, STATE_SLOTS)
    old = emit(n * slots)
    return memories._replace(k=r, r=r, old=old, new=emit(old + slots))


@ti.func
def undo_voxel(u: ti.template(), v, t: ti.template()):
    """Reverse a voxel's gauges and integration."""
    if t.voxel[v * columns.VOXEL_COLUMNS + columns.GAUGE] >= 0:
        gauge_adjoint(u, v, t)
    voxel_adjoint(u, v, t)


def for_every(count: int, adjoint: Any) -> Any:
    """The reverse of a stage, of all items of active robots; ``count`` is the place of their number in the plan."""

    @ti.func
    def undo(
        threads: ti.template(), step: ti.template(), memories: ti.template(), t: ti.template(), lanes: ti.template()
    ):
        robots = memories.m.shape[1]
        for n in range(spread(threads, t.plan[count] * robots)):
            i, r = n // robots, n % robots
            if i < t.plan[count] and lanes[0, r, STATE] == ACTIVE:
                adjoint(ti.static(step_of(memories, step, r, t)), i, t)

    return undo


@ti.func
def recall(threads: ti.template(), n: ti.template(), memories: ti.template(), t: ti.template()):
    """Parameters of the step that led to record n."""
    for r in range(spread(threads, memories.m.shape[1])):
        if r < memories.m.shape[1]:
            recall_groups(memories.m, r, memories.record, r, n * t.plan[STATE_SLOTS], t)


@ti.func
def contacts(
    threads: ti.template(),
    step: ti.template(),
    memories: ti.template(),
    t: ti.template(),
    lanes: ti.template(),
    record: ti.template(),
):
    """Contacts between voxels."""
    robots = memories.m.shape[1]
    for n in range(spread(threads, record.log.shape[1] * robots)):
        q, r = n // robots, n % robots
        if q < record.logged[step, r] and lanes[0, r, STATE] == ACTIVE:
            u = ti.static(step_of(memories, step, r, t))
            contact_adjoint(u, record.log[step, q, r, 0], record.log[step, q, r, 1], True, t)


@ti.func
def groups(threads: ti.template(), n: ti.template(), memories: ti.template(), t: ti.template(), lanes: ti.template()):
    """Rest lengths, groups and channels."""
    for r in range(spread(threads, memories.m.shape[1])):
        if r < memories.m.shape[1] and lanes[0, r, STATE] == ACTIVE:
            group_adjoint(ti.static(step_of(memories, n, r, t)), t)


@ti.func
def meet(
    threads: ti.template(),
    n: ti.template(),
    step: ti.template(),
    slots: ti.template(),
    memories: ti.template(),
    t: ti.template(),
    marks: ti.template(),
):
    """Ends of runs, events and recordings of a step, n being its place in the record."""
    for r in range(spread(threads, memories.m.shape[1])):
        if r < memories.m.shape[1]:
            here = n * t.plan[STATE_SLOTS]
            u = ti.static(memories._replace(k=0, r=0, old=here, new=here))
            meet_events_back(u, 0, r, step, slots, t, marks)


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
def reverse_kernels(real: Real, medium: Medium, threads: int | None) -> ReverseKernels:
    """Kernels for one precision and kind of surroundings, and so many threads (see ``threads_for``).

    The first number that they are given is the place in the record before the step.
    """
    i32, lanes, memory = ti.i32, ints(3), real.scalars(2)
    memories = Undo(memory, None, memory, None, memory, None, None)

    def reading(*names: str) -> Shared:
        return shared_types(real, medium, names)

    def spreading(stages: Any, *types: Any) -> Any:
        return partial(kernel_of(stages, threads, *types), threads)

    def over(count: int, adjoint: Any, *names: str) -> Any:
        return spreading(for_every(count, adjoint), i32, memories, reading(*names), lanes)

    grouped = reading("rest", "edge", "gravity")
    return ReverseKernels(
        spreading(recall, i32, memories._replace(a=None), grouped),
        over(VOXELS, undo_voxel, "link", "voxel", "time_step", "edge", "relief"),
        over(LINKS, link_adjoint, "link", "voxel", "edge"),
        over(SQUARES, square_adjoint, "square", "voxel"),
        spreading(contacts, i32, memories, reading("surface"), lanes, Record(None, None, ints(4), ints(2))),
        spreading(groups, i32, memories, grouped, lanes),
        spreading(meet, i32, i32, i32, memories, reading("link", "edge"), mark_types(real, back=True)),
    )
