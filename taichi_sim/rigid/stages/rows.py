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
            for kind in ti.static((slots.MODES, slots.WAYS)):
                first = body_at(robots, b) + kind
                write(robots, first + 1, select(touching > 0.5, read(robots, first + 1), read(robots, first)))


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
        strength = read(robots, body + slots.HIGH) - read(robots, body + slots.LOW)
        strength = select(strength < slots.NO_STOP, strength, 0.0 * strength)  # of servos without a limit
        strength = strength + read(robots, body + slots.RUBBING)
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
            by_law, rubs = read(robots, body + slots.SERVO) >= 0.0, read(robots, body + slots.RUBBING) > 0.0
            after, turns = next_mode(robots, body, mode, impulse, loose, slack), way
            if any_lane(by_law | rubs):
                mode_then, way_then = next_level(robots, body, mode, way, impulse, loose, slack)
                after, turns = select(by_law | rubs, mode_then, after), select(rubs, way_then, way)
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
    """The next mode of the row of a motor, or of a hinge without a drive, that does not rub."""
    rate, target = read(robots, body + slots.RATE), read(robots, body + slots.TARGET)
    low, high = read(robots, body + slots.LOW), read(robots, body + slots.HIGH)
    ahead = rate - target
    driven, held = (mode > -0.5) & (mode < 0.5), (mode > 1.5) | (mode < -1.5)
    beyond = select(impulse > high + loose, 1.0, select(impulse < low - loose, -1.0, 0.0 * impulse))
    passed = ((mode > 0.5) & (ahead > slack)) | ((mode < -0.5) & (ahead < 0.0 - slack))
    kept = select(passed & (low < high), slots.MODE_DRIVEN, mode)
    passive, stop = low >= high, at_stop(robots, body, mode, slack)
    stopped = (((mode > 0.5) | passive) & (stop > 1.5)) | (((mode < -0.5) | passive) & (stop < -1.5))
    after = select(driven, beyond, select(stopped, stop, kept))
    lifted = ((mode > 1.5) & (impulse < high - loose)) | ((mode < -1.5) & (impulse > low + loose))
    return select(held, select(lifted, 0.5 * mode, mode), after)


@ti.func
def next_level(robots: ti.template(), body, mode, way, impulse, loose, slack):
    """The next mode of the row of a servo, or of a hinge that rubs, and which way that turns: 1, -1, or 0 if held.

    The impulse of drive, friction and stops falls as the rate grows, on levels one after another: that of the lower
    stop, of the largest impulse, of what the drive wants, of the least impulse, of the upper stop; and where the rate
    is 0 that of friction. A row whose solution lies beyond its level goes on to the next one.
    """
    rubs = read(robots, body + slots.RUBBING) > 0.0
    at_rest, held = rubs & (way > -0.5) & (way < 0.5), (mode > 1.5) | (mode < -1.5)
    driven_mode, driven_way = leave_level(robots, body, mode, way, impulse, loose, slack)
    rest_mode, rest_way = leave_rest(robots, body, mode, impulse, loose, slack)
    stop_mode, stop_way = leave_stop(robots, body, mode, way, impulse, loose, slack)
    after = select(held, stop_mode, select(at_rest, rest_mode, driven_mode))
    return after, select(held, stop_way, select(at_rest, rest_way, driven_way))


@ti.func
def leave_level(robots: ti.template(), body, mode, way, impulse, loose, slack):
    """Mode and way after a level of the drive: the first of its ends, a turn round and a stop that the rate passed."""
    servo, rubbing, one = read(robots, body + slots.SERVO), read(robots, body + slots.RUBBING), 0.0 * mode + 1.0
    rate, target = read(robots, body + slots.RATE), read(robots, body + slots.TARGET)
    low, high = read(robots, body + slots.LOW), read(robots, body + slots.HIGH)
    least, most = read(robots, body + slots.LEAST_RATE), read(robots, body + slots.MOST_RATE)
    by_law, firm, absent, rubs = servo >= 0.0, servo < 0.0, low >= high, rubbing > 0.0
    upper, lower, between = mode > 0.5, mode < -0.5, (mode > -0.5) & (mode < 0.5)
    # Bounds of a servo's impulse beyond which the level ends, where the rate is too high and too low.
    weakest, strongest = select(upper, high, low), select(lower, low, high)
    asked = target - servo * rate
    given = select(by_law, asked, impulse + way * rubbing)
    too_fast = select(by_law, weakest - loose - asked, rate - target - slack) > 0.0
    too_slow = select(by_law, asked - strongest - loose, target - rate - slack) > 0.0
    on = ((upper & too_fast) | (between & (given < low - loose))) & (low < high)
    back = ((lower & too_slow) | (between & (given > high + loose))) & (low < high)
    # Whether it comes to rest, or to a stop, before the level ends.
    rest_on = lower | absent | (by_law & (target >= weakest)) | (firm & upper & (target >= 0.0 - slack))
    rest_back = upper | absent | (by_law & (target <= strongest)) | (firm & lower & (target <= slack))
    stop_on = lower | absent | (by_law & (target - servo * most >= weakest))
    stop_back = upper | absent | (by_law & (target - servo * least <= strongest))
    turns = rubs & (((way < -0.5) & (rate > slack) & rest_on) | ((way > 0.5) & (rate < 0.0 - slack) & rest_back))
    above, below = (rate > most + slack) & stop_on, (rate < least - slack) & stop_back
    rest_first_on, rest_first_back = rubs & (way < -0.5) & (most > 0.0), rubs & (way > 0.5) & (least < 0.0)
    after = select(above, select(rest_first_on, mode, 0.0 - 2.0 * one), mode)
    after = select(below, select(rest_first_back, mode, 2.0 * one), after)
    # A level that lies beyond a stop as a whole is left by its end.
    after = select(on & ((after > -1.5) | below), mode - one, after)
    after = select(back & ((after < 1.5) | above), mode + one, after)
    return select(turns, mode, after), select(turns, 0.0 * one, way)


@ti.func
def leave_rest(robots: ti.template(), body, mode, impulse, loose, slack):
    """Mode and way after friction held a hinge, as far as it goes beside what the drive gives at rest."""
    rubbing, one = read(robots, body + slots.RUBBING), 0.0 * mode + 1.0
    least, most = read(robots, body + slots.LEAST_RATE), read(robots, body + slots.MOST_RATE)
    given_on, mode_on = beside(robots, body, 0.0 * one, one, slack)
    given_back, mode_back = beside(robots, body, 0.0 * one, 0.0 - one, slack)
    on, back = impulse < given_on - rubbing - loose, impulse > given_back + rubbing + loose
    after = select(on, mode_on, select(back, mode_back, mode))
    after = select(least > slack, 2.0 * one, select(most < 0.0 - slack, 0.0 - 2.0 * one, after))
    return after, select(on, one, select(back, 0.0 - one, 0.0 * one))


@ti.func
def leave_stop(robots: ti.template(), body, mode, way, impulse, loose, slack):
    """Mode and way after a stop held a hinge, which it does unless it would have to pull."""
    rubbing, one = read(robots, body + slots.RUBBING), 0.0 * mode + 1.0
    least, most = read(robots, body + slots.LEAST_RATE), read(robots, body + slots.MOST_RATE)
    given_on, mode_on = beside(robots, body, least, one, slack)
    given_back, mode_back = beside(robots, body, most, 0.0 - one, slack)
    way_on = select(least < 0.0 - slack, 0.0 - one, one)
    way_back = select(most > slack, one, 0.0 - one)
    on = (mode > 1.5) & (impulse < given_on - way_on * rubbing - loose)
    back = (mode < -1.5) & (impulse > given_back - way_back * rubbing + loose)
    return select(on, mode_on, select(back, mode_back, mode)), select(on, way_on, select(back, way_back, way))


@ti.func
def beside(robots: ti.template(), body, rate, side, slack):
    """Impulse of a drive and mode of its row at a rate; of a motor just above it (``side`` 1) or below it (-1)."""
    servo, target = read(robots, body + slots.SERVO), read(robots, body + slots.TARGET)
    low, high = read(robots, body + slots.LOW), read(robots, body + slots.HIGH)
    asked, one = target - servo * rate, 0.0 * side + 1.0
    # Whether the motor wants more than that: also if it wants the rate itself, where it is just below.
    slower = ((side > 0.0) & (target > rate + slack)) | ((side < 0.0) & (target >= rate - slack))
    given = select(servo >= 0.0, larger(low, smaller(high, asked)), select(slower, high, low))
    law_mode = select(asked > high, one, select(asked < low, 0.0 - one, 0.0 * one))
    return given, select(servo >= 0.0, law_mode, select(slower, one, 0.0 - one))
