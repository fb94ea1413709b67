"""A robot's state on a tape: all that a step starts with, warm starts included, so that it comes out the same again."""

from typing import Any

from taichi_sim.autodiff.lanes import load, store
from taichi_sim.autodiff.tracing import primitive
from taichi_sim.rigid import slots
from taichi_sim.rigid.memory import Block, body_at, point_at, read, write
from taichi_sim.runtime import ti


@primitive
def swap(robots: Block, slot: Any, tape: Any, kept: Any, at: Any, writing: bool) -> None:
    """Write a slot on the tape, or read it back."""
    if writing:
        store(tape, kept, at, read(robots, slot))
    else:
        write(robots, slot, load(tape, kept, at))


@ti.func
def wind(robots: ti.template(), tape: ti.template(), kept, t, writing: ti.template()):
    """Write the state before step t on the tape, or read it back."""
    at = t * robots.plan[slots.KEPT]
    for c in range(7):
        swap(robots, slots.POSITION + c, tape, kept, at + c, writing)
    at += 7
    for b in range(robots.plan[slots.BODIES]):
        for c in range(slots.STATE_WIDTH):
            swap(robots, body_at(robots, b) + c, tape, kept, at + c, writing)
        at += slots.STATE_WIDTH
    for c in range(robots.plan[slots.MOTORS]):
        swap(robots, robots.plan[slots.NEURON] + c, tape, kept, at + c, writing)
    at += robots.plan[slots.MOTORS]
    for i in range(robots.plan[slots.POINTS]):
        for phase in ti.static(range(2)):
            swap(robots, point_at(robots, i) + slots.IMPULSES + phase, tape, kept, at + phase, writing)
        at += 2
