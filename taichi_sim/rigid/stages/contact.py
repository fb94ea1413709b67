"""Points that touch the ground: which, their rows of the factored mass matrix, and the complementarity of normals.

With M = L^T D L of the articulated tree, the matrix of normal rows is A = (L^-T J^T)^T D^-1 (L^-T J^T); a point's row
holds an entry for each hinge between it and the base, and six for the base.
"""

from taichi_sim.autodiff.lanes import any_lane, larger
from taichi_sim.autodiff.tracing import select, sqrt
from taichi_sim.ground import laws as uneven
from taichi_sim.rigid import slots
from taichi_sim.rigid.memory import (
    assign,
    body_at,
    cell_under,
    column,
    entry_at,
    hinge_on_path,
    listed_at,
    listed_in_plan,
    listed_point,
    per_cell,
    point_at,
    put,
    read,
    row,
    setting,
    variables,
    write,
)
from taichi_sim.rigid.stages import laws, sand, spatial
from taichi_sim.runtime import ti

MOST_PIVOTS = 300  # solutions with other members; 60 leave robots unsolved that are shaken hard
PIVOTS_OF_STUDIES = 60  # in their solver
FALLEN = 1.0  # m: the depth at which a point that has no solution shows that its robot falls through the ground
BLOCK_FLIPS = 5.0  # of all violators at once without there being fewer; then one at a time, which always ends


@ti.func
def find_ground(robots: ti.template(), x, y, z, radius):
    """Depth of a ball in uneven ground, whose plane under its centre it touches; its normal and factor of friction."""
    height, nx, ny, nz, factor = uneven.ground(x, y, *cell_under(robots, x, y), per_cell(robots))
    return uneven.penetration(2.0 * radius, 0.0 * radius, z, height, nz), nx, ny, nz, factor


@ti.func
def at_ground(robots: ti.template(), depth):
    """Whether a point so deep in the ground touches it, or is above it by rounding only, which must not decide."""
    return depth >= 0.0 - read(robots, slots.TOUCH_TOLERANCE)


@ti.func
def find_contacts(robots: ti.template()):
    """Depths of all points; lists those that touch in any lane, sets touch sensors, returns their number."""
    touching = setting(robots, slots.TOUCHING)
    count = 0
    for i in range(robots.plan[slots.POINTS]):
        b = listed_in_plan(robots, slots.POINT_BODIES, i)
        body, point = body_at(robots, b), point_at(robots, i)
        given = robots.plan[slots.POINT_PARAMETER] + i * slots.POINT_PARAMETER_WIDTH
        arm = ti.static(spatial.turned(row(robots, body + slots.ROTATION, 9), row(robots, given, 3)))
        at = ti.static(spatial.plus(row(robots, body + slots.PLACE, 3), arm))
        radius = read(robots, given + 3)
        depth = radius
        if ti.static(not robots.uneven):
            height = read(robots, slots.POSITION + 2) + at[2] + read(robots, body + slots.DRIFT + 2)
            depth = radius - height
            put(robots, point + slots.AT, (at[0], at[1], at[2] - radius))
        else:
            of_tree = ti.static(spatial.plus(row(robots, slots.POSITION, 3), at))
            x, y, z = ti.static(spatial.plus(of_tree, row(robots, body + slots.DRIFT, 3)))
            depth, nx, ny, nz, factor = find_ground(robots, x, y, z, radius)
            put(robots, point + slots.AT, spatial.minus_times(at, (nx, ny, nz), radius))
            put(robots, point + slots.NORMAL, (nx, ny, nz, factor))
        write(robots, point + slots.DEEP, depth)
        touches = at_ground(robots, depth)
        for phase in ti.static(range(2)):
            slot = point + slots.IMPULSES + phase
            write(robots, slot, select(touches, read(robots, slot), 0.0))
        sensor = column(robots, b, slots.TOUCH)
        if sensor >= 0:
            slot = robots.plan[slots.READING] + sensor
            write(robots, slot, select(touches, touching, read(robots, slot)))
        if any_lane(touches):
            robots.listed[robots.number, count] = i
            count += 1
    return count


@ti.func
def reduce_points(robots: ti.template(), count, push_out):
    """Rows of the factored matrix, and how much each point's free velocity falls short."""
    floating = setting(robots, slots.FLOATING)
    for n in range(count):
        _i, b, point = listed_point(robots, n)
        x, y = read(robots, point + slots.AT), read(robots, point + slots.AT + 1)
        zero = 0.0 * x
        left = ti.static(variables(6, zero))
        if ti.static(not robots.uneven):
            assign(left, (y, 0.0 - x, zero, zero, zero, zero + 1.0))
        else:
            normal = ti.static(row(robots, point + slots.NORMAL, 3))
            assign(left, spatial.joined(spatial.cross(row(robots, point + slots.AT, 3), normal), normal))
        free = zero
        length = column(robots, b, slots.PATH_LENGTH)
        for back in range(length):
            d = length - 1 - back
            hinge = body_at(robots, hinge_on_path(robots, b, d))
            share = spatial.dot(row(robots, hinge + slots.SCREW, 6), left)
            write(robots, point + slots.HINGES + d, share)
            free = free + share * read(robots, hinge + slots.FREE_RATE)
            lost = share * read(robots, hinge + slots.INVERSE)
            assign(left, spatial.minus_times(left, row(robots, hinge + slots.COLUMN, 6), lost))
        free = free + spatial.dot(left, row(robots, body_at(robots, 0) + slots.VELOCITY, 6))
        reduced = ti.static(spatial.forward(row(robots, slots.ROOT, 21), left))
        put(robots, point + slots.ROW, [x * floating for x in reduced])
        deep, drift = read(robots, point + slots.DEEP), read(robots, body_at(robots, b) + slots.DRIFT + 2)
        risen = laws.pushed_out(deep, push_out)
        if ti.static(robots.uneven):
            drifted = ti.static(row(robots, body_at(robots, b) + slots.DRIFT, 3))
            drift = spatial.dot(row(robots, point + slots.NORMAL, 3), drifted)
        if ti.static(robots.granular):
            risen = sand.unless_yielding(robots, risen)
        write(robots, point + slots.RIGHT, risen + push_out * drift - free)


@ti.func
def fill_matrix(robots: ti.template(), count):
    """The matrix of normal rows, its lower triangle; the compliance on its diagonal makes it definite.

    That of four points in a plane is singular, and its entries are as large as robots are light: so compliance is a
    part of the entry at least, beyond what rounding leaves.
    """
    compliance, least = setting(robots, slots.COMPLIANCE), setting(robots, slots.LEAST_COMPLIANCE)
    for n in range(count):
        _i, b, point = listed_point(robots, n)
        mine = ti.static(row(robots, point + slots.ROW, 6))
        for l in range(n + 1):
            _j, c, other = listed_point(robots, l)
            value = spatial.dot(mine, row(robots, other + slots.ROW, 6))
            shared = ti.min(column(robots, b, slots.PATH_LENGTH), column(robots, c, slots.PATH_LENGTH))
            for d in range(shared):
                hinge = hinge_on_path(robots, b, d)
                if hinge == hinge_on_path(robots, c, d):
                    both = read(robots, point + slots.HINGES + d) * read(robots, other + slots.HINGES + d)
                    value = value + both * read(robots, body_at(robots, hinge) + slots.INVERSE)
            if n == l:
                value = value + larger(least * value, 0.0 * value + compliance)
            write(robots, entry_at(robots, slots.MATRIX, n, l), value)


@ti.func
def solve_members(robots: ti.template(), count, phase):
    """Impulses of the points that push: those make their velocities as required; the others' are zero.

    On sand those of saturated points are their largest ones.
    """
    for n in range(count):
        point = listed_at(robots, n)
        member, right = read(robots, point + slots.MEMBER), read(robots, point + slots.RIGHT)
        if ti.static(robots.granular):
            right = right - sand.saturated_share(robots, count, n)
        value = member * right
        factor_n = entry_at(robots, slots.FACTOR, n, 0)
        for l in range(n):
            other = listed_at(robots, l)
            factor_l = entry_at(robots, slots.FACTOR, l, 0)
            entry = member * read(robots, other + slots.MEMBER) * read(robots, entry_at(robots, slots.MATRIX, n, l))
            for j in range(l):
                entry = entry - read(robots, factor_n + j) * read(robots, factor_l + j)
            entry = entry * read(robots, factor_l + l)
            write(robots, factor_n + l, entry)
            value = value - entry * read(robots, other + slots.SCRATCH)
        diagonal = select(member > 0.5, read(robots, entry_at(robots, slots.MATRIX, n, n)), 1.0)
        for l in range(n):
            entry = read(robots, factor_n + l)
            diagonal = diagonal - entry * entry
        inverse = 1.0 / sqrt(diagonal)
        write(robots, factor_n + n, inverse)
        write(robots, point + slots.SCRATCH, value * inverse)
    for back in range(count):
        n = count - 1 - back
        point = listed_at(robots, n)
        value = read(robots, point + slots.SCRATCH)
        for l in range(n + 1, count):
            impulse = read(robots, listed_at(robots, l) + slots.IMPULSES + phase)
            value = value - read(robots, entry_at(robots, slots.FACTOR, l, n)) * impulse
        impulse = value * read(robots, entry_at(robots, slots.FACTOR, n, n))
        if ti.static(robots.granular):
            impulse = sand.with_saturated(robots, n, impulse)
        write(robots, point + slots.IMPULSES + phase, impulse)


@ti.func
def violations(robots: ti.template(), count, phase, late, active):
    """Marks points that pull, sink in without pushing, or have more than sand bears; how many, and by how much at most.

    A mark is 1, of robots on sand the violation, and 0 in robots that are not ``active``: these are left as they are.
    ``late`` is for batches with sand: so are robots on firm ground then, as they are alone.
    """
    tolerance, of_impulse = setting(robots, slots.TOLERANCE), read(robots, slots.IMPULSE_TOLERANCE)
    number = 0.0 * read(robots, 0)
    worst = number
    for n in range(count):
        point = listed_at(robots, n)
        impulse = read(robots, point + slots.IMPULSES + phase)
        short = read(robots, point + slots.RIGHT)
        for l in range(count):
            entry = read(robots, entry_at(robots, slots.MATRIX, ti.max(n, l), ti.min(n, l)))
            short = short - entry * read(robots, listed_at(robots, l) + slots.IMPULSES + phase)
        pushes = read(robots, point + slots.MEMBER) > 0.5
        touches = at_ground(robots, read(robots, point + slots.DEEP))
        amount = select(pushes, 0.0 - impulse, select(touches, short, 0.0))
        if ti.static(robots.granular):
            amount = sand.bounded_violation(robots, n, amount, impulse, short)
        if ti.static(not robots.drifting):
            amount = select(amount < sand.UNBOUNDED, amount, sand.UNBOUNDED)  # a NaN is the worst of all
        wrong = (amount > select(pushes, of_impulse, tolerance)) & (active > 0.5)
        mark = select(wrong, 1.0, 0.0 * amount)
        if ti.static(robots.granular):
            mark = sand.marked(robots, wrong, amount, late)
        write(robots, point + slots.EXCESS, mark)
        number = number + select(mark > 0.0, 1.0, 0.0)
        worst = larger(select(wrong, amount, 0.0 * amount), worst)
    return number, worst


@ti.func
def touching(robots: ti.template(), count):
    """Whether a robot touches the ground: 1, or 0."""
    found = 0.0 * read(robots, 0)
    for n in range(count):
        touches = at_ground(robots, read(robots, listed_at(robots, n) + slots.DEEP))
        found = select(touches, 1.0 + 0.0 * found, found)
    return found


@ti.func
def choose_members(robots: ti.template(), count, phase):
    """Begin with the points that pushed in the last step."""
    for n in range(count):
        point = listed_at(robots, n)
        pushed = read(robots, point + slots.IMPULSES + phase) > 0.0
        write(robots, point + slots.MEMBER, select(pushed, 1.0, 0.0))
        if ti.static(robots.granular):
            sand.begin_saturated(robots, n, phase)


@ti.func
def solve_normals(robots: ti.template(), count, phase, active):
    """Normal impulses, exactly: those push that must, and no other point sinks in.

    Robots that are not ``active``, whose step is solved, keep the points that push: others of their batch still change.

    Block principal pivoting: all violators change sides at once; where that stops helping, the last one does (Murty).
    Source: Judice, Pires, Computers & Operations Research 21 (1994) 587. On sand see ``sand.move_within_bounds``.
    """
    fewest = 0.0 * read(robots, 0) + 1e9
    patience = 0.0 * fewest + BLOCK_FLIPS
    most = ti.static(PIVOTS_OF_STUDIES if robots.drifting else MOST_PIVOTS)
    late = ti.static(sand.MOST_ROUNDS if robots.granular else most) - most
    left = most + late
    while left > 0:
        solve_members(robots, count, phase)
        number, worst = violations(robots, count, phase, left <= late + 1, active)
        left -= 1
        if ti.static(robots.granular):
            if left == late:
                sand.give_up_on_firm(robots, worst)
        if any_lane(number > 0.5):
            if left == 0:
                before = read(robots, slots.RESIDUAL)
                write(robots, slots.RESIDUAL, select(number > 0.5, larger(worst, before), before))
            if left > ti.static(-1 if robots.drifting else 0):  # the studies' solver left its last ones changed
                if ti.static(robots.granular):
                    sand.move_within_bounds(robots, count, phase)
                better = number < fewest
                patience = select(better, BLOCK_FLIPS, patience - 1.0)
                fewest = select(better, number, fewest)
                last_only = patience < 0.0
                pending = 0.0 * number + 1.0
                for back in range(count):
                    point = listed_at(robots, count - 1 - back)
                    wrong = read(robots, point + slots.EXCESS)
                    flip = select(last_only, wrong * pending, wrong)
                    pending = pending * (1.0 - wrong)
                    member = read(robots, point + slots.MEMBER)
                    write(robots, point + slots.MEMBER, member + flip * (1.0 - 2.0 * member))
        else:
            left = 0
    for n in range(count):  # what rounding leaves of a point that does not push
        slot = listed_at(robots, n) + slots.IMPULSES + phase
        impulse = read(robots, slot)
        kept = select(impulse > 0.0, impulse, 0.0)
        if ti.static(not robots.drifting):  # a NaN costs a point its impulse; whoever fell for that has diverged
            fell = read(robots, listed_at(robots, n) + slots.DEEP) > FALLEN
            kept = select((impulse <= 0.0) | (impulse > 0.0), kept, select(fell, impulse, 0.0))
        if ti.static(robots.granular):
            kept = sand.bounded_impulse(robots, n, kept)
        write(robots, slot, kept)


@ti.func
def apply_normals(robots: ti.template(), count, phase):
    """Add normal impulses to the right-hand sides of hinges and base."""
    for n in range(count):
        _i, b, point = listed_point(robots, n)
        impulse = read(robots, point + slots.IMPULSES + phase)
        for d in range(column(robots, b, slots.PATH_LENGTH)):
            slot = body_at(robots, hinge_on_path(robots, b, d)) + slots.CONTACT
            write(robots, slot, read(robots, slot) + impulse * read(robots, point + slots.HINGES + d))
        right = ti.static(row(robots, slots.ROOT_RIGHT, 6))
        put(robots, slots.ROOT_RIGHT, spatial.plus_times(right, row(robots, point + slots.ROW, 6), impulse))
