"""Water at rest around rigid bodies: buoyancy, drag and added mass, by the part of them that is below its surface.

A solid is made of portions (see ``model.shapes``): balls, and parts of other solids, whose heights are spread evenly.
Of a portion of volume V with its centre at the depth d, whose heights reach h = sqrt(n.A n) from it along the vertical
n, a share is below the surface that grows with s = (1 + d/h) / 2, from 0 to 1: s, or s^2 (3 - 2 s) of a ball. Buoyancy
is the slope of a potential by d and, where it turns, by h: so it floats as Archimedes says, and rights itself likewise.

- Buoyancy is the weight of the water displaced, through the centre of what is below.
- Drag is 1/2 rho |v| (C a) v at the portion's centre, a matrix of areas along the body's axes; a plate that moves
  aslant has a pressure in proportion to the sine (Kirchhoff's plate; Hoerner, Fluid-Dynamic Drag, 1965, ch. III).
- Added mass is half the mass of the water displaced, that of a ball (Lamb, Hydrodynamics, 1932, art. 92). What goes in
  must bring its added mass to its own speed, the slamming of von Karman (NACA TN 321, 1929); what comes out leaves it
  behind. The speed that it has is that of the step before, in the pose of then: with the arms of the new pose the
  added mass of a body whose middle is elsewhere would turn with it without a push, and give energy. So water gives no
  more than it took, but for what explicit steps give to fast spins.

Drag and added mass are part of a step's linear system, the drag's speed being that before the step: so they slow a body
whatever the time step, and never turn it round. The surface stays level: no waves, no wake, no lift across the motion.
"""

from collections.abc import Sequence
from typing import Any

from taichi_sim.autodiff.lanes import larger, smaller
from taichi_sim.autodiff.tracing import primitive, pull_back, sqrt
from taichi_sim.rigid import slots
from taichi_sim.rigid.memory import (
    Block,
    Pieces,
    add,
    body_at,
    count_of,
    gather,
    given_at,
    listed_in_plan,
    put,
    read,
    row,
    scatter,
    setting,
    write,
)
from taichi_sim.rigid.stages import spatial
from taichi_sim.runtime import emit, ti

Reals = Sequence[Any]
TURNS_BACK = 3  # repetitions that find the angular velocity of the step before
LEAST = 1e-30  # (m/s)^2, keeps the speed's derivative finite


@primitive
def own_motion(*values: Any) -> tuple[Any, ...]:
    """Angular velocity and velocity of a body at the end of the step before (6), from what it carries.

    Values: mass, inertia at rest (6), rotation (9), place (3), carried (6); then drifting and the time step.

    A body that carries momentum had its angular velocity in the pose that it had then, which is found by turning back.
    """
    (mass,), at_rest, rotation, place, angular, linear = spatial.cut(values, 1, 6, 9, 3, 3, 3)
    drifting, time_step = values[25:]
    if drifting:
        return (*angular, *linear)
    spin = spatial.minus_times(angular, spatial.cross(place, linear), 1.0)
    own = [emit(spatial.dot(rotation[i::3], spin)) for i in range(3)]
    inverse = _inverse(at_rest)
    turning = spatial.times_triangle(inverse, own)
    for _ in range(TURNS_BACK):  # in the body's axes, which turn about it, it is the same before and after the turn
        turning = spatial.times_triangle(inverse, _turned_by(turning, time_step, own))
    return (*spatial.turned(rotation, turning), *(x / mass for x in linear))


@primitive
def _turned_by(spin: Reals, time: Any, v: Reals) -> Reals:
    """A vector that turns with ``spin`` for a time, to the fourth order of the angle."""
    first = spatial.cross(spin, v)
    second, square = spatial.cross(spin, first), emit(time * time * spatial.dot(spin, spin))
    once, twice = emit(time * (1.0 - square / 6.0)), emit(0.5 * time * time * (1.0 - square / 12.0))
    return spatial.plus_times(spatial.plus_times(v, first, once), second, twice)


@primitive
def wet_share(height: Any, is_ball: Any) -> Any:
    """Share of a portion that is below the surface, and the slope by its reach h of the share's integral over depth.

    ``height`` is how deep the portion's centre is, in its reaches.
    """
    s = 0.5 * height + 0.5
    s = emit(smaller(larger(s, 0.0 * s), 1.0 + 0.0 * s))
    even = emit(s * (1.0 - s))
    share = s + is_ball * (s * s * (3.0 - 2.0 * s) - s)
    return emit(share), emit(even + is_ball * (3.0 * even * even - even))


@primitive
def water_on(*values: Any) -> tuple[list[Any], ...]:
    """What water does to a portion in a step: its place, the matrix B (6) and impulse p there, and a moment (3).

    The body is given p - B v at that place, where it moves with v after the step, and the moment.

    Values: the portion (17), rotation (9), place (3), drift (3), height of the base, the body's motion before (6);
    then the water (4), time step, push-out rate, drifting.
    """
    offset, spread, (volume, is_ball), areas = spatial.cut(values, 3, 6, 2, 6)
    rotation, place, drift, (base,), spin, velocity = spatial.cut(values[17:], 9, 3, 3, 1, 3, 3)
    level, weight, carried, half_density, time_step, push_out, drifting = values[39:]
    arm = spatial.turned(rotation, offset)
    at, arm_before = spatial.plus(place, arm), _turned_by(spin, 0.0 - time_step, arm)
    spread_up = spatial.times_triangle(spread, rotation[6:])
    reach = emit(sqrt(spatial.dot(rotation[6:], spread_up)))
    depth = emit(level - base - at[2] - drift[2])
    moving = spatial.plus(velocity, spatial.cross(spin, arm_before))
    share, by_reach = wet_share(depth / reach, is_ball)
    before, _ = wet_share((depth + time_step * moving[2]) / reach, is_ball)
    added = emit(carried * volume)
    speed = sqrt(spatial.dot(moving, moving) + LEAST)
    slowing = emit(time_step * half_density * speed * share)
    matrix = [emit(slowing * x) for x in spatial.turned_inertia(rotation, areas)]
    for i in (0, 2, 5):
        matrix[i] = emit(matrix[i] + added * share)
    kept = emit(added * smaller(share, before))
    lift = emit(time_step * weight * volume)
    impulse = [emit(kept * x) for x in moving]
    impulse[2] = emit(impulse[2] + lift * share)
    if drifting:  # its own velocity is that of the tree less the correction of its drift
        impulse = spatial.plus_times(impulse, spatial.times_triangle(matrix, drift), push_out)
    below = spatial.turned(rotation, spread_up)
    turn = emit(lift * by_reach / reach)
    return at, matrix, impulse, [emit(0.0 - turn * below[1]), emit(turn * below[0]), emit(0.0 * turn)]


@primitive
def water_work(*values: Any) -> Any:
    """Work of the water on a portion in the motion z, see ``laws.work``.

    Values: those of ``water_on`` up to the body's motion before (39), y (6), z (6); then the rest of them.
    """
    given, y, z = spatial.cut(values, 39, 6, 6)
    at, matrix, impulse, moment = water_on(*given, *values[51:])
    moves = spatial.plus(y[3:], spatial.cross(y[:3], at))
    other = spatial.plus(z[3:], spatial.cross(z[:3], at))
    left = spatial.minus_times(impulse, spatial.times_triangle(matrix, moves), 1.0)
    return spatial.dot(other, left) + spatial.dot(z[:3], moment)


@primitive
def _inverse(matrix: Reals) -> list[Any]:
    """Inverse of a symmetric positive definite 3 x 3 matrix, triangles, by cofactors of what its trace makes 1."""
    scale = emit(1.0 / (matrix[0] + matrix[2] + matrix[5]))
    a, b, c, d, e, f = (emit(scale * x) for x in matrix)
    first, second, third = emit(c * f - e * e), emit(d * e - b * f), emit(b * e - c * d)
    factor = emit(scale / (a * first + b * second + d * third))
    cofactors = first, second, emit(a * f - d * d), third, emit(b * d - a * e), emit(a * c - b * b)
    return [emit(factor * x) for x in cofactors]


@primitive
def _wet_at(robots: Block, b: Any) -> Any:
    """First slot of what water knows of a body."""
    return emit(count_of(robots, slots.WET_BODY) + b * slots.WET_BODY_WIDTH)


@primitive
def _motion_slots(robots: Block, b: Any) -> Pieces:
    """Slots for ``own_motion``: mass and inertia, rotation, place, carried."""
    body = body_at(robots, b)
    own = (body + slots.ROTATION, 9), (body + slots.PLACE, 3), (body + slots.CARRIED, 6)
    return ((given_at(robots, b) + slots.MASS, 7), *own)


@primitive
def _portion_slots(robots: Block, e: Any, b: Any) -> Pieces:
    """Slots for ``water_on``: the portion, its body's rotation, place and drift, the base's height, the motion."""
    body, part = body_at(robots, b), count_of(robots, slots.PORTION) + e * slots.PORTION_WIDTH
    pose = (body + slots.ROTATION, 9), (body + slots.PLACE, 3), (body + slots.DRIFT, 3)
    before = _wet_at(robots, b) + slots.MOTION_BEFORE
    return ((part, slots.PORTION_WIDTH), *pose, (slots.POSITION + 2, 1), (before, 6))


@primitive
def _constants(robots: Block) -> tuple[Any, ...]:
    """What laws of water are given beside slots: the water, time step, push-out rate, drifting."""
    water = row(robots, count_of(robots, slots.WATER), slots.WATER_WIDTH)
    return (*water, setting(robots, slots.TIME_STEP), setting(robots, slots.PUSH_OUT), robots.drifting)


@primitive
def water_inertia(robots: Block, b: Any) -> tuple[Any, ...]:
    """What water adds to a body's spatial inertia (21)."""
    return row(robots, _wet_at(robots, b) + slots.WATER_INERTIA, 21)


@ti.func
def immerse(robots: ti.template()):
    """What water adds to each body's spatial inertia, and to its momentum."""
    constants = ti.static(_constants(robots))
    for b in range(robots.plan[slots.BODIES]):
        motion = ti.static(own_motion(*gather(robots, _motion_slots(robots, b)), constants[-1], constants[4]))
        put(robots, _wet_at(robots, b) + slots.MOTION_BEFORE, motion)
        for c in range(slots.WATER_INERTIA, slots.WET_BODY_WIDTH):
            write(robots, _wet_at(robots, b) + c, 0.0 * read(robots, slots.POSITION))
    for e in range(robots.plan[slots.PORTIONS]):
        b = listed_in_plan(robots, slots.PORTION_BODIES, e)
        found = ti.static(water_on(*gather(robots, _portion_slots(robots, e, b)), *constants))
        add(robots, _wet_at(robots, b) + slots.WATER_INERTIA, spatial.at_point(found[0], found[1]))
        turning = ti.static(spatial.plus(spatial.cross(found[0], found[2]), found[3]))
        add(robots, body_at(robots, b) + slots.MOMENTUM, spatial.joined(turning, found[2]))


@ti.func
def undo_immerse(robots: ti.template(), motion: ti.template(), cotangents: ti.template()):
    """Reverse ``immerse`` in the adjoint motion z: cotangents of portions, poses and what bodies carry."""
    constants = ti.static(_constants(robots))
    one = 0.0 * read(robots, slots.POSITION) + 1.0
    for b in range(robots.plan[slots.BODIES]):
        for c in range(slots.WET_BODY_WIDTH):
            write(cotangents, _wet_at(robots, b) + c, 0.0 * one)
    for e in range(robots.plan[slots.PORTIONS]):
        b = listed_in_plan(robots, slots.PORTION_BODIES, e)
        velocity = body_at(robots, b) + slots.VELOCITY
        pieces = ti.static(_portion_slots(robots, e, b) + ((velocity, 6),))
        inputs = ti.static(gather(robots, pieces) + row(motion, velocity, 6))
        to = ti.static(pull_back(water_work, inputs, constants, (one,)))
        scatter(cotangents, pieces, to[:-6])
        add(cotangents, body_at(robots, b) + slots.MOMENTUM, to[-6:])
    for b in range(robots.plan[slots.BODIES]):
        pieces = ti.static(_motion_slots(robots, b))
        seeds = ti.static(row(cotangents, _wet_at(robots, b) + slots.MOTION_BEFORE, 6))
        to = ti.static(pull_back(own_motion, gather(robots, pieces), (constants[-1], constants[4]), seeds))
        scatter(cotangents, pieces, to)
