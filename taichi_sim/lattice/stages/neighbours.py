"""The list of neighbours that may collide: who is near whom, built again when voxels have moved.

Each robot follows its own rule: its list holds the pairs of surface voxels whose centres were within 2.5 edges
when it was built, and it is built again once one of them has moved more than half an edge. The robots of a block
share one sorted list, the union of theirs, with a bit per robot; so neither neighbours nor batch size change a result.
"""

from typing import Any, NamedTuple

from taichi_sim.autodiff.lanes import NATIVE_WIDTH, Real, any_lane, ints
from taichi_sim.lattice.stages.contact import listed_slots, place_slots
from taichi_sim.lattice.stages.memory import PAIRS, SURFACE
from taichi_sim.runtime import ti

LIST, LENGTH, REBUILDS = 0, 1, 2  # columns of ``info``
NOWHERE = 2**30


class Lists(NamedTuple):
    """The lists of all blocks, and what building them needs; the two of a block take turns.

    Attributes:
        row: first pair of each surface voxel, shape (blocks, 2, surface voxels + 1).
        partner: the other, later surface voxel of each pair, shape (blocks, 2, pairs).
        mask: bits of the lanes whose lists hold the pair, shape (blocks, 2, pairs).
        info: integers of a block: which list holds, its length, how often lists were built; more are the driver's.
        bits: the bit of every lane.
        touched: whether a surface voxel's contact force is begun in this step, shape (blocks, surface voxels).
        fresh: pairs of a voxel that are being collected, shape (blocks, surface voxels).
        scratch, scratch_scalar: surface positions ``bunch`` at a time, and the same memory as scalars.
        near, near_scalar: which of a bunch are near, likewise.
        bunch: voxels that are compared at a time.
    """

    row: Any
    partner: Any
    mask: Any
    info: Any
    bits: Any
    touched: Any
    fresh: Any
    scratch: Any
    scratch_scalar: Any
    near: Any
    near_scalar: Any
    bunch: int


def list_types(real: Real) -> Lists:
    """Types of lists in kernels."""
    bunch = NATIVE_WIDTH[real.precision]
    bunches = ti.types.ndarray(dtype=ti.types.vector(bunch, real.scalar), ndim=3)
    scratch, near = (bunches, real.scalars(4)), (ints(1, bunch), ints(2))
    return Lists(ints(3), ints(3), ints(3), ints(2), ints(1, real.width), ints(2), ints(2), *scratch, *near, bunch)


@ti.func
def rebuild_lane(ms: ti.template(), block, k, lane, radius_squared, t: ti.template(), lists: ti.template()):
    """Build one robot's part of a block's list; returns 0 and changes nothing if the list has no room.

    ``ms`` is the memory seen as scalars [slot, lane]. The new list is merged from the old one and the fresh pairs.
    """
    bunch = ti.static(lists.bunch)
    count = t.plan[SURFACE]
    for s in range(count):
        slots = place_slots(s, t)
        for c in ti.static(range(3)):
            lists.scratch_scalar[block, c, s // bunch, s % bunch] = ms[k + slots[c], lane]
    old = lists.info[block, LIST]
    new = 1 - old
    bit = 1 << lane
    length = 0
    for s in range(count):
        found = _near_voxels(block, s, count, radius_squared, t.excluded, lists)
        lists.row[block, new, s] = length
        o = lists.row[block, old, s]
        end = lists.row[block, old, s + 1]
        f = 0
        while f < found or o < end:
            next_fresh = NOWHERE
            next_old = NOWHERE
            if f < found:
                next_fresh = lists.fresh[block, f]
            if o < end:
                next_old = lists.partner[block, old, o]
            robots = 0
            if next_old <= next_fresh:
                robots = lists.mask[block, old, o] & ~bit
                o += 1
            if next_fresh <= next_old:
                robots = robots | bit
                f += 1
            if robots != 0:
                if length < t.plan[PAIRS]:
                    lists.partner[block, new, length] = ti.min(next_fresh, next_old)
                    lists.mask[block, new, length] = robots
                length += 1
    lists.row[block, new, count] = length
    fits = 0
    if length <= t.plan[PAIRS]:
        fits = 1
        lists.info[block, LIST] = new
        lists.info[block, LENGTH] = length
        lists.info[block, REBUILDS] += 1
        for s in range(count):
            slots = listed_slots(s, t)
            for c in ti.static(range(3)):
                ms[k + slots[c], lane] = lists.scratch_scalar[block, c, s // bunch, s % bunch]
    return fits


@ti.func
def _near_voxels(block, s, count, radius_squared, excluded: ti.template(), lists: ti.template()):
    """Collect later surface voxels near surface voxel s, in ascending order; returns their number."""
    bunch = ti.static(lists.bunch)
    found = 0
    x = lists.scratch_scalar[block, 0, s // bunch, s % bunch]
    y = lists.scratch_scalar[block, 1, s // bunch, s % bunch]
    z = lists.scratch_scalar[block, 2, s // bunch, s % bunch]
    for g in range((s + 1) // bunch, (count + bunch - 1) // bunch):
        dx = lists.scratch[block, 0, g] - x
        dy = lists.scratch[block, 1, g] - y
        dz = lists.scratch[block, 2, g] - z
        within = dx * dx + dy * dy + dz * dz <= radius_squared
        if any_lane(within):
            lists.near[block] = ti.select(within, 1, 0)
            for i in range(bunch):
                if lists.near_scalar[block, i] != 0:
                    other = g * bunch + i
                    if other > s and other < count and excluded[s, other // 32] & (1 << (other % 32)) == 0:
                        lists.fresh[block, found] = other
                        found += 1
    return found
