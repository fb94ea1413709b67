"""What lies under a voxel on uneven ground: the cell of its robot's grid that it is over.

``relief`` begins with numbers that all grids share; then come the grids, tables of cells side by side, of 10 reals each
(see ``laws.relief.ground``). Robots may share one.
"""

from typing import Any

from taichi_sim.autodiff.lanes import any_lane, vector
from taichi_sim.autodiff.tracing import primitive
from taichi_sim.lattice.stages import columns, memory
from taichi_sim.runtime import element, emit, ti

CELL = 10  # reals of a cell: height at its first corner and along four sides, and friction likewise
# Places of what they share: width of a cell and its inverse, the highest and steepest ground.
WIDTH, PER_CELL, TOP, STEEPNESS = range(4)
SHARED = 4
ORIGIN_X, ORIGIN_Y = range(2)  # places of what comes before the cells of a grid: where it begins [m]
ORIGIN = 2


@ti.func
def may_touch(size, z, t: ti.template()):
    """Whether any voxel of such a size and height is low enough to touch the ground somewhere."""
    return any_lane(0.5 * size * t.relief[STEEPNESS] - 0.5 * t.edge - (z - t.relief[TOP]) >= 0.0)


@primitive
def per_cell(t: columns.Shared) -> Any:
    """Inverse width of a cell [1/m]."""
    return emit(element(t.relief, PER_CELL))


@primitive
def cell_under(x: Any, y: Any, k: Any, t: columns.Shared) -> tuple[Any, ...]:
    """First corner (2) and table (10) of the cells under voxels at (x, y); at the edge for those beyond."""
    if not t.packed:
        return table_of(x, y, columns.grid_of(k, t.plan), t)
    lanes = [table_of(element(x, i), element(y, i), t.grid, t) for i in range(t.lanes.width)]
    return tuple(vector(values) for values in zip(*lanes, strict=True))


@primitive
def table_of(x: Any, y: Any, first: Any, t: columns.Shared) -> tuple[Any, ...]:
    """:func:`cell_under` of one voxel."""
    slot, x0, y0 = place_of(x, y, first, t)
    return (x0, y0, *(emit(element(t.relief, emit(slot + i))) for i in range(CELL)))


@ti.func
def place_of(x, y, first, t: ti.template()):
    """Slot of the cell under a voxel, and its first corner."""
    width, inverse = t.relief[WIDTH], t.relief[PER_CELL]
    x0, y0 = t.relief[first + ORIGIN_X], t.relief[first + ORIGIN_Y]
    i = ti.cast(ti.floor((x - x0) * inverse), ti.i32)
    j = ti.cast(ti.floor((y - y0) * inverse), ti.i32)
    i = ti.max(0, ti.min(i, t.plan[memory.CELLS_X] - 1))
    j = ti.max(0, ti.min(j, t.plan[memory.CELLS_Y] - 1))
    slot = first + ORIGIN + (i * t.plan[memory.CELLS_Y] + j) * CELL
    return slot, x0 + i * width, y0 + j * width
