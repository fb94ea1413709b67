"""Rows of hinges: which drives have what they want, which are at bounds or stops, and which friction holds.

A row's rate is given, or its impulse is; which of them, its mode says. Rows whose solution leaves what its mode allows
go on to the next mode, until none does.
"""

from taichi_sim.autodiff.lanes import any_lane, larger, smaller
from taichi_sim.autodiff.tracing import select
from taichi_sim.rigid import slots
from taichi_sim.rigid.memory import body_at, is_hinged, read, row, setting, write
from taichi_sim.rigid.stages import spatial
from taichi_sim.runtime import ti

LARGEST_SLIP = 1e-3  # past a stop, of the hinge's range, in a step
ROUNDINGS = 100.0  # of the size of a row's terms, in tolerances, that rounding leaves of their sum


@ti.func
def keep_way(robots: ti.template(), body, phase):
    """Keep the way in which a hinge with friction turned, unless its drive wants otherwise; others turn freely."""
    mode, way = read(robots, body + slots.MODES + phase), read(robots, body + slots.WAYS + phase)
    servo, target, none = read(robots, body + slots.SERVO), read(robots, body + slots.TARGET), 0.0 * way
    low, high = read(robots, body + slots.LOW), read(robots, body + slots.HIGH)
    ahead = select(servo >= 0.0, larger(target - high, none) + smaller(target - low, none), target)
    front, rear = (ahead > 0.0) & (way < -0.5) & (mode < 0.5), (ahead < 0.0) & (way > 0.5) & (mode > -0.5)
    neither = (ahead >= 0.0) & (ahead <= 0.0) & (mode * way > select(servo >= 0.0, none + 0.5, none - 0.5))
    kept = select(front | rear | neither, none, way)
    write(robots, body + slots.WAYS + phase, select(read(robots, body + slots.RUBBING) > 0.0, kept, none + 1.0))


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
