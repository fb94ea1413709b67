"""The way back through a rollout: every step again from the tape, then reversed."""

from functools import lru_cache
from typing import Any

from taichi_sim.autodiff.lanes import Real
from taichi_sim.rigid.memory import KEPT, SLOTS, STEPS
from taichi_sim.rigid.stages.adjoint import (
    clear_work,
    prepare_adjoint,
    uncommand,
    unmove,
    unplace,
    unsense,
    unshift_moments,
    unsolve,
    unthink,
)
from taichi_sim.rigid.stages.articulated import assemble, gather, solve_base, spread
from taichi_sim.rigid.stages.contact import apply_normals, fill_matrix, reduce_points, solve_members
from taichi_sim.rigid.stages.step import (
    COMPLIANCE,
    ERROR_REDUCTION,
    FLOATING,
    GAIN,
    GRAVITY,
    MEMORY,
    TIME_STEP,
    observe,
    respond,
)
from taichi_sim.rigid.stages.tape import fetch
from taichi_sim.runtime import ti


@ti.func
def solve_adjoint(
    m: ti.template(),
    a: ti.template(),
    g: ti.template(),
    k,
    plan: ti.template(),
    table: ti.template(),
    points: ti.template(),
    paths: ti.template(),
    listed: ti.template(),
    settings: ti.template(),
    block,
    count,
    rows,
):
    """The motion z: the step's linear system for the cotangents of its solution, with the same contacts and limits."""
    prepare_adjoint(m, a, g, k, plan)
    assemble(a, k, plan, points, listed, block, count, rows, 0.0, False)
    gather(a, k, plan, table, rows)
    solve_base(a, k, plan, settings[FLOATING])
    if count > 0:
        reduce_points(a, k, plan, points, paths, table, listed, block, count, 0.0, settings[FLOATING])
        fill_matrix(a, k, plan, points, paths, table, listed, block, count, settings[COMPLIANCE])
        solve_members(a, k, plan, listed, block, count, rows)
        apply_normals(a, k, plan, points, paths, table, listed, block, count, rows)
    spread(a, k, plan, table)


@lru_cache
def gradient_kernel(real: Real, grain: int, drifting: bool, conserving: bool) -> Any:
    """The kernel for one kind of real."""
    lanes = grain > 1
    reals = ti.types.ndarray(dtype=real.type, ndim=1 if lanes else 2)
    ints1, ints2 = (ti.types.ndarray(dtype=ti.i32, ndim=n) for n in (1, 2))
    numbers = ti.types.ndarray(dtype=real.scalar, ndim=1)

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
                    k = block * plan[SLOTS]
                    kept = block * plan[KEPT] * (plan[STEPS] + 1)
                h = settings[TIME_STEP]
                push_out = settings[ERROR_REDUCTION] / h
                for back in range(plan[STEPS] + 1):
                    t = plan[STEPS] - back
                    fetch(m, k, plan, tape, kept, t)
                    count = observe(m, k, plan, table, points, eyes, listed, settings, block, t, drifting)
                    if back > 0:
                        clear_work(g, k, plan)
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
                        rows = ti.min(count, 1)
                        unmove(m, a, g, k, plan, table, h, push_out, settings[FLOATING], drifting, conserving)
                        solve_adjoint(m, a, g, k, plan, table, points, paths, listed, settings, block, count, rows)
                        unsolve(
                            m,
                            a,
                            g,
                            k,
                            plan,
                            table,
                            points,
                            listed,
                            block,
                            count,
                            rows,
                            h,
                            settings[GRAVITY],
                            push_out,
                            drifting,
                            conserving,
                        )
                        if ti.static(conserving):
                            unshift_moments(m, m, g, k, plan, settings[FLOATING], 1.0)
                        uncommand(m, a, g, k, plan, table, rows, h, push_out)
                        unthink(m, g, k, plan, t, settings[MEMORY], settings[GAIN])
                    unsense(m, g, k, plan, eyes)
                    unplace(m, g, k, plan, table, drifting)

    return run
