"""The watch list of pairs that may collide: who is near whom, built again when voxels have moved.

Each robot follows its own rule: its list holds the pairs of surface voxels whose centres were within 2.5 edges
when it was built, and it is built again once one of them has moved more than half an edge. The robots of a block
share one sorted list, the union of theirs, with a bit per robot; so neither neighbours nor batch size change a result.
"""

from taichi_sim.autodiff.lanes import any_lane
from taichi_sim.lattice.stages.columns import SURFACE_COLUMNS, SURFACE_VOXEL
from taichi_sim.lattice.stages.memory import PAIRS, SURFACE, VOXEL, WATCH
from taichi_sim.runtime import ti

LIST, LENGTH, REBUILDS = 0, 1, 2  # columns of ``info``
NOWHERE = 2**30


@ti.func
def rebuild_lane(
    ms: ti.template(),
    block,
    k,
    lane,
    bunch: ti.template(),
    radius_squared,
    plan: ti.template(),
    surface: ti.template(),
    excluded: ti.template(),
    scratch: ti.template(),
    scratch_scalar: ti.template(),
    near: ti.template(),
    near_scalar: ti.template(),
    fresh: ti.template(),
    row: ti.template(),
    partner: ti.template(),
    mask: ti.template(),
    info: ti.template(),
):
    """Build one robot's part of a block's list; returns 0 and changes nothing if the list has no room.

    ms is the memory seen as scalars [slot, lane]; scratch holds the robot's surface positions ``bunch`` at a time.
    The lists are double: the new one is merged from the old one and the fresh pairs.
    """
    count = plan[SURFACE]
    for s in range(count):
        for c in ti.static(range(3)):
            voxel = k + plan[VOXEL] + surface[SURFACE_COLUMNS * s + SURFACE_VOXEL]
            scratch_scalar[block, c, s // bunch, s % bunch] = ms[voxel + c, lane]
    old = info[block, LIST]
    new = 1 - old
    bit = 1 << lane
    length = 0
    for s in range(count):
        found = _near_voxels(
            block, s, bunch, count, radius_squared, excluded, scratch, scratch_scalar, near, near_scalar, fresh
        )
        row[block, new, s] = length
        o = row[block, old, s]
        end = row[block, old, s + 1]
        f = 0
        while f < found or o < end:
            next_fresh = NOWHERE
            next_old = NOWHERE
            if f < found:
                next_fresh = fresh[block, f]
            if o < end:
                next_old = partner[block, old, o]
            robots = 0
            if next_old <= next_fresh:
                robots = mask[block, old, o] & ~bit
                o += 1
            if next_fresh <= next_old:
                robots = robots | bit
                f += 1
            if robots != 0:
                if length < plan[PAIRS]:
                    partner[block, new, length] = ti.min(next_fresh, next_old)
                    mask[block, new, length] = robots
                length += 1
    row[block, new, count] = length
    fits = 0
    if length <= plan[PAIRS]:
        fits = 1
        info[block, LIST] = new
        info[block, LENGTH] = length
        info[block, REBUILDS] += 1
        for s in range(count):
            for c in ti.static(range(3)):
                place = scratch_scalar[block, c, s // bunch, s % bunch]
                ms[k + plan[WATCH] + 3 * s + c, lane] = place
    return fits


@ti.func
def _near_voxels(
    block,
    s,
    bunch: ti.template(),
    count,
    radius_squared,
    excluded: ti.template(),
    scratch: ti.template(),
    scratch_scalar: ti.template(),
    near: ti.template(),
    near_scalar: ti.template(),
    fresh: ti.template(),
):
    """Collect later surface voxels near surface voxel s, in ascending order; returns their number."""
    found = 0
    x = scratch_scalar[block, 0, s // bunch, s % bunch]
    y = scratch_scalar[block, 1, s // bunch, s % bunch]
    z = scratch_scalar[block, 2, s // bunch, s % bunch]
    for g in range((s + 1) // bunch, (count + bunch - 1) // bunch):
        dx = scratch[block, 0, g] - x
        dy = scratch[block, 1, g] - y
        dz = scratch[block, 2, g] - z
        within = dx * dx + dy * dy + dz * dz <= radius_squared
        if any_lane(within):
            near[block] = ti.select(within, 1, 0)
            for i in range(bunch):
                if near_scalar[block, i] != 0:
                    other = g * bunch + i
                    if other > s and other < count and excluded[s, other // 32] & (1 << (other % 32)) == 0:
                        fresh[block, found] = other
                        found += 1
    return found
