"""The kernels of the reverse of the stepped driver: scalars, a loop per stage of a step, a kernel for all of them.

The stages are those of the reverse of the packed driver. Where several threads add to the same cotangent they do so
atomically, so on a GPU the last digits of a gradient depend on their order.
"""

from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any, NamedTuple

from taichi_sim.autodiff.lanes import Real, ints
from taichi_sim.autodiff.tracing import primitive
from taichi_sim.bundling import kernel_of
from taichi_sim.lattice.drivers.marks import ACTIVE, STATE, Way, mark_types, meet_events_back, receive_sizes
from taichi_sim.lattice.drivers.stepped_kernels import Has, Record, spread
from taichi_sim.lattice.program import QUANTITY_COUNT
from taichi_sim.lattice.stages import columns, memory
from taichi_sim.lattice.stages.columns import Medium, Shared, shared_types
from taichi_sim.lattice.stages.contact import contact_adjoint
from taichi_sim.lattice.stages.enclosure import square_adjoint
from taichi_sim.lattice.stages.gauges import gauge_adjoint
from taichi_sim.lattice.stages.groups import (
    channel_adjoint,
    derive_group,
    derive_rest,
    recall_channel,
    rests_adjoint,
    state_adjoint,
)
from taichi_sim.lattice.stages.link import link_adjoint, rest_slot
from taichi_sim.lattice.stages.memory import GROUPS, LINKS, RESTS, SQUARES, STATE_SLOTS, VOXELS
from taichi_sim.lattice.stages.undo import Undo
from taichi_sim.lattice.stages.voxel import voxel_adjoint
from taichi_sim.runtime import element, emit, ti


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


def for_every(count: int, adjoint: Any, each: int = 1) -> Any:
    """The reverse of a stage, of all items of active robots.

    ``count`` is the place in the plan of how many things they have, ``each`` how many items every thing has.
    """

    @ti.func
    def undo(
        threads: ti.template(), step: ti.template(), memories: ti.template(), t: ti.template(), lanes: ti.template()
    ):
        robots = memories.m.shape[1]
        for n in range(spread(threads, t.plan[count] * each * robots)):
            i, r = n // robots, n % robots
            if i < t.plan[count] * each and lanes[0, r, STATE] == ACTIVE:
                adjoint(ti.static(step_of(memories, step, r, t)), i, t)

    return undo


@ti.func
def recall(threads: ti.template(), n: ti.template(), memories: ti.template(), t: ti.template()):
    """Parameters of the step that led to record n."""
    m, record = ti.static(memories.m, memories.record)
    robots = m.shape[1]
    for j in range(spread(threads, t.plan[GROUPS] * robots)):
        g, r = j // robots, j % robots
        if g < t.plan[GROUPS]:
            for q in range(QUANTITY_COUNT):
                recall_channel(m, r, g * QUANTITY_COUNT + q, record, r, n * t.plan[STATE_SLOTS], t)
            derive_group(m, r, g, t)
    for j in range(spread(threads, t.plan[RESTS] * robots)):
        i, r = j // robots, j % robots
        if i < t.plan[RESTS]:
            derive_rest(m, r, i, t)


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
def undo_rests(
    threads: ti.template(), n: ti.template(), memories: ti.template(), t: ti.template(), lanes: ti.template()
):
    """Rest lengths, a thread per robot."""
    for r in range(spread(threads, memories.m.shape[1])):
        if r < memories.m.shape[1] and lanes[0, r, STATE] == ACTIVE:
            rests_adjoint(ti.static(step_of(memories, n, r, t)), t)


class Column(NamedTuple):
    """A robot's column in the memories: of one step, its lane, how many slots it has, and the tables."""

    u: Any
    lane: Any
    slots: Any
    t: Any


@ti.func
def end_run(own: ti.template(), robot, marks: ti.template()):
    """Let a robot's cotangents be those of its last state."""
    u, lane, t = ti.static((own.u, own.lane, own.t))
    for slot in range(own.slots):
        u.a[u.k + slot, lane] = 0.0
    for v in range(t.plan[VOXELS]):
        for c in range(memory.STICKS):
            voxel = u.k + t.plan[memory.VOXEL] + v * memory.VOXEL_WIDTH
            u.a[voxel + c, lane] = marks.finals[robot, v, c]


@ti.func
def receive(own: ti.template(), robot, snapshot, step, marks: ti.template()):
    """Add the cotangents of a recorded pose, of the strains of its links and of its rest sizes."""
    u, lane, t = ti.static((own.u, own.lane, own.t))
    for v in range(t.plan[VOXELS]):
        for c in range(7):
            voxel = u.k + t.plan[memory.VOXEL] + v * memory.VOXEL_WIDTH
            u.a[voxel + c, lane] += marks.poses[robot, snapshot, v, c]
    if step > 0:  # what links remember at the start of a run is given
        for l in range(t.plan[LINKS]):
            rest = u.k + rest_slot(l, t) + 1
            link = t.plan[memory.LINK] + l * memory.LINK_WIDTH
            u.a[u.k + link, lane] += marks.strains[robot, snapshot, l] * u.m[rest, lane]
            u.a[rest, lane] += marks.strains[robot, snapshot, l] * u.record[u.r + u.new + link, lane]
    receive_sizes(u, lane, robot, snapshot, step, t, marks)


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
            way = ti.static(Way(u, 0, r, t, end_run, receive, Column(u, r, slots, t)))
            meet_events_back(way, step, marks)


undo_voxels = for_every(VOXELS, undo_voxel)
undo_links = for_every(LINKS, link_adjoint)
undo_squares = for_every(SQUARES, square_adjoint)
undo_states = for_every(GROUPS, state_adjoint)
undo_channels = for_every(GROUPS, channel_adjoint, QUANTITY_COUNT)


@ti.func
def undo_step(
    threads: ti.template(),
    has: ti.template(),
    n: ti.template(),
    memories: ti.template(),
    t: ti.template(),
    lanes: ti.template(),
    record: ti.template(),
):
    """Undo the step from record n to the next."""
    recall(threads, n + 1, memories, t)
    undo_voxels(threads, n, memories, t, lanes)
    undo_links(threads, n, memories, t, lanes)
    if ti.static(has.squares):
        undo_squares(threads, n, memories, t, lanes)
    if ti.static(has.contacts):
        contacts(threads, n, memories, t, lanes, record)
    undo_rests(threads, n, memories, t, lanes)
    undo_states(threads, n, memories, t, lanes)
    undo_channels(threads, n, memories, t, lanes)


@dataclass(frozen=True)
class ReverseKernels:
    """A step undone, parameters recalled for what is due at a step, and that undone."""

    step: Any
    recall: Any
    marks: Any


@lru_cache
def reverse_kernels(real: Real, medium: Medium, threads: int | None, has: Has) -> ReverseKernels:
    """Kernels for one precision, kind of surroundings and of step, and so many threads (see ``threads_for``).

    The first number that they are given is the place in the record before the step.
    """
    i32, lanes, memory = ti.i32, ints(3), real.scalars(2)
    memories = Undo(memory, None, memory, None, memory, None, None)

    def reading(*names: str) -> Shared:
        return shared_types(real, medium, names)

    def spreading(stages: Any, *types: Any) -> Any:
        return partial(kernel_of(stages, threads, *types), threads)

    read = ["link", "voxel", "rest", "time_step", "edge", "gravity", "relief"]
    read += ["surface"] if has.contacts else []
    read += ["square"] if has.squares else []
    log = Record(None, None, ints(4), ints(2)) if has.contacts else Record(None, None, None, None)
    return ReverseKernels(
        partial(kernel_of(undo_step, threads, has, i32, memories, reading(*read), lanes, log), threads, has),
        spreading(recall, i32, memories._replace(a=None), reading("rest", "edge", "gravity")),
        spreading(meet, i32, i32, i32, memories, reading("link", "edge"), mark_types(real, back=True)),
    )
