"""The watch list of pairs that may collide: who is near whom, built again when voxels have moved.

Each robot follows its own rule: its list holds the pairs of surface voxels whose centres were within 2.5 edges
when it was built, and it is built again once one of them has moved more than half an edge. The robots of a block
share one sorted list, the union of theirs, with a bit per robot; so neither neighbours nor batch size change a result.
"""

from taichi_sim.lanes import any_lane
from taichi_sim.runtime import ti

LIST, PAIRS, REBUILDS = 0, 1, 2  # columns of ``info``
NOWHERE = 2**30


@ti.func
def rebuild_lane(
    k, lane, width: ti.template(), bunch: ti.template(), surface_count, capacity, radius_squared,
    surface: ti.template(), excluded: ti.template(), voxel: ti.template(), watch: ti.template(),
    scratch: ti.template(), scratch_scalar: ti.template(), fresh: ti.template(),
    row: ti.template(), partner: ti.template(), mask: ti.template(), info: ti.template(),
):  # fmt: skip
    """Build one robot's part of block k's list; returns 0 and changes nothing if the capacity is too small.

    voxel and watch are the scalar views [block, item, component, lane]; scratch holds the robot's surface
    positions ``bunch`` at a time. The lists are double: the new one is merged from the old one and the fresh pairs.
    """
    for s in range(surface_count):
        for c in ti.static(range(3)):
            scratch_scalar[k, c, s // bunch, s % bunch] = voxel[k, surface[s], c, lane]
    old = info[k, LIST]
    new = 1 - old
    bit = 1 << lane
    length = 0
    for s in range(surface_count):
        found = _near_voxels(
            k, s, bunch, surface_count, radius_squared, excluded, scratch, scratch_scalar, fresh
        )
        row[k, new, s] = length
        o = row[k, old, s]
        end = row[k, old, s + 1]
        f = 0
        while f < found or o < end:
            next_fresh = NOWHERE
            next_old = NOWHERE
            if f < found:
                next_fresh = fresh[k, f]
            if o < end:
                next_old = partner[k, old, o]
            robots = 0
            if next_old <= next_fresh:
                robots = mask[k, old, o] & ~bit
                o += 1
            if next_fresh <= next_old:
                robots = robots | bit
                f += 1
            if robots != 0:
                if length < capacity:
                    partner[k, new, length] = ti.min(next_fresh, next_old)
                    mask[k, new, length] = robots
                length += 1
    row[k, new, surface_count] = length
    fits = 0
    if length <= capacity:
        fits = 1
        info[k, LIST] = new
        info[k, PAIRS] = length
        info[k, REBUILDS] += 1
        for s in range(surface_count):
            for c in ti.static(range(3)):
                watch[k, s, c, lane] = voxel[k, surface[s], c, lane]
    return fits


@ti.func
def _near_voxels(
    k, s, bunch: ti.template(), surface_count, radius_squared,
    excluded: ti.template(), scratch: ti.template(), scratch_scalar: ti.template(), fresh: ti.template(),
):  # fmt: skip
    """Collect later surface voxels near surface voxel s, in ascending order; returns their number."""
    found = 0
    x = scratch_scalar[k, 0, s // bunch, s % bunch]
    y = scratch_scalar[k, 1, s // bunch, s % bunch]
    z = scratch_scalar[k, 2, s // bunch, s % bunch]
    for g in range((s + 1) // bunch, (surface_count + bunch - 1) // bunch):
        dx = scratch[k, 0, g] - x
        dy = scratch[k, 1, g] - y
        dz = scratch[k, 2, g] - z
        near = dx * dx + dy * dy + dz * dz <= radius_squared
        if any_lane(near):
            distances = dx * dx + dy * dy + dz * dz
            for i in ti.static(range(bunch)):
                other = g * bunch + i
                if distances[i] <= radius_squared and other > s and other < surface_count:
                    if excluded[s, other // 32] & (1 << (other % 32)) == 0:
                        fresh[k, found] = other
                        found += 1
    return found
