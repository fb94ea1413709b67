"""Work of drives: what their torques do in a step, and its derivatives."""

from taichi_sim.autodiff.lanes import larger
from taichi_sim.autodiff.tracing import select
from taichi_sim.rigid import slots
from taichi_sim.rigid.memory import body_at, column, is_hinged, read, write
from taichi_sim.rigid.stages.rows import row_impulse
from taichi_sim.runtime import ti


@ti.func
def drive_level(robots: ti.template(), body, rows):
    """Whether a drive has its largest impulse (1 or -1), or less than that (0), which then follows from its row.

    At a stop a servo has what its law says. A motor that wants to turn past a stop pushes there with all its torque.
    """
    mode, none = read(robots, body + slots.MODES + rows), 0.0 * read(robots, body + slots.RATE)
    servo, target = read(robots, body + slots.SERVO), read(robots, body + slots.TARGET)
    law = target - servo * read(robots, body + slots.RATE)
    above, below = law > read(robots, body + slots.HIGH), law < read(robots, body + slots.LOW)
    by_law = select(above, none + 1.0, select(below, none - 1.0, none))
    level = select(mode > 0.5, none + 1.0, select(mode < -0.5, none - 1.0, none))
    at_stop, at_bound = (mode > 1.5) | (mode < -1.5), (level * level > 0.5) & (mode * mode < 2.0)
    past = select(target <= read(robots, body + slots.LEAST_RATE), none - 1.0, level)
    past = select(target >= read(robots, body + slots.MOST_RATE), none + 1.0, past)
    return select(servo >= 0.0, select(at_stop, by_law, level), select(at_bound, level, past))


@ti.func
def drive_impulse(robots: ti.template(), body, rows, level):
    """Impulse of a drive in a step, without what its hinge's stops, spring, damper and friction have [N m s]."""
    servo, rate = read(robots, body + slots.SERVO), read(robots, body + slots.RATE)
    law = read(robots, body + slots.TARGET) - servo * rate
    held = row_impulse(robots, body) + read(robots, body + slots.WAYS + rows) * read(robots, body + slots.RUBBING)
    bound = select(level > 0.5, read(robots, body + slots.HIGH), read(robots, body + slots.LOW))
    return select(level * level > 0.5, bound, select(servo >= 0.0, law, held))


@ti.func
def do_work(robots: ti.template(), rows):
    """Add the work that drives do in a step; none is won back from those that are driven."""
    total = read(robots, slots.WORK)
    for b in range(1, robots.plan[slots.BODIES]):
        if is_hinged(robots, b) and column(robots, b, slots.MOTOR) >= 0:
            body = body_at(robots, b)
            work = drive_impulse(robots, body, rows, drive_level(robots, body, rows)) * read(robots, body + slots.RATE)
            total = total + larger(work, 0.0 * work)
    write(robots, slots.WORK, total)


@ti.func
def undo_work(robots: ti.template(), cotangents: ti.template(), rows):
    """Reverse ``do_work``: cotangents of rates; those of the drives' impulses are left where their targets lie."""
    for b in range(1, robots.plan[slots.BODIES]):
        if is_hinged(robots, b) and column(robots, b, slots.MOTOR) >= 0:
            body = body_at(robots, b)
            level, rate = drive_level(robots, body, rows), read(robots, body + slots.RATE)
            impulse = drive_impulse(robots, body, rows, level)
            share = select(impulse * rate > 0.0, read(cotangents, slots.WORK), 0.0 * rate)
            servo = read(robots, body + slots.SERVO)
            by_law = (level * level < 0.5) & (servo >= 0.0)
            write(cotangents, body + slots.TARGET, share * rate)
            of_rate = share * (impulse - select(by_law, servo * rate, 0.0 * rate))
            write(cotangents, body + slots.RATE, read(cotangents, body + slots.RATE) + of_rate)
