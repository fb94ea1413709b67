"""The reverse pass of a step, stage by stage.

Three memories of the same layout: that of ``robots`` as the step left it, ``motion`` for the adjoint motion z, and
``cotangents``. Those of the state after the step lie in the slots of the state, and become those of the state before.
"""

from typing import Any

from taichi_sim.autodiff import rotations
from taichi_sim.autodiff.elementary import sine_cosine
from taichi_sim.autodiff.tracing import primitive, pull_back, select
from taichi_sim.rigid import slots
from taichi_sim.rigid.memory import (
    Block,
    add,
    assign,
    body_at,
    column,
    gather,
    given_at,
    gravity_of,
    is_hinged,
    listed_at,
    listed_point,
    parent_at,
    put,
    read,
    row,
    scatter,
    setting,
    variables,
    write,
)
from taichi_sim.rigid.stages import laws, sand, spatial
from taichi_sim.rigid.stages.arguments import (
    body_slots,
    carrier_slots,
    contact_slots,
    eye_slots,
    hinge_slots,
    moving_slots,
    shifted_slots,
)
from taichi_sim.rigid.stages.articulated import assemble, collect, solve_base, spread
from taichi_sim.rigid.stages.contact import apply_normals, fill_matrix, reduce_points, solve_members
from taichi_sim.rigid.stages.control import commanded
from taichi_sim.rigid.stages.motion import common_motion
from taichi_sim.rigid.stages.rows import row_impulse
from taichi_sim.rigid.stages.spatial import Reals
from taichi_sim.rigid.stages.water import undo_immerse
from taichi_sim.rigid.stages.work import drive_level, friction_way, undo_work
from taichi_sim.runtime import ti

# Pieces of ``body_slots``, ``moving_slots`` and ``hinge_slots`` whose cotangents become those before the step.
CARRIED, OWN, LAST_RATE = 3, 4, 1


@primitive
def add_one(cotangents: Block, slot: Any, value: Any) -> None:
    """Add to a slot."""
    write(cotangents, slot, read(cotangents, slot) + value)


@ti.func
def clear_work(cotangents: ti.template()):
    """Forget cotangents of what is no state: they are a step's own."""
    zero = 0.0 * read(cotangents, slots.POSITION)
    for b in range(cotangents.plan[slots.BODIES]):
        for c in range(slots.STATE_WIDTH, slots.BODY_WIDTH):
            write(cotangents, body_at(cotangents, b) + c, zero)
    for c in range(cotangents.plan[slots.SENSORS]):
        write(cotangents, cotangents.plan[slots.READING] + c, zero)


@ti.func
def undo_shift_moments(robots: ti.template(), carrying: ti.template(), cotangents: ti.template(), sign):
    """Reverse ``motion.shift_moments``; momenta are those in the memory of ``carrying``."""
    motion = ti.static(common_motion(robots, carrying))
    share = motion[6]
    of_motion = ti.static(variables(6, 0.0 * share))
    for b in range(robots.plan[slots.BODIES]):
        body, given = body_at(robots, b), given_at(robots, b)
        own = ti.static(row(robots, given + slots.MASS, 1) + row(robots, body + slots.PLACE, 3))
        inputs = ti.static(spatial.joined(own, row(carrying, body + slots.CARRIED + 3, 3), motion[:6]))
        seeds = ti.static([sign * s for s in row(cotangents, body + slots.CARRIED, 3)])
        to = ti.static(pull_back(laws.moment_shift, inputs, (), seeds))
        scatter(cotangents, shifted_slots(robots, b), to[:7])
        assign(of_motion, spatial.plus(of_motion, to[7:]))
    of_centre, of_going = ti.static([s * share for s in of_motion[:3]]), ti.static([s * share for s in of_motion[3:]])
    for b in range(robots.plan[slots.BODIES]):
        body, given = body_at(robots, b), given_at(robots, b)
        mass = read(robots, given + slots.MASS)
        arm = ti.static(spatial.minus_times(row(robots, body + slots.PLACE, 3), motion[:3], 1.0))
        of_mass = spatial.dot(of_centre, arm) - spatial.dot(of_going, motion[3:6])
        add_one(cotangents, given + slots.MASS, of_mass)
        add(cotangents, body + slots.PLACE, [mass * s for s in of_centre])
        add(cotangents, body + slots.CARRIED + 3, of_going)


@ti.func
def undo_move(robots: ti.template(), motion: ti.template(), cotangents: ti.template()):
    """Reverse ``move_bodies``: cotangents of velocities, hinges' rates and the state before the step."""
    h, push_out = setting(robots, slots.TIME_STEP), setting(robots, slots.PUSH_OUT)
    if ti.static(not robots.drifting):
        for b in range(robots.plan[slots.BODIES]):  # momenta after the step
            before = ti.static(gather(robots, moving_slots(robots, b)))
            moved = ti.static(laws.carried_on(*before, h, push_out, robots.drifting))
            put(motion, body_at(robots, b) + slots.CARRIED, moved[:6])
        undo_shift_moments(robots, motion, cotangents, -1.0)
    root = body_at(robots, 0)
    base = ti.static(row(robots, slots.POSITION, 7) + row(robots, root + slots.VELOCITY, 6))
    to_base = ti.static(pull_back(laws.moved_base, base, (h,), row(cotangents, slots.POSITION, 7)))
    put(cotangents, slots.POSITION, to_base[:7])
    add(cotangents, root + slots.VELOCITY, to_base[7:])
    for b in range(robots.plan[slots.BODIES]):
        body = body_at(robots, b)
        pieces = ti.static(moving_slots(robots, b))
        after = ti.static(row(cotangents, body + slots.CARRIED, 6) + row(cotangents, body + slots.OWN, 3))
        constants = ti.static((h, push_out, robots.drifting))
        to_body = ti.static(pull_back(laws.carried_on, gather(robots, pieces), constants, after))
        scatter(cotangents, pieces, to_body, (OWN,))
        if is_hinged(robots, b):
            of_rate = h * read(cotangents, body + slots.ANGLE) + read(cotangents, body + slots.LAST_RATE)
            add_one(cotangents, body + slots.RATE, of_rate)


@ti.func
def prepare_adjoint(robots: ti.template(), motion: ti.template(), cotangents: ti.template(), rows):
    """The adjoint system: the step's own, for cotangents instead of momenta.

    Its rates are zero where the step's are given. Where that is for a motor, whose impulse is then a result of the
    step, they are minus the cotangent of that impulse: the row of the solution's derivative by it.
    """
    for slot in range(robots.plan[slots.READING]):
        write(motion, slot, read(robots, slot))
    zero = 0.0 * read(robots, slots.POSITION)
    for b in range(robots.plan[slots.BODIES]):
        body = body_at(robots, b)
        put(motion, body + slots.MOMENTUM, row(cotangents, body + slots.VELOCITY, 6))
        put(motion, body + slots.DRIFT, (zero, zero, zero))
        write(motion, body + slots.PUSH, read(cotangents, body + slots.RATE))
        spent, level = read(cotangents, body + slots.TARGET), drive_level(robots, body, rows)
        holds = (level * level < 0.5) & (read(robots, body + slots.SERVO) < 0.0)
        given = select(holds, zero - spent, zero)
        put(motion, body + slots.TARGET, (given,))
        put(motion, body + slots.LOW, (zero, zero))
        put(motion, body + slots.LEAST_RATE, (given, given))
        write(motion, body + slots.RUBBING, zero)
    if ti.static(motion.granular):
        sand.forget_limits(motion)


@ti.func
def solve_adjoint(robots: ti.template(), motion: ti.template(), cotangents: ti.template(), count, rows):
    """The motion z: the step's linear system for the cotangents of its solution, with the same contacts and limits."""
    prepare_adjoint(robots, motion, cotangents, rows)
    assemble(motion, count, rows, 0.0)
    collect(motion, rows)
    solve_base(motion)
    if count > 0:
        reduce_points(motion, count, 0.0)
        fill_matrix(motion, count)
        solve_members(motion, count, rows)
        apply_normals(motion, count, rows)
    spread(motion)


@primitive
def contact_slopes(robots: Block, n: Any, inputs: Reals, constants: Reals, one: Any) -> tuple[Any, ...]:
    """Derivatives of the work of a point that touches the ground, by ``inputs``."""
    point = listed_at(robots, n)
    rise = laws.push_out_slope(read(robots, point + slots.DEEP), setting(robots, slots.PUSH_OUT))
    if robots.ground is None:
        return pull_back(laws.contact_work, inputs, (*constants, rise), (one,))
    constants = (*constants, rise, *row(robots, point + slots.NORMAL, 3))
    if robots.granular:
        return pull_back(sand.sand_work, inputs, (*constants, *sand.constants_of(robots, n)), (one,))
    return pull_back(laws.uneven_contact_work, inputs, constants, (one,))


@ti.func
def undo_solve(robots: ti.template(), motion: ti.template(), cotangents: ti.template(), count, rows):
    """Reverse the solution: cotangents of bodies' places, what they carry, and hinges' wanted rates."""
    h, push_out = setting(robots, slots.TIME_STEP), setting(robots, slots.PUSH_OUT)
    gravity = ti.static(gravity_of(robots))
    one = 0.0 * read(robots, slots.POSITION) + 1.0
    for b in range(robots.plan[slots.BODIES]):
        body = body_at(robots, b)
        pieces = ti.static(body_slots(robots, b) + ((body + slots.VELOCITY, 6),))
        inputs = ti.static(gather(robots, pieces) + row(motion, body + slots.VELOCITY, 6))
        constants = ti.static((h,) + gravity + (push_out, robots.drifting))
        to = ti.static(pull_back(laws.work, inputs, constants, (one,)))
        scatter(cotangents, pieces, to[:34], (CARRIED,))  # velocities: those of y and z as functions of the screws
        put(cotangents, body + slots.MOMENTUM, to[34:])
    for n in range(count):
        i, b, point = listed_point(robots, n)
        body = body_at(robots, b)
        pieces = ti.static(contact_slots(robots, b, i))
        multiplier = 0.0 - read(motion, point + slots.IMPULSES + rows)
        strength = one * 0.0
        if rows > 0:
            strength = read(robots, point + slots.RUBS)
        impulse = read(robots, point + slots.IMPULSES + rows)
        inputs = ti.static(gather(robots, pieces) + row(motion, body + slots.VELOCITY, 6) + (strength,))
        constants = ti.static((impulse, multiplier, push_out, robots.drifting))
        to = ti.static(contact_slopes(robots, n, inputs, constants, one))
        scatter(cotangents, pieces, to[:-7])
        add(cotangents, body + slots.MOMENTUM, to[-7:-1])
        add_one(cotangents, slots.SLIP_STRENGTH, select(strength > 0.0, to[-1], 0.0 * one))
    if ti.static(robots.wet):
        undo_immerse(robots, motion, cotangents)
    for back in range(1, robots.plan[slots.BODIES]):
        b = robots.plan[slots.BODIES] - back
        body, parent = body_at(robots, b), parent_at(robots, b)
        of_y = ti.static(row(cotangents, body + slots.VELOCITY, 6))
        of_z = ti.static(row(cotangents, body + slots.MOMENTUM, 6))
        if is_hinged(robots, b):
            screw = ti.static(row(cotangents, body + slots.SCREW, 6))
            of_rate = ti.static(spatial.plus_times(screw, of_y, read(robots, body + slots.RATE)))
            put(cotangents, body + slots.SCREW, spatial.plus_times(of_rate, of_z, read(motion, body + slots.RATE)))
        add(cotangents, parent + slots.VELOCITY, of_y)
        add(cotangents, parent + slots.MOMENTUM, of_z)


@ti.func
def undo_command(robots: ti.template(), motion: ti.template(), cotangents: ti.template(), rows):
    """Reverse ``command_hinges``: cotangents of angles, rates before the step, neurons, motors and stops.

    Those that ``undo_work`` left, of impulses in ``TARGET`` and of rates before the step in ``SERVO``, are added.
    """
    h, push_out = setting(robots, slots.TIME_STEP), setting(robots, slots.PUSH_OUT)
    for b in range(1, robots.plan[slots.BODIES]):
        if is_hinged(robots, b):
            body, motor = body_at(robots, b), column(robots, b, slots.MOTOR)
            mode, rate = read(robots, body + slots.MODES + rows), read(motion, body + slots.RATE)
            none = 0.0 * mode
            way = read(robots, body + slots.WAYS + rows)
            turns = (way > 0.5) | (way < -0.5)
            driven, by_law = (mode > -0.5) & (mode < 0.5) & turns, read(robots, body + slots.SERVO) >= 0.0
            of_rate = 0.0 - row_impulse(motion, body)
            of_target = select(driven, select(by_law, rate, of_rate), none)
            of_least, of_most = select(mode > 1.5, of_rate, none), select(mode < -1.5, of_rate, none)
            by_low = select((mode < -0.5) & (mode > -1.5), rate, none)
            by_high = select((mode > 0.5) & (mode < 1.5), rate, none)
            resisted = 0.0 - rate * read(robots, body + slots.RATE)
            of_servo = select(driven & by_law, resisted, none)
            spent, level = read(cotangents, body + slots.TARGET), drive_level(robots, body, rows)
            of_rubbing = 0.0 - friction_way(robots, body, rows) * rate
            within = by_law & (level * level < 0.5)
            of_target = of_target + select(within, spent, none)
            of_servo = of_servo - select(within, spent * read(robots, body + slots.RATE), none)
            by_low, by_high = by_low + select(level < -0.5, spent, none), by_high + select(level > 0.5, spent, none)
            of_stops = ti.static((of_least, of_most))
            seeds = ti.static((of_target, rate, by_low, by_high) + of_stops + (resisted, of_servo, of_rubbing))
            pieces = ti.static(hinge_slots(robots, b))
            inputs = ti.static(gather(robots, pieces) + (commanded(robots, b),))
            to = ti.static(pull_back(laws.hinge_row, inputs, (h, push_out, robots.drifting), seeds))
            scatter(cotangents, pieces, to[:15], (LAST_RATE,))
            add_one(cotangents, body + slots.LAST_RATE, read(cotangents, body + slots.SERVO))
            if motor >= 0:
                add_one(cotangents, robots.plan[slots.NEURON] + motor, to[15])


@ti.func
def reverse_response(robots: ti.template(), motion: ti.template(), cotangents: ti.template(), count):
    """Reverse ``step.respond`` and ``motion.move_bodies``."""
    rows = ti.min(count, 1)
    undo_move(robots, motion, cotangents)
    if ti.static(not robots.drifting):
        undo_work(robots, cotangents, rows)
    solve_adjoint(robots, motion, cotangents, count, rows)
    undo_solve(robots, motion, cotangents, count, rows)
    if ti.static(not robots.drifting):
        undo_shift_moments(robots, robots, cotangents, 1.0)
    undo_command(robots, motion, cotangents, rows)


@ti.func
def undo_think(robots: ti.template(), cotangents: ti.template(), step):
    """Reverse ``think``: cotangents of neurons before the step, weights, commands and sensors."""
    memory, gain = setting(robots, slots.MEMORY), setting(robots, slots.GAIN)
    motors = robots.plan[slots.MOTORS]
    for j in range(motors):
        slot = robots.plan[slots.NEURON] + j
        value, cotangent = read(robots, slot), read(cotangents, slot)
        if robots.plan[slots.COMMANDS] > 0:
            at = ti.min(step // robots.plan[slots.HOLD], robots.plan[slots.COMMANDS] - 1)
            add_one(cotangents, robots.plan[slots.COMMAND] + at * motors + j, cotangent)
            write(cotangents, slot, 0.0 * cotangent)
        else:
            inner = (1.0 - value * value) * cotangent
            write(cotangents, slot, memory * inner)
            for s in range(robots.plan[slots.SENSORS]):
                weight, reading = robots.plan[slots.WEIGHT] + s * motors + j, robots.plan[slots.READING] + s
                add_one(cotangents, weight, gain * inner * read(robots, reading))
                add_one(cotangents, reading, gain * inner * read(robots, weight))


@ti.func
def undo_sense(robots: ti.template(), cotangents: ti.template()):
    """Reverse ``sense_light``: cotangents of the places of light sensors."""
    for s in range(robots.plan[slots.LIGHTS]):
        pieces = ti.static(eye_slots(robots, s))
        seed = read(cotangents, robots.plan[slots.READING] + robots.plan[slots.TOUCHES] + s)
        to = ti.static(pull_back(laws.light_reading, gather(robots, pieces), (), (seed,)))
        scatter(cotangents, pieces, to)


@ti.func
def undo_place(robots: ti.template(), cotangents: ti.template()):
    """Reverse ``place_bodies``, leaves first: cotangents of the base's pose, the angles and the axes."""
    for back in range(1, robots.plan[slots.BODIES]):
        b = robots.plan[slots.BODIES] - back
        body = body_at(robots, b)
        pieces = ti.static(carrier_slots(robots, b))
        if ti.static(robots.drifting):
            of_drift = ti.static(row(cotangents, body + slots.DRIFT, 3))
            back_again = ti.static([0.0 - x for x in of_drift])
            add(cotangents, body + slots.OWN, of_drift)
            add(cotangents, slots.POSITION, back_again)
            add(cotangents, body + slots.PLACE, back_again)
        before = ti.static(gather(robots, pieces))
        if is_hinged(robots, b):
            sine, cosine = sine_cosine(read(robots, body + slots.ANGLE))
            axis = given_at(robots, b) + slots.AXIS
            inputs = ti.static(before + (sine, cosine) + row(robots, axis, 3))
            seeds = ti.static(row(cotangents, body + slots.ROTATION, 18))
            to = ti.static(pull_back(laws.hinged_place, inputs, (), seeds))
            scatter(cotangents, pieces, to[:18])
            add(cotangents, axis, to[20:])
            add_one(cotangents, body + slots.ANGLE, to[18] * cosine - to[19] * sine)
        else:
            of_place = ti.static(row(cotangents, body + slots.PLACE, 3))
            to = ti.static(pull_back(laws.welded_place, before, (), of_place))
            scatter(cotangents, pieces, to)
            add(cotangents, parent_at(robots, b) + slots.ROTATION, row(cotangents, body + slots.ROTATION, 9))
    q = ti.static(row(robots, slots.ORIENTATION, 4))
    seeds = ti.static(row(cotangents, body_at(robots, 0) + slots.ROTATION, 9))
    to = ti.static(pull_back(rotations.matrix, q, (), seeds))
    add(cotangents, slots.ORIENTATION, to)
