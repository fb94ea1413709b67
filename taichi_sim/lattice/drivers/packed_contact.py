"""Who may touch whom in a robot whose voxels lie in lanes, and the forces of contact, a pack of pairs at a time."""

from typing import Any, NamedTuple

from taichi_sim.autodiff.lanes import all_lanes, any_lane, consecutive, load, load_all, store_all
from taichi_sim.autodiff.tracing import primitive
from taichi_sim.lattice import materials
from taichi_sim.lattice.drivers.marks import current_size
from taichi_sim.lattice.drivers.packed_lanes import Lanes, gather_all
from taichi_sim.lattice.laws import contact
from taichi_sim.lattice.stages import memory
from taichi_sim.runtime import element, emit, ti

# Columns of the integers of a robot.
STEP, NEXT_MARK, STATE, LISTED, REBUILDS, NEAR, CHANGING, FRESH, LOGGED, KEPT = range(10)
INFO_COLUMNS = 10
RUNNING, FINISHED, OUT_OF_PAIRS = 0, 1, 2

SHORT = 0.1  # voxel edges that a voxel may move, and sizes may grow, before the short list is made again
# Times that much is between what touches and what the short list has: both voxels move, and their reach, 0.625 edges of
# either, grows.
SLACK = 2.0 + 2.0 * 0.625 + 0.05


NEAR_COLUMNS = 6
NOT_THERE = 1e30  # m


class Pairs(NamedTuple):
    """Who may touch whom, robot by robot, and whose contact forces are to be taken.

    Attributes:
        listed: pairs of surface voxels of the neighbour list, shape (B, 2, pairs).
        near: the short list: numbers of both, their places in VOXEL, and those of their groups, shape
            (B, 6, pairs + width).
        seen: positions at which the short list was made, by pack.
        place, place_scalar: scratch, as vectors and as scalars: positions of surface voxels in their order, x, y and z
            by vector, while pairs are listed; the forces of a pack of pairs while they are added.
        sizes: mean sizes of groups at that time, by pack of groups.
        drift: the largest squared distance from ``seen``, by robot.
        touched: whether a pack has a contact force, shape (B, P).
        changing: rows of what is spread that change from step to step, shape (B, rows).
        info: integers of a robot.
    """

    listed: Any
    near: Any
    seen: Any
    place: Any
    place_scalar: Any
    sizes: Any
    drift: Any
    touched: Any
    changing: Any
    info: Any


class Record(NamedTuple):
    """States before each of the steps ``first`` to ``first`` + room - 2, and the contacts of each.

    Attributes:
        kept: whether there is a record; known when a kernel is compiled.
        first: step of the first state.
        states, scalar_states: shape (B * room * state slots, lanes), as reals and as scalars.
        groups, group_column: channels, shape (B * room * slots, lanes), as reals and as scalars [slot, lane].
        contacts: touching pairs of surface voxels, shape (B, contacts, 2).
        start: first contact of each step, shape (B, room).
    """

    kept: bool = False
    first: Any = None
    states: Any = None
    scalar_states: Any = None
    groups: Any = None
    group_column: Any = None
    contacts: Any = None
    start: Any = None


@ti.func
def list_pairs(r: ti.template(), radius_squared):
    """List the pairs of surface voxels that are near, in ascending order; returns 0 if there is no room."""
    i, k, ms, t, p, pairs = ti.static((r.i, r.k, r.ms, r.t, r.p, r.pairs))
    count = 0
    w = ti.static(p.width)
    surface = t.plan[memory.SURFACE]
    rows = scratch_rows(t, w)
    first = i * rows * 3
    for s in range(rows * w):
        at = (first + s // w * 3) * w + s % w
        for c in ti.static(range(3)):
            pairs.place_scalar[at + c * w] = NOT_THERE
        if s < surface:
            place = (k + t.plan[memory.VOXEL]) * w + p.surface[s, 0]
            for c in ti.static(range(3)):
                pairs.place_scalar[at + c * w] = ms[place + c * w]
    for s in range(surface):
        at = (first + s // w * 3) * w + s % w
        x, y, z = pairs.place_scalar[at], pairs.place_scalar[at + w], pairs.place_scalar[at + 2 * w]
        for row in range((s + 1) // w, rows):
            dx, dy, dz = load_all(pairs.place, first + 3 * row, (0, 1, 2))
            dx, dy, dz = dx - x, dy - y, dz - z
            within = dx * dx + dy * dy + dz * dz <= radius_squared
            if any_lane(within):
                q = row * w
                bits = lane_bits(within, w) & ~(t.excluded[s, q // 32] >> (q % 32))
                if q <= s:
                    bits = bits & ~((2 << (s - q)) - 1)
                if bits != 0:
                    for j in range(w):
                        if bits & (1 << j) != 0:
                            if count < pairs.listed.shape[2]:
                                pairs.listed[i, 0, count], pairs.listed[i, 1, count] = s, q + j
                            count += 1
    fits = 0
    if count <= pairs.listed.shape[2]:
        fits = 1
        pairs.info[i, LISTED] = count
        pairs.info[i, REBUILDS] += 1
    return fits


@ti.func
def scratch_rows(t: ti.template(), width: ti.template()):
    """Vectors in which a robot's surface voxels lie in their order."""
    return (t.plan[memory.SURFACE] + width - 1) // width


@ti.func
def lane_bits(condition, width: ti.template()):
    """A whole number with a bit for each lane in which a condition holds."""
    bits = ti.Vector([1 << j for j in ti.static(range(width))])
    return ti.select(condition, bits, 0).sum()


@ti.func
def renew_list(r: ti.template(), radius):
    """List neighbours anew, and note where voxels are; halts the robot if there is no room."""
    i, k, m, t, pairs = ti.static((r.i, r.k, r.m, r.t, r.pairs))
    if list_pairs(r, radius * radius) == 0:
        pairs.info[i, STATE] = OUT_OF_PAIRS
    else:
        for v in range(t.plan[memory.VOXELS]):
            place = load_all(m, k, consecutive(t.plan[memory.VOXEL] + v * memory.VOXEL_WIDTH, 3))
            store_all(m, k, consecutive(t.plan[memory.LISTED] + 3 * v, 3), place)
        zero = 0.0 * load(m, k, t.plan[memory.CONSTANT])
        store_all(m, k, (t.plan[memory.MONITOR] + memory.MOVED,), (zero,))
        pairs.drift[i] = zero + NOT_THERE


@ti.func
def mean_size(c, tg: ti.template()):
    """Slot of the mean size of group c."""
    return current_size(c, tg) - memory.SIZE + memory.MEAN_SIZE


@ti.func
def shorten(r: ti.template(), margin):
    """Make the short list: listed pairs that could touch before a voxel has moved, and sizes grown, by the margin."""
    i, k, h, m, g, t, tg, p, pairs = ti.static((r.i, r.k, r.h, r.m, r.g, r.t, r.tg, r.p, r.pairs))
    count = 0
    w = ti.static(p.width)
    for n in range((pairs.info[i, LISTED] + w - 1) // w):
        one, two = ti.static(of_surface(pairs.listed, i, 0, n * w, p), of_surface(pairs.listed, i, 1, n * w, p))
        dx, dy, dz, limit = offsets(r, one[0], two[0], one[1], two[1])
        limit = limit + SLACK * margin
        far = dx * dx + dy * dy + dz * dz >= limit * limit
        if not all_lanes(far):
            near = ~lane_bits(far, w)
            for j in range(ti.min(w, pairs.info[i, LISTED] - n * w)):
                if near & (1 << j) != 0:
                    enter(r, count, pairs.listed[i, 0, n * w + j], pairs.listed[i, 1, n * w + j])
                    count += 1
    pairs.info[i, NEAR] = count
    for _ in range((w - count % w) % w):  # two who are never near fill up the last pack
        enter(r, count, t.plan[memory.SURFACE], t.plan[memory.SURFACE] + 1)
        count += 1
    for v in range(t.plan[memory.VOXELS]):
        first = (i * t.plan[memory.VOXELS] + v) * 3
        for c in ti.static(range(3)):
            pairs.seen[first + c] = m[k + t.plan[memory.VOXEL] + v * memory.VOXEL_WIDTH + c]
    for c in range(tg.plan[memory.GROUPS]):
        pairs.sizes[i * tg.plan[memory.GROUPS] + c] = load(g, h, mean_size(c, tg))


@ti.func
def enter(r: ti.template(), n, s1, s2):
    """Enter a pair of surface voxels into the short list."""
    i, p, near = ti.static((r.i, r.p, r.pairs.near))
    near[i, 0, n], near[i, 1, n] = s1, s2
    for c in ti.static(range(2)):
        near[i, 2 + 2 * c, n], near[i, 3 + 2 * c, n] = p.surface[s1, c], p.surface[s2, c]


@ti.func
def offsets(r: ti.template(), one: ti.template(), two: ti.template(), group1: ti.template(), group2: ti.template()):
    """Offsets between the voxels of a pack of pairs, and the distances at which they touch."""
    k, h, ms, gs, t, tg, w = ti.static((r.k, r.h, r.ms, r.gs, r.t, r.tg, r.p.width))
    first, size = (k + t.plan[memory.VOXEL]) * w, (h + tg.plan[memory.CURRENT] + memory.MEAN_SIZE) * w
    x1, y1, z1 = gather_all(ms, one, (0, 1, 2), w, first)
    x2, y2, z2 = gather_all(ms, two, (0, 1, 2), w, first)
    limit = contact.reach(gather_all(gs, group1, (0,), w, size)[0], gather_all(gs, group2, (0,), w, size)[0])
    return x2 - x1, y2 - y1, z2 - z1, limit


@ti.func
def collide(r: ti.template(), log: ti.template()):
    """Contact forces of the short list, a pack of pairs at a time; they are added pair by pair, in the list's order."""
    i, k, h, ms, g, gs, t, tg, p, pairs = ti.static((r.i, r.k, r.h, r.ms, r.g, r.gs, r.t, r.tg, r.p, r.pairs))
    w = ti.static(p.width)
    margin = SHORT * t.edge
    grown = 0
    for c in range(tg.plan[memory.GROUPS]):
        if any_lane(load(g, h, mean_size(c, tg)) > pairs.sizes[i * tg.plan[memory.GROUPS] + c] + margin):
            grown = 1
    if any_lane(pairs.drift[i] > margin * margin) or grown == 1:
        shorten(r, margin)
    sums = (k + t.plan[memory.CONTACT]) * w
    for n in range((pairs.info[i, NEAR] + w - 1) // w):
        one, two = ti.static(column(pairs.near, i, 2, n * w, w), column(pairs.near, i, 3, n * w, w))
        group1, group2 = ti.static(column(pairs.near, i, 4, n * w, w), column(pairs.near, i, 5, n * w, w))
        dx, dy, dz, limit = offsets(r, one, two, group1, group2)
        near = dx * dx + dy * dy + dz * dz < limit * limit
        if any_lane(near):
            push = memory.MOMENTUM
            first, constant = (k + t.plan[memory.VOXEL]) * w, (h + tg.plan[memory.CONSTANT]) * w
            px, py, pz = gather_all(ms, one, (push, push + 1, push + 2), w, first)
            qx, qy, qz = gather_all(ms, two, (push, push + 1, push + 2), w, first)
            constants = ti.static((materials.INVERSE_MASS, materials.STIFFNESS, materials.CONTACT_DAMPING))
            w1, k1, c1 = gather_all(gs, group1, constants, w, constant)
            w2, k2, c2 = gather_all(gs, group2, constants, w, constant)
            f = contact.force_between(dx, dy, dz, limit, px, py, pz, qx, qy, qz, w1, w2, k1, k2, c1, c2, near)
            scratch = i * scratch_rows(t, w) * 3
            store_all(pairs.place, scratch, (0, 1, 2), f)
            touch = lane_bits(near, w)
            for j in range(w):
                if touch & (1 << j) != 0:
                    for end in ti.static(range(2)):
                        place = p.surface[pairs.near[i, end, n * w + j], 2]
                        pairs.touched[i, place // (3 * w)] = 1
                        for c in ti.static(range(3)):
                            force = pairs.place_scalar[(scratch + c) * w + j]
                            if ti.static(end == 0):
                                force = 0.0 - force
                            ms[sums + place + c * w] = ms[sums + place + c * w] + force
                    if ti.static(log.kept):
                        entry = pairs.info[i, LOGGED]
                        if entry < log.contacts.shape[1]:
                            log.contacts[i, entry, 0] = pairs.near[i, 0, n * w + j]
                            log.contacts[i, entry, 1] = pairs.near[i, 1, n * w + j]
                        pairs.info[i, LOGGED] = entry + 1


@primitive
def column(pairs: Any, i: Any, number: int, n: Any, width: int) -> list[Any]:
    """A column of a list of pairs, from its entry n on."""
    return [emit(element(pairs, i, number, emit(n + j))) for j in range(width)]


@primitive
def of_surface(pairs: Any, i: Any, end: int, n: Any, p: Lanes) -> tuple[list[Any], ...]:
    """Places in VOXEL and of the groups of the voxels at one end of a list of pairs, from its entry n on."""
    numbers = column(pairs, i, end, n, p.width)
    return tuple([emit(element(p.surface, s, c)) for s in numbers] for c in range(2))
