"""The reverse pass of a step, stage by stage.

Three memories of the same layout: m as the step left it, a for the adjoint motion z, g for cotangents. Those of the
state after the step lie in g's slots of the state, and become those of the state before it.
"""

from taichi_sim.autodiff import rotations
from taichi_sim.autodiff.elementary import sine_cosine
from taichi_sim.autodiff.lanes import accumulate, load, store
from taichi_sim.autodiff.tracing import pull_back, select
from taichi_sim.rigid.memory import (
    ANCHOR,
    ANGLE,
    AXIS,
    BODIES,
    BODY_COLUMNS,
    BODY_WIDTH,
    BY_ANGLE,
    BY_COMMAND,
    CARRIED,
    CENTRE,
    COMMAND,
    COMMANDS,
    DRIFT,
    HIGH,
    HINGED,
    HOLD,
    IMPULSES,
    LIGHT,
    LIGHT_PARAMETER,
    LIGHT_PARAMETER_WIDTH,
    LIGHTS,
    LOW,
    LOWER,
    MASS,
    MODES,
    MOMENTUM,
    MOTOR,
    MOTORS,
    NEURON,
    OFFSET,
    ORIENTATION,
    OWN,
    PARAMETER,
    PARAMETER_WIDTH,
    PARENT,
    PLACE,
    POINT_PARAMETER,
    POINT_PARAMETER_WIDTH,
    POSITION,
    PUSH,
    RATE,
    READING,
    ROTATION,
    RUBS,
    SCREW,
    STATE_WIDTH,
    TARGET,
    TORQUE,
    TOUCHES,
    UPPER,
    VELOCITY,
    WEIGHT,
    body_at,
    point_at,
    put,
    row,
)
from taichi_sim.rigid.stages import laws, spatial
from taichi_sim.rigid.stages.articulated import row_impulse
from taichi_sim.rigid.stages.motion import common_motion, moving_body
from taichi_sim.runtime import ti


@ti.func
def add(g: ti.template(), k, first, values: ti.template()):
    """Add to slots that follow one another."""
    for i in ti.static(range(len(values))):
        accumulate(g, k, first + i, values[i])


@ti.func
def clear_work(g: ti.template(), k, plan: ti.template()):
    """Forget cotangents of what is no state: they are a step's own."""
    zero = 0.0 * load(g, k, POSITION)
    for b in range(plan[BODIES]):
        for c in range(STATE_WIDTH, BODY_WIDTH):
            store(g, k, body_at(plan, b) + c, zero)
    for c in range(plan[TOUCHES] + plan[LIGHTS]):
        store(g, k, plan[READING] + c, zero)


@ti.func
def unshift_moments(m: ti.template(), c: ti.template(), g: ti.template(), k, plan: ti.template(), floating, sign):
    """``shift_moments`` reversed; momenta are those that c carries."""
    x, y, z, vx, vy, vz, share = common_motion(m, c, k, plan, floating)
    zero = 0.0 * x
    g0, g1, g2, g3, g4, g5 = zero, zero, zero, zero, zero, zero
    for b in range(plan[BODIES]):
        body, given = body_at(plan, b), plan[PARAMETER] + b * PARAMETER_WIDTH
        inputs = ti.static(
            spatial.joined(
                load(m, k, given + MASS),
                row(m, k, body + PLACE, 3),
                row(c, k, body + CARRIED + 3, 3),
                x,
                y,
                z,
                vx,
                vy,
                vz,
            )
        )
        seeds = ti.static([sign * s for s in row(g, k, body + CARRIED, 3)])
        to = ti.static(pull_back(laws.moment_shift, inputs, (), seeds))
        accumulate(g, k, given + MASS, to[0])
        add(g, k, body + PLACE, to[1:4])
        add(g, k, body + CARRIED + 3, to[4:7])
        g0, g1, g2 = g0 + to[7], g1 + to[8], g2 + to[9]
        g3, g4, g5 = g3 + to[10], g4 + to[11], g5 + to[12]
    of_centre, of_going = (
        ti.static((g0 * share, g1 * share, g2 * share)),
        ti.static((g3 * share, g4 * share, g5 * share)),
    )
    for b in range(plan[BODIES]):
        body, given = body_at(plan, b), plan[PARAMETER] + b * PARAMETER_WIDTH
        mass = load(m, k, given + MASS)
        arm = ti.static(spatial.minus_times(row(m, k, body + PLACE, 3), (x, y, z), 1.0))
        accumulate(g, k, given + MASS, spatial.dot(of_centre, arm) - spatial.dot(of_going, (vx, vy, vz)))
        add(g, k, body + PLACE, [mass * s for s in of_centre])
        add(g, k, body + CARRIED + 3, of_going)


@ti.func
def unmove(
    m: ti.template(),
    a: ti.template(),
    g: ti.template(),
    k,
    plan: ti.template(),
    table: ti.template(),
    time_step,
    correction,
    floating,
    drifting: ti.template(),
    conserving: ti.template(),
):
    """From the state after a step to velocities, hinges' rates and the state before."""
    if ti.static(conserving):
        for b in range(plan[BODIES]):  # momenta after the step
            moved = ti.static(laws.carried_on(*moving_body(m, k, plan, b), time_step, correction, drifting, conserving))
            put(a, k, body_at(plan, b) + CARRIED, moved[:6])
        unshift_moments(m, a, g, k, plan, floating, -1.0)
    root = body_at(plan, 0)
    velocity = ti.static(row(m, k, root + VELOCITY, 6))
    base = ti.static(spatial.joined(row(m, k, POSITION, 7), velocity))
    seeds = ti.static(row(g, k, POSITION, 7))
    to_base = ti.static(pull_back(laws.moved_base, base, (time_step,), seeds))
    put(g, k, POSITION, to_base[:7])
    add(g, k, root + VELOCITY, to_base[7:])
    for b in range(plan[BODIES]):
        body, given = body_at(plan, b), plan[PARAMETER] + b * PARAMETER_WIDTH
        before = ti.static(moving_body(m, k, plan, b))
        after = ti.static(spatial.joined(row(g, k, body + CARRIED, 6), row(g, k, body + OWN, 3)))
        to_body = ti.static(pull_back(laws.carried_on, before, (time_step, correction, drifting, conserving), after))
        add(g, k, given + MASS, to_body[:7])
        add(g, k, body + ROTATION, to_body[7:16])
        add(g, k, body + PLACE, to_body[16:19])
        add(g, k, body + DRIFT, to_body[19:22])
        put(g, k, body + OWN, to_body[22:25])
        add(g, k, body + VELOCITY, to_body[25:])
        if table[b * BODY_COLUMNS + HINGED] == 1:
            accumulate(g, k, body + RATE, time_step * load(g, k, body + ANGLE))


@ti.func
def prepare_adjoint(m: ti.template(), a: ti.template(), g: ti.template(), k, plan: ti.template()):
    """The adjoint system: the step's own, for cotangents instead of momenta; its targets are zero."""
    for slot in range(plan[READING]):
        store(a, k, slot, load(m, k, slot))
    zero = 0.0 * load(m, k, POSITION)
    for b in range(plan[BODIES]):
        body = body_at(plan, b)
        put(a, k, body + MOMENTUM, row(g, k, body + VELOCITY, 6))
        put(a, k, body + DRIFT, (zero, zero, zero))
        store(a, k, body + PUSH, load(g, k, body + RATE))
        store(a, k, body + TARGET, zero)
        store(a, k, body + HIGH, zero)
        store(a, k, body + LOW, zero)


@ti.func
def unsolve(
    m: ti.template(),
    a: ti.template(),
    g: ti.template(),
    k,
    plan: ti.template(),
    table: ti.template(),
    points: ti.template(),
    listed: ti.template(),
    block,
    count,
    rows,
    time_step,
    weight,
    push_out,
    drifting: ti.template(),
    conserving: ti.template(),
):
    """From velocities to where bodies are, what they carry and what hinges want."""
    one = 0.0 * load(m, k, POSITION) + 1.0
    for b in range(plan[BODIES]):
        body, given = body_at(plan, b), plan[PARAMETER] + b * PARAMETER_WIDTH
        inputs = ti.static(
            spatial.joined(
                row(m, k, given + MASS, 7),
                row(m, k, body + ROTATION, 9),
                row(m, k, body + PLACE, 3),
                row(m, k, body + CARRIED, 6),
                row(m, k, body + DRIFT, 3),
                row(m, k, body + VELOCITY, 6),
                row(a, k, body + VELOCITY, 6),
            )
        )
        to = ti.static(pull_back(laws.work, inputs, (time_step, weight, push_out, drifting, conserving), (one,)))
        add(g, k, given + MASS, to[:7])
        add(g, k, body + ROTATION, to[7:16])
        add(g, k, body + PLACE, to[16:19])
        put(g, k, body + CARRIED, to[19:25])
        add(g, k, body + DRIFT, to[25:28])
        add(g, k, body + VELOCITY, to[28:34])  # from here on those of y and z as functions of the screws
        put(g, k, body + MOMENTUM, to[34:])
    for n in range(count):
        i = listed[block, n]
        body, point, given = body_at(plan, points[i]), point_at(plan, i), plan[POINT_PARAMETER] + i * 4
        inputs = ti.static(
            spatial.joined(
                row(m, k, body + ROTATION, 9),
                row(m, k, body + PLACE, 3),
                row(m, k, body + DRIFT, 3),
                row(m, k, given, POINT_PARAMETER_WIDTH),
                load(m, k, POSITION + 2),
                row(m, k, body + VELOCITY, 6),
                row(a, k, body + VELOCITY, 6),
            )
        )
        multiplier = 0.0 - load(a, k, point + IMPULSES + rows)
        strength = one * 0.0
        if rows > 0:
            strength = load(m, k, point + RUBS)
        constants = ti.static((load(m, k, point + IMPULSES + rows), multiplier, strength, push_out, drifting))
        to = ti.static(pull_back(laws.contact_work, inputs, constants, (one,)))
        add(g, k, body + ROTATION, to[:9])
        add(g, k, body + PLACE, to[9:12])
        add(g, k, body + DRIFT, to[12:15])
        add(g, k, given, to[15:19])
        accumulate(g, k, POSITION + 2, to[19])
        add(g, k, body + VELOCITY, to[20:26])
        add(g, k, body + MOMENTUM, to[26:])
    for back in range(1, plan[BODIES]):
        b = plan[BODIES] - back
        body, parent = body_at(plan, b), body_at(plan, table[b * BODY_COLUMNS + PARENT])
        of_y, of_z = ti.static(row(g, k, body + VELOCITY, 6)), ti.static(row(g, k, body + MOMENTUM, 6))
        if table[b * BODY_COLUMNS + HINGED] == 1:
            screw = ti.static(
                spatial.plus_times(
                    spatial.plus_times(row(g, k, body + SCREW, 6), of_y, load(m, k, body + RATE)),
                    of_z,
                    load(a, k, body + RATE),
                )
            )
            put(g, k, body + SCREW, screw)
        add(g, k, parent + VELOCITY, of_y)
        add(g, k, parent + MOMENTUM, of_z)


@ti.func
def uncommand(
    m: ti.template(),
    a: ti.template(),
    g: ti.template(),
    k,
    plan: ti.template(),
    table: ti.template(),
    rows,
    time_step,
    push_out,
):
    """From hinges' rows to angles, neurons and motors."""
    for b in range(1, plan[BODIES]):
        if table[b * BODY_COLUMNS + HINGED] == 1:
            body, given = body_at(plan, b), plan[PARAMETER] + b * PARAMETER_WIDTH
            mode = load(m, k, body + MODES + rows)
            driven = (mode > -0.5) & (mode < 0.5)
            of_target = select(driven, 0.0 - row_impulse(a, k, body), 0.0 * mode)
            angle = load(m, k, body + ANGLE)
            stopped = (angle <= load(m, k, given + LOWER)) | (angle >= load(m, k, given + UPPER))
            wanted = select(stopped, 0.0 * of_target, of_target)
            accumulate(
                g,
                k,
                body + ANGLE,
                load(m, k, given + BY_ANGLE) * wanted - push_out * select(stopped, of_target, 0.0 * of_target),
            )
            accumulate(g, k, given + BY_ANGLE, angle * wanted)
            accumulate(g, k, given + OFFSET, wanted)
            pushed = load(m, k, body + PUSH)
            way = select(stopped, select(pushed > 0.0, 1.0, select(pushed < 0.0, -1.0, 0.0 * mode)), mode)
            accumulate(g, k, given + TORQUE, time_step * way * load(a, k, body + RATE))
            motor = table[b * BODY_COLUMNS + MOTOR]
            if motor >= 0:
                accumulate(g, k, given + BY_COMMAND, load(m, k, plan[NEURON] + motor) * wanted)
                accumulate(g, k, plan[NEURON] + motor, load(m, k, given + BY_COMMAND) * wanted)


@ti.func
def unthink(m: ti.template(), g: ti.template(), k, plan: ti.template(), step, memory, gain):
    """From neurons to their last values, weights and sensors."""
    for j in range(plan[MOTORS]):
        slot = plan[NEURON] + j
        value, cotangent = load(m, k, slot), load(g, k, slot)
        if plan[COMMANDS] > 0:
            at = ti.min(step // plan[HOLD], plan[COMMANDS] - 1)
            accumulate(g, k, plan[COMMAND] + at * plan[MOTORS] + j, cotangent)
            store(g, k, slot, 0.0 * cotangent)
        else:
            inner = (1.0 - value * value) * cotangent
            store(g, k, slot, memory * inner)
            for s in range(plan[TOUCHES] + plan[LIGHTS]):
                weight, reading = plan[WEIGHT] + s * plan[MOTORS] + j, plan[READING] + s
                accumulate(g, k, weight, gain * inner * load(m, k, reading))
                accumulate(g, k, reading, gain * inner * load(m, k, weight))


@ti.func
def unsense(m: ti.template(), g: ti.template(), k, plan: ti.template(), eyes: ti.template()):
    """From light sensors to where they are."""
    source, base = ti.static(row(m, k, LIGHT, 3)), ti.static(row(m, k, POSITION, 3))
    for s in range(plan[LIGHTS]):
        body = body_at(plan, eyes[s])
        given = plan[LIGHT_PARAMETER] + s * LIGHT_PARAMETER_WIDTH
        inputs = ti.static(
            spatial.joined(base, row(m, k, body + ROTATION, 9), row(m, k, body + PLACE, 3), row(m, k, given, 3), source)
        )
        seed = load(g, k, plan[READING] + plan[TOUCHES] + s)
        to = ti.static(pull_back(laws.light_reading, inputs, (), (seed,)))
        add(g, k, POSITION, to[:3])
        add(g, k, body + ROTATION, to[3:12])
        add(g, k, body + PLACE, to[12:15])
        add(g, k, given, to[15:18])
        add(g, k, LIGHT, to[18:])


@ti.func
def unplace(m: ti.template(), g: ti.template(), k, plan: ti.template(), table: ti.template(), drifting: ti.template()):
    """From bodies, leaves first, to the base and the angles."""
    for back in range(1, plan[BODIES]):
        b = plan[BODIES] - back
        body, parent = body_at(plan, b), body_at(plan, table[b * BODY_COLUMNS + PARENT])
        given = plan[PARAMETER] + b * PARAMETER_WIDTH
        if ti.static(drifting):
            of_drift = ti.static(row(g, k, body + DRIFT, 3))
            back_again = ti.static([0.0 - x for x in of_drift])
            add(g, k, body + OWN, of_drift)
            add(g, k, POSITION, back_again)
            add(g, k, body + PLACE, back_again)
        before = ti.static(
            spatial.joined(
                row(m, k, parent + ROTATION, 9),
                row(m, k, parent + PLACE, 3),
                row(m, k, given + ANCHOR, 3),
                row(m, k, given + CENTRE, 3),
            )
        )
        of_place = ti.static(row(g, k, body + PLACE, 3))
        if table[b * BODY_COLUMNS + HINGED] == 1:
            sine, cosine = sine_cosine(load(m, k, body + ANGLE))
            inputs = ti.static(spatial.joined(before, sine, cosine))
            seeds = ti.static(spatial.joined(row(g, k, body + ROTATION, 9), of_place, row(g, k, body + SCREW, 6)))
            to = ti.static(pull_back(laws.hinged_place, inputs, row(m, k, given + AXIS, 3), seeds))
            add(g, k, parent + ROTATION, to[:9])
            add(g, k, parent + PLACE, to[9:12])
            add(g, k, given + ANCHOR, to[12:15])
            add(g, k, given + CENTRE, to[15:18])
            accumulate(g, k, body + ANGLE, to[18] * cosine - to[19] * sine)
        else:
            to = ti.static(pull_back(laws.welded_place, before, (), of_place))
            add(g, k, parent + ROTATION, to[:9])
            add(g, k, parent + ROTATION, row(g, k, body + ROTATION, 9))
            add(g, k, parent + PLACE, to[9:12])
            add(g, k, given + ANCHOR, to[12:15])
            add(g, k, given + CENTRE, to[15:18])
    q = ti.static(row(m, k, ORIENTATION, 4))
    to_q = ti.static(pull_back(rotations.matrix, q, (), row(g, k, body_at(plan, 0) + ROTATION, 9)))
    add(g, k, ORIENTATION, to_q)
