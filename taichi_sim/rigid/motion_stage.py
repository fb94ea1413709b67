"""Where bodies are, what they carry into a step, and how they move on."""

from taichi_sim import rotations
from taichi_sim.elementary import sine_cosine
from taichi_sim.lanes import load, store
from taichi_sim.rigid import spatial
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
from taichi_sim.runtime import ti
from taichi_sim.tracing import sqrt


@ti.func
def place_bodies(m: ti.template(), k, plan: ti.template(), table: ti.template(), drifting: ti.template()):
    """Rotations and places of all bodies, parents first, and their hinges as spatial vectors."""
    q = ti.static(row(m, k, ORIENTATION, 4))
    root = body_at(plan, 0)
    turned = ti.static(rotations.matrix(*q))
    put(m, k, root + ROTATION, turned)
    zero = 0.0 * q[0]
    put(m, k, root + PLACE, (zero, zero, zero))
    put(m, k, root + DRIFT, (zero, zero, zero))
    for b in range(1, plan[BODIES]):
        body, parent = body_at(plan, b), body_at(plan, table[b * BODY_COLUMNS + PARENT])
        given = plan[PARAMETER] + b * PARAMETER_WIDTH
        of_parent = ti.static(row(m, k, parent + ROTATION, 9))
        anchor = ti.static(spatial.plus(
            row(m, k, parent + PLACE, 3), spatial.turned(of_parent, row(m, k, given + ANCHOR, 3))))  # fmt: skip
        centre = ti.static(row(m, k, given + CENTRE, 3))
        if table[b * BODY_COLUMNS + HINGED] == 1:
            axis = ti.static(spatial.turned(of_parent, row(m, k, given + AXIS, 3)))
            sine, cosine = sine_cosine(load(m, k, body + ANGLE))
            rotation = ti.static(spatial.product(spatial.about_axis(axis, sine, cosine), of_parent))
            put(m, k, body + ROTATION, rotation)
            put(m, k, body + PLACE, spatial.plus(anchor, spatial.turned(rotation, centre)))
            put(m, k, body + SCREW, spatial.joined(axis, spatial.cross(anchor, axis)))
        else:
            put(m, k, body + ROTATION, of_parent)
            put(m, k, body + PLACE, spatial.plus(anchor, spatial.turned(of_parent, centre)))
        if ti.static(drifting):
            for c in ti.static(range(3)):
                tree = load(m, k, POSITION + c) + load(m, k, body + PLACE + c)
                store(m, k, body + DRIFT + c, load(m, k, body + OWN + c) - tree)


@ti.func
def gather_momentum(m: ti.template(), k, plan: ti.template(), time_step, weight, correction,
                    drifting: ti.template(), conserving: ti.template()):  # fmt: skip
    """Inertias, and the momentum of each body with what gravity and gyroscopic moments add in the step."""
    for b in range(plan[BODIES]):
        body, given = body_at(plan, b), plan[PARAMETER] + b * PARAMETER_WIDTH
        mass = load(m, k, given + MASS)
        place = ti.static(row(m, k, body + PLACE, 3))
        inertia = ti.static(spatial.turned_inertia(row(m, k, body + ROTATION, 9), row(m, k, given + REST_INERTIA, 6)))
        put(m, k, body + INERTIA, spatial.moved_inertia(inertia, mass, place))
        angular, linear = ti.static(row(m, k, body + CARRIED, 3)), ti.static(row(m, k, body + CARRIED + 3, 3))
        falling = time_step * weight * mass
        if ti.static(conserving):  # carried are momenta
            put(m, k, body + MOMENTUM, (angular[0] + place[1] * falling, angular[1] - place[0] * falling, angular[2],
                                        linear[0], linear[1], linear[2] + falling))  # fmt: skip
        else:  # carried are velocities
            spin = ti.static([spatial.dot((inertia[i], inertia[j], inertia[l]), angular)
                              for i, j, l in ((0, 1, 3), (1, 2, 4), (3, 4, 5))])  # fmt: skip
            gyroscopic = ti.static(spatial.cross(angular, spin))
            v = ti.static(spatial.plus_times(linear, row(m, k, body + DRIFT, 3), correction) if drifting else linear)
            p = ti.static((mass * v[0], mass * v[1], mass * v[2] + falling))
            moment = ti.static(spatial.cross(place, p))
            angular_sum = ti.static(spatial.minus_times(spatial.plus(moment, spin), gyroscopic, time_step))
            put(m, k, body + MOMENTUM, spatial.joined(angular_sum, p))


@ti.func
def move_bodies(m: ti.template(), k, plan: ti.template(), table: ti.template(), time_step, correction,
                drifting: ti.template(), conserving: ti.template()):  # fmt: skip
    """Carry velocities or momenta, and move on: semi-implicit Euler."""
    root = body_at(plan, 0)
    turning, moving = ti.static(row(m, k, root + VELOCITY, 3)), ti.static(row(m, k, root + VELOCITY + 3, 3))
    for b in range(plan[BODIES]):
        body = body_at(plan, b)
        w, v = ti.static(row(m, k, body + VELOCITY, 3)), ti.static(row(m, k, body + VELOCITY + 3, 3))
        place = ti.static(row(m, k, body + PLACE, 3))
        if ti.static(conserving):
            mass = load(m, k, plan[PARAMETER] + b * PARAMETER_WIDTH + MASS)
            matrix = ti.static(spatial.rigid_matrix(row(m, k, body + INERTIA, 6), mass, place))
            p = ti.static(spatial.times(matrix, spatial.joined(w, v)))
            # The common point moves on with the base, and the moment about it changes.
            moment = ti.static(spatial.minus_times(p[:3], spatial.cross(moving, p[3:]), time_step))
            put(m, k, body + CARRIED, spatial.joined(moment, p[3:]))
        else:
            linear = ti.static(spatial.plus(v, spatial.cross(w, place)))
            if ti.static(drifting):
                true = ti.static(spatial.minus_times(linear, row(m, k, body + DRIFT, 3), correction))
                put(m, k, body + CARRIED, spatial.joined(w, true))
                put(m, k, body + OWN, spatial.plus_times(row(m, k, body + OWN, 3), true, time_step))
            else:
                put(m, k, body + CARRIED, spatial.joined(w, linear))
        if table[b * BODY_COLUMNS + HINGED] == 1:
            store(m, k, body + ANGLE, load(m, k, body + ANGLE) + time_step * load(m, k, body + RATE))
    put(m, k, POSITION, spatial.plus_times(row(m, k, POSITION, 3), moving, time_step))
    q = ti.static(row(m, k, ORIENTATION, 4))
    turn = ti.static(rotations.multiply(0.0 * q[0], *turning, *q))
    moved = ti.static(spatial.plus_times(q, turn, 0.5 * time_step))
    shrink = 1.0 / sqrt(spatial.dot(moved, moved))
    put(m, k, ORIENTATION, [x * shrink for x in moved])
