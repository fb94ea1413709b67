"""Pressure on the squares of closed surfaces: the forces on their corners, and the reverse.

See ``groups`` for what the arguments hold.
"""

from typing import Any

from taichi_sim.autodiff.lanes import consecutive, load_all, store_all
from taichi_sim.autodiff.tracing import primitive
from taichi_sim.lattice.laws import enclosure
from taichi_sim.lattice.stages import columns, memory
from taichi_sim.lattice.stages.groups import channels_of
from taichi_sim.lattice.stages.undo import cotangents_of, reverse
from taichi_sim.runtime import element, emit, ti


@primitive
def corners(q: Any, t: columns.Shared) -> list[Any]:
    """Numbers of the voxels at the corners of square q."""
    return [element(t.square, emit(q * columns.SQUARE_COLUMNS + i)) for i in range(4)]


@primitive
def corner_slots(first: Any, width: int, q: Any, t: columns.Shared) -> tuple[Any, ...]:
    """Slots of three components of each corner of square q, in a section of so many slots a voxel."""
    return tuple(slot for voxel in corners(q, t) for slot in consecutive(first + voxel * width, 3))


@primitive
def pressure_slots(q: Any, t: columns.Shared) -> tuple[Any, ...]:
    """Slots of the pressures of the corners of square q."""
    return tuple(channels_of(voxel, t) + columns.PRESSURE for voxel in corners(q, t))


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
    seeds = cotangents_of(u, corner_slots(t.plan[memory.FORCE], 6, q, t))
    reverse(u, enclosure.pressed_square, places, pressure_slots(q, t), (), seeds)
