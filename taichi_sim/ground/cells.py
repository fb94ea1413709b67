"""How kernels find the cell of uneven ground that is under a place.

``relief`` begins with numbers that all grids share; then come the grids: numbers of each, and its cells side by side,
of 10 reals each (see ``laws.ground``). Robots may share one.
"""

from typing import Any

from taichi_sim.autodiff.lanes import vector
from taichi_sim.autodiff.tracing import primitive
from taichi_sim.runtime import element, emit, ti

CELL = 10  # reals of a cell: height at its first corner and along four sides, and friction likewise
# Places of what they share: width of a cell and its inverse, the highest and steepest ground.
WIDTH, PER_CELL, TOP, STEEPNESS = range(4)
SHARED = 4
# Places of what comes before the cells of a grid: where it begins [m]; water's surface over the floor [m], weight per
# volume [N/m^3], and mass per volume that is carried along [kg/m^3]; stress per depth at which it yields [N/m^3]; how
# many cells it has along x and y.
ORIGIN_X, ORIGIN_Y, LEVEL, WEIGHT, CARRIED, YIELD, CELLS_X, CELLS_Y = range(8)
HEAD = 8


@primitive
def cell_of(x: Any, y: Any, first: Any, relief: Any) -> tuple[Any, ...]:
    """First corner (2) and table (10) of the cell at (x, y) of the grid that begins at ``first``, or nearest to it."""
    slot, x0, y0 = place_of(x, y, first, relief)
    return (x0, y0, *(emit(element(relief, slot + i)) for i in range(CELL)))


@primitive
def cells_of(x: Any, y: Any, firsts: Any, relief: Any) -> tuple[Any, ...]:
    """:func:`cell_of` for places in lanes, each on the grid that begins where ``firsts`` says."""
    lanes = [cell_of(element(x, i), element(y, i), first, relief) for i, first in enumerate(firsts)]
    return tuple(vector(values) for values in zip(*lanes, strict=True))


@ti.func
def place_of(x, y, first, relief: ti.template()):
    """Slot of the cell under a place, and its first corner."""
    width, inverse = relief[WIDTH], relief[PER_CELL]
    x0, y0 = relief[first + ORIGIN_X], relief[first + ORIGIN_Y]
    across, along = ti.cast(relief[first + CELLS_X], ti.i32), ti.cast(relief[first + CELLS_Y], ti.i32)
    i = ti.cast(ti.floor((x - x0) * inverse), ti.i32)
    j = ti.cast(ti.floor((y - y0) * inverse), ti.i32)
    i = ti.max(0, ti.min(i, across - 1))
    j = ti.max(0, ti.min(j, along - 1))
    slot = first + HEAD + (i * along + j) * CELL
    return slot, x0 + i * width, y0 + j * width
