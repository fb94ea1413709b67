"""What a robot senses, what its neurons make of it, and what its hinges' motors and stops ask for."""

from taichi_sim.autodiff.elementary import hyperbolic_tangent
from taichi_sim.autodiff.lanes import load, smaller, store
from taichi_sim.autodiff.tracing import select
from taichi_sim.rigid.memory import (
    ANGLE,
    BODIES,
    BODY_COLUMNS,
    BY_ANGLE,
    BY_COMMAND,
    CLOSEST,
    COMMAND,
    COMMANDS,
    HIGH,
    HINGED,
    HOLD,
    LIGHT,
    LIGHT_PARAMETER,
    LIGHT_PARAMETER_WIDTH,
    LIGHTS,
    LOW,
    LOWER,
    MODES,
    MOTOR,
    MOTORS,
    NEURON,
    NO_STOP,
    OFFSET,
    PARAMETER,
    PARAMETER_WIDTH,
    PLACE,
    POSITION,
    PUSH,
    READING,
    ROTATION,
    TARGET,
    TORQUE,
    TOUCHES,
    UPPER,
    WEIGHT,
    body_at,
    row,
)
from taichi_sim.rigid.stages import laws
from taichi_sim.runtime import ti


@ti.func
def clear_touch(m: ti.template(), k, plan: ti.template(), apart):
    """Touch sensors before contacts are looked for."""
    for s in range(plan[TOUCHES]):
        store(m, k, plan[READING] + s, 0.0 * load(m, k, 0) + apart)


@ti.func
def sense_light(m: ti.template(), k, plan: ti.template(), eyes: ti.template()):
    """Readings 1 / d^2 of light sensors, and how close the base came to the light, seen from above."""
    source = ti.static(row(m, k, LIGHT, 3))
    base = ti.static(row(m, k, POSITION, 3))
    for s in range(plan[LIGHTS]):
        body = body_at(plan, eyes[s])
        given = plan[LIGHT_PARAMETER] + s * LIGHT_PARAMETER_WIDTH
        rotation, place = ti.static(row(m, k, body + ROTATION, 9)), ti.static(row(m, k, body + PLACE, 3))
        reading = laws.light_reading(*base, *rotation, *place, *row(m, k, given, 3), *source)
        store(m, k, plan[READING] + plan[TOUCHES] + s, reading)
    dx, dy = base[0] - source[0], base[1] - source[1]
    store(m, k, CLOSEST, smaller(dx * dx + dy * dy, load(m, k, CLOSEST)))


@ti.func
def think(m: ti.template(), k, plan: ti.template(), step, memory, gain):
    """Motor neurons m = tanh(memory m + gain sum of W s), or commands given beforehand."""
    sensors = plan[TOUCHES] + plan[LIGHTS]
    for j in range(plan[MOTORS]):
        slot = plan[NEURON] + j
        if plan[COMMANDS] > 0:
            at = ti.min(step // plan[HOLD], plan[COMMANDS] - 1)
            store(m, k, slot, load(m, k, plan[COMMAND] + at * plan[MOTORS] + j))
        else:
            drive = 0.0 * load(m, k, 0)
            for s in range(sensors):
                drive = drive + load(m, k, plan[WEIGHT] + s * plan[MOTORS] + j) * load(m, k, plan[READING] + s)
            store(m, k, slot, hyperbolic_tangent(memory * load(m, k, slot) + gain * drive))


@ti.func
def command_hinges(m: ti.template(), k, plan: ti.template(), table: ti.template(), time_step, push_out):
    """Each hinge's row: the rate it should have, and the impulses it may use for it.

    At a stop the row is the stop's, and the motor pushes with all its torque the way it wants to go (ODE's rule for a
    powered joint at its stop).
    """
    for b in range(1, plan[BODIES]):
        if table[b * BODY_COLUMNS + HINGED] == 1:
            body, given = body_at(plan, b), plan[PARAMETER] + b * PARAMETER_WIDTH
            angle = load(m, k, body + ANGLE)
            motor = table[b * BODY_COLUMNS + MOTOR]
            command = 0.0 * angle
            if motor >= 0:
                command = load(m, k, plan[NEURON] + motor)
            wanted = (
                load(m, k, given + BY_COMMAND) * command
                + load(m, k, given + BY_ANGLE) * angle
                + load(m, k, given + OFFSET)
            )
            strength = time_step * load(m, k, given + TORQUE)
            lower, upper = load(m, k, given + LOWER), load(m, k, given + UPPER)
            at_lower, at_upper = angle <= lower, angle >= upper
            stopped = at_lower | at_upper
            upwards = (wanted > 0.0) | ((wanted >= 0.0) & at_upper)
            store(m, k, body + PUSH, select(stopped, select(upwards, strength, 0.0 - strength), 0.0 * strength))
            back = push_out * (select(at_lower, lower, upper) - angle)
            store(m, k, body + TARGET, select(stopped, back, wanted))
            high = select(stopped, select(at_lower, NO_STOP, 0.0 * strength), strength)
            low = select(stopped, select(at_lower, 0.0 * strength, 0.0 - NO_STOP), 0.0 - strength)
            store(m, k, body + HIGH, high)
            store(m, k, body + LOW, low)
            for phase in ti.static(range(2)):  # a bound that is out of reach holds nothing
                mode = load(m, k, body + MODES + phase)
                absent = ((mode > 0.5) & (high >= NO_STOP)) | ((mode < -0.5) & (low <= 0.0 - NO_STOP))
                store(m, k, body + MODES + phase, select(absent, 0.0 * mode, mode))
