"""Velocities of an articulated tree: from the leaves to the base and back.

An articulated body's inertia I and momentum p say which impulse f = I v - p it needs to move with v. A hinge with the
spatial vector S adds S u to its parent's velocity. Either its rate u is given (a motor that holds its rate, a stop), or
the impulse along it is; in both cases u = u0 - (U.v) / D with U = I S and 1 / D = 0 where the rate is given, and the
parent sees I - U U^T / D and p - U u0. (Featherstone, Rigid Body Dynamics Algorithms, 2008, chapter 7, for velocities.)
A rotor, a damper and a spring add to D = S.U what they resist each unit of the rate with.
"""

from taichi_sim.autodiff.lanes import any_lane, larger, smaller
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

LARGEST_SLIP = 1e-3  # past a stop, of the hinge's range, in a step
ROUNDINGS = 100.0  # of the size of a row's terms, in tolerances, that rounding leaves of their sum


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


@ti.func
def repeat_rows(robots: ti.template(), touching):
    """Robots that touch nothing have the rows of the first phase in all: whether others of their batch touch or not."""
    for b in range(1, robots.plan[slots.BODIES]):
        if is_hinged(robots, b):
            first = body_at(robots, b) + slots.MODES
            write(robots, first + 1, select(touching > 0.5, read(robots, first + 1), read(robots, first)))
            way = body_at(robots, b) + slots.WAYS
            write(robots, way + 1, select(touching > 0.5, read(robots, way + 1), read(robots, way)))


@ti.func
def row_impulse(robots: ti.template(), body):
    """The impulse of a hinge's drive, stop and friction: what its body needs less what it has, and what else acts."""
    needed = spatial.dot(row(robots, body + slots.COLUMN, 6), row(robots, body + slots.VELOCITY, 6))
    given = spatial.dot(row(robots, body + slots.SCREW, 6), row(robots, body + slots.IMPULSE, 6))
    resisted = read(robots, body + slots.RESISTANCE) * read(robots, body + slots.RATE)
    return needed - given - read(robots, body + slots.CONTACT) - read(robots, body + slots.PUSH) + resisted


@ti.func
def row_tolerances(robots: ti.template(), body):
    """How far the impulse and the rate of a hinge's row may be from their bounds: beyond what rounding leaves of them.

    Of a motor's strength it is a small part, also where that is less than the tolerance, and of a hinge without a motor
    only what rounding leaves. No step passes a stop by more than a thousandth of the range. The studies' solver has one
    tolerance for all.
    """
    tolerance = setting(robots, slots.TOLERANCE)
    contact = read(robots, body + slots.CONTACT)
    of_impulse = 0.0 * contact + tolerance
    of_rate = of_impulse
    if ti.static(not robots.drifting):
        needed = spatial.sum_of_sizes(row(robots, body + slots.COLUMN, 6), row(robots, body + slots.VELOCITY, 6))
        given = spatial.sum_of_sizes(row(robots, body + slots.SCREW, 6), row(robots, body + slots.IMPULSE, 6))
        push = read(robots, body + slots.PUSH)
        resisted = read(robots, body + slots.RESISTANCE) * read(robots, body + slots.RATE)
        beside = larger(push, 0.0 - push) + larger(resisted, 0.0 - resisted)
        size = needed + given + larger(contact, 0.0 - contact) + beside
        strength = read(robots, body + slots.HIGH) - read(robots, body + slots.LOW) + read(robots, body + slots.RUBBING)
        of_impulse = tolerance * (smaller(1.0 + 0.0 * size, ROUNDINGS * strength) + ROUNDINGS * size)
        most = LARGEST_SLIP * (read(robots, body + slots.MOST_RATE) - read(robots, body + slots.LEAST_RATE))
        of_rate = tolerance + smaller(tolerance * ROUNDINGS * size * read(robots, body + slots.INVERSE), most)
    return of_impulse, of_rate


@ti.func
def switch_rows(robots: ti.template(), phase, single, last, active):
    """Hinges' rows whose impulse left its bounds, or whose rate passed the desired one or a stop's, change by a level.

    Returns how many such rows there are. They change all at once or, in robots where ``single`` is 1, the last of them
    only. In the ``last`` rounds, rows whose rate passes a stop are held there, and none is let go.
    """
    wrong = 0.0 * read(robots, 0)
    for back in range(1, robots.plan[slots.BODIES]):
        b = robots.plan[slots.BODIES] - back
        if is_hinged(robots, b):
            body = body_at(robots, b)
            mode, way = read(robots, body + slots.MODES + phase), read(robots, body + slots.WAYS + phase)
            impulse = row_impulse(robots, body)
            loose, slack = row_tolerances(robots, body)
            after, turns = next_mode(robots, body, mode, impulse, loose, slack), way
            if any_lane(read(robots, body + slots.RUBBING) > 0.0):
                rubs = read(robots, body + slots.RUBBING) > 0.0
                mode_then, way_then = next_way(robots, body, mode, way, impulse, loose, slack)
                after, turns = select(rubs, mode_then, after), select(rubs, way_then, way)
            if last > 0:
                held = (mode > 1.5) | (mode < -1.5)
                after, turns = select(held, mode, at_stop(robots, body, mode, slack)), way
            after, turns = select(active > 0.5, after, mode), select(active > 0.5, turns, way)
            changed = (after - mode) * (after - mode) + (turns - way) * (turns - way)
            waits = (single > 0.5) & (wrong > 0.5)
            wrong = wrong + smaller(changed, 1.0 + 0.0 * mode)
            write(robots, body + slots.MODES + phase, select(waits, mode, after))
            write(robots, body + slots.WAYS + phase, select(waits, way, turns))
    return wrong


@ti.func
def at_stop(robots: ti.template(), body, mode, slack):
    """The mode of a row whose rate passes a stop's; else its own."""
    rate = read(robots, body + slots.RATE)
    below = rate < read(robots, body + slots.LEAST_RATE) - slack
    above = rate > read(robots, body + slots.MOST_RATE) + slack
    return select(below, 2.0, select(above, -2.0, mode))


@ti.func
def next_mode(robots: ti.template(), body, mode, impulse, loose, slack):
    """The next mode of the row of a hinge without friction."""
    servo, rate, target = (
        read(robots, body + slots.SERVO),
        read(robots, body + slots.RATE),
        read(robots, body + slots.TARGET),
    )
    by_law, firm = servo >= 0.0, servo < 0.0
    low, high = read(robots, body + slots.LOW), read(robots, body + slots.HIGH)
    ahead, asked = rate - target, target - servo * rate  # of a motor; of a servo
    driven, held = (mode > -0.5) & (mode < 0.5), (mode > 1.5) | (mode < -1.5)
    beyond = select(impulse > high + loose, 1.0, select(impulse < low - loose, -1.0, 0.0 * impulse))
    weaker = (firm & (ahead > slack)) | (by_law & (asked < high - loose))
    stronger = (firm & (ahead < 0.0 - slack)) | (by_law & (asked > low + loose))
    passed = ((mode > 0.5) & weaker) | ((mode < -0.5) & stronger)
    after = select(driven, beyond, select(passed & (low < high), slots.MODE_DRIVEN, mode))
    passive, stop = low >= high, at_stop(robots, body, mode, slack)
    below, above = stop > 1.5, stop < -1.5
    stopped = (((mode > 0.5) | passive) & below) | (((mode < -0.5) | passive) & above)
    stopped = (by_law & (below | above)) | (stopped & ((mode > 0.5) | (mode < -0.5)))
    after = select(stopped, stop, after)
    # What the drive itself gives at a stop, without which the stop would have to pull.
    most, least = select(by_law, smaller(asked, high), high), select(by_law, larger(asked, low), low)
    lifted = ((mode > 1.5) & (impulse < most - loose)) | ((mode < -1.5) & (impulse > least + loose))
    let_go = select(by_law, slots.MODE_DRIVEN, 0.5 * mode)
    return select(held, select(lifted, let_go, mode), after)


@ti.func
def next_way(robots: ti.template(), body, mode, way, impulse, loose, slack):
    """The next mode of the row of a hinge with friction, and which way it turns: 1, -1, or 0 where friction holds it.

    The impulse of drive, friction and stops falls as the rate grows, in levels: at a stop, with the largest impulse, as
    the drive wants it, with the least one, at the other stop; where the rate is 0 friction has one of its own among
    them. A row goes on to the next level.
    """
    servo, rubbing, rate = (
        read(robots, body + slots.SERVO),
        read(robots, body + slots.RUBBING),
        read(robots, body + slots.RATE),
    )
    by_law, target = servo >= 0.0, read(robots, body + slots.TARGET)
    low, high = read(robots, body + slots.LOW), read(robots, body + slots.HIGH)
    one = 0.0 * mode + 1.0
    to_front, to_back = rate > slack, rate < 0.0 - slack
    # At rest a servo gives its law's impulse, a motor that wants to turn all of its own, and one that does not any.
    law = larger(low, smaller(high, target))
    least = select(by_law, law, select(target > slack, high, low))
    most = select(by_law, law, select(target < 0.0 - slack, low, high))
    law_mode = select(target > high, one, select(target < low, 0.0 - one, 0.0 * one))
    front = select(by_law, law_mode, select(target > slack, one, 0.0 - one))  # modes beside the level of the friction
    rear = select(by_law, law_mode, select(target < 0.0 - slack, 0.0 - one, one))
    # Where friction holds it.
    forwards, backwards = impulse < least - rubbing - loose, impulse > most + rubbing + loose
    way_then = select(forwards, one, select(backwards, 0.0 - one, 0.0 * one))
    mode_then = select(forwards, front, select(backwards, rear, mode))
    # Where it turns.
    own = impulse + way * rubbing  # of the drive
    asked = target - servo * rate
    turns = (way > 0.5) | (way < -0.5)
    stops = ((way > 0.5) & to_back & (mode - front < 0.5) & (front - mode < 0.5)) | (
        (way < -0.5) & to_front & (mode - rear < 0.5) & (rear - mode < 0.5)
    )
    beyond = select(own > high + loose, one, select(own < low - loose, 0.0 - one, 0.0 * one))
    weaker = select(by_law, high - loose - asked, rate - target - slack) > 0.0
    stronger = select(by_law, asked - low - loose, target - rate - slack) > 0.0
    passed = (((mode > 0.5) & weaker) | ((mode < -0.5) & stronger)) & (low < high)
    turning = select((mode > -0.5) & (mode < 0.5), beyond, select(passed, slots.MODE_DRIVEN, mode))
    mode_then = select(turns, select(stops, mode, turning), mode_then)
    way_then = select(turns, select(stops, 0.0 * one, way), way_then)
    stop = at_stop(robots, body, mode, slack)
    past = (stop > 1.5) | (stop < -1.5)
    mode_then, way_then = select(past, stop, mode_then), select(past, way, way_then)
    # Where a stop holds it: it lets go of what it would have to pull.
    asked_mode = select(asked > high, one, select(asked < low, 0.0 - one, 0.0 * one))
    up = select(by_law, larger(low, smaller(high, asked)), high)
    up = select(to_front, up - rubbing, select(to_back, up + rubbing, most + rubbing))
    down = select(by_law, larger(low, smaller(high, asked)), low)
    down = select(to_back, down + rubbing, select(to_front, down - rubbing, least - rubbing))
    lifted = ((mode > 1.5) & (impulse < up - loose)) | ((mode < -1.5) & (impulse > down + loose))
    let_go = select(by_law, asked_mode, 0.5 * mode)
    held = (mode > 1.5) | (mode < -1.5)
    after_stop = select(to_front, one, select(to_back, 0.0 - one, 0.0 * one))
    mode_then = select(held, select(lifted, let_go, mode), mode_then)
    return mode_then, select(held, select(lifted, after_stop, way), way_then)
