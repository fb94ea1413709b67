"""A time step of a block of robots: look and think; solve; keep away those that exploded.

A step solves, as the solver does that the studies ran on, first without friction; the points that then push rub in the
second solution. Each is a mixed linear complementarity problem: hinges' rows by turns with normals, until nobody
changes sides.
"""

from taichi_sim.autodiff.lanes import any_lane, larger, smaller
from taichi_sim.autodiff.tracing import select
from taichi_sim.rigid import slots
from taichi_sim.rigid.memory import body_at, read, row, setting, write
from taichi_sim.rigid.stages import spatial
from taichi_sim.rigid.stages.articulated import assemble, collect, solve_base, spread
from taichi_sim.rigid.stages.contact import (
    apply_normals,
    choose_members,
    fill_matrix,
    find_contacts,
    reduce_points,
    solve_normals,
    touching,
)
from taichi_sim.rigid.stages.control import clear_touch, command_hinges, sense_light, think
from taichi_sim.rigid.stages.friction import rub
from taichi_sim.rigid.stages.motion import gather_momentum, place_bodies
from taichi_sim.rigid.stages.rows import repeat_rows, switch_rows
from taichi_sim.rigid.stages.sand import limit_normals
from taichi_sim.rigid.stages.water import immerse
from taichi_sim.rigid.stages.work import do_work
from taichi_sim.runtime import ti

MOST_SWITCHES, TRIES_TOGETHER = 1000, 4  # solutions a phase; of them all at once without fewer wrong rows than ever
SWITCHES_OF_STUDIES, TOGETHER_IN_STUDIES = 30, 8  # solutions a phase in their solver; all at once in the first
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
    active = 0.0 * read(robots, slots.POSITION) + 1.0
    for phase in range(phases):
        if phase == 0 or count > 0:
            solve_phase(robots, count, phase, active)
            if ti.static(not robots.drifting):
                if phase == 0:
                    active = touching(robots, count)
                    repeat_rows(robots, active)
            if phase + 1 < phases:
                rub(robots, count, phase)
    if ti.static(not robots.drifting):
        do_work(robots, ti.min(count, 1))


@ti.func
def solve_phase(robots: ti.template(), count, phase, those):
    """Velocities of all bodies, and impulses that go with them; robots where ``those`` is 0 keep their rows and points.

    Rows that are wrong change all at once while that leaves fewer of them; where it goes on in circles, one at a time,
    which ends (Murty), until fewer are wrong than ever before (Portugal, Judice & Vicente, Mathematics of Computation
    63, 1994).
    """
    rows = ti.min(phase, 1)  # phases after the first share its memory
    push_out = setting(robots, slots.PUSH_OUT)
    last = ti.static(0 if robots.drifting else 1) * robots.plan[slots.BODIES]  # rounds, that let nothing past a stop
    left = ti.static(SWITCHES_OF_STUDIES if robots.drifting else MOST_SWITCHES) + last
    none = 0.0 * read(robots, slots.POSITION)
    single, tries, fewest, active = none, none + TRIES_TOGETHER, none + FARTHEST, none + those
    unsolved = read(robots, slots.RESIDUAL)
    choose_members(robots, count, rows)
    while left > 0:
        # What earlier rounds left counts no more.
        write(robots, slots.RESIDUAL, select(active > 0.5, unsolved, read(robots, slots.RESIDUAL)))
        assemble(robots, count, phase, push_out)
        collect(robots, rows)
        solve_base(robots)
        if count > 0:
            reduce_points(robots, count, push_out)
            fill_matrix(robots, count)
            solve_normals(robots, count, rows, active)
            apply_normals(robots, count, rows)
        spread(robots)
        left -= 1
        wrong = switch_rows(robots, rows, single, ti.cast(left < last, ti.i32), active)
        if ti.static(robots.drifting):
            if left == ti.static(SWITCHES_OF_STUDIES - TOGETHER_IN_STUDIES):
                single = single + 1.0
        else:
            tries = select(wrong < fewest, none + TRIES_TOGETHER, tries - 1.0)
            single = select(tries > 0.0, none, none + 1.0)
            fewest = smaller(fewest, wrong)
            active = select(wrong > 0.0, none + 1.0, none)
        if any_lane(wrong > 0.0):
            if left == last:
                unsolved = select(wrong > 0.0, 1.0, unsolved)
        else:
            left = 0
    write(robots, slots.RESIDUAL, larger(unsolved, read(robots, slots.RESIDUAL)))


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
