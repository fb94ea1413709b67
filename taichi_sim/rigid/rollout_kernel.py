"""Rollouts of rigid robots: blocks of robots in native vector lanes (CPU), or one a thread (GPU)."""

from functools import lru_cache
from typing import Any

from taichi_sim.autodiff.lanes import Real, load, store
from taichi_sim.rigid.memory import (
    ANGLE,
    BODIES,
    BODY_COLUMNS,
    EVERY,
    FRAME,
    FRAMES,
    HINGED,
    KEPT,
    LIGHTS,
    MOTORS,
    NEURON,
    POSITION,
    READING,
    SLOTS,
    STEPS,
    TOUCHES,
    body_at,
)
from taichi_sim.rigid.stages.motion import move_bodies
from taichi_sim.rigid.stages.step import ERROR_REDUCTION, FLOATING, TIME_STEP, observe, quarantine, respond
from taichi_sim.rigid.stages.tape import keep
from taichi_sim.runtime import ti


@ti.func
def record(m: ti.template(), k, plan: ti.template(), table: ti.template(), frames: ti.template(), at, frame):
    """Note pose, angles, readings and neurons."""
    sensors, motors = plan[TOUCHES] + plan[LIGHTS], plan[MOTORS]
    slot = frame * plan[FRAME]
    for c in range(7):
        store(frames, at, slot + c, load(m, k, POSITION + c))
    slot += 7
    for b in range(1, plan[BODIES]):
        if table[b * BODY_COLUMNS + HINGED] == 1:
            store(frames, at, slot, load(m, k, body_at(plan, b) + ANGLE))
            slot += 1
    for c in range(sensors):
        store(frames, at, slot + c, load(m, k, plan[READING] + c))
    for c in range(motors):
        store(frames, at, slot + sensors + c, load(m, k, plan[NEURON] + c))


@lru_cache
def rollout_kernel(real: Real, grain: int, drifting: bool, conserving: bool, recording: bool, taping: bool) -> Any:
    """The kernel for one kind of real; on a GPU, where ``grain`` is 1, slots lie one after the other."""
    lanes = grain > 1
    reals = ti.types.ndarray(dtype=real.type, ndim=1 if lanes else 2)
    ints1, ints2 = (ti.types.ndarray(dtype=ti.i32, ndim=n) for n in (1, 2))
    numbers = ti.types.ndarray(dtype=real.scalar, ndim=1)

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
                    k = block * plan[SLOTS]
                    at = block * plan[FRAME] * plan[FRAMES]
                    kept = block * plan[KEPT] * (plan[STEPS] + 1)
                h = settings[TIME_STEP]
                for t in range(plan[STEPS] + 1):
                    if ti.static(taping):
                        keep(m, k, plan, tape, kept, t)
                    count = observe(m, k, plan, table, points, eyes, listed, settings, block, t, drifting)
                    if ti.static(recording):
                        if t % plan[EVERY] == 0:
                            record(m, k, plan, table, frames, at, t // plan[EVERY])
                    if t < plan[STEPS]:
                        respond(
                            m,
                            k,
                            plan,
                            table,
                            points,
                            paths,
                            listed,
                            settings,
                            block,
                            count,
                            phases,
                            drifting,
                            conserving,
                        )
                        move_bodies(
                            m,
                            k,
                            plan,
                            table,
                            h,
                            settings[ERROR_REDUCTION] / h,
                            settings[FLOATING],
                            drifting,
                            conserving,
                        )
                        quarantine(m, k, plan, ti.cast(t, real.scalar))

    return run
