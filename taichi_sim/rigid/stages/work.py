"""Work of drives: what their torques do in a step, and its derivatives."""

from taichi_sim.autodiff.lanes import larger
from taichi_sim.autodiff.tracing import select
from taichi_sim.rigid import slots
from taichi_sim.rigid.memory import body_at, column, is_hinged, read, write
from taichi_sim.rigid.stages.rows import row_impulse
from taichi_sim.runtime import ti


@ti.func
def friction_way(robots: ti.template(), body, rows):
    """The way that a hinge turns, against which its friction acts: 1 or -1, or 0 where it holds."""
    mode, rate = read(robots, body + slots.MODES + rows), read(robots, body + slots.RATE)
    none = 0.0 * mode
    of_rate = select(rate > 0.0, none + 1.0, select(rate < 0.0, none - 1.0, none))
    return select((mode > 1.5) | (mode < -1.5), of_rate, read(robots, body + slots.WAYS + rows))


@ti.func
def wanted_impulse(robots: ti.template(), body, rows):
    """Impulse of a drive without bounds: of a servo by its law, of a motor that holds its rate what that takes."""
    servo, rate = read(robots, body + slots.SERVO), read(robots, body + slots.RATE)
    held = row_impulse(robots, body) + friction_way(robots, body, rows) * read(robots, body + slots.RUBBING)
    return select(servo >= 0.0, read(robots, body + slots.TARGET) - servo * rate, held)


@ti.func
def drive_level(robots: ti.template(), body, rows):
    """Whether a drive has its largest impulse (1 or -1), or the one that it wants (0).

    Where a hinge is at a stop, the stop has what is beyond the bounds of the drive. Where friction holds it, a motor
    that wants to turn pushes with all that it has, and one that does not brakes.
    """
    mode, wanted = read(robots, body + slots.MODES + rows), wanted_impulse(robots, body, rows)
    none = 0.0 * mode
    at_stop = (mode > 1.5) | (mode < -1.5)
    above, below = wanted > read(robots, body + slots.HIGH), wanted < read(robots, body + slots.LOW)
    of_stop = select(above, none + 1.0, select(below, none - 1.0, none))
    of_drive = select(mode > 0.5, none + 1.0, select(mode < -0.5, none - 1.0, none))
    target, before = read(robots, body + slots.TARGET), read(robots, body + slots.LAST_RATE)
    braking = select(before > 0.0, none - 1.0, none + 1.0)
    of_rest = select(target > 0.0, none + 1.0, select(target < 0.0, none - 1.0, braking))
    of_rest = select(read(robots, body + slots.SERVO) >= 0.0, of_stop, of_rest)
    way = read(robots, body + slots.WAYS + rows)
    return select(at_stop, of_stop, select((way > -0.5) & (way < 0.5), of_rest, of_drive))


@ti.func
def drive_impulse(robots: ti.template(), body, rows, level):
    """Impulse of a drive in a step, without what its hinge's stops, spring, damper and friction have [N m s]."""
    bound = select(level > 0.5, read(robots, body + slots.HIGH), read(robots, body + slots.LOW))
    return select(level * level > 0.5, bound, wanted_impulse(robots, body, rows))


@ti.func
def mean_rate(robots: ti.template(), body):
    """Mean of the rates of a hinge before and after a step: times an impulse, it is what a flywheel gains."""
    return 0.5 * (read(robots, body + slots.LAST_RATE) + read(robots, body + slots.RATE))


@ti.func
def do_work(robots: ti.template(), rows):
    """Add the work that drives do in a step; none is won back from those that are driven."""
    total = read(robots, slots.WORK)
    for b in range(1, robots.plan[slots.BODIES]):
        if is_hinged(robots, b) and column(robots, b, slots.MOTOR) >= 0:
            body = body_at(robots, b)
            work = drive_impulse(robots, body, rows, drive_level(robots, body, rows)) * mean_rate(robots, body)
            total = total + larger(work, 0.0 * work)
    write(robots, slots.WORK, total)


@ti.func
def undo_work(robots: ti.template(), cotangents: ti.template(), rows):
    """Reverse ``do_work``: cotangents of rates after the step.

    Those of the drives' impulses are left where their targets lie, those of rates before the step where ``SERVO`` lies.
    """
    for b in range(1, robots.plan[slots.BODIES]):
        if is_hinged(robots, b) and column(robots, b, slots.MOTOR) >= 0:
            body = body_at(robots, b)
            level, rate = drive_level(robots, body, rows), mean_rate(robots, body)
            impulse = drive_impulse(robots, body, rows, level)
            share = select(impulse * rate > 0.0, read(cotangents, slots.WORK), 0.0 * rate)
            servo = read(robots, body + slots.SERVO)
            by_law = (level * level < 0.5) & (servo >= 0.0)
            write(cotangents, body + slots.TARGET, share * rate)
            write(cotangents, body + slots.SERVO, 0.5 * share * impulse)
            of_rate = share * (0.5 * impulse - select(by_law, servo * rate, 0.0 * rate))
            write(cotangents, body + slots.RATE, read(cotangents, body + slots.RATE) + of_rate)
