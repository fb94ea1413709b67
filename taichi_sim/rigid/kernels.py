"""Kernels of rigid robots: rollouts, and the way back through them.

Blocks of robots run in native vector lanes (CPU), or one robot a thread (GPU), where ``grain`` is 1 and slots lie one
after the other.
"""

from functools import lru_cache
from typing import Any

from taichi_sim.autodiff.lanes import Real
from taichi_sim.autodiff.tracing import primitive
from taichi_sim.rigid import slots
from taichi_sim.rigid.memory import Block, Uneven, copy_slots, restore_state, start_of
from taichi_sim.rigid.stages import adjoint
from taichi_sim.rigid.stages.motion import move_bodies
from taichi_sim.rigid.stages.step import observe, quarantine, respond
from taichi_sim.runtime import ti


def _types(real: Real, lanes: bool) -> tuple[Any, Any, Any, Any]:
    """Types of arguments: memory, the plan, lists of points, numbers of the run."""
    ints1, ints2 = (ti.types.ndarray(dtype=ti.i32, ndim=n) for n in (1, 2))
    memory = ti.types.ndarray(dtype=real.type, ndim=1 if lanes else 2)
    return memory, ints1, ints2, ti.types.ndarray(dtype=real.scalar, ndim=1)


@primitive
def _ground(relief: Any, grid: Any, width: int, uneven: bool) -> Uneven | None:
    """What kernels know of uneven ground; level ground has arrays of no meaning."""
    return Uneven(relief, grid, width) if uneven else None


@lru_cache
def rollout_kernel(
    real: Real, grain: int, drifting: bool, uneven: bool, wet: bool, granular: bool, recording: bool, taping: bool
) -> Any:
    """The kernel that runs robots from a step to another, for one kind of real."""
    lanes = grain > 1
    reals, ints, lists, numbers = _types(real, lanes)

    @ti.kernel
    def run(
        blocks: ti.i32,
        m: reals,
        frames: reals,
        tape: reals,
        plan: ints,
        listed: lists,
        settings: numbers,
        relief: numbers,
        grid: ints,
    ):
        for i in range(grain * blocks):
            if i % grain == 0:
                block = i // grain
                k = start_of(block, plan[slots.SLOTS], lanes)
                at = start_of(block, plan[slots.FRAME_WIDTH] * plan[slots.FRAMES], lanes)
                kept = start_of(block, plan[slots.KEPT] * (plan[slots.STEPS] + 1), lanes)
                ground = ti.static(_ground(relief, grid, real.width, uneven))
                robots = ti.static(Block(m, k, block, plan, listed, settings, drifting, ground, wet, granular))
                for t in range(plan[slots.FIRST], plan[slots.UNTIL] + 1):
                    if ti.static(taping):
                        copy_slots(robots, slots.STATE, slots.KEPT, tape, kept, t * plan[slots.KEPT])
                    count = observe(robots, t)
                    if ti.static(recording):
                        if t % plan[slots.EVERY] == 0:
                            first = t // plan[slots.EVERY] * plan[slots.FRAME_WIDTH]
                            copy_slots(robots, slots.FRAME, slots.FRAME_WIDTH, frames, at, first)
                    if t < plan[slots.UNTIL]:
                        respond(robots, count)
                        move_bodies(robots)
                        quarantine(robots, ti.cast(t, real.scalar))

    return run


@lru_cache
def gradient_kernel(real: Real, grain: int, drifting: bool, uneven: bool, wet: bool, granular: bool) -> Any:
    """The kernel that goes back through a rollout: every step again from the tape, then reversed."""
    lanes = grain > 1
    reals, ints, lists, numbers = _types(real, lanes)

    @ti.kernel
    def run(
        blocks: ti.i32,
        m: reals,
        a: reals,
        g: reals,
        tape: reals,
        plan: ints,
        listed: lists,
        settings: numbers,
        relief: numbers,
        grid: ints,
    ):
        for i in range(grain * blocks):
            if i % grain == 0:
                block = i // grain
                k = start_of(block, plan[slots.SLOTS], lanes)
                kept = start_of(block, plan[slots.KEPT] * (plan[slots.STEPS] + 1), lanes)
                ground = ti.static(_ground(relief, grid, real.width, uneven))
                robots = ti.static(Block(m, k, block, plan, listed, settings, drifting, ground, wet, granular))
                motion = ti.static(Block(a, k, block, plan, listed, settings, False, ground, wet, granular))
                cotangents = ti.static(Block(g, k, block, plan, listed, settings, drifting, ground, wet, granular))
                for back in range(plan[slots.UNTIL] - plan[slots.FIRST] + 1):
                    t = plan[slots.UNTIL] - back
                    restore_state(robots, tape, kept, t * plan[slots.KEPT])
                    count = observe(robots, t)
                    if back > 0:
                        adjoint.clear_work(cotangents)
                        respond(robots, count)
                        adjoint.reverse_response(robots, motion, cotangents, count)
                        adjoint.undo_think(robots, cotangents, t)
                    adjoint.undo_sense(robots, cotangents)
                    adjoint.undo_place(robots, cotangents)

    return run
