"""A time step of a block of robots: look and think; solve; keep away those that exploded.

A step solves, as the solver does that the studies ran on, first without friction; the points that then push rub in the
second solution. Each is a mixed linear complementarity problem: hinges' rows by turns with normals, until nobody
changes sides.
"""

from taichi_sim.autodiff.lanes import any_lane, load, store
from taichi_sim.autodiff.tracing import select
from taichi_sim.rigid.memory import (
    BODIES,
    DIVERGED,
    IMPULSES,
    MOTORS,
    NEURON,
    POINTS,
    POSITION,
    RESIDUAL,
    STATE_WIDTH,
    VELOCITY,
    body_at,
    point_at,
    row,
)
from taichi_sim.rigid.stages import spatial
from taichi_sim.rigid.stages.articulated import assemble, gather, solve_base, spread, switch_rows
from taichi_sim.rigid.stages.contact import (
    apply_normals,
    choose_members,
    fill_matrix,
    find_contacts,
    reduce_points,
    solve_normals,
)
from taichi_sim.rigid.stages.control import clear_touch, command_hinges, sense_light, think
from taichi_sim.rigid.stages.friction import rub
from taichi_sim.rigid.stages.motion import gather_momentum, place_bodies
from taichi_sim.runtime import ti

MOST_SWITCHES, SWITCHES_TOGETHER = 30, 8  # solutions a phase, while hinges' rows change; all at once in the first
MOST_PIVOTS = 60
FARTHEST = 1e6  # m, or m/s: beyond it a robot has exploded

# Places in the array of numbers of a run.
(
    TIME_STEP,
    GRAVITY,
    ERROR_REDUCTION,
    SLIP_STRENGTH,
    FRICTION,
    COMPLIANCE,
    MEMORY,
    GAIN,
    APART,
    TOUCHING,
    FLOATING,
    TOLERANCE,
) = range(12)
SETTINGS = 12

AWAY = (0.0, 0.0, 1e4, 1.0, 0.0, 0.0, 0.0)  # where a robot is put that exploded: high above the ground


@ti.func
def observe(
    m: ti.template(),
    k,
    plan: ti.template(),
    table: ti.template(),
    points: ti.template(),
    eyes: ti.template(),
    listed: ti.template(),
    settings: ti.template(),
    block,
    t,
    drifting: ti.template(),
):
    """Where everything is, what is sensed and what neurons say; returns how many points are listed as touching."""
    place_bodies(m, k, plan, table, drifting)
    clear_touch(m, k, plan, settings[APART])
    count = find_contacts(m, k, plan, table, points, listed, block, settings[TOUCHING])
    sense_light(m, k, plan, eyes)
    think(m, k, plan, t, settings[MEMORY], settings[GAIN])
    return count


@ti.func
def respond(
    m: ti.template(),
    k,
    plan: ti.template(),
    table: ti.template(),
    points: ti.template(),
    paths: ti.template(),
    listed: ti.template(),
    settings: ti.template(),
    block,
    count,
    phases,
    drifting: ti.template(),
    conserving: ti.template(),
):
    """Velocities of all bodies at the end of the step."""
    h = settings[TIME_STEP]
    push_out = settings[ERROR_REDUCTION] / h
    command_hinges(m, k, plan, table, h, push_out)
    gather_momentum(m, k, plan, h, settings[GRAVITY], push_out, settings[FLOATING], drifting, conserving)
    for phase in range(phases):
        if phase == 0 or count > 0:
            solve_phase(m, k, plan, table, points, paths, listed, settings, block, count, phase, push_out, drifting)
            if phase + 1 < phases:
                rub(
                    m,
                    k,
                    plan,
                    points,
                    listed,
                    block,
                    count,
                    phase,
                    settings[SLIP_STRENGTH],
                    settings[FRICTION],
                    push_out,
                )


@ti.func
def solve_phase(
    m: ti.template(),
    k,
    plan: ti.template(),
    table: ti.template(),
    points: ti.template(),
    paths: ti.template(),
    listed: ti.template(),
    settings: ti.template(),
    block,
    count,
    phase,
    push_out,
    drifting: ti.template(),
):
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
        together = 0
        if left > MOST_SWITCHES - SWITCHES_TOGETHER:
            together = 1
        changes = switch_rows(m, k, plan, table, rows, settings[TOLERANCE], together)
        left -= 1
        if any_lane(changes > 0.0):
            if left == 0:
                store(m, k, RESIDUAL, select(changes > 0.0, 1.0, load(m, k, RESIDUAL)))
        else:
            left = 0


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
