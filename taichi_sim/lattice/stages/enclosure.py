"""Pressure on the squares of closed surfaces: the forces on their corners, and the reverse.

See ``groups`` for what the arguments hold.
"""

from taichi_sim.autodiff.lanes import accumulate_all, consecutive, load_all, store_all
from taichi_sim.autodiff.tracing import pull_back
from taichi_sim.lattice.laws import enclosure
from taichi_sim.lattice.stages import columns, memory
from taichi_sim.lattice.stages.groups import channel_slot
from taichi_sim.runtime import ti


@ti.func
def corner_slots(first, width: ti.template(), q, t: ti.template()):
    """Slots of three components of each corner of square q, in a section of so many slots a voxel."""
    a = first + t.square[q * columns.SQUARE_COLUMNS] * width
    b = first + t.square[q * columns.SQUARE_COLUMNS + 1] * width
    c = first + t.square[q * columns.SQUARE_COLUMNS + 2] * width
    d = first + t.square[q * columns.SQUARE_COLUMNS + 3] * width
    return consecutive(a, 3) + consecutive(b, 3) + consecutive(c, 3) + consecutive(d, 3)


@ti.func
def pressure_slots(q, t: ti.template()):
    """Slots of the pressures of the corners of square q."""
    return (
        channel_slot(t.square[q * columns.SQUARE_COLUMNS], columns.PRESSURE, t),
        channel_slot(t.square[q * columns.SQUARE_COLUMNS + 1], columns.PRESSURE, t),
        channel_slot(t.square[q * columns.SQUARE_COLUMNS + 2], columns.PRESSURE, t),
        channel_slot(t.square[q * columns.SQUARE_COLUMNS + 3], columns.PRESSURE, t),
    )


@ti.func
def square_stage(m: ti.template(), k, q, t: ti.template()):
    """Forces of the pressure on the corners of square q."""
    places = load_all(m, k, corner_slots(t.plan[memory.VOXEL], memory.VOXEL_WIDTH, q, t))
    pressures = load_all(m, k, pressure_slots(q, t))
    first = t.plan[memory.PRESSED] + q * memory.PRESSED_WIDTH
    store_all(m, k, consecutive(first, memory.PRESSED_WIDTH), enclosure.pressed_square(*places, *pressures))


@ti.func
def add_pressure(m: ti.template(), k, v, fx, fy, fz, t: ti.template()):
    """A force on voxel v, and that of the pressure on the squares around it, in ascending order."""
    row = v * columns.VOXEL_COLUMNS
    for i in range(t.voxel[row + columns.FIRST_CORNER], t.voxel[row + columns.END_CORNER]):
        px, py, pz = load_all(m, k, consecutive(t.plan[memory.PRESSED] + t.corner[i], 3))
        fx, fy, fz = fx + px, fy + py, fz + pz
    return fx, fy, fz


@ti.func
def square_adjoint(u: ti.template(), q, t: ti.template()):
    """Reverse the pressure on square q."""
    places = corner_slots(t.plan[memory.VOXEL], memory.VOXEL_WIDTH, q, t)
    before = corner_slots(u.old + t.plan[memory.VOXEL], memory.VOXEL_WIDTH, q, t)
    pressures = pressure_slots(q, t)
    inputs = load_all(u.record, u.r, before) + load_all(u.m, u.k, pressures)
    seeds = load_all(u.a, u.k, corner_slots(t.plan[memory.FORCE], 6, q, t))
    accumulate_all(u.a, u.k, places + pressures, ti.static(pull_back(enclosure.pressed_square, inputs, (), seeds)))
