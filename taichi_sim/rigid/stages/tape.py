"""A robot's state on a tape: all that a step starts with, warm starts included, so that it comes out the same again."""

from taichi_sim.autodiff.lanes import load, store
from taichi_sim.rigid.memory import (
    BODIES,
    IMPULSES,
    KEPT,
    MOTORS,
    NEURON,
    POINTS,
    POSITION,
    STATE_WIDTH,
    body_at,
    point_at,
)
from taichi_sim.runtime import ti


@ti.func
def swap(m: ti.template(), k, slot, tape: ti.template(), kept, at, writing: ti.template()):
    """Write a slot on the tape, or read it back."""
    if ti.static(writing):
        store(tape, kept, at, load(m, k, slot))
    else:
        store(m, k, slot, load(tape, kept, at))


@ti.func
def wind(m: ti.template(), k, plan: ti.template(), tape: ti.template(), kept, t, writing: ti.template()):
    """Write the state before step t, or read it back."""
    at = t * plan[KEPT]
    for c in range(7):
        swap(m, k, POSITION + c, tape, kept, at + c, writing)
    at += 7
    for b in range(plan[BODIES]):
        for c in range(STATE_WIDTH):
            swap(m, k, body_at(plan, b) + c, tape, kept, at + c, writing)
        at += STATE_WIDTH
    for c in range(plan[MOTORS]):
        swap(m, k, plan[NEURON] + c, tape, kept, at + c, writing)
    at += plan[MOTORS]
    for i in range(plan[POINTS]):
        for phase in ti.static(range(2)):
            swap(m, k, point_at(plan, i) + IMPULSES + phase, tape, kept, at + phase, writing)
        at += 2


@ti.func
def keep(m: ti.template(), k, plan: ti.template(), tape: ti.template(), kept, t):
    """Write the state before step t."""
    wind(m, k, plan, tape, kept, t, True)


@ti.func
def fetch(m: ti.template(), k, plan: ti.template(), tape: ti.template(), kept, t):
    """Read the state before step t back."""
    wind(m, k, plan, tape, kept, t, False)
