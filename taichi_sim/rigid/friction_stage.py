"""Friction of points on the ground.

Viscous slip: a horizontal impulse of -(h / slip) v, v the point's velocity at the end of the step, without any cone
(ODE with mu = infinity and slip1 = slip2). With a coefficient of friction the strength falls where the impulse would
exceed mu times the normal one; it is found by repetition, and inside the cone the point creeps at slip times the force.
"""

from taichi_sim.lanes import load, smaller, store
from taichi_sim.rigid import spatial
from taichi_sim.rigid.memory import AT, DRIFT, IMPULSES, RUBS, VELOCITY, body_at, point_at, row
from taichi_sim.runtime import ti
from taichi_sim.tracing import select, sqrt

_SLOWEST = 1e-12  # m^2/s^2, keeps a division finite


@ti.func
def rub(m: ti.template(), k, plan: ti.template(), points: ti.template(), listed: ti.template(), block, count, phase,
        strength, friction, correction):  # fmt: skip
    """The strength of each point's friction in the next phase: those rub that push without friction."""
    for n in range(count):
        i = listed[block, n]
        point, body = point_at(plan, i), body_at(plan, points[i])
        pushes = load(m, k, point + IMPULSES) > 0.0
        most = 0.0 * load(m, k, point) + strength
        if phase > 0:
            w, v = ti.static(row(m, k, body + VELOCITY, 3)), ti.static(row(m, k, body + VELOCITY + 3, 3))
            moving = ti.static(spatial.minus_times(
                spatial.plus(v, spatial.cross(w, row(m, k, point + AT, 3))), row(m, k, body + DRIFT, 3), correction
            ))  # fmt: skip
            speed = sqrt(moving[0] * moving[0] + moving[1] * moving[1] + _SLOWEST)
            most = smaller(friction * load(m, k, point + IMPULSES + 1) / speed, most)
        store(m, k, point + RUBS, select(pushes, most, 0.0 * most))
