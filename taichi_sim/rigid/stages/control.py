"""Sensors, neurons, and the rates and impulses that motors and stops of hinges ask for."""

from taichi_sim.autodiff.elementary import hyperbolic_tangent
from taichi_sim.autodiff.lanes import smaller
from taichi_sim.autodiff.tracing import select
from taichi_sim.rigid import slots
from taichi_sim.rigid.memory import (
    body_at,
    column,
    gather,
    is_hinged,
    put,
    read,
    row,
    setting,
    write,
)
from taichi_sim.rigid.stages import laws
from taichi_sim.rigid.stages.arguments import eye_slots, hinge_slots
from taichi_sim.rigid.stages.rows import keep_way
from taichi_sim.runtime import ti


@ti.func
def clear_touch(robots: ti.template()):
    """Reset touch sensors before contacts are looked for."""
    apart = setting(robots, slots.APART)
    for s in range(robots.plan[slots.TOUCHES]):
        write(robots, robots.plan[slots.READING] + s, 0.0 * read(robots, 0) + apart)


@ti.func
def sense_light(robots: ti.template()):
    """Readings 1 / d^2 of light sensors, and how close the base came to the light, seen from above."""
    for s in range(robots.plan[slots.LIGHTS]):
        reading = laws.light_reading(*gather(robots, eye_slots(robots, s)))
        write(robots, robots.plan[slots.READING] + robots.plan[slots.TOUCHES] + s, reading)
    source, base = ti.static(row(robots, slots.LIGHT, 3)), ti.static(row(robots, slots.POSITION, 3))
    dx, dy = base[0] - source[0], base[1] - source[1]
    write(robots, slots.CLOSEST, smaller(dx * dx + dy * dy, read(robots, slots.CLOSEST)))


@ti.func
def think(robots: ti.template(), step):
    """Motor neurons m = tanh(memory m + gain sum of W s), or commands given beforehand."""
    memory, gain = setting(robots, slots.MEMORY), setting(robots, slots.GAIN)
    sensors, motors = robots.plan[slots.SENSORS], robots.plan[slots.MOTORS]
    for j in range(motors):
        slot = robots.plan[slots.NEURON] + j
        if robots.plan[slots.COMMANDS] > 0:
            at = ti.min(step // robots.plan[slots.HOLD], robots.plan[slots.COMMANDS] - 1)
            write(robots, slot, read(robots, robots.plan[slots.COMMAND] + at * motors + j))
        else:
            drive = 0.0 * read(robots, 0)
            for s in range(sensors):
                weight = read(robots, robots.plan[slots.WEIGHT] + s * motors + j)
                drive = drive + weight * read(robots, robots.plan[slots.READING] + s)
            write(robots, slot, hyperbolic_tangent(memory * read(robots, slot) + gain * drive))


@ti.func
def commanded(robots: ti.template(), b):
    """The command of a hinge's motor; 0 without a motor."""
    command = 0.0 * read(robots, 0)
    motor = column(robots, b, slots.MOTOR)
    if motor >= 0:
        command = read(robots, robots.plan[slots.NEURON] + motor)
    return command


@ti.func
def command_hinges(robots: ti.template()):
    """Each hinge's row: the rate it should have, the impulses it may use for it, and what acts on it besides."""
    h, push_out = setting(robots, slots.TIME_STEP), setting(robots, slots.PUSH_OUT)
    for b in range(1, robots.plan[slots.BODIES]):
        if is_hinged(robots, b):
            body = body_at(robots, b)
            hinge = ti.static(gather(robots, hinge_slots(robots, b)))
            wanted = ti.static(laws.hinge_row(*hinge, commanded(robots, b), h, push_out, robots.drifting))
            put(robots, body + slots.TARGET, wanted[:4])
            put(robots, body + slots.LEAST_RATE, wanted[4:])
            low, high = read(robots, body + slots.LOW), read(robots, body + slots.HIGH)
            for phase in ti.static(range(2)):  # a bound that is out of reach holds nothing
                mode = read(robots, body + slots.MODES + phase)
                absent = ((mode > 0.5) & (high >= slots.NO_STOP)) | ((mode < -0.5) & (low <= 0.0 - slots.NO_STOP))
                write(robots, body + slots.MODES + phase, select(absent, 0.0 * mode, mode))
                keep_way(robots, body, phase)
