"""Reading and writing the slots of robots' memory in kernels; ``slots`` describes them."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from taichi_sim.autodiff.lanes import load, store
from taichi_sim.autodiff.tracing import primitive
from taichi_sim.ground.cells import PER_CELL, cell_of, cells_of
from taichi_sim.rigid import slots
from taichi_sim.runtime import element, emit, ti, variable_of

Pieces = tuple[tuple[Any, int], ...]  # first slots of runs of slots, and their lengths


class Uneven(NamedTuple):
    """Uneven ground under the robots of a kernel.

    Attributes:
        relief: the grids, see ``ground.cells``.
        grid: where that of each robot begins.
        width: robots side by side in a real.
    """

    relief: Any
    grid: Any
    width: int


class Block(NamedTuple):
    """A block of robots as functions of a kernel see it: a memory, and what describes its robots.

    Attributes:
        m: the memory.
        k: where the block lies in it, see ``lanes.load``.
        number: of the block.
        plan: counts, first slots of sections, and lists, see ``slots``.
        listed: points that touch the ground in any robot of the block, (blocks, points).
        settings: numbers of the run, see ``slots.TIME_STEP`` and so on.
        drifting: whether bodies carry velocities and may drift off their hinges; else they carry momenta.
        ground: uneven ground, or None.
        wet: whether there is water on it.
        granular: whether it is sand, under some of the robots at least.
    """

    m: Any
    k: Any
    number: Any
    plan: Any
    listed: Any
    settings: Any
    drifting: bool
    ground: Uneven | None = None
    wet: bool = False
    granular: bool = False

    @property
    def uneven(self) -> bool:
        """Whether the ground is uneven."""
        return self.ground is not None


@primitive
def start_of(block: Any, width: Any, lanes: bool) -> Any:
    """First slot of a block in a memory with ``width`` slots a robot; on a GPU its number (see ``lanes.load``)."""
    return emit(block * width) if lanes else block


@primitive
def read(robots: Block, slot: Any) -> Any:
    """Read a slot."""
    return load(robots.m, robots.k, slot)


@primitive
def write(robots: Block, slot: Any, value: Any) -> None:
    """Write a slot."""
    store(robots.m, robots.k, slot, value)


@primitive
def row(robots: Block, first: Any, count: int) -> tuple[Any, ...]:
    """Read slots that follow one another."""
    return gather(robots, ((first, count),))


@primitive
def put(robots: Block, first: Any, values: Sequence[Any]) -> None:
    """Write slots that follow one another."""
    start = emit(first)
    for i, value in enumerate(values):
        write(robots, start + i, value)


@primitive
def add(robots: Block, first: Any, values: Sequence[Any]) -> None:
    """Add to slots that follow one another. A robot's memory is one thread's own, so it needs no atomic additions."""
    start = emit(first)
    for i, value in enumerate(values):
        write(robots, start + i, read(robots, start + i) + value)


@primitive
def gather(robots: Block, pieces: Pieces) -> tuple[Any, ...]:
    """Read runs of slots, one after the other."""
    starts = [(emit(first), count) for first, count in pieces]
    return tuple(read(robots, start + i) for start, count in starts for i in range(count))


@primitive
def scatter(robots: Block, pieces: Pieces, values: Sequence[Any], written: Sequence[int] = ()) -> None:
    """Add values to the slots that ``gather`` reads; write those of some pieces instead."""
    for n, (first, count) in enumerate(pieces):
        (put if n in written else add)(robots, first, values[:count])
        values = values[count:]


@primitive
def variables(count: int, start: Any) -> tuple[Any, ...]:
    """So many variables of a kernel, to be changed by ``assign``."""
    return tuple(variable_of(start) for _ in range(count))


@primitive
def assign(targets: Sequence[Any], values: Sequence[Any]) -> None:
    """Change variables, all at once."""
    for target, value in zip(targets, [emit(value) for value in values], strict=True):
        target._assign(value)


@primitive
def setting(robots: Block, place: int) -> Any:
    """A number of the run."""
    return element(robots.settings, place)


@primitive
def gravity_of(robots: Block) -> tuple[Any, ...]:
    """Gravity along x, y and z [m/s^2]."""
    return tuple(setting(robots, slots.GRAVITY + i) for i in range(3))


@primitive
def count_of(robots: Block, place: int) -> Any:
    """A count of the plan, or the first slot of a section."""
    return element(robots.plan, place)


@primitive
def listed_in_plan(robots: Block, place: int, n: Any) -> Any:
    """An entry of one of the plan's lists."""
    return emit(element(robots.plan, count_of(robots, place) + n))


@primitive
def body_at(robots: Block, b: Any) -> Any:
    """First slot of a body."""
    return emit(count_of(robots, slots.BODY) + b * slots.BODY_WIDTH)


@primitive
def given_at(robots: Block, b: Any) -> Any:
    """First slot of a body's parameters."""
    return emit(count_of(robots, slots.PARAMETER) + b * slots.PARAMETER_WIDTH)


@primitive
def point_at(robots: Block, i: Any) -> Any:
    """First slot of a point."""
    return emit(count_of(robots, slots.POINT) + i * (slots.HINGES + count_of(robots, slots.DEPTH)))


@primitive
def patch_at(robots: Block, i: Any) -> Any:
    """First slot of the surface that belongs to a point."""
    return emit(count_of(robots, slots.PATCH) + i * slots.PATCH_WIDTH)


@primitive
def column(robots: Block, b: Any, place: int) -> Any:
    """An integer of a body."""
    return emit(element(robots.plan, slots.PLACES + b * slots.BODY_COLUMNS + place))


@primitive
def parent_at(robots: Block, b: Any) -> Any:
    """First slot of the body that carries a body."""
    return body_at(robots, column(robots, b, slots.PARENT))


@primitive
def is_hinged(robots: Block, b: Any) -> Any:
    """Whether a body hangs on a hinge."""
    return column(robots, b, slots.HINGED) == 1


@primitive
def listed_point(robots: Block, n: Any) -> tuple[Any, Any, Any]:
    """A point that touches the ground: its number, its body, its first slot."""
    i = emit(element(robots.listed, robots.number, n))
    return i, listed_in_plan(robots, slots.POINT_BODIES, i), point_at(robots, i)


@primitive
def listed_at(robots: Block, n: Any) -> Any:
    """First slot of a point that touches the ground."""
    return point_at(robots, element(robots.listed, robots.number, n))


@primitive
def hinge_on_path(robots: Block, b: Any, d: Any) -> Any:
    """The hinged body number d on the way from the base to a body."""
    return listed_in_plan(robots, slots.PATHS, b * count_of(robots, slots.DEPTH) + d)


@primitive
def entry_at(robots: Block, section: int, n: Any, l: Any) -> Any:
    """Slot of an entry of the matrix of normal rows, or of its factor: row n, column l <= n."""
    return count_of(robots, section) + n * (n + 1) // 2 + l


@primitive
def cell_under(robots: Block, x: Any, y: Any) -> tuple[Any, ...]:
    """First corner (2) and table (10) of the cells of uneven ground at places."""
    assert robots.ground is not None
    relief, grid, width = robots.ground
    firsts = [emit(element(grid, emit(robots.number * width + i))) for i in range(width)]
    return cell_of(x, y, firsts[0], relief) if width == 1 else cells_of(x, y, firsts, relief)


@primitive
def per_cell(robots: Block) -> Any:
    """Inverse width of a cell of uneven ground [1/m]."""
    assert robots.ground is not None
    return emit(element(robots.ground.relief, PER_CELL))


@ti.func
def copy_slots(robots: ti.template(), listed, count, to: ti.template(), k, first):
    """Copy the slots that a list of the plan names to another memory."""
    for c in range(robots.plan[count]):
        store(to, k, first + c, read(robots, robots.plan[robots.plan[listed] + c]))


@ti.func
def restore_state(robots: ti.template(), tape: ti.template(), k, first):
    """Read back the state that ``copy_slots`` wrote."""
    for c in range(robots.plan[slots.KEPT]):
        write(robots, robots.plan[robots.plan[slots.STATE] + c], load(tape, k, first + c))
