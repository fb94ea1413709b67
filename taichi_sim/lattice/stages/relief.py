"""What lies under a voxel on uneven ground: the cell of its robot's grid that it is over (see ``ground.cells``)."""

from typing import Any

from taichi_sim.autodiff.lanes import any_lane
from taichi_sim.autodiff.tracing import primitive
from taichi_sim.ground.cells import CARRIED, LEVEL, PER_CELL, STEEPNESS, TOP, WEIGHT, YIELD, cell_of, cells_of
from taichi_sim.lattice.stages import columns
from taichi_sim.runtime import element, emit, ti


@ti.func
def may_touch(size, z, t: ti.template()):
    """Whether any voxel of such a size and height is low enough to touch the ground somewhere."""
    return any_lane(0.5 * size * t.relief[STEEPNESS] - 0.5 * t.edge - (z - t.relief[TOP]) >= 0.0)


@primitive
def per_cell(t: columns.Shared) -> Any:
    """Inverse width of a cell [1/m]."""
    return emit(element(t.relief, PER_CELL))


@primitive
def first_of_grid(k: Any, t: columns.Shared) -> Any:
    """Where the grid of a robot begins in ``relief``."""
    return t.grid if t.packed else columns.grid_of(k, t.plan)


@primitive
def cell_under(x: Any, y: Any, k: Any, t: columns.Shared) -> tuple[Any, ...]:
    """First corner (2) and table (10) of the cells under voxels at (x, y); at the edge for those beyond."""
    first = first_of_grid(k, t)
    if not t.packed:
        return cell_of(x, y, first, t.relief)
    return cells_of(x, y, [first] * t.lanes.width, t.relief)


@primitive
def water_of(k: Any, t: columns.Shared) -> tuple[Any, ...]:
    """Level of a robot's water over the floor [m], its weight and the mass carried along, per volume."""
    first = first_of_grid(k, t)
    return tuple(emit(element(t.relief, first + place)) for place in (LEVEL, WEIGHT, CARRIED))


@primitive
def yield_of(k: Any, t: columns.Shared) -> Any:
    """Stress per depth at which the ground of a robot yields [N/m^3]."""
    return emit(element(t.relief, first_of_grid(k, t) + YIELD))
