"""Friction of points on the ground.

Viscous slip: a horizontal impulse of -(h / slip) v, v the point's velocity at the end of the step, without any cone
(ODE with mu = infinity and slip1 = slip2). With a coefficient of friction the strength falls where the impulse would
exceed mu times the normal one; inside the cone the point creeps at slip times the force. That strength is found by
repetition: friction of strength c slowed the point from u to v, so that an impulse takes (u / v - 1) / c times itself
off its speed; the largest impulse, P, leaves u - P (u / v - 1) / c, and has the strength P over that.
"""

from typing import Any

from taichi_sim.autodiff.lanes import larger, smaller
from taichi_sim.autodiff.tracing import primitive, select, sqrt
from taichi_sim.rigid import slots
from taichi_sim.rigid.memory import Block, body_at, listed_point, read, row, setting, write
from taichi_sim.rigid.stages import spatial
from taichi_sim.runtime import ti

_SLOWEST = 1e-12  # m^2/s^2, keeps a division finite
_LEAST = 1e-20  # likewise
ENDLESS = 1e30  # a coefficient of friction that stands for infinity


@primitive
def axes_of(robots: Block, point: Any) -> spatial.Axes:
    """Axes in the plane of uneven ground under a point that friction acts along; None where they are x and y."""
    return None if robots.ground is None else spatial.tangents(row(robots, point + slots.NORMAL, 3))


@ti.func
def rub(robots: ti.template(), count, phase):
    """The strength of each point's friction in the next phase: those rub that push without friction."""
    strength, friction = setting(robots, slots.SLIP_STRENGTH), setting(robots, slots.FRICTION)
    push_out = setting(robots, slots.PUSH_OUT)
    for n in range(count):
        _i, b, point = listed_point(robots, n)
        body = body_at(robots, b)
        pushes = read(robots, point + slots.IMPULSES) > 0.0
        most = 0.0 * read(robots, point) + strength
        if friction < ENDLESS:
            y = ti.static(row(robots, body + slots.VELOCITY, 6))
            of_tree = ti.static(spatial.plus(y[3:], spatial.cross(y[:3], row(robots, point + slots.AT, 3))))
            moving = ti.static(spatial.minus_times(of_tree, row(robots, body + slots.DRIFT, 3), push_out))
            axes = ti.static(axes_of(robots, point))
            sliding = ti.static(spatial.along(axes, moving))
            speed = sqrt(sliding[0] * sliding[0] + sliding[1] * sliding[1] + _SLOWEST)
            if phase == 0:
                write(robots, point + slots.SLIDES, speed)
            else:
                free = read(robots, point + slots.SLIDES)
                largest = friction * read(robots, point + slots.IMPULSES + 1)
                if ti.static(robots.uneven):
                    largest = largest * read(robots, point + slots.ROUGHNESS)
                before = larger(read(robots, point + slots.RUBS), 0.0 * free + _LEAST)
                slowed = larger(free / speed - 1.0, 0.0 * free) / before
                most = smaller(largest / larger(free - largest * slowed, 0.0 * free + _LEAST), most)
        write(robots, point + slots.RUBS, select(pushes, most, 0.0 * most))
