"""Friction of points on the ground.

Viscous slip: a horizontal impulse of -(h / slip) v, v the point's velocity at the end of the step, without any cone
(ODE with mu = infinity and slip1 = slip2). With a coefficient of friction the strength falls where the impulse would
exceed mu times the normal one; inside the cone the point creeps at slip times the force. That strength is found by
repetition: friction of strength c slowed the point from u to v, so that an impulse takes (u / v - 1) / c times itself
off its speed; the largest impulse, P, leaves u - P (u / v - 1) / c, and has the strength P over that.
"""

from taichi_sim.autodiff.lanes import larger, load, smaller, store
from taichi_sim.autodiff.tracing import select, sqrt
from taichi_sim.rigid.memory import AT, DRIFT, IMPULSES, RUBS, SLIDES, VELOCITY, body_at, point_at, row
from taichi_sim.rigid.stages import spatial
from taichi_sim.runtime import ti

_SLOWEST = 1e-12  # m^2/s^2, keeps a division finite
_LEAST = 1e-20  # likewise
ENDLESS = 1e30  # a coefficient of friction that stands for infinity


@ti.func
def rub(
    m: ti.template(),
    k,
    plan: ti.template(),
    points: ti.template(),
    listed: ti.template(),
    block,
    count,
    phase,
    strength,
    friction,
    correction,
):
    """The strength of each point's friction in the next phase: those rub that push without friction."""
    for n in range(count):
        i = listed[block, n]
        point, body = point_at(plan, i), body_at(plan, points[i])
        pushes = load(m, k, point + IMPULSES) > 0.0
        most = 0.0 * load(m, k, point) + strength
        if friction < ENDLESS:
            w, v = ti.static(row(m, k, body + VELOCITY, 3)), ti.static(row(m, k, body + VELOCITY + 3, 3))
            moving = ti.static(
                spatial.minus_times(
                    spatial.plus(v, spatial.cross(w, row(m, k, point + AT, 3))), row(m, k, body + DRIFT, 3), correction
                )
            )
            speed = sqrt(moving[0] * moving[0] + moving[1] * moving[1] + _SLOWEST)
            if phase == 0:
                store(m, k, point + SLIDES, speed)
            else:
                free, largest = load(m, k, point + SLIDES), friction * load(m, k, point + IMPULSES + 1)
                slowed = larger(free / speed - 1.0, 0.0 * free) / larger(load(m, k, point + RUBS), 0.0 * free + _LEAST)
                most = smaller(largest / larger(free - largest * slowed, 0.0 * free + _LEAST), most)
        store(m, k, point + RUBS, select(pushes, most, 0.0 * most))
