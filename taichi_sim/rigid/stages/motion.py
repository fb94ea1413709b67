"""Where bodies are, what they carry into a step, and how they move on."""

from taichi_sim.autodiff import rotations
from taichi_sim.autodiff.elementary import sine_cosine
from taichi_sim.rigid import slots
from taichi_sim.rigid.memory import (
    body_at,
    gather,
    given_at,
    is_hinged,
    put,
    read,
    row,
    setting,
    write,
)
from taichi_sim.rigid.stages import laws, spatial
from taichi_sim.rigid.stages.arguments import carrier_slots, moving_slots
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
            placed = ti.static(laws.hinged_place(*before, sine, cosine, *axis))
            put(robots, body + slots.ROTATION, placed[:9])
            put(robots, body + slots.PLACE, placed[9:12])
            put(robots, body + slots.SCREW, placed[12:])
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
    x, y, z, vx, vy, vz = total, total, total, total, total, total
    for b in range(robots.plan[slots.BODIES]):
        body = body_at(robots, b)
        mass = read(robots, given_at(robots, b) + slots.MASS)
        place = ti.static(row(robots, body + slots.PLACE, 3))
        momentum = ti.static(row(carrying, body + slots.CARRIED + 3, 3))
        total = total + mass
        x, y, z = x + mass * place[0], y + mass * place[1], z + mass * place[2]
        vx, vy, vz = vx + momentum[0], vy + momentum[1], vz + momentum[2]
    share = setting(robots, slots.FLOATING) / total
    return x * share, y * share, z * share, vx * share, vy * share, vz * share, share


@ti.func
def shift_moments(robots: ti.template(), sign):
    """Moments of momentum about the common point from those carried from step to step (or back: -1)."""
    x, y, z, vx, vy, vz, _share = common_motion(robots, robots)
    for b in range(robots.plan[slots.BODIES]):
        body = body_at(robots, b)
        mass = read(robots, given_at(robots, b) + slots.MASS)
        place = ti.static(row(robots, body + slots.PLACE, 3))
        momentum = ti.static(row(robots, body + slots.CARRIED + 3, 3))
        shift = ti.static(laws.moment_shift(mass, *place, *momentum, x, y, z, vx, vy, vz))
        put(robots, body + slots.CARRIED, spatial.plus_times(row(robots, body + slots.CARRIED, 3), shift, sign))


@ti.func
def gather_momentum(robots: ti.template()):
    """Inertias about the common point, and the momentum of each body."""
    h, weight = setting(robots, slots.TIME_STEP), setting(robots, slots.GRAVITY)
    push_out = setting(robots, slots.PUSH_OUT)
    if ti.static(not robots.drifting):
        shift_moments(robots, 1.0)
    for b in range(robots.plan[slots.BODIES]):
        body, given = body_at(robots, b), given_at(robots, b)
        mass = read(robots, given + slots.MASS)
        place = ti.static(row(robots, body + slots.PLACE, 3))
        rotation = ti.static(row(robots, body + slots.ROTATION, 9))
        turned = ti.static(spatial.turned_inertia(rotation, row(robots, given + slots.REST_INERTIA, 6)))
        carried = ti.static(row(robots, body + slots.CARRIED, 6))
        drift = ti.static(row(robots, body + slots.DRIFT, 3))
        put(robots, body + slots.INERTIA, spatial.moved_inertia(turned, mass, place))
        momentum = ti.static(laws.momentum(mass, turned, place, carried, drift, h, weight, push_out, robots.drifting))
        put(robots, body + slots.MOMENTUM, momentum)


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
            turn = h * read(robots, body + slots.RATE)
            write(robots, body + slots.ANGLE, read(robots, body + slots.ANGLE) + turn)
    if ti.static(not robots.drifting):
        shift_moments(robots, -1.0)
    put(robots, slots.POSITION, laws.moved_base(*row(robots, slots.POSITION, 7), *velocity, h))
