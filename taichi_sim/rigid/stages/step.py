"""A time step of a block of robots: look and think; solve; keep away those that exploded.

A step solves, as the solver does that the studies ran on, first without friction; the points that then push rub in the
second solution. Each is a mixed linear complementarity problem: hinges' rows by turns with normals, until nobody
changes sides.
"""

from taichi_sim.autodiff.lanes import any_lane
from taichi_sim.autodiff.tracing import select
from taichi_sim.rigid import slots
from taichi_sim.rigid.memory import body_at, read, row, setting, write
from taichi_sim.rigid.stages import spatial
from taichi_sim.rigid.stages.articulated import assemble, collect, solve_base, spread, switch_rows
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
from taichi_sim.rigid.stages.sand import limit_normals
from taichi_sim.rigid.stages.water import immerse
from taichi_sim.runtime import ti

MOST_SWITCHES, SWITCHES_TOGETHER = 120, 8  # solutions a phase, while hinges' rows change; all at once in the first
SWITCHES_OF_STUDIES = 30  # at most, in their solver
FARTHEST = 1e6  # m, or m/s: beyond it a robot has exploded
HIGH_ABOVE = 1e4  # m: where a robot is put that exploded


@ti.func
def observe(robots: ti.template(), t):
    """Place bodies, find contacts, read sensors and update neurons; return the number of points listed as touching."""
    place_bodies(robots)
    clear_touch(robots)
    count = find_contacts(robots)
    sense_light(robots)
    think(robots, t)
    return count


@ti.func
def respond(robots: ti.template(), count):
    """Velocities of all bodies at the end of the step."""
    command_hinges(robots)
    gather_momentum(robots)
    if ti.static(robots.wet):
        immerse(robots)
    if ti.static(robots.granular):
        limit_normals(robots, count)
    phases = robots.plan[slots.PHASES]
    for phase in range(phases):
        if phase == 0 or count > 0:
            solve_phase(robots, count, phase)
            if phase + 1 < phases:
                rub(robots, count, phase)


@ti.func
def solve_phase(robots: ti.template(), count, phase):
    """Velocities of all bodies, and impulses of hinges and normals that go with them."""
    rows = ti.min(phase, 1)  # phases after the first share its memory
    push_out = setting(robots, slots.PUSH_OUT)
    most = ti.static(SWITCHES_OF_STUDIES if robots.drifting else MOST_SWITCHES)
    left = most
    choose_members(robots, count, rows)
    while left > 0:
        assemble(robots, count, phase, push_out)
        collect(robots, rows)
        solve_base(robots)
        if count > 0:
            reduce_points(robots, count, push_out)
            fill_matrix(robots, count)
            solve_normals(robots, count, rows)
            apply_normals(robots, count, rows)
        spread(robots)
        together = 0
        if left > most - SWITCHES_TOGETHER:
            together = 1
        changes = switch_rows(robots, rows, together)
        left -= 1
        if any_lane(changes > 0.0):
            if left == 0:
                write(robots, slots.RESIDUAL, select(changes > 0.0, 1.0, read(robots, slots.RESIDUAL)))
        else:
            left = 0


@ti.func
def quarantine(robots: ti.template(), step):
    """A robot that exploded is noted and put away, so that its numbers do no harm."""
    root = body_at(robots, 0)
    all_six = ti.static(row(robots, slots.POSITION, 3) + row(robots, root + slots.VELOCITY, 6))
    size = spatial.dot(all_six, all_six)
    sound = size < FARTHEST * FARTHEST  # false of a NaN
    if any_lane(select(sound, 0.0 * all_six[0], 0.0 * read(robots, slots.RESIDUAL) + 1.0) > 0.5):
        before = read(robots, slots.DIVERGED)
        write(robots, slots.DIVERGED, select(sound | (before >= 0.0), before, 0.0 * before + step))
        for c in range(robots.plan[slots.KEPT]):
            slot = robots.plan[robots.plan[slots.STATE] + c]
            away = 0.0
            if slot == slots.POSITION + 2:
                away = HIGH_ABOVE
            if slot == slots.ORIENTATION:
                away = 1.0
            write(robots, slot, select(sound, read(robots, slot), away))
