"""Rollouts of rigid robots: blocks of robots in native vector lanes (CPU), or one a thread (GPU).

A step: place bodies, find contacts, sense, think; then, as the solver that the studies ran on does, solve without
friction, let points that push then rub, and solve again; move on. Each solution is one of a mixed linear
complementarity problem: hinges' rows by turns with normals, until nobody changes sides.
"""

from functools import lru_cache
from typing import Any

from taichi_sim.lanes import Real, any_lane, load, store
from taichi_sim.rigid import spatial
from taichi_sim.rigid.articulated_stage import assemble, gather, solve_base, spread, switch_rows
from taichi_sim.rigid.contact_stage import (
    apply_normals,
    choose_members,
    fill_matrix,
    find_contacts,
    reduce_points,
    solve_normals,
)
from taichi_sim.rigid.control_stage import clear_touch, command_hinges, sense_light, think
from taichi_sim.rigid.friction_stage import rub
from taichi_sim.rigid.memory import (
    ANGLE,
    BODIES,
    BODY_COLUMNS,
    DIVERGED,
    EVERY,
    FRAME,
    FRAMES,
    HINGED,
    IMPULSES,
    LIGHTS,
    MOTORS,
    NEURON,
    POINTS,
    POSITION,
    READING,
    RESIDUAL,
    SLOTS,
    STEPS,
    TOUCHES,
    VELOCITY,
    body_at,
    point_at,
    row,
)
from taichi_sim.rigid.motion_stage import gather_momentum, move_bodies, place_bodies
from taichi_sim.runtime import ti
from taichi_sim.tracing import select

MOST_SWITCHES = 12  # solutions a phase, while hinges' rows change
MOST_PIVOTS = 60
FARTHEST = 1e6  # m, or m/s: beyond it a robot has exploded

# Places in the array of numbers of a run.
(TIME_STEP, GRAVITY, ERROR_REDUCTION, SLIP_STRENGTH, FRICTION, COMPLIANCE, MEMORY, GAIN, APART, TOUCHING, FLOATING,
 TOLERANCE) = range(12)  # fmt: skip
SETTINGS = 12

AWAY = (0.0, 0.0, 1e4, 1.0, 0.0, 0.0, 0.0)  # where a robot is put that exploded: high above the ground
STATE_WIDTH = 12  # slots of a body that it carries from step to step


@ti.func
def solve_phase(m: ti.template(), k, plan: ti.template(), table: ti.template(), points: ti.template(),
                paths: ti.template(), listed: ti.template(), settings: ti.template(), block, count, phase, push_out,
                drifting: ti.template()):  # fmt: skip
    """Velocities of all bodies, and impulses of hinges and normals that go with them."""
    rows = ti.min(phase, 1)  # phases after the first share its memory
    left = MOST_SWITCHES
    choose_members(m, k, plan, listed, block, count, rows)
    while left > 0:
        assemble(m, k, plan, points, listed, block, count, phase, push_out, drifting)
        gather(m, k, plan, table, rows)
        solve_base(m, k, plan, settings[FLOATING])
        if count > 0:
            reduce_points(m, k, plan, points, paths, table, listed, block, count, push_out, settings[FLOATING])
            fill_matrix(m, k, plan, points, paths, table, listed, block, count, settings[COMPLIANCE])
            solve_normals(m, k, plan, listed, block, count, rows, settings[TOLERANCE], MOST_PIVOTS)
            apply_normals(m, k, plan, points, paths, table, listed, block, count, rows)
        spread(m, k, plan, table)
        changes = switch_rows(m, k, plan, table, rows, settings[TOLERANCE])
        left -= 1
        if any_lane(changes > 0.0):
            if left == 0:
                store(m, k, RESIDUAL, select(changes > 0.0, 1.0, load(m, k, RESIDUAL)))
        else:
            left = 0


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


@ti.func
def quarantine(m: ti.template(), k, plan: ti.template(), step):
    """A robot that exploded is noted and put away, so that its numbers do no harm."""
    p, v = ti.static(row(m, k, POSITION, 3)), ti.static(row(m, k, body_at(plan, 0) + VELOCITY, 6))
    all_six = ti.static(spatial.joined(p, v))
    size = spatial.dot(all_six, all_six)
    sound = size < FARTHEST * FARTHEST  # false of a NaN
    if any_lane(select(sound, 0.0 * p[0], 0.0 * load(m, k, RESIDUAL) + 1.0) > 0.5):
        before = load(m, k, DIVERGED)
        store(m, k, DIVERGED, select(sound | (before >= 0.0), before, 0.0 * before + step))
        for c in ti.static(range(7)):
            value = load(m, k, POSITION + c)
            store(m, k, POSITION + c, select(sound, value, AWAY[c]))
        for b in range(plan[BODIES]):
            for c in range(STATE_WIDTH):
                slot = body_at(plan, b) + c
                store(m, k, slot, select(sound, load(m, k, slot), 0.0))
        for c in range(plan[MOTORS]):
            store(m, k, plan[NEURON] + c, select(sound, load(m, k, plan[NEURON] + c), 0.0))
        for c in range(plan[POINTS]):
            for phase in ti.static(range(2)):
                slot = point_at(plan, c) + IMPULSES + phase
                store(m, k, slot, select(sound, load(m, k, slot), 0.0))


@lru_cache
def rollout_kernel(real: Real, grain: int, drifting: bool, conserving: bool, recording: bool) -> Any:
    """The kernel for one kind of real; on a GPU, where ``grain`` is 1, slots lie one after the other."""
    lanes = grain > 1
    reals = ti.types.ndarray(dtype=real.type, ndim=1 if lanes else 2)
    ints1, ints2 = (ti.types.ndarray(dtype=ti.i32, ndim=n) for n in (1, 2))
    numbers = ti.types.ndarray(dtype=real.scalar, ndim=1)

    @ti.kernel
    def run(blocks: ti.i32, phases: ti.i32, m: reals, frames: reals, plan: ints1, table: ints1, points: ints1,
            paths: ints1, eyes: ints1, listed: ints2, settings: numbers):  # fmt: skip
        for i in range(grain * blocks):
            if i % grain == 0:
                block = i // grain
                k, at = block, block
                if ti.static(lanes):
                    k = block * plan[SLOTS]
                    at = block * plan[FRAME] * plan[FRAMES]
                h = settings[TIME_STEP]
                push_out = settings[ERROR_REDUCTION] / h
                for t in range(plan[STEPS] + 1):
                    place_bodies(m, k, plan, table, drifting)
                    clear_touch(m, k, plan, settings[APART])
                    count = find_contacts(m, k, plan, table, points, listed, block, settings[TOUCHING])
                    sense_light(m, k, plan, eyes)
                    think(m, k, plan, t, settings[MEMORY], settings[GAIN])
                    if ti.static(recording):
                        if t % plan[EVERY] == 0:
                            record(m, k, plan, table, frames, at, t // plan[EVERY])
                    if t < plan[STEPS]:
                        command_hinges(m, k, plan, table, h, push_out)
                        gather_momentum(m, k, plan, h, settings[GRAVITY], push_out, drifting, conserving)
                        for phase in range(phases):
                            if phase == 0 or count > 0:
                                solve_phase(m, k, plan, table, points, paths, listed, settings, block, count, phase,
                                            push_out, drifting)  # fmt: skip
                                rub(m, k, plan, points, listed, block, count, phase, settings[SLIP_STRENGTH],
                                    settings[FRICTION], push_out)  # fmt: skip
                        move_bodies(m, k, plan, table, h, push_out, drifting, conserving)
                        quarantine(m, k, plan, ti.cast(t, real.scalar))

    return run
