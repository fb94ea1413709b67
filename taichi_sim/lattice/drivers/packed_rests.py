"""Rest lengths of links, from the sizes of the groups at their ends, a pack of lengths at a time."""

from typing import Any

from taichi_sim.autodiff.lanes import consecutive, load, store_all
from taichi_sim.autodiff.tracing import primitive
from taichi_sim.lattice.drivers.packed_lanes import Lanes, gather_all
from taichi_sim.lattice.laws.group import rest_length as rest_law
from taichi_sim.lattice.stages import memory
from taichi_sim.runtime import element, emit, ti


@ti.func
def inverse_rest(l, tg: ti.template()):
    """Slot and lane, in the memory of groups, of the inverse of the rest length of link l."""
    place, w = tg.lanes.inverse[l], ti.static(tg.lanes.width)
    return tg.plan[memory.REST] + place // w, place % w


@primitive
def rest_ends(gs: Any, h: Any, n: Any, tg: Any, p: Lanes) -> tuple[Any, Any]:
    """Sizes of the groups at both ends of a pack of rest lengths."""
    first = emit((h + element(tg.plan, memory.CURRENT)) * p.width)
    return tuple(gather_all(gs, rest_places(n, end, p), (0,), 1, first)[0] for end in range(2))


@primitive
def rest_places(n: Any, end: int, p: Lanes) -> list[Any]:
    """Places in CURRENT of the sizes at one end of a pack of rest lengths."""
    row = emit((2 * n + end) * p.width)
    return [emit(load(p.rests, row, j)) for j in range(p.width)]


@ti.func
def derive_rests(g: ti.template(), gs: ti.template(), h, tg: ti.template(), p: ti.template()):
    """Rest lengths, from the sizes of groups."""
    for n in range(p.rests.shape[0] // (2 * p.width)):
        minus, plus = ti.static(rest_ends(gs, h, n, tg, p))
        length = rest_law(minus, plus)
        store_all(g, h, consecutive(tg.plan[memory.REST] + n * memory.REST_WIDTH, memory.REST_WIDTH), length)
