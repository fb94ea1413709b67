"""Velocities of an articulated tree: from the leaves to the base and back.

An articulated body's inertia I and momentum p say which impulse f = I v - p it needs to move with v. A hinge with the
spatial vector S adds S u to its parent's velocity. Either its rate u is given (a motor that holds its rate, a stop), or
the impulse along it is; in both cases u = u0 - (U.v) / D with U = I S and 1 / D = 0 where the rate is given, and the
parent sees I - U U^T / D and p - U u0. (Featherstone, Rigid Body Dynamics Algorithms, 2008, chapter 7, for velocities.)
A rotor, a damper and a spring add to D = S.U what they resist each unit of the rate with.
"""

from taichi_sim.autodiff.tracing import select
from taichi_sim.rigid import slots
from taichi_sim.rigid.memory import (
    add,
    body_at,
    given_at,
    is_hinged,
    listed_point,
    parent_at,
    put,
    read,
    row,
    setting,
    write,
)
from taichi_sim.rigid.stages import spatial
from taichi_sim.rigid.stages.friction import axes_of
from taichi_sim.rigid.stages.water import water_inertia
from taichi_sim.runtime import ti


@ti.func
def assemble(robots: ti.template(), count, phase, push_out):
    """Inertias and momenta of bodies on their own; from phase 1 on with the friction of points that rub."""
    for b in range(robots.plan[slots.BODIES]):
        body = body_at(robots, b)
        mass = read(robots, given_at(robots, b) + slots.MASS)
        inertia, place = ti.static(row(robots, body + slots.INERTIA, 6)), ti.static(row(robots, body + slots.PLACE, 3))
        put(robots, body + slots.ARTICULATED, spatial.rigid_matrix(inertia, mass, place))
        if ti.static(robots.wet):
            add(robots, body + slots.ARTICULATED, water_inertia(robots, b))
        put(robots, body + slots.IMPULSE, row(robots, body + slots.MOMENTUM, 6))
        write(robots, body + slots.CONTACT, 0.0 * mass)
    if phase > 0:
        for n in range(count):
            _i, b, point = listed_point(robots, n)
            body = body_at(robots, b)
            strength = read(robots, point + slots.RUBS)
            at = ti.static(row(robots, point + slots.AT, 3))
            axes = ti.static(axes_of(robots, point))
            added = ti.static(spatial.drag(at, strength, axes))
            for e in ti.static(range(len(added))):
                slot = body + slots.ARTICULATED + added[e][0]
                write(robots, slot, read(robots, slot) + added[e][1])
            if ti.static(robots.drifting):  # its own velocity is that of the tree less the correction of its drift
                drift = ti.static(spatial.along(axes, row(robots, body + slots.DRIFT, 3)))
                fx = strength * push_out * drift[0]
                fy = strength * push_out * drift[1]
                pull = ti.static(spatial.back_along(axes, fx, fy))
                impulse = ti.static(spatial.joined(spatial.cross(at, pull), pull))
                put(robots, body + slots.IMPULSE, spatial.plus(row(robots, body + slots.IMPULSE, 6), impulse))


@ti.func
def collect(robots: ti.template(), phase):
    """Add each body's articulated inertia and momentum to its parent's, from the leaves to the base."""
    for back in range(1, robots.plan[slots.BODIES]):
        b = robots.plan[slots.BODIES] - back
        body, parent = body_at(robots, b), parent_at(robots, b)
        inertia = ti.static(row(robots, body + slots.ARTICULATED, 21))
        impulse = ti.static(row(robots, body + slots.IMPULSE, 6))
        of_parent = ti.static(row(robots, parent + slots.ARTICULATED, 21))
        at_parent = ti.static(row(robots, parent + slots.IMPULSE, 6))
        if is_hinged(robots, b):
            screw = ti.static(row(robots, body + slots.SCREW, 6))
            column = ti.static(spatial.times(inertia, screw))
            mode = read(robots, body + slots.MODES + phase)
            held, asked = (mode > 1.5) | (mode < -1.5), (mode > -0.5) & (mode < 0.5)
            servo = read(robots, body + slots.SERVO)
            way = read(robots, body + slots.WAYS + phase)
            stuck = (way > -0.5) & (way < 0.5)
            driven = held | stuck | (asked & (servo < 0.0))
            bound = select(mode > 0.0, read(robots, body + slots.HIGH), read(robots, body + slots.LOW))
            bound = select(asked, read(robots, body + slots.TARGET), bound)
            resistance = read(robots, body + slots.RESISTANCE) + select(asked & (servo >= 0.0), servo, 0.0 * servo)
            inverse = 1.0 / (spatial.dot(screw, column) + resistance)
            push = read(robots, body + slots.PUSH) - way * read(robots, body + slots.RUBBING)
            free = (push + bound + spatial.dot(screw, impulse)) * inverse
            stop = select(mode > 0.0, read(robots, body + slots.LEAST_RATE), read(robots, body + slots.MOST_RATE))
            given = select(held, stop, select(stuck, 0.0 * mode, read(robots, body + slots.TARGET)))
            rate = select(driven, given, free)
            inverse = select(driven, 0.0, inverse)
            put(robots, body + slots.COLUMN, column)
            write(robots, body + slots.INVERSE, inverse)
            write(robots, body + slots.FREE_RATE, rate)
            left = ti.static(spatial.less_outer(inertia, column, inverse))
            put(robots, parent + slots.ARTICULATED, spatial.plus(of_parent, left))
            rest = ti.static(spatial.minus_times(impulse, column, rate))
            put(robots, parent + slots.IMPULSE, spatial.plus(at_parent, rest))
        else:
            put(robots, parent + slots.ARTICULATED, spatial.plus(of_parent, inertia))
            put(robots, parent + slots.IMPULSE, spatial.plus(at_parent, impulse))


@ti.func
def solve_base(robots: ti.template()):
    """The base's factor, and its velocity without contacts."""
    floating = setting(robots, slots.FLOATING)
    root = body_at(robots, 0)
    factor = ti.static(spatial.cholesky(row(robots, root + slots.ARTICULATED, 21)))
    free = ti.static(spatial.forward(factor, row(robots, root + slots.IMPULSE, 6)))
    # Never -0, to which points that touch in other lanes only would add their +0.
    right = ti.static([x * floating + 0.0 for x in free])
    put(robots, slots.ROOT, factor)
    put(robots, slots.ROOT_RIGHT, right)
    put(robots, root + slots.VELOCITY, spatial.backward(factor, right))


@ti.func
def spread(robots: ti.template()):
    """Velocities of all bodies, from the base to the leaves, contacts included."""
    factor, right = ti.static(row(robots, slots.ROOT, 21)), ti.static(row(robots, slots.ROOT_RIGHT, 6))
    put(robots, body_at(robots, 0) + slots.VELOCITY, spatial.backward(factor, right))
    for b in range(1, robots.plan[slots.BODIES]):
        body = body_at(robots, b)
        velocity = ti.static(row(robots, parent_at(robots, b) + slots.VELOCITY, 6))
        if is_hinged(robots, b):
            pulled = read(robots, body + slots.CONTACT) - spatial.dot(row(robots, body + slots.COLUMN, 6), velocity)
            rate = read(robots, body + slots.FREE_RATE) + read(robots, body + slots.INVERSE) * pulled
            write(robots, body + slots.RATE, rate)
            put(robots, body + slots.VELOCITY, spatial.plus_times(velocity, row(robots, body + slots.SCREW, 6), rate))
        else:
            put(robots, body + slots.VELOCITY, velocity)
