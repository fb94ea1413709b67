"""Friction of points on the ground.

Viscous slip: a horizontal impulse of -(h / slip) v, v the point's velocity at the end of the step, without any cone
(ODE with mu = infinity and slip1 = slip2). With a coefficient of friction the strength c of a point, which gives it the
impulse c v, falls where that would exceed the largest one, P = mu times the normal one; inside the cone the point
creeps at slip times the force. The strength P / v is found by repetition: friction slowed the point from u to v with
impulses whose sum over all points that slide was F, and that of their P is what they should have been, so the next
speed is u - (P / F) (u - v). A sum, as friction that pitches a body loads some of its points and takes the load off
others, which says nothing of how they will be slowed together. A point that held may slide: it counts by itself.
"""

from typing import Any

from taichi_sim.autodiff.lanes import larger, smaller
from taichi_sim.autodiff.tracing import primitive, select, sqrt
from taichi_sim.rigid import slots
from taichi_sim.rigid.memory import Block, body_at, listed_point, read, row, setting, write
from taichi_sim.rigid.stages import spatial
from taichi_sim.rigid.stages.sand import ploughing
from taichi_sim.runtime import ti

_SLOWEST = 1e-12  # m^2/s^2, keeps a division finite
_LEAST = 1e-20  # likewise
ENDLESS = 1e30  # a coefficient of friction that stands for infinity


@primitive
def axes_of(robots: Block, point: Any) -> spatial.Axes:
    """Axes in the plane of uneven ground under a point that friction acts along; None where they are x and y."""
    return None if robots.ground is None else spatial.tangents(row(robots, point + slots.NORMAL, 3))


@primitive
def sliding_of(robots: Block, point: Any, body: Any, push_out: Any) -> Any:
    """Velocity of a point along the ground, in the axes that friction acts along."""
    y = row(robots, body + slots.VELOCITY, 6)
    of_tree = spatial.plus(y[3:], spatial.cross(y[:3], row(robots, point + slots.AT, 3)))
    moving = spatial.minus_times(of_tree, row(robots, body + slots.DRIFT, 3), push_out)
    return spatial.along(axes_of(robots, point), moving)


@primitive
def sliding_speed(robots: Block, point: Any, body: Any, push_out: Any) -> Any:
    """How fast a point slides on the ground."""
    sliding = sliding_of(robots, point, body, push_out)
    return sqrt(sliding[0] * sliding[0] + sliding[1] * sliding[1] + _SLOWEST)


@primitive
def largest_impulse(robots: Block, n: Any, point: Any, phase: Any, push_out: Any) -> Any:
    """The largest impulse of friction that the cone allows a listed point that pushed as it did in the last phase.

    On sand with what ploughing adds to it, as the point slides.
    """
    largest = setting(robots, slots.FRICTION) * read(robots, point + slots.IMPULSES + ti.min(phase, 1))
    if robots.uneven:
        largest = largest * read(robots, point + slots.ROUGHNESS)
    if robots.granular:
        _, b, _ = listed_point(robots, n)
        sliding = sliding_of(robots, point, body_at(robots, b), push_out)
        largest = largest + ploughing(robots, n, sliding, axes_of(robots, point))
    return largest


@ti.func
def allowed_share(robots: ti.template(), count, phase):
    """What the cones allow points that slide, all together, over the impulses that they had in the last phase."""
    strength, push_out = read(robots, slots.SLIP_STRENGTH), setting(robots, slots.PUSH_OUT)
    allowed = 0.0 * read(robots, slots.RESIDUAL)
    had = allowed + _LEAST
    for n in range(count):
        _i, b, point = listed_point(robots, n)
        before = read(robots, point + slots.RUBS)
        slides = (before > 0.0) & (before < strength)
        impulse = before * sliding_speed(robots, point, body_at(robots, b), push_out)
        allowed = allowed + select(slides, largest_impulse(robots, n, point, phase, push_out), 0.0 * before)
        had = had + select(slides, impulse, 0.0 * before)
    return allowed / had


@ti.func
def rub(robots: ti.template(), count, phase):
    """The strength of each point's friction in the next phase: those rub that push."""
    strength, friction = read(robots, slots.SLIP_STRENGTH), setting(robots, slots.FRICTION)
    push_out = setting(robots, slots.PUSH_OUT)
    together = 0.0 * read(robots, slots.RESIDUAL)
    if friction < ENDLESS and phase > 0:
        together = allowed_share(robots, count, phase)
    for n in range(count):
        _i, b, point = listed_point(robots, n)
        pushes = read(robots, point + slots.IMPULSES) > 0.0
        most = 0.0 * read(robots, point) + strength
        if friction < ENDLESS:
            speed = sliding_speed(robots, point, body_at(robots, b), push_out)
            largest = largest_impulse(robots, n, point, phase, push_out)
            if phase == 0:
                write(robots, point + slots.SLIDES, speed)
            free, before = read(robots, point + slots.SLIDES), read(robots, point + slots.RUBS)
            alone = largest / larger(before * speed, 0.0 * speed + _LEAST)
            share = select(before < strength, 0.0 * alone + together, alone)
            left = free - share * larger(free - speed, 0.0 * free)
            # Without friction so far nothing tells how much it slows: it leaves no more than the speed.
            left = select((before > 0.0) & (phase > 0), left, speed)
            most = smaller(largest / larger(left, 0.0 * left + _LEAST), most)
            pushes = largest > 0.0
        write(robots, point + slots.RUBS, select(pushes, most, 0.0 * most))
