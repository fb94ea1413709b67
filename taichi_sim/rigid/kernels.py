"""Kernels of rigid robots: rollouts, and the way back through them.

Blocks of robots run in native vector lanes (CPU), or one robot a thread (GPU), where ``grain`` is 1 and slots lie one
after the other.
"""

from functools import lru_cache
from typing import Any

from taichi_sim.autodiff.lanes import Real, store
from taichi_sim.rigid import slots
from taichi_sim.rigid.memory import Block, body_at, is_hinged, read
from taichi_sim.rigid.stages import adjoint
from taichi_sim.rigid.stages.motion import move_bodies
from taichi_sim.rigid.stages.step import observe, quarantine, respond
from taichi_sim.rigid.stages.tape import wind
from taichi_sim.runtime import ti


@ti.func
def record(robots: ti.template(), frames: ti.template(), at, frame):
    """Note pose, angles, readings and neurons."""
    slot = frame * robots.plan[slots.FRAME]
    for c in range(7):
        store(frames, at, slot + c, read(robots, slots.POSITION + c))
    slot += 7
    for b in range(1, robots.plan[slots.BODIES]):
        if is_hinged(robots, b):
            store(frames, at, slot, read(robots, body_at(robots, b) + slots.ANGLE))
            slot += 1
    sensors = robots.plan[slots.TOUCHES] + robots.plan[slots.LIGHTS]
    for c in range(sensors):
        store(frames, at, slot + c, read(robots, robots.plan[slots.READING] + c))
    for c in range(robots.plan[slots.MOTORS]):
        store(frames, at, slot + sensors + c, read(robots, robots.plan[slots.NEURON] + c))


def _types(real: Real, lanes: bool) -> tuple[Any, Any, Any, Any]:
    """Types of arguments: memory, whole numbers in one and in two dimensions, numbers of the run."""
    ints1, ints2 = (ti.types.ndarray(dtype=ti.i32, ndim=n) for n in (1, 2))
    memory = ti.types.ndarray(dtype=real.type, ndim=1 if lanes else 2)
    return memory, ints1, ints2, ti.types.ndarray(dtype=real.scalar, ndim=1)


@lru_cache
def rollout_kernel(real: Real, grain: int, drifting: bool, recording: bool, taping: bool) -> Any:
    """The kernel that runs robots to the end, for one kind of real."""
    lanes = grain > 1
    reals, ints1, ints2, numbers = _types(real, lanes)

    @ti.kernel
    def run(
        blocks: ti.i32,
        phases: ti.i32,
        m: reals,
        frames: reals,
        tape: reals,
        plan: ints1,
        table: ints1,
        points: ints1,
        paths: ints1,
        eyes: ints1,
        listed: ints2,
        settings: numbers,
    ):
        for i in range(grain * blocks):
            if i % grain == 0:
                block = i // grain
                k, at, kept = block, block, block
                if ti.static(lanes):
                    k = block * plan[slots.SLOTS]
                    at = block * plan[slots.FRAME] * plan[slots.FRAMES]
                    kept = block * plan[slots.KEPT] * (plan[slots.STEPS] + 1)
                robots = ti.static(Block(m, k, block, plan, table, points, paths, eyes, listed, settings, drifting))
                for t in range(plan[slots.STEPS] + 1):
                    if ti.static(taping):
                        wind(robots, tape, kept, t, True)
                    count = observe(robots, t)
                    if ti.static(recording):
                        if t % plan[slots.EVERY] == 0:
                            record(robots, frames, at, t // plan[slots.EVERY])
                    if t < plan[slots.STEPS]:
                        respond(robots, count, phases)
                        move_bodies(robots)
                        quarantine(robots, ti.cast(t, real.scalar))

    return run


@lru_cache
def gradient_kernel(real: Real, grain: int, drifting: bool) -> Any:
    """The kernel that goes back through a rollout: every step again from the tape, then reversed."""
    lanes = grain > 1
    reals, ints1, ints2, numbers = _types(real, lanes)

    @ti.kernel
    def run(
        blocks: ti.i32,
        phases: ti.i32,
        m: reals,
        a: reals,
        g: reals,
        tape: reals,
        plan: ints1,
        table: ints1,
        points: ints1,
        paths: ints1,
        eyes: ints1,
        listed: ints2,
        settings: numbers,
    ):
        for i in range(grain * blocks):
            if i % grain == 0:
                block = i // grain
                k, kept = block, block
                if ti.static(lanes):
                    k = block * plan[slots.SLOTS]
                    kept = block * plan[slots.KEPT] * (plan[slots.STEPS] + 1)
                robots = ti.static(Block(m, k, block, plan, table, points, paths, eyes, listed, settings, drifting))
                motion = ti.static(Block(a, k, block, plan, table, points, paths, eyes, listed, settings, False))
                cotangents = ti.static(Block(g, k, block, plan, table, points, paths, eyes, listed, settings, drifting))
                for back in range(plan[slots.STEPS] + 1):
                    t = plan[slots.STEPS] - back
                    wind(robots, tape, kept, t, False)
                    count = observe(robots, t)
                    if back > 0:
                        adjoint.clear_work(cotangents)
                        respond(robots, count, phases)
                        rows = ti.min(count, 1)
                        adjoint.unmove(robots, motion, cotangents)
                        adjoint.solve_adjoint(robots, motion, cotangents, count, rows)
                        adjoint.unsolve(robots, motion, cotangents, count, rows)
                        if ti.static(not drifting):
                            adjoint.unshift_moments(robots, robots, cotangents, 1.0)
                        adjoint.uncommand(robots, motion, cotangents, rows)
                        adjoint.unthink(robots, cotangents, t)
                    adjoint.unsense(robots, cotangents)
                    adjoint.unplace(robots, cotangents)

    return run
