"""Where bodies are, what they carry into a step, and how they move on."""

from taichi_sim.autodiff import rotations
from taichi_sim.autodiff.elementary import sine_cosine
from taichi_sim.autodiff.lanes import load, store
from taichi_sim.rigid.memory import (
    ANCHOR,
    ANGLE,
    AXIS,
    BODIES,
    BODY_COLUMNS,
    CARRIED,
    CENTRE,
    DRIFT,
    HINGED,
    INERTIA,
    MASS,
    MOMENTUM,
    MOVING,
    ORIENTATION,
    OWN,
    PARAMETER,
    PARAMETER_WIDTH,
    PARENT,
    PLACE,
    POSITION,
    RATE,
    REST_INERTIA,
    ROTATION,
    SCREW,
    VELOCITY,
    body_at,
    put,
    row,
)
from taichi_sim.rigid.stages import laws, spatial
from taichi_sim.runtime import ti


@ti.func
def place_bodies(m: ti.template(), k, plan: ti.template(), table: ti.template(), drifting: ti.template()):
    """Rotations and places of all bodies, parents first, and their hinges as spatial vectors."""
    q = ti.static(row(m, k, ORIENTATION, 4))
    root = body_at(plan, 0)
    zero = 0.0 * q[0]
    put(m, k, root + ROTATION, rotations.matrix(*q))
    put(m, k, root + PLACE, (zero, zero, zero))
    put(m, k, root + DRIFT, (zero, zero, zero))
    for b in range(1, plan[BODIES]):
        body, parent = body_at(plan, b), body_at(plan, table[b * BODY_COLUMNS + PARENT])
        given = plan[PARAMETER] + b * PARAMETER_WIDTH
        before = ti.static(
            spatial.joined(
                row(m, k, parent + ROTATION, 9),
                row(m, k, parent + PLACE, 3),
                row(m, k, given + ANCHOR, 3),
                row(m, k, given + CENTRE, 3),
            )
        )
        if table[b * BODY_COLUMNS + HINGED] == 1:
            sine, cosine = sine_cosine(load(m, k, body + ANGLE))
            placed = ti.static(laws.hinged_place(*before, sine, cosine, *row(m, k, given + AXIS, 3)))
            put(m, k, body + ROTATION, placed[:9])
            put(m, k, body + PLACE, placed[9:12])
            put(m, k, body + SCREW, placed[12:])
        else:
            put(m, k, body + ROTATION, before[:9])
            put(m, k, body + PLACE, laws.welded_place(*before))
        if ti.static(drifting):
            for c in ti.static(range(3)):
                tree = load(m, k, POSITION + c) + load(m, k, body + PLACE + c)
                store(m, k, body + DRIFT + c, load(m, k, body + OWN + c) - tree)


@ti.func
def common_motion(m: ti.template(), c: ti.template(), k, plan: ti.template(), floating):
    """Centre of mass relative to the base, its velocity, and one over the mass, all zero where the base is fixed.

    Masses and places are those of memory m, momenta those that c carries.
    """
    total = 0.0 * load(m, k, 0)
    x, y, z, vx, vy, vz = total, total, total, total, total, total
    for b in range(plan[BODIES]):
        body = body_at(plan, b)
        mass = load(m, k, plan[PARAMETER] + b * PARAMETER_WIDTH + MASS)
        total = total + mass
        x = x + mass * load(m, k, body + PLACE)
        y = y + mass * load(m, k, body + PLACE + 1)
        z = z + mass * load(m, k, body + PLACE + 2)
        vx = vx + load(c, k, body + CARRIED + 3)
        vy = vy + load(c, k, body + CARRIED + 4)
        vz = vz + load(c, k, body + CARRIED + 5)
    share = floating / total
    return x * share, y * share, z * share, vx * share, vy * share, vz * share, share


@ti.func
def shift_moments(m: ti.template(), k, plan: ti.template(), floating, sign):
    """Moments of momentum about the common point from those carried from step to step (or back: -1)."""
    x, y, z, vx, vy, vz, _share = common_motion(m, m, k, plan, floating)
    for b in range(plan[BODIES]):
        body, given = body_at(plan, b), plan[PARAMETER] + b * PARAMETER_WIDTH
        before = ti.static(
            spatial.joined(load(m, k, given + MASS), row(m, k, body + PLACE, 3), row(m, k, body + CARRIED + 3, 3))
        )
        shift = ti.static(laws.moment_shift(*before, x, y, z, vx, vy, vz))
        put(m, k, body + CARRIED, spatial.plus_times(row(m, k, body + CARRIED, 3), shift, sign))


@ti.func
def gather_momentum(
    m: ti.template(),
    k,
    plan: ti.template(),
    time_step,
    weight,
    correction,
    floating,
    drifting: ti.template(),
    conserving: ti.template(),
):
    """Inertias about the common point, and the momentum of each body."""
    if ti.static(conserving):
        shift_moments(m, k, plan, floating, 1.0)
    for b in range(plan[BODIES]):
        body, given = body_at(plan, b), plan[PARAMETER] + b * PARAMETER_WIDTH
        mass = load(m, k, given + MASS)
        place = ti.static(row(m, k, body + PLACE, 3))
        turned = ti.static(spatial.turned_inertia(row(m, k, body + ROTATION, 9), row(m, k, given + REST_INERTIA, 6)))
        carried, drift = ti.static(row(m, k, body + CARRIED, 6)), ti.static(row(m, k, body + DRIFT, 3))
        put(m, k, body + INERTIA, spatial.moved_inertia(turned, mass, place))
        put(
            m,
            k,
            body + MOMENTUM,
            laws.momentum(mass, turned, place, carried, drift, time_step, weight, correction, drifting, conserving),
        )


@ti.func
def move_bodies(
    m: ti.template(),
    k,
    plan: ti.template(),
    table: ti.template(),
    time_step,
    correction,
    floating,
    drifting: ti.template(),
    conserving: ti.template(),
):
    """Carry velocities or momenta, and move on: semi-implicit Euler."""
    velocity = ti.static(row(m, k, body_at(plan, 0) + VELOCITY, 6))
    for b in range(plan[BODIES]):
        body = body_at(plan, b)
        moved = ti.static(laws.carried_on(*moving_body(m, k, plan, b), time_step, correction, drifting, conserving))
        put(m, k, body + CARRIED, moved[:6])
        if ti.static(conserving):
            w, v = ti.static(row(m, k, body + VELOCITY, 3)), ti.static(row(m, k, body + VELOCITY + 3, 3))
            linear = ti.static(spatial.plus(v, spatial.cross(w, row(m, k, body + PLACE, 3))))
            put(m, k, body + MOVING, spatial.joined(w, linear))
        else:
            put(m, k, body + MOVING, moved[:6])
        if ti.static(drifting):
            put(m, k, body + OWN, moved[6:])
        if table[b * BODY_COLUMNS + HINGED] == 1:
            store(m, k, body + ANGLE, load(m, k, body + ANGLE) + time_step * load(m, k, body + RATE))
    if ti.static(conserving):
        shift_moments(m, k, plan, floating, -1.0)
    base = ti.static(row(m, k, POSITION, 7))
    moved_base = ti.static(laws.moved_base(*base, *velocity, time_step))
    put(m, k, POSITION, moved_base)


@ti.func
def moving_body(m: ti.template(), k, plan: ti.template(), b):
    """What ``laws.carried_on`` wants to know of a body."""
    body, given = body_at(plan, b), plan[PARAMETER] + b * PARAMETER_WIDTH
    return ti.static(
        spatial.joined(
            row(m, k, given + MASS, 7),
            row(m, k, body + ROTATION, 9),
            row(m, k, body + PLACE, 3),
            row(m, k, body + DRIFT, 3),
            row(m, k, body + OWN, 3),
            row(m, k, body + VELOCITY, 6),
        )
    )
