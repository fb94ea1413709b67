"""Velocities of an articulated tree: from the leaves to the base and back.

An articulated body's inertia I and momentum p say which impulse f = I v - p it needs to move with v. A hinge with the
spatial vector S adds S u to its parent's velocity. Either its rate u is given (a motor that holds its rate, a stop), or
the impulse along it is; in both cases u = u0 - (U.v) / D with U = I S and 1 / D = 0 where the rate is given, and the
parent sees I - U U^T / D and p - U u0. (Featherstone, Rigid Body Dynamics Algorithms, 2008, chapter 7, for velocities.)
"""

from taichi_sim.autodiff.lanes import larger, load, store
from taichi_sim.autodiff.tracing import select
from taichi_sim.rigid.memory import (
    ARTICULATED,
    AT,
    BODIES,
    BODY_COLUMNS,
    COLUMN,
    CONTACT,
    DRIFT,
    FREE_RATE,
    HIGH,
    HINGED,
    IMPULSE,
    INERTIA,
    INVERSE,
    LOW,
    MASS,
    MODE_DRIVEN,
    MODES,
    MOMENTUM,
    PARAMETER,
    PARAMETER_WIDTH,
    PARENT,
    PLACE,
    PUSH,
    RATE,
    ROOT,
    ROOT_RIGHT,
    RUBS,
    SCREW,
    TARGET,
    VELOCITY,
    body_at,
    point_at,
    put,
    row,
)
from taichi_sim.rigid.stages import spatial
from taichi_sim.runtime import ti


@ti.func
def assemble(
    m: ti.template(),
    k,
    plan: ti.template(),
    points: ti.template(),
    listed: ti.template(),
    block,
    count,
    phase,
    correction,
    drifting: ti.template(),
):
    """Inertias and momenta of bodies on their own; from phase 1 on with the friction of points that rub."""
    for b in range(plan[BODIES]):
        body = body_at(plan, b)
        mass = load(m, k, plan[PARAMETER] + b * PARAMETER_WIDTH + MASS)
        inertia, place = ti.static(row(m, k, body + INERTIA, 6)), ti.static(row(m, k, body + PLACE, 3))
        put(m, k, body + ARTICULATED, spatial.rigid_matrix(inertia, mass, place))
        put(m, k, body + IMPULSE, row(m, k, body + MOMENTUM, 6))
        store(m, k, body + CONTACT, 0.0 * mass)
    if phase > 0:
        for n in range(count):
            point = point_at(plan, listed[block, n])
            body = body_at(plan, points[listed[block, n]])
            strength = load(m, k, point + RUBS)
            at = ti.static(row(m, k, point + AT, 3))
            added = ti.static(spatial.drag(at, strength))
            for e in ti.static(range(len(added))):
                slot = body + ARTICULATED + added[e][0]
                store(m, k, slot, load(m, k, slot) + added[e][1])
            if ti.static(drifting):  # its own velocity is that of the tree less the correction of its drift
                fx = strength * correction * load(m, k, body + DRIFT)
                fy = strength * correction * load(m, k, body + DRIFT + 1)
                pull = ti.static((fx, fy, 0.0 * fx))
                added_impulse = ti.static(spatial.joined(spatial.cross(at, pull), pull))
                put(m, k, body + IMPULSE, spatial.plus(row(m, k, body + IMPULSE, 6), added_impulse))


@ti.func
def gather(m: ti.template(), k, plan: ti.template(), table: ti.template(), phase):
    """From the leaves to the base; then the base's factor and free velocity."""
    for back in range(1, plan[BODIES]):
        b = plan[BODIES] - back
        body, parent = body_at(plan, b), body_at(plan, table[b * BODY_COLUMNS + PARENT])
        inertia, impulse = ti.static(row(m, k, body + ARTICULATED, 21)), ti.static(row(m, k, body + IMPULSE, 6))
        of_parent = ti.static(row(m, k, parent + ARTICULATED, 21))
        at_parent = ti.static(row(m, k, parent + IMPULSE, 6))
        if table[b * BODY_COLUMNS + HINGED] == 1:
            screw = ti.static(row(m, k, body + SCREW, 6))
            column = ti.static(spatial.times(inertia, screw))
            mode = load(m, k, body + MODES + phase)
            driven = (mode > -0.5) & (mode < 0.5)
            bound = select(mode > 0.0, load(m, k, body + HIGH), load(m, k, body + LOW))
            inverse = 1.0 / spatial.dot(screw, column)
            free = (load(m, k, body + PUSH) + bound + spatial.dot(screw, impulse)) * inverse
            rate = select(driven, load(m, k, body + TARGET), free)
            inverse = select(driven, 0.0, inverse)
            put(m, k, body + COLUMN, column)
            store(m, k, body + INVERSE, inverse)
            store(m, k, body + FREE_RATE, rate)
            put(m, k, parent + ARTICULATED, spatial.plus(of_parent, spatial.less_outer(inertia, column, inverse)))
            put(m, k, parent + IMPULSE, spatial.plus(at_parent, spatial.minus_times(impulse, column, rate)))
        else:
            put(m, k, parent + ARTICULATED, spatial.plus(of_parent, inertia))
            put(m, k, parent + IMPULSE, spatial.plus(at_parent, impulse))


@ti.func
def solve_base(m: ti.template(), k, plan: ti.template(), floating):
    """The base's velocity without contacts; ``floating`` is 0 where it is fixed to the world, else 1."""
    root = body_at(plan, 0)
    factor = ti.static(spatial.cholesky(row(m, k, root + ARTICULATED, 21)))
    right = ti.static([x * floating for x in spatial.forward(factor, row(m, k, root + IMPULSE, 6))])
    put(m, k, ROOT, factor)
    put(m, k, ROOT_RIGHT, right)
    put(m, k, root + VELOCITY, spatial.backward(factor, right))


@ti.func
def spread(m: ti.template(), k, plan: ti.template(), table: ti.template()):
    """From the base to the leaves, contacts included."""
    put(m, k, body_at(plan, 0) + VELOCITY, spatial.backward(row(m, k, ROOT, 21), row(m, k, ROOT_RIGHT, 6)))
    for b in range(1, plan[BODIES]):
        body, parent = body_at(plan, b), body_at(plan, table[b * BODY_COLUMNS + PARENT])
        velocity = ti.static(row(m, k, parent + VELOCITY, 6))
        if table[b * BODY_COLUMNS + HINGED] == 1:
            pulled = load(m, k, body + CONTACT) - spatial.dot(row(m, k, body + COLUMN, 6), velocity)
            rate = load(m, k, body + FREE_RATE) + load(m, k, body + INVERSE) * pulled
            store(m, k, body + RATE, rate)
            put(m, k, body + VELOCITY, spatial.plus_times(velocity, row(m, k, body + SCREW, 6), rate))
        else:
            put(m, k, body + VELOCITY, velocity)


@ti.func
def row_impulse(m: ti.template(), k, body):
    """The impulse of a hinge's row, beside its push: what its body needs less what it has."""
    needed = spatial.dot(row(m, k, body + COLUMN, 6), row(m, k, body + VELOCITY, 6))
    given = spatial.dot(row(m, k, body + SCREW, 6), row(m, k, body + IMPULSE, 6))
    return needed - given - load(m, k, body + CONTACT) - load(m, k, body + PUSH)


@ti.func
def switch_rows(m: ti.template(), k, plan: ti.template(), table: ti.template(), phase, tolerance, together):
    """Hinges' rows whose impulse left its bounds, or whose rate passed the desired one, change; whether any did.

    All at once; where that goes on in circles, ``together`` being 0, the last one only, which ends (Murty).
    """
    changes = 0.0 * load(m, k, 0)
    for back in range(1, plan[BODIES]):
        b = plan[BODIES] - back
        if table[b * BODY_COLUMNS + HINGED] == 1:
            body = body_at(plan, b)
            impulse = row_impulse(m, k, body)
            low, high = load(m, k, body + LOW), load(m, k, body + HIGH)
            ahead = load(m, k, body + RATE) - load(m, k, body + TARGET)
            mode = load(m, k, body + MODES + phase)
            driven = (mode > -0.5) & (mode < 0.5)
            beyond = select(impulse > high + tolerance, 1.0, select(impulse < low - tolerance, -1.0, 0.0 * impulse))
            passed = ((mode > 0.5) & (ahead > tolerance)) | ((mode < -0.5) & (ahead < 0.0 - tolerance))
            kept = select(passed & (low < high), MODE_DRIVEN, mode)
            after = select(driven, beyond, kept)
            if together == 0:
                after = select(changes > 0.0, mode, after)
            store(m, k, body + MODES + phase, after)
            changes = larger(changes, (after - mode) * (after - mode))
    return changes
