"""The reverse of what acts on the surface of a packed robot: pressure on closed skins, and contacts between voxels.

Several of them may reach the same voxel or group, so they give their cotangents lane by lane.
"""

from typing import Any

from taichi_sim.autodiff.lanes import load, vector
from taichi_sim.autodiff.tracing import Condition, primitive, pull_back
from taichi_sim.lattice import materials
from taichi_sim.lattice.drivers.packed_kernel import square_inputs
from taichi_sim.lattice.drivers.packed_lanes import gather_all
from taichi_sim.lattice.laws import contact, enclosure
from taichi_sim.lattice.stages import columns, memory
from taichi_sim.runtime import element, emit, ti


@primitive
def scatter_all(ms: Any, places: Any, slots: Any, values: Any, width: int) -> None:
    """Add reals to slots after the place of each lane, lane by lane."""
    for j, place in enumerate(places):
        for slot, value in zip(slots, values, strict=True):
            target = load(ms, place, slot * width)
            target._assign(target + element(value, j))


@ti.func
def undo_squares(b: ti.template(), q):
    """Reverse the pressure on a pack of squares."""
    u, ug, memories, rs, t, p = ti.static((b.u, b.ug, b.memories, b.rs, b.t, b.p))
    inputs = square_inputs(rs, u.r + u.old + t.plan[memory.VOXEL], memories.gs, ug.k, q, p)
    seeds = ti.static(square_seeds(memories.a_scalar, u.k + t.plan[memory.FORCE], q, p))
    found = ti.static(pull_back(enclosure.pressed_square, inputs, (), seeds))
    give_squares(memories, u.k + t.plan[memory.VOXEL], ug.k, q, found, p)


@primitive
def square_rows(index: Any, q: Any, corner: int, width: int) -> list[Any]:
    """A row of the index of corners of a pack of squares."""
    row = emit((q * columns.SQUARE_COLUMNS + corner) * width)
    return [emit(load(index, row, j)) for j in range(width)]


@primitive
def square_seeds(a_scalar: Any, first: Any, q: Any, p: Any) -> tuple[Any, ...]:
    """Cotangents of the forces on the corners of a pack of squares; squares that fill up the last pack have none."""
    found: tuple[Any, ...] = ()
    w = p.width
    for corner in range(columns.SQUARE_COLUMNS):
        places = [emit(first * w + force_place(at, w)) for at in square_rows(p.square_corner, q, corner, w)]
        given = gather_all(a_scalar, places, range(3), w)
        found += tuple(emit(value * load(p.square_there, q, 0)) for value in given)
    return found


def force_place(place: Any, width: int) -> Any:
    """Place in FORCE, 6 slots a pack, of a voxel whose place in VOXEL is given."""
    return place // (memory.VOXEL_WIDTH * width) * (6 * width) + place % width


@primitive
def give_squares(memories: Any, first: Any, h: Any, q: Any, found: Any, p: Any) -> None:
    """Add the cotangents of the corners' positions and pressures."""
    w = p.width
    for corner in range(columns.SQUARE_COLUMNS):
        places = [emit(first * w + at) for at in square_rows(p.square_corner, q, corner, w)]
        scatter_all(memories.a_scalar, places, range(3), found[3 * corner : 3 * corner + 3], w)
        slots = [emit(h * w + at) for at in square_rows(p.square_pressure, q, corner, w)]
        scatter_all(memories.ag_scalar, slots, (0,), found[12 + corner : 13 + corner], 1)


@ti.func
def undo_contacts(b: ti.template(), first, end, contacts: ti.template()):
    """Reverse a pack of contacts, entries of the record from ``first`` to ``end`` at most."""
    u, ug, memories, rs, i, t, tg, p = ti.static((b.u, b.ug, b.memories, b.rs, b.i, b.t, b.tg, b.p))
    w = ti.static(p.width)
    one = ti.static(contact_rows(contacts, i, 0, first, end, t, p))
    two = ti.static(contact_rows(contacts, i, 1, first, end, t, p))
    touching = contact_mask(first, end, t, p)
    motion = ti.static((0, 1, 2, memory.MOMENTUM, memory.MOMENTUM + 1, memory.MOMENTUM + 2))
    before = (u.r + u.old + t.plan[memory.VOXEL]) * w
    mass, stiff, damp = ti.static((materials.INVERSE_MASS, materials.STIFFNESS, materials.CONTACT_DAMPING))
    size = (ug.k + tg.plan[memory.CURRENT] + memory.MEAN_SIZE) * w
    constant = (ug.k + tg.plan[memory.CONSTANT]) * w
    x = gather_all(rs, one[0], motion, w, before)
    y = gather_all(rs, two[0], motion, w, before)
    sizes = gather_all(memories.gs, one[1], (0,), w, size) + gather_all(memories.gs, two[1], (0,), w, size)
    c1 = gather_all(memories.gs, one[1], (mass, stiff, damp), w, constant)
    c2 = gather_all(memories.gs, two[1], (mass, stiff, damp), w, constant)
    inputs = x + y + sizes + (c1[0], c2[0], c1[1], c2[1], c1[2], c2[2])
    forces = (u.k + t.plan[memory.FORCE]) * w
    f1 = gather_all(memories.a_scalar, one[2], (0, 1, 2), w, forces)
    f2 = gather_all(memories.a_scalar, two[2], (0, 1, 2), w, forces)
    seeds = (f2[0] - f1[0], f2[1] - f1[1], f2[2] - f1[2])
    found = ti.static(pull_back(contact.pair_force, inputs, (Condition(touching > 0.5),), seeds))
    after = (u.k + t.plan[memory.VOXEL]) * w
    scatter_all(memories.a_scalar, shifted(one[0], after), motion, found[:6], w)
    scatter_all(memories.a_scalar, shifted(two[0], after), motion, found[6:12], w)
    scatter_all(memories.ag_scalar, shifted(one[1], size), (0,), found[12:13], w)
    scatter_all(memories.ag_scalar, shifted(two[1], size), (0,), found[13:14], w)
    for_one, for_two = ti.static((found[14], found[16], found[18]), (found[15], found[17], found[19]))
    scatter_all(memories.ag_scalar, shifted(one[1], constant), (mass, stiff, damp), for_one, w)
    scatter_all(memories.ag_scalar, shifted(two[1], constant), (mass, stiff, damp), for_two, w)


@primitive
def shifted(places: Any, first: Any) -> list[Any]:
    """Places behind a first one."""
    return [emit(first + place) for place in places]


@primitive
def contact_rows(contacts: Any, i: Any, end_of: int, first: Any, end: Any, t: Any, p: Any) -> tuple[list[Any], ...]:
    """Places in VOXEL, of the group, and in FORCE of one end of each contact of a pack; past the end, of nobody."""
    rows: tuple[list[Any], ...] = ([], [], [])
    nobody = emit(element(t.plan, memory.SURFACE) + end_of)
    for j in range(p.width):
        entry = emit(ti.min(first + j, end - 1))
        s = emit(ti.select(first + j < end, element(contacts, i, entry, end_of), nobody))
        place = emit(element(p.surface, s, 0))
        for row, value in zip(rows, (place, element(p.surface, s, 1), force_place(place, p.width)), strict=True):
            row.append(emit(value))
    return rows


@primitive
def contact_mask(first: Any, end: Any, t: Any, p: Any) -> Any:
    """1 in lanes that have a contact."""
    kind = load(t.shape, 0, 0)
    one = emit(0.0 * element(emit(kind), 0) + 1.0)
    return vector([emit(ti.select(first + j < end, one, 0.0 * one)) for j in range(p.width)])
