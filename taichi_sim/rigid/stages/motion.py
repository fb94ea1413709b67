"""Places of bodies, their momenta at the start of a step, and how they move on."""

from taichi_sim.autodiff import rotations
from taichi_sim.autodiff.elementary import sine_cosine
from taichi_sim.rigid import slots
from taichi_sim.rigid.memory import (
    assign,
    body_at,
    gather,
    given_at,
    gravity_of,
    is_hinged,
    put,
    read,
    row,
    setting,
    variables,
    write,
)
from taichi_sim.rigid.stages import laws, spatial
from taichi_sim.rigid.stages.arguments import body_slots, carrier_slots, moving_slots, shifted_slots
from taichi_sim.runtime import ti


@ti.func
def place_bodies(robots: ti.template()):
    """Rotations and places of all bodies, parents first, and their hinges as spatial vectors."""
    q = ti.static(row(robots, slots.ORIENTATION, 4))
    root = body_at(robots, 0)
    zero = 0.0 * q[0]
    put(robots, root + slots.ROTATION, rotations.matrix(*q))
    put(robots, root + slots.PLACE, (zero, zero, zero))
    put(robots, root + slots.DRIFT, (zero, zero, zero))
    for b in range(1, robots.plan[slots.BODIES]):
        body = body_at(robots, b)
        before = ti.static(gather(robots, carrier_slots(robots, b)))
        if is_hinged(robots, b):
            sine, cosine = sine_cosine(read(robots, body + slots.ANGLE))
            axis = ti.static(row(robots, given_at(robots, b) + slots.AXIS, 3))
            put(robots, body + slots.ROTATION, laws.hinged_place(*before, sine, cosine, *axis))
        else:
            put(robots, body + slots.ROTATION, before[:9])
            put(robots, body + slots.PLACE, laws.welded_place(*before))
        if ti.static(robots.drifting):
            for c in ti.static(range(3)):
                tree = read(robots, slots.POSITION + c) + read(robots, body + slots.PLACE + c)
                write(robots, body + slots.DRIFT + c, read(robots, body + slots.OWN + c) - tree)


@ti.func
def common_motion(robots: ti.template(), carrying: ti.template()):
    """Centre of mass relative to the base, its velocity, and one over the mass, all zero where the base is fixed.

    Masses and places are those of ``robots``, momenta those in the memory of ``carrying``.
    """
    total = 0.0 * read(robots, 0)
    motion = ti.static(variables(6, total))
    for b in range(robots.plan[slots.BODIES]):
        body = body_at(robots, b)
        mass = read(robots, given_at(robots, b) + slots.MASS)
        moments = ti.static([mass * x for x in row(robots, body + slots.PLACE, 3)])
        total = total + mass
        assign(motion, spatial.plus(motion, spatial.joined(moments, row(carrying, body + slots.CARRIED + 3, 3))))
    share = setting(robots, slots.FLOATING) / total
    return ti.static(spatial.joined([x * share for x in motion], share))


@ti.func
def shift_moments(robots: ti.template(), sign):
    """Moments of momentum about the common point from those carried from step to step (or back: -1)."""
    motion = ti.static(common_motion(robots, robots)[:6])
    for b in range(robots.plan[slots.BODIES]):
        pieces = ti.static(shifted_slots(robots, b))
        shift = ti.static(laws.moment_shift(*gather(robots, pieces), *motion))
        carried = body_at(robots, b) + slots.CARRIED
        put(robots, carried, spatial.plus_times(row(robots, carried, 3), shift, sign))


@ti.func
def gather_momentum(robots: ti.template()):
    """Inertias about the common point, and the momentum of each body."""
    h, push_out = setting(robots, slots.TIME_STEP), setting(robots, slots.PUSH_OUT)
    gravity = ti.static(gravity_of(robots))
    if ti.static(not robots.drifting):
        shift_moments(robots, 1.0)
    for b in range(robots.plan[slots.BODIES]):
        inputs = ti.static(gather(robots, body_slots(robots, b)))
        put(robots, body_at(robots, b) + slots.INERTIA, laws.prepared(*inputs, h, *gravity, push_out, robots.drifting))


@ti.func
def move_bodies(robots: ti.template()):
    """Carry velocities or momenta, and move on: semi-implicit Euler."""
    h, push_out = setting(robots, slots.TIME_STEP), setting(robots, slots.PUSH_OUT)
    velocity = ti.static(row(robots, body_at(robots, 0) + slots.VELOCITY, 6))
    for b in range(robots.plan[slots.BODIES]):
        body = body_at(robots, b)
        moving = ti.static(gather(robots, moving_slots(robots, b)))
        moved = ti.static(laws.carried_on(*moving, h, push_out, robots.drifting))
        put(robots, body + slots.CARRIED, moved[:6])
        if ti.static(robots.drifting):
            put(robots, body + slots.MOVING, moved[:6])
            put(robots, body + slots.OWN, moved[6:])
        else:
            y = ti.static(row(robots, body + slots.VELOCITY, 6))
            linear = ti.static(spatial.plus(y[3:], spatial.cross(y[:3], row(robots, body + slots.PLACE, 3))))
            put(robots, body + slots.MOVING, spatial.joined(*y[:3], linear))
        if is_hinged(robots, b):
            rate = read(robots, body + slots.RATE)
            write(robots, body + slots.ANGLE, read(robots, body + slots.ANGLE) + h * rate)
            write(robots, body + slots.LAST_RATE, rate)
    if ti.static(not robots.drifting):
        shift_moments(robots, -1.0)
    put(robots, slots.POSITION, laws.moved_base(*row(robots, slots.POSITION, 7), *velocity, h))
