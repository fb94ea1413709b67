"""Granular ground under rigid bodies: what it bears of each point that touches it, and how it holds the point sideways.

The stress on a surface that is pushed into the ground is YIELD times its depth, by the square of the cosine between its
outward normal and the way that it is pushed (see ``ground.laws.outer_share``). Over the surface that belongs to a
point, the part of it that is buried, that is YIELD times a volume:

- straight into the ground, along its normal, it is the largest normal impulse of a step, over h. The ground stops what
  goes in, with as much as it takes up to that; it neither pulls, nor pushes out. So each point's impulse lies between
  two bounds: at the lower one the point leaves, at the upper one (it is *saturated*) it goes on sinking, and between
  them it stands still;
- along the ground, the way that the lowest place slides, 0.37 of it joins the largest impulse of friction: ploughing.

Of each face of a box a quarter belongs to each of its corners, at the corner's depth; where the other end of an edge
is above the ground, only the buried part of it counts. So a box that is level, or tilted about one edge, has what its
faces have, exactly. Of a capsule an end has half of the cylinder in the same way, and its ball by a share that grows
with the cosine between the outward axis and straight down, from 0 to 1: exact of one that lies or stands upright.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial

from taichi_sim.autodiff.elementary import polynomial
from taichi_sim.autodiff.lanes import absolute, larger, smaller
from taichi_sim.autodiff.tracing import primitive, select, sqrt
from taichi_sim.ground.laws import DRAGGED, FIRM
from taichi_sim.rigid import slots
from taichi_sim.rigid.memory import (
    Block,
    body_at,
    count_of,
    entry_at,
    listed_at,
    listed_point,
    patch_at,
    read,
    row,
    setting,
    write,
)
from taichi_sim.rigid.stages import spatial
from taichi_sim.runtime import emit, ti

Reals = Sequence[Any]
LEAST = 1e-12  # m, keeps divisions finite
LEAST_SQUARE = 1e-20  # m^2/s^2, likewise; a point that slides more slowly ploughs less
UPRIGHT = 1e-4  # squared sine of an axis that stands upright, which its derivative needs
UNBOUNDED = 1e30  # N s: what firm ground bears
MOST_ROUNDS = 300  # solutions with other members in a phase; no fewer than ``contact.MOST_PIVOTS``


def _half_cylinder(weight: Callable[[Any], Any], power: float) -> Mapping[bool, list[float]]:
    """Series in s of the integral of (cos a - 1 + s) weight(a) from a = 0 to where it is 0, over s^power, for s <= 1.

    It is that over half of a cylinder sunk by s of its radius: of depth by the square of a component of the normal.
    """
    x, weights = np.polynomial.legendre.leggauss(40)

    def mean(s: Any) -> Any:
        widest = 2 * np.arcsin(np.sqrt(s / 2))
        angles = widest * (x[:, None] + 1) / 2
        heights = 2 * (np.sin(widest / 2) ** 2 - np.sin(angles / 2) ** 2)
        return widest / 2 * (weights @ (heights * weight(angles))) / s**power

    found = {}
    for single, degree in ((True, 9), (False, 16)):
        series = Chebyshev.interpolate(mean, degree, [0.0, 1.0]).convert(kind=Polynomial, domain=[-1, 1])
        found[single] = [float(c) for c in series.coef]
    return found


_LYING, _ACROSS = _half_cylinder(lambda a: np.cos(a) ** 2, 1.5), _half_cylinder(lambda a: np.sin(a) ** 2, 2.5)


@primitive
def ball_bears(s: Any) -> Any:
    """Integral over a ball of radius R sunk by s R of depth by cos^2 from straight down, over pi R^3 / 6."""
    below = emit(smaller(s, 0.0 * s + 1.0))
    return emit(below * below * (6.0 - 4.0 * below + below * below) + 4.0 * (s - below))


@primitive
def ball_ploughs(s: Any) -> tuple[Any, Any]:
    """The same integral by cos^2 from one way along the ground, over the lower half of the ball and the upper one."""
    low, below = emit(smaller(s, 0.0 * s + 1.0)), emit(smaller(s, 0.0 * s + 2.0))
    lower = emit(0.25 * low * low * low * (4.0 - low) + 2.0 * (s - low))
    return lower, emit(0.25 * below * below * below * (4.0 - below) + 4.0 * (s - below) - lower)


@primitive
def cylinder_bears(s: Any) -> Any:
    """Integral over a lying cylinder of radius R sunk by s R of depth by cos^2 from straight down, over 2 R^2."""
    below = emit(smaller(s, 0.0 * s + 1.0))
    return emit(below * sqrt(below + LEAST) * polynomial(_LYING, below) + 0.25 * math.pi * (s - below))


@primitive
def cylinder_ploughs(s: Any) -> Any:
    """The same from one way across it, over R^2."""
    past = larger(s - 1.0, 0.0 * s)
    near = emit(larger(smaller(s, 2.0 - s), 0.0 * s))
    return emit(near * near * sqrt(near + LEAST) * polynomial(_ACROSS, near) + 0.5 * math.pi * past)


@primitive
def _buried(depth: Any, rise: Any) -> Any:
    """Share of an edge in the ground that begins at a depth and rises by so much."""
    return emit(depth / larger(larger(rise, depth), LEAST + 0.0 * depth))


@primitive
def _corner(edges: Reals, rotation: Reals, depth: Any, up: Reals, way: Reals) -> Any:
    """Integral over a quarter of the faces that meet at a corner of a box of depth by cos^2 from a way."""
    columns = [rotation[k::3] for k in range(3)]
    parts, ahead = [], []
    for edge, column in zip(edges, columns, strict=True):
        part = _buried(depth, emit(edge * spatial.dot(column, up)))
        outwards = emit(select(edge < 0.0, spatial.dot(column, way), 0.0 - spatial.dot(column, way)))
        leading = emit(larger(outwards, 0.0 * outwards))
        parts.append(emit(absolute(edge) * part))
        ahead.append(emit(leading * leading))
    areas = parts[1] * parts[2] * ahead[0] + parts[2] * parts[0] * ahead[1] + parts[0] * parts[1] * ahead[2]
    return emit(0.25 * depth * areas)


@primitive
def buried_surface(*values: Any) -> tuple[Any, Any]:
    """Integrals over the surface of a point of depth by cos^2 [m^3]: from straight down, and from a way along ground.

    Values: the patch (9), radius, rotation (9), depth; then the ground's normal (3) and the way (3).
    """
    (even, turned, length), axis_at_rest, edges, (radius,), rotation, (depth,) = spatial.cut(values, 3, 3, 3, 1, 9, 1)
    up, way = values[20:23], values[23:26]
    depth = emit(larger(depth, 0.0 * depth))
    axis, down = spatial.turned(rotation, axis_at_rest), [emit(0.0 - x) for x in up]
    straight, aside = spatial.dot(axis, down), spatial.dot(axis, way)
    cubed = emit(math.pi / 6.0 * radius * radius * radius)
    lower, upper = (emit(cubed * (even + side * turned * straight)) for side in (1.0, -1.0))
    s = emit(depth / larger(radius, LEAST + 0.0 * radius))
    sine = emit(sqrt(1.0 - straight * straight + UPRIGHT * straight * straight))
    across = emit(radius * sine)
    deep = depth - radius + across  # of the lowest line of the cylinder at this end
    deep = emit(larger(deep, 0.0 * deep))
    side = emit(length * radius * across * _buried(deep, emit(length * straight)))
    of_side = emit(deep / larger(across, LEAST + 0.0 * across))
    of_lower, of_upper = ball_ploughs(s)
    bears = lower * ball_bears(s) + side * sine * sine * cylinder_bears(of_side)
    ploughs = lower * of_lower + upper * of_upper + 0.5 * side * (1.0 - aside * aside) * cylinder_ploughs(of_side)
    corner_bears, corner_ploughs = (_corner(edges, rotation, depth, up, each) for each in (down, way))
    return emit(bears + corner_bears), emit(ploughs + corner_ploughs)


@primitive
def sand_work(*values: Any) -> Any:
    """``laws.uneven_contact_work`` of a point on ground that yields, or not.

    Values: the patch (9), rotation (9), place (3), drift (3), offset (3), radius, place of the base (3), y (6), z (6),
    strength of friction; then normal impulse, multiplier, push-out rate, drifting, slope of the push-out by the depth,
    normal (3), depth of the level z = 0 along it, stress per depth times time step, saturated, whether it yields.
    """
    patch, rotation, place, drift, offset, (radius,), base, y, z = spatial.cut(values, 9, 9, 3, 3, 3, 1, 3, 6, 6)
    strength, impulse, multiplier, push_out, drifting, rise, *normal = values[43:52]
    level, stress, saturated, yields = values[52:]
    axes = spatial.tangents(normal)
    at = spatial.plus(place, spatial.turned(rotation, offset))
    height = spatial.dot(spatial.plus(base, at), normal)
    drifted = spatial.dot(drift, normal)
    none = [0.0 * x for x in normal]
    limit, _ = buried_surface(*patch, radius, *rotation, emit(radius - height - drifted + level), *normal, *none)
    borne = select(saturated > 0.5, stress * limit, impulse)
    wanted = select(yields > 0.5, push_out * drifted, rise * (radius - height) + (push_out - rise) * drifted)
    lowest = [x - radius * n for x, n in zip(at, normal, strict=True)]
    moving = spatial.plus(y[3:], spatial.cross(y[:3], lowest))
    other = spatial.plus(z[3:], spatial.cross(z[:3], lowest))
    sliding = spatial.minus_times(moving, drift, push_out) if drifting else moving
    pushed = borne * spatial.dot(other, normal) + multiplier * (wanted - spatial.dot(moving, normal))
    return pushed - strength * spatial.dot(spatial.along(axes, sliding), spatial.along(axes, other))


@primitive
def sandy_at(robots: Block, i: Any) -> Any:
    """First slot of what sand knows of a point in a step."""
    return emit(count_of(robots, slots.SANDY_POINT) + i * slots.SANDY_POINT_WIDTH)


@primitive
def listed_sandy(robots: Block, n: Any) -> Any:
    """First slot of what sand knows of a listed point in a step."""
    return sandy_at(robots, listed_point(robots, n)[0])


@primitive
def yield_per_depth(robots: Block) -> Any:
    """Stress per depth at which the ground yields [N/m^3]; at least ``FIRM`` where it does not."""
    return read(robots, count_of(robots, slots.SAND))


@primitive
def _surface(robots: Block, i: Any, body: Any, point: Any, way: Reals) -> tuple[Any, Any]:
    """:func:`buried_surface` of a point."""
    patch = row(robots, patch_at(robots, i), slots.PATCH_WIDTH)
    radius = read(robots, count_of(robots, slots.POINT_PARAMETER) + i * slots.POINT_PARAMETER_WIDTH + 3)
    pose = (radius, *row(robots, body + slots.ROTATION, 9), read(robots, point + slots.DEEP))
    return buried_surface(*patch, *pose, *row(robots, point + slots.NORMAL, 3), *way)


@primitive
def ploughing(robots: Block, n: Any, sliding: Reals, axes: Any) -> Any:
    """What joins the largest impulse of friction of a listed point that slides so along two axes; of firm ground, 0."""
    i, b, point = listed_point(robots, n)
    inverse = emit(1.0 / sqrt(sliding[0] * sliding[0] + sliding[1] * sliding[1] + LEAST_SQUARE))
    way = spatial.back_along(axes, emit(sliding[0] * inverse), emit(sliding[1] * inverse))
    _, ploughs = _surface(robots, i, body_at(robots, b), point, way)
    stress = yield_per_depth(robots)
    held = DRAGGED * setting(robots, slots.TIME_STEP) * stress * ploughs
    return emit(select(stress < FIRM, held, 0.0 * held))


@primitive
def unless_yielding(robots: Block, speed: Any) -> Any:
    """How fast a point is pushed out: not at all where the ground yields."""
    return select(yield_per_depth(robots) < FIRM, 0.0 * speed, speed)


@ti.func
def limit_normals(robots: ti.template(), count):
    """The largest normal impulse of each listed point."""
    for n in range(count):
        i, b, point = listed_point(robots, n)
        zero = 0.0 * read(robots, point + slots.DEEP)
        surface = ti.static(_surface(robots, i, body_at(robots, b), point, (zero, zero, zero)))
        stress = yield_per_depth(robots)
        most = setting(robots, slots.TIME_STEP) * stress * surface[0]
        write(robots, sandy_at(robots, i) + slots.LIMIT, select(stress < FIRM, most, zero + UNBOUNDED))


@ti.func
def begin_saturated(robots: ti.template(), n, phase):
    """Begin with those points at their largest impulse that had it in the last step, beside the members."""
    point, sandy = listed_at(robots, n), listed_sandy(robots, n)
    impulse, member = read(robots, point + slots.IMPULSES + phase), read(robots, point + slots.MEMBER)
    limit = read(robots, sandy + slots.LIMIT)
    full = impulse >= limit
    write(robots, sandy + slots.SATURATED, select(full, member, 0.0 * member))
    write(robots, sandy + slots.WITHIN, smaller(impulse, limit))
    write(robots, point + slots.MEMBER, select(full, 0.0 * member, member))


@ti.func
def saturated_share(robots: ti.template(), count, n):
    """What saturated points add to the velocity of a listed one."""
    share = 0.0 * read(robots, slots.POSITION)
    for l in range(count):
        sandy = listed_sandy(robots, l)
        entry = read(robots, entry_at(robots, slots.MATRIX, ti.max(n, l), ti.min(n, l)))
        share = share + entry * (read(robots, sandy + slots.SATURATED) * read(robots, sandy + slots.LIMIT))
    return share


@ti.func
def with_saturated(robots: ti.template(), n, impulse):
    """The impulse of a listed point: its largest one if it is saturated, else as given."""
    sandy = listed_sandy(robots, n)
    saturated = read(robots, sandy + slots.SATURATED) > 0.5
    return select(saturated, read(robots, sandy + slots.LIMIT), impulse)


@ti.func
def bounded_violation(robots: ti.template(), n, amount, impulse, short):
    """How far a listed point violates its conditions, as a member, saturated, or neither, which gives ``amount``.

    ``short`` is what its velocity lacks of the one at which it stands still.
    """
    sandy = listed_sandy(robots, n)
    member = read(robots, listed_at(robots, n) + slots.MEMBER) > 0.5
    beyond = larger(amount, impulse - read(robots, sandy + slots.LIMIT))
    saturated = read(robots, sandy + slots.SATURATED) > 0.5
    return select(member, beyond, select(saturated, 0.0 - short, amount))


@ti.func
def marked(robots: ti.template(), wrong, amount, late):
    """The mark of a violator: of robots on sand by how much it violates its conditions, else 1, or 0 if it is late."""
    on_firm = 1.0 + 0.0 * amount
    if late:
        on_firm = 0.0 * amount
    mark = select(yield_per_depth(robots) < FIRM, amount, on_firm)
    return select(wrong, mark, 0.0 * amount)


@ti.func
def give_up_on_firm(robots: ti.template(), worst):
    """Note the largest violation of robots on firm ground whose pivots are used up; they have no more rounds alone."""
    on_firm = select(yield_per_depth(robots) < FIRM, 0.0 * worst, worst)
    write(robots, slots.RESIDUAL, larger(on_firm, read(robots, slots.RESIDUAL)))


@ti.func
def is_member(robots: ti.template(), n):
    """Whether a listed point is one of those that stand still."""
    return read(robots, listed_at(robots, n) + slots.MEMBER) > 0.5


@ti.func
def way_within(robots: ti.template(), n, phase):
    """Part of the way from a listed point's impulse to the one that was solved for that is within its bounds."""
    point, sandy = listed_at(robots, n), listed_sandy(robots, n)
    within, solved = read(robots, sandy + slots.WITHIN), read(robots, point + slots.IMPULSES + phase)
    bound = select(solved > within, read(robots, sandy + slots.LIMIT), 0.0 * within)
    leaves = is_member(robots, n) & (read(robots, point + slots.EXCESS) > 0.0)
    return select(leaves, (bound - within) / (solved - within), 1.0 + 0.0 * within)


@ti.func
def move_within_bounds(robots: ti.template(), count, phase):
    """Change members and saturated points of robots on sand, whose violations are noted; none stay so.

    Impulses are the least of a convex function between two bounds each, as the matrix is definite: so they go towards
    the solution of the members, as far as all stay within bounds, and whose bound ends the way is a member no more.
    Where none does, the one that violates the condition at its bound most becomes a member. So the function never
    grows, and the same members are never met again. (BVLS: Stark, Parker, Computational Statistics 10 (1995) 129.
    Pivoting, as on firm ground, takes hundreds of rounds where many points share few bodies.)
    """
    sandy_robot = yield_per_depth(robots) < FIRM
    way = 0.0 * read(robots, slots.POSITION) + 1.0
    worst = 0.0 * way
    for n in range(count):
        way = smaller(way_within(robots, n, phase), way)
        excess = read(robots, listed_at(robots, n) + slots.EXCESS)
        worst = larger(worst, select(is_member(robots, n), 0.0 * way, excess))
    for n in range(count):
        point, sandy = listed_at(robots, n), listed_sandy(robots, n)
        within, solved = read(robots, sandy + slots.WITHIN), read(robots, point + slots.IMPULSES + phase)
        limit, excess = read(robots, sandy + slots.LIMIT), read(robots, point + slots.EXCESS)
        member = is_member(robots, n)
        stops = sandy_robot & member & (excess > 0.0) & (way_within(robots, n, phase) <= way)
        above = solved > within
        reached = smaller(larger(within + way * (solved - within), 0.0 * way), limit)
        after = select(stops, select(above, limit, 0.0 * way), select(way < 1.0, reached, solved))
        after = select(sandy_robot & member, after, solved)
        freed = sandy_robot & (excess > 0.0) & (excess >= worst) & (way >= 1.0) & (worst > 0.0)
        freed = freed & (read(robots, point + slots.MEMBER) < 0.5)
        saturated = select(freed, 0.0 * way, read(robots, sandy + slots.SATURATED))
        write(robots, point + slots.IMPULSES + phase, after)
        write(robots, sandy + slots.WITHIN, smaller(larger(after, 0.0 * way), limit))
        write(robots, sandy + slots.SATURATED, select(stops & above, 1.0, saturated))
        before = read(robots, point + slots.MEMBER)
        write(robots, point + slots.MEMBER, select(stops, 0.0 * way, select(freed, 1.0, before)))
    for n in range(count):
        slot = listed_at(robots, n) + slots.EXCESS
        write(robots, slot, select(sandy_robot, 0.0 * way, read(robots, slot)))


@ti.func
def bounded_impulse(robots: ti.template(), n, impulse):
    """An impulse without what rounding has added to the largest one; remembered as the one within bounds."""
    sandy = listed_sandy(robots, n)
    limit = read(robots, sandy + slots.LIMIT)
    bounded = select(impulse > limit, limit, impulse)  # a NaN stays one
    write(robots, sandy + slots.WITHIN, bounded)
    return bounded


@ti.func
def forget_limits(motion: ti.template()):
    """Saturated points have no impulse in the adjoint motion: theirs do not depend on the step's velocities."""
    for i in range(motion.plan[slots.POINTS]):
        write(motion, sandy_at(motion, i) + slots.LIMIT, 0.0 * read(motion, slots.POSITION))


@primitive
def constants_of(robots: Block, n: Any) -> tuple[Any, ...]:
    """The last constants of ``sand_work`` for a listed point."""
    i, b, point = listed_point(robots, n)
    normal, stress = row(robots, point + slots.NORMAL, 3), yield_per_depth(robots)
    drift = row(robots, body_at(robots, b) + slots.DRIFT, 3)
    lowest = spatial.plus(spatial.plus(row(robots, slots.POSITION, 3), drift), row(robots, point + slots.AT, 3))
    level = emit(read(robots, point + slots.DEEP) + spatial.dot(lowest, normal))
    none = 0.0 * stress
    per_depth = select(stress < FIRM, stress * setting(robots, slots.TIME_STEP), none)
    saturated = read(robots, sandy_at(robots, i) + slots.SATURATED)
    return level, emit(per_depth), saturated, emit(select(stress < FIRM, none + 1.0, none))
