"""Voxels in vector lanes, as kernels see them: where lanes find what they need of neighbours, and how they get it."""

from typing import Any, NamedTuple

from taichi_sim.autodiff.lanes import Real, assign_all, ints, load, load_all, store, variables, vector
from taichi_sim.autodiff.tracing import primitive, select
from taichi_sim.lattice.drivers.packs import ALIGNED, GATHER, NEXT
from taichi_sim.lattice.stages import columns, memory
from taichi_sim.lattice.stages.columns import Shared, grid_of, in_variables, plan_in_variables
from taichi_sim.lattice.stages.link import link_axes
from taichi_sim.runtime import element, emit, ti

FORCE_WIDTH = 14  # of a link pack: F, M, G, N, and its shares in the strains of the voxels at both ends
SHARES = 12

# Columns of the rows of link packs: how and where they find the voxels at their "+" ends (see ``packs.Reach``), whether
# there is a link in every lane, whether a voxel at an end has a gauge of strain.
KIND, TARGET, FULL, GAUGED, LINK_ROW = range(5)
# Columns of the rows of packs: how and where they find the links on their "-" sides, by axis; a pack that is ready when
# so many packs are, counted in this order; how many are after the links of the row's pack.
READY, READY_END, PACK_ROW = 6, 7, 8
# Columns of the rows of what is spread: slot in the vector memory; the quantities that it follows from, the first and
# the one after the last.
TO, FIRST_QUANTITY, END_QUANTITY, SPREAD_ROW = range(4)
# Columns of the rows of what is given back: slot in the vector memory; place in the memory of groups of a group that
# was spread there; and the number of the mask that has 1 in the lanes of that group.
SOURCE, MASK, GIVE_ROW = 1, 2, 3
BY_LANE = -1  # instead of a mask: every lane has a group of its own, and the source is the number of the row


class Lanes(NamedTuple):
    """Index tables that tell each lane where its neighbours' and groups' numbers lie, the same for all robots.

    See ``packs``. A place is a slot of a scalar.

    Attributes:
        width: lanes of a pack.
        links, packs, spreads: rows of link packs, packs and what is spread, with the columns above.
        gives, masks: rows of what is given back on the way back, and their masks.
        plus: lane numbers of the voxels at the "+" ends of link packs.
        minus: lane numbers of the links on the "-" sides of packs, by axis.
        there, outer: 1 where a link pack has a link, by link pack, and where a pack has a surface voxel, by pack.
        shape: what the table of voxels says of those of a pack, see ``columns``.
        source, group: places in the memory of groups of what is spread, and of the groups' channels, by row and lane.
        rests: places in CURRENT of the groups at either end of a pack of rest lengths, by pack, end and lane.
        surface: place in VOXEL, group's place in CONSTANT, place in CONTACT of each surface voxel, and twice nobody.
        voxel, link: place of each voxel in VOXEL, and of each link in LINK.
        inverse: place in REST, in the memory of groups, of the inverse of each link's rest length.
        square_corner, square_pressure: places of the corners of squares in VOXEL, and slots of their pressures, by
            pack of squares, corner and lane.
        corner: places in PRESSED of the forces on a pack's voxels, rows of lanes.
        square_there: 1 where a pack of squares has one.
    """

    width: Any
    links: Any
    packs: Any
    spreads: Any
    plus: Any
    minus: Any
    there: Any
    outer: Any
    shape: Any
    source: Any
    group: Any
    rests: Any
    surface: Any
    voxel: Any
    link: Any
    inverse: Any
    square_corner: Any
    square_pressure: Any
    corner: Any
    square_there: Any
    gives: Any = None
    masks: Any = None


def lane_types(real: Real) -> Lanes:
    """Types of ``Lanes`` in kernels."""
    flat, real_array = ints(1), real.memory
    rows, shapes = (flat,) * 5, (real_array,) * 3
    return Lanes(real.width, *rows, *shapes, *(flat,) * 3, ints(2), *(flat,) * 6, real_array)


class PackedRobot(NamedTuple):
    """What a kernel knows of the robot that it steps: its number, offsets in the memories, tables, contact lists.

    Attributes:
        i, k, h: number; first slot in the vector memory, and in that of groups.
        m, ms, g, gs, g2: see ``Memories``.
        t, tg: what stages of voxels and links are given, and stages of groups.
        p, pairs: see ``Lanes`` and ``Pairs``.
    """

    i: Any
    k: Any
    h: Any
    m: Any
    ms: Any
    g: Any
    gs: Any
    g2: Any
    t: Any
    tg: Any
    p: Any
    pairs: Any


@primitive
def with_lanes(shared: Shared, lanes: Lanes, scalars: Any, robot: Any) -> Shared:
    """What stages are given of a robot whose voxels lie in lanes; ``scalars`` are of the memory that links read."""
    t = in_variables(shared)._replace(shape=lanes.shape, packed=True, lanes=lanes)
    if t.medium.relief:
        t = t._replace(grid=grid_of(robot, shared.plan))
    return t._replace(transverse=lambda m, k, l: transverse(m, scalars, k, l, t, lanes))


@primitive
def taken_up(v: Any, last: Any, width: int) -> Any:
    """Every lane takes the value of the next, the last one a given value."""
    taken = [element(v, min(i + 1, width - 1)) for i in range(width)]
    return with_lane(vector(taken), width - 1, last, width)


@primitive
def taken_down(v: Any, first: Any, width: int) -> Any:
    """Every lane takes the value of the one before, the first one a given value."""
    return with_lane(vector([element(v, max(i - 1, 0)) for i in range(width)]), 0, first, width)


@primitive
def with_lane(v: Any, lane: int, value: Any, width: int) -> Any:
    """A vector with another value in one lane; selected, as machines move whole vectors sooner than single lanes."""
    return emit(select(vector([float(i == lane) for i in range(width)]) > 0.5, value, v))


@primitive
def of_groups(groups: Shared, t: Shared) -> Shared:
    """What stages of groups are given: tables of their own, and the world of the others."""
    plan = plan_in_variables(groups.plan)
    return groups._replace(plan=plan, packed=True, lanes=t.lanes, time_step=t.time_step, edge=t.edge, gravity=t.gravity)


@primitive
def gather_all(ms: Any, places: Any, slots: Any, width: int, first: Any = 0) -> tuple[Any, ...]:
    """Reals from slots after the place of each lane, ``width`` scalars each; ``first`` is added to places."""
    return tuple(vector([load(ms, place, emit(first + slot * width)) for place in places]) for slot in slots)


@primitive
def lane_place(lane: Any, slots: Any, width: int) -> Any:
    """Place of a lane number in a section of so many slots a pack; the width is a power of two."""
    shift = width.bit_length() - 1
    return emit((lane >> shift) * (slots * width) + (lane & (width - 1)))


@primitive
def places_of(first: Any, lanes: Any, row: Any, slots: int, width: int) -> list[Any]:
    """Places of a row of lane numbers in a section of so many slots a pack."""
    found = []
    for i in range(width):
        lane = emit(load(lanes, emit(row * width), i))
        found.append(emit(first * width + lane_place(lane, slots, width)))
    return found


@ti.func
def plus_all(
    m: ti.template(),
    ms: ti.template(),
    first,
    slots: ti.template(),
    components: ti.template(),
    own: ti.template(),
    l,
    p: ti.template(),
):
    """Load components of a section, ``slots`` a pack, for the voxels at the "+" ends of a link pack.

    ``own`` are those of the voxels at the "-" ends.
    """
    w = ti.static(p.width)
    found = ti.static(variables(own))
    how = p.links[l * LINK_ROW + KIND]
    target = p.links[l * LINK_ROW + TARGET]
    if how == ALIGNED:
        assign_all(found, load_all(m, first + target * slots, components))
    elif how == NEXT:
        place = first * w + lane_place(target, slots, w)
        for i in ti.static(range(len(own))):
            last = ms[place + components[i] * w]
            assign_all(found[i : i + 1], (taken_up(own[i], last, w),))
    else:
        places = ti.static(places_of(first, p.plus, l, slots, w))
        assign_all(found, gather_all(ms, places, components, w))
    return ti.static(tuple(found))


@ti.func
def minus_all(
    m: ti.template(),
    ms: ti.template(),
    first,
    slots: ti.template(),
    components: ti.template(),
    zero,
    v,
    axis,
    t: ti.template(),
    p: ti.template(),
):
    """Load components of a section, ``slots`` a link pack, for the links on a pack's "-" sides; zero where none is."""
    w = ti.static(p.width)
    found = ti.static(variables([zero for _ in components]))
    how = p.packs[v * PACK_ROW + 2 * axis + KIND]
    target = p.packs[v * PACK_ROW + 2 * axis + TARGET]
    if how == ALIGNED:
        assign_all(found, load_all(m, first + target * slots, components))
    elif how == NEXT:
        own = first + t.voxel[v * columns.VOXEL_COLUMNS + columns.SIDE_LINK + 2 * axis + 1] * slots
        place = first * w + lane_place(target, slots, w)
        for i in ti.static(range(len(components))):
            odd = ms[place + components[i] * w]
            assign_all(found[i : i + 1], (taken_down(load(m, own, components[i]), odd, w),))
    elif how == GATHER:
        places = ti.static(places_of(first, p.minus, v * 3 + axis, slots, w))
        assign_all(found, gather_all(ms, places, components, w))
    return ti.static(tuple(found))


@ti.func
def pose_slots(pack, l, t: ti.template()):
    """Slots of position and orientation behind a first one, components along a link pack's axis first."""
    a, b, c = link_axes(l, t)
    return pack + a, pack + b, pack + c, pack + 3, pack + 4 + a, pack + 4 + b, pack + 4 + c


@ti.func
def own_pack(l, t: ti.template()):
    """First slot in VOXEL of the pack at the "-" ends of a link pack."""
    return t.link[l * columns.LINK_COLUMNS + columns.LINK_MINUS]


@ti.func
def transverse(m: ti.template(), ms: ti.template(), k, l, t: ti.template(), p: ti.template()):
    """The two transverse strains of the voxels at either end of a link pack, all of which have gauges."""
    _, b, c = link_axes(l, t)
    first = k + t.plan[memory.STRAIN]
    pack = own_pack(l, t) // memory.VOXEL_WIDTH * memory.STRAIN_WIDTH
    own = load_all(m, first, (pack + 3 + b, pack + 3 + c))
    beyond = plus_all(m, ms, first, memory.STRAIN_WIDTH, (3 + b, 3 + c), own, l, p)
    return own + beyond


@primitive
def spread(m: Any, gs: Any, k: Any, h: Any, n: Any, p: Lanes) -> None:
    """Bring row n of what the program did to groups into the lanes of the packs that have them."""
    first, start = emit(n * p.width), emit(h * p.width)
    values = vector([load(gs, start, emit(load(p.source, first, j))) for j in range(p.width)])
    store(m, k, emit(element(p.spreads, emit(n * SPREAD_ROW + TO))), values)
