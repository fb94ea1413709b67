"""Laws of a step for each body and point, as functions of reals; their derivatives are the step's reverse pass.

The velocities y of a step solve a linear system (contacts, stops and motors' limits as they came out). With z the
solution of the same system for the cotangents of y, the cotangent of anything that the system depends on is the
derivative of ``work`` and ``contact_work``: what the right-hand side less the left does in the motion z, y and z being
kept (the implicit function theorem; the system is symmetric).
"""

from collections.abc import Sequence
from typing import Any

from taichi_sim.autodiff.lanes import larger, smaller
from taichi_sim.autodiff.tracing import primitive, select, sqrt
from taichi_sim.rigid import slots
from taichi_sim.rigid.model.settings import EARTH
from taichi_sim.rigid.stages import spatial
from taichi_sim.runtime import emit

Reals = Sequence[Any]
RETURN = 10.0  # 1/s, of the way from beyond a stop, at most
SLOWEST_SQUARE = 1e-20  # m^2/s^2, keeps the slope of a speed finite


@primitive
def prepared(*values: Any) -> list[Any]:
    """A body's inertia about the common point (6), and its spatial momentum (6) with what a step adds to it.

    That is what gravity and gyroscopic moments add; the latter at the start of the step, explicitly (ODE 0.12).

    Values: mass, inertia at rest (6), rotation (9), place (3), carried (6), drift (3); then time step, gravity
    (3), correction, drifting.
    """
    (mass,), at_rest, rotation, place, angular, linear, drift = spatial.cut(values, 1, 6, 9, 3, 3, 3, 3)
    time_step, *gravity, correction, drifting = values[28:]
    turned = spatial.turned_inertia(rotation, at_rest)
    falling = [time_step * g * mass for g in gravity]
    if drifting:
        spin = spatial.times_triangle(turned, angular)
        gyroscopic = spatial.cross(angular, spin)
        v = spatial.plus_times(linear, drift, correction)
        linear = [mass * x + added for x, added in zip(v, falling, strict=True)]
        angular = spatial.minus_times(spatial.plus(spatial.cross(place, linear), spin), gyroscopic, time_step)
    else:  # carried are momenta
        angular = spatial.plus(angular, spatial.cross(place, falling))
        linear = spatial.plus(linear, falling)
    return [*spatial.moved_inertia(turned, mass, place), *angular, *linear]


@primitive
def work(*values: Any) -> Any:
    """z . (momentum - inertia y) of a body.

    Values: mass, inertia at rest (6), rotation (9), place (3), carried (6), drift (3), y (6), z (6); then time step,
    gravity (3), correction, drifting.
    """
    own, y, z = spatial.cut(values, 28, 6, 6)
    inertia, momentum = spatial.cut(prepared(*own, *values[40:]), 6, 6)
    held = spatial.times(spatial.rigid_matrix(inertia, own[0], own[16:19]), y)
    return spatial.dot(z, spatial.minus_times(momentum, held, 1.0))


@primitive
def contact_work(*values: Any) -> Any:
    """Work of a point's normal impulse and friction in the motion z, plus its target times its multiplier.

    Values: rotation (9), place (3), drift (3), offset (3), radius, height of the base, y (6), z (6), strength of
    friction; then normal impulse, multiplier, push-out rate, drifting, slope of the push-out by the depth.
    """
    rotation, place, drift, offset, (radius, base), y, z = spatial.cut(values, 9, 3, 3, 3, 2, 6, 6)
    strength, impulse, multiplier, push_out, drifting, rise = values[32:]
    at = spatial.plus(place, spatial.turned(rotation, offset))
    depth = radius - base - at[2]  # what drift takes off it, the correction of the drift asks for again
    lowest = [at[0], at[1], at[2] - radius]
    moving = spatial.plus(y[3:], spatial.cross(y[:3], lowest))
    other = spatial.plus(z[3:], spatial.cross(z[:3], lowest))
    wanted = rise * depth
    if drifting:
        moving = [moving[0] - push_out * drift[0], moving[1] - push_out * drift[1], moving[2]]
        wanted = wanted + (push_out - rise) * drift[2]
    normal = impulse * other[2] + multiplier * (wanted - moving[2])
    return normal - strength * (moving[0] * other[0] + moving[1] * other[1])


@primitive
def pushed_out(depth: Any, push_out: Any) -> Any:
    """Speed at which the ground pushes out a point that is so deep in it: at most that of a fall through the depth.

    Where a ball passes an edge its depth jumps by a part of its radius, whatever the time step. Undone in a few steps,
    that would throw it, the higher the shorter they are; so it gets the energy of the ground's height and no more.
    """
    return smaller(push_out * depth, _fallen_through(depth))


@primitive
def push_out_slope(depth: Any, push_out: Any) -> Any:
    """Derivative of :func:`pushed_out` by the depth."""
    fallen = emit(_fallen_through(depth))
    return emit(select(push_out * depth < fallen, push_out + 0.0 * fallen, EARTH / fallen))


@primitive
def _fallen_through(depth: Any) -> Any:
    """Speed after a fall from rest through a depth, on earth; not quite 0 where there is none."""
    return sqrt(2.0 * EARTH * larger(depth, 0.0 * depth) + SLOWEST_SQUARE)


@primitive
def uneven_contact_work(*values: Any) -> Any:
    """:func:`contact_work` of a point on uneven ground: where it is, that is a plane of the normal n.

    Values: rotation (9), place (3), drift (3), offset (3), radius, place of the base (3), y (6), z (6), strength
    of friction; then normal impulse, multiplier, push-out rate, drifting, slope of the push-out by the depth, n (3).
    """
    rotation, place, drift, offset, (radius,), base, y, z = spatial.cut(values, 9, 3, 3, 3, 1, 3, 6, 6)
    strength, impulse, multiplier, push_out, drifting, rise, *normal = values[34:]
    axes = spatial.tangents(normal)
    at = spatial.plus(place, spatial.turned(rotation, offset))
    depth = radius - spatial.dot(spatial.plus(base, at), normal)  # but for the height of the plane, a constant
    lowest = [x - radius * n for x, n in zip(at, normal, strict=True)]
    moving = spatial.plus(y[3:], spatial.cross(y[:3], lowest))
    other = spatial.plus(z[3:], spatial.cross(z[:3], lowest))
    sliding = spatial.minus_times(moving, drift, push_out) if drifting else moving
    wanted = rise * depth
    if drifting:
        wanted = wanted + (push_out - rise) * spatial.dot(drift, normal)
    pushed = impulse * spatial.dot(other, normal) + multiplier * (wanted - spatial.dot(moving, normal))
    return pushed - strength * spatial.dot(spatial.along(axes, sliding), spatial.along(axes, other))


@primitive
def hinged_place(*values: Any) -> tuple[Any, ...]:
    """Rotation (9), place (3) and screw (6) of a hinged body.

    Values: the parent's rotation (9) and place (3), anchor (3), centre (3), sine, cosine, axis (3).
    """
    of_parent, at_parent, anchor, centre, (sine, cosine), axis = spatial.cut(values, 9, 3, 3, 3, 2, 3)
    turned_axis = spatial.turned(of_parent, axis)
    at = spatial.plus(at_parent, spatial.turned(of_parent, anchor))
    rotation = spatial.product(spatial.about_axis(turned_axis, sine, cosine), of_parent)
    place = spatial.plus(at, spatial.turned(rotation, centre))
    return (*rotation, *place, *turned_axis, *spatial.cross(at, turned_axis))


@primitive
def welded_place(*values: Any) -> tuple[Any, ...]:
    """Place (3) of a body that is fixed to its parent: of the parent's rotation (9), place (3), anchor, centre (3)."""
    of_parent, at_parent, anchor, centre = spatial.cut(values, 9, 3, 3, 3)
    return tuple(spatial.plus(at_parent, spatial.turned(of_parent, spatial.plus(anchor, centre))))


@primitive
def carried_on(*values: Any) -> tuple[Any, ...]:
    """Motion that a body carries into the next step (6), and its place there (3).

    Values: mass, inertia at rest (6), rotation (9), place (3), drift (3), own place (3), velocity (6); then time step,
    correction, drifting.
    """
    (mass,), at_rest, rotation, place, drift, own, velocity = spatial.cut(values, 1, 6, 9, 3, 3, 3, 6)
    time_step, correction, drifting = values[31:]
    if not drifting:  # see ``moment_shift``
        inertia = spatial.moved_inertia(spatial.turned_inertia(rotation, at_rest), mass, place)
        return (*spatial.times(spatial.rigid_matrix(inertia, mass, place), velocity), *own)
    linear = spatial.plus(velocity[3:], spatial.cross(velocity[:3], place))
    linear = spatial.minus_times(linear, drift, correction)
    return (*velocity[:3], *linear, *spatial.plus_times(own, linear, time_step))


@primitive
def moment_shift(*values: Any) -> tuple[Any, ...]:
    """Difference between a body's moment of momentum about the common point and the one that it carries between steps.

    It carries that of its motion relative to the robot's centre of mass, about it. So their sum is the robot's about
    its centre of mass, which is conserved, and the speed of the whole is of no consequence to what its bodies do.

    Values: mass, place (3), momentum (3); centre of mass (3), its velocity (3).
    """
    (mass,), place, linear, centre, going = spatial.cut(values, 1, 3, 3, 3, 3)
    arm = spatial.minus_times(place, centre, 1.0)
    whole = [mass * x for x in going]
    return tuple(spatial.plus(spatial.cross(centre, linear), spatial.cross(arm, whole)))


@primitive
def moved_base(*values: Any) -> tuple[Any, ...]:
    """Place (3) and orientation (4) of the base after a step; of these before, its velocity (6); then the time step."""
    position, q, velocity = spatial.cut(values, 3, 4, 6)
    time_step = values[13]
    w = velocity[:3]
    turn = [
        0.0 - (w[0] * q[1] + w[1] * q[2] + w[2] * q[3]),
        w[0] * q[0] + w[1] * q[3] - w[2] * q[2],
        w[1] * q[0] + w[2] * q[1] - w[0] * q[3],
        w[2] * q[0] + w[0] * q[2] - w[1] * q[1],
    ]
    moved = spatial.plus_times(q, turn, 0.5 * time_step)
    shrink = 1.0 / spatial.length(moved)
    return (*spatial.plus_times(position, velocity[3:], time_step), *(x * shrink for x in moved))


@primitive
def hinge_row(*values: Any) -> tuple[Any, ...]:
    """A hinge's row: what its drive wants, what pushes beside it, bounds of impulse and rate, what resists the rate.

    A motor holds its rate as far as its torque goes; a servo has the torque that its law gives, as far as that goes.
    Stops keep the rate within what leads no farther than to them, with whatever impulse that takes; from beyond a stop
    they lead back. In the studies' solver stops act only once they are passed: the row is then the stop's, and the
    drive pushes with all its torque the way it wants to go, whatever rate that gives (ODE's rule for a powered joint at
    its stop).

    A rotor resists a change of the rate, a damper and a spring resist the rate and pull. A quarter of what a spring
    gains in a step counts as inertia: it then swings as by the trapezoidal rule, without loss and stable however stiff
    it is (Newmark, 1959, beta = 1/4). So do servos. Friction, the last value, takes as large an impulse against the
    rate, and holds the hinge as far as that goes.

    Values: angle, rate before; torque, by_command, by_angle and offset of the drive; stops; its fastest rate; inertia
    of the rotor, damping, stiffness and angle at rest of the spring; the drive's by_rate; friction; command; then time
    step, correction, drifting.
    """
    angle, rate, torque, by_command, by_angle, offset, lower, upper, fastest = values[:9]
    rotor, damping, stiffness, spring_rest, by_rate, friction, command, time_step, correction, drifting = values[9:]
    rubbing = time_step * friction
    inertia = rotor + 0.25 * time_step * time_step * stiffness
    resistance = inertia + time_step * damping
    passive = inertia * rate - time_step * stiffness * (angle - spring_rest)
    asked = by_command * command + by_angle * angle + offset
    wanted = select(asked > fastest, fastest, select(asked < 0.0 - fastest, 0.0 - fastest, asked))
    strength = time_step * torque
    none = 0.0 * strength
    firm = by_rate < none
    gained = 0.25 * time_step * time_step * (none - by_angle)
    pull = time_step * asked + gained * rate
    servo = select(firm, none - 1.0, gained + time_step * by_rate)
    at_lower, at_upper = angle <= lower, angle >= upper
    if not drifting:
        at_once, back = 1.0 / time_step, smaller(none + correction, none + RETURN)
        least = select(at_lower, back, at_once) * (lower - angle)
        most = select(at_upper, back, at_once) * (upper - angle)
        target = select(firm, select(wanted < least, least, select(wanted > most, most, wanted)), pull)
        return target, none + passive, 0.0 - strength, strength, least, most, resistance, servo, rubbing
    stopped = at_lower | at_upper
    upwards = (wanted > 0.0) | ((wanted >= 0.0) & at_upper)
    target = select(stopped, correction * (select(at_lower, lower, upper) - angle), select(firm, wanted, pull))
    given = select(pull > strength, strength, select(pull < 0.0 - strength, 0.0 - strength, pull))
    push = select(stopped, select(firm, select(upwards, strength, 0.0 - strength), given), none)
    low = select(stopped, select(at_lower, none, none - slots.NO_STOP), 0.0 - strength)
    high = select(stopped, select(at_lower, none + slots.NO_STOP, none), strength)
    servo = select(stopped, none - 1.0, servo)
    return target, push + passive, low, high, none - slots.NO_STOP, none + slots.NO_STOP, resistance, servo, rubbing


@primitive
def light_reading(*values: Any) -> Any:
    """Reading of a light sensor: of the base's place, its body's rotation (9) and place (3), offset; then the light."""
    base, rotation, place, offset, light = spatial.cut(values, 3, 9, 3, 3, 3)
    at = spatial.plus(spatial.plus(base, place), spatial.turned(rotation, offset))
    away = spatial.minus_times(light, at, 1.0)
    return 1.0 / spatial.dot(away, away)
