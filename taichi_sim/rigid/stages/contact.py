"""Points that touch the ground: which, their rows of the factored mass matrix, and the complementarity of normals.

With M = L^T D L of the articulated tree, the matrix of normal rows is A = (L^-T J^T)^T D^-1 (L^-T J^T); a point's row
holds an entry for each hinge between it and the base, and six for the base.
"""

from taichi_sim.autodiff.lanes import any_lane, larger, load, store
from taichi_sim.autodiff.tracing import select, sqrt
from taichi_sim.rigid.memory import (
    AT,
    BODY_COLUMNS,
    COLUMN,
    CONTACT,
    DEEP,
    DEPTH,
    DRIFT,
    EXCESS,
    FACTOR,
    FREE_RATE,
    HINGES,
    IMPULSES,
    INVERSE,
    MATRIX,
    MEMBER,
    PATH_LENGTH,
    PLACE,
    POINT_PARAMETER,
    POINT_PARAMETER_WIDTH,
    POINTS,
    POSITION,
    READING,
    RESIDUAL,
    RIGHT,
    ROOT,
    ROOT_RIGHT,
    ROTATION,
    ROW,
    SCRATCH,
    SCREW,
    TOUCH,
    VELOCITY,
    body_at,
    point_at,
    put,
    row,
)
from taichi_sim.rigid.stages import spatial
from taichi_sim.runtime import ti

BLOCK_FLIPS = 5.0  # of all violators at once without there being fewer; then one at a time, which always ends


@ti.func
def find_contacts(
    m: ti.template(),
    k,
    plan: ti.template(),
    table: ti.template(),
    points: ti.template(),
    listed: ti.template(),
    block,
    touching,
):
    """Depths of all points; lists those that touch in any lane, sets touch sensors, returns their number."""
    count = 0
    for i in range(plan[POINTS]):
        b = points[i]
        body, point, given = body_at(plan, b), point_at(plan, i), plan[POINT_PARAMETER] + i * POINT_PARAMETER_WIDTH
        at = ti.static(
            spatial.plus(row(m, k, body + PLACE, 3), spatial.turned(row(m, k, body + ROTATION, 9), row(m, k, given, 3)))
        )
        radius = load(m, k, given + 3)
        height = load(m, k, POSITION + 2) + at[2] + load(m, k, body + DRIFT + 2)
        depth = radius - height
        put(m, k, point + AT, (at[0], at[1], at[2] - radius))
        store(m, k, point + DEEP, depth)
        touches = depth >= 0.0
        for phase in ti.static(range(2)):
            store(m, k, point + IMPULSES + phase, select(touches, load(m, k, point + IMPULSES + phase), 0.0))
        sensor = table[b * BODY_COLUMNS + TOUCH]
        if sensor >= 0:
            slot = plan[READING] + sensor
            store(m, k, slot, select(touches, touching, load(m, k, slot)))
        if any_lane(touches):
            listed[block, count] = i
            count += 1
    return count


@ti.func
def reduce_points(
    m: ti.template(),
    k,
    plan: ti.template(),
    points: ti.template(),
    paths: ti.template(),
    table: ti.template(),
    listed: ti.template(),
    block,
    count,
    push_out,
    floating,
):
    """Rows of the factored matrix, and how much each point's free velocity falls short."""
    for n in range(count):
        b = points[listed[block, n]]
        point, own = point_at(plan, listed[block, n]), body_at(plan, b)
        x, y = load(m, k, point + AT), load(m, k, point + AT + 1)
        zero = 0.0 * x
        f0, f1, f2, f3, f4, f5 = y, 0.0 - x, zero, zero, zero, zero + 1.0
        free = zero
        length = table[b * BODY_COLUMNS + PATH_LENGTH]
        for back in range(length):
            d = length - 1 - back
            hinge = body_at(plan, paths[b * plan[DEPTH] + d])
            share = spatial.dot(row(m, k, hinge + SCREW, 6), (f0, f1, f2, f3, f4, f5))
            store(m, k, point + HINGES + d, share)
            free = free + share * load(m, k, hinge + FREE_RATE)
            lost = share * load(m, k, hinge + INVERSE)
            f0 = f0 - lost * load(m, k, hinge + COLUMN)
            f1 = f1 - lost * load(m, k, hinge + COLUMN + 1)
            f2 = f2 - lost * load(m, k, hinge + COLUMN + 2)
            f3 = f3 - lost * load(m, k, hinge + COLUMN + 3)
            f4 = f4 - lost * load(m, k, hinge + COLUMN + 4)
            f5 = f5 - lost * load(m, k, hinge + COLUMN + 5)
        left = ti.static((f0, f1, f2, f3, f4, f5))
        free = free + spatial.dot(left, row(m, k, body_at(plan, 0) + VELOCITY, 6))
        put(m, k, point + ROW, [x * floating for x in spatial.forward(row(m, k, ROOT, 21), left)])
        target = push_out * load(m, k, point + DEEP) + push_out * load(m, k, own + DRIFT + 2)
        store(m, k, point + RIGHT, target - free)


@ti.func
def fill_matrix(
    m: ti.template(),
    k,
    plan: ti.template(),
    points: ti.template(),
    paths: ti.template(),
    table: ti.template(),
    listed: ti.template(),
    block,
    count,
    compliance,
):
    """The matrix of normal rows, its lower triangle; ``compliance`` on its diagonal makes it definite."""
    for n in range(count):
        b, point = points[listed[block, n]], point_at(plan, listed[block, n])
        mine = ti.static(row(m, k, point + ROW, 6))
        for l in range(n + 1):
            c, other = points[listed[block, l]], point_at(plan, listed[block, l])
            value = spatial.dot(mine, row(m, k, other + ROW, 6))
            shared = ti.min(table[b * BODY_COLUMNS + PATH_LENGTH], table[c * BODY_COLUMNS + PATH_LENGTH])
            for d in range(shared):
                hinge = paths[b * plan[DEPTH] + d]
                if hinge == paths[c * plan[DEPTH] + d]:
                    both = load(m, k, point + HINGES + d) * load(m, k, other + HINGES + d)
                    value = value + both * load(m, k, body_at(plan, hinge) + INVERSE)
            if n == l:
                value = value + compliance
            store(m, k, plan[MATRIX] + n * (n + 1) // 2 + l, value)


@ti.func
def solve_members(m: ti.template(), k, plan: ti.template(), listed: ti.template(), block, count, phase):
    """Impulses of the points that push: those make their velocities as required; the others' are zero."""
    for n in range(count):
        point, first = point_at(plan, listed[block, n]), n * (n + 1) // 2
        member = load(m, k, point + MEMBER)
        value = member * load(m, k, point + RIGHT)
        for l in range(n):
            start = l * (l + 1) // 2
            other = point_at(plan, listed[block, l])
            entry = member * load(m, k, other + MEMBER) * load(m, k, plan[MATRIX] + first + l)
            for j in range(l):
                entry = entry - load(m, k, plan[FACTOR] + first + j) * load(m, k, plan[FACTOR] + start + j)
            entry = entry * load(m, k, plan[FACTOR] + start + l)
            store(m, k, plan[FACTOR] + first + l, entry)
            value = value - entry * load(m, k, other + SCRATCH)
        diagonal = select(member > 0.5, load(m, k, plan[MATRIX] + first + n), 1.0)
        for l in range(n):
            entry = load(m, k, plan[FACTOR] + first + l)
            diagonal = diagonal - entry * entry
        inverse = 1.0 / sqrt(diagonal)
        store(m, k, plan[FACTOR] + first + n, inverse)
        store(m, k, point + SCRATCH, value * inverse)
    for back in range(count):
        n = count - 1 - back
        point = point_at(plan, listed[block, n])
        value = load(m, k, point + SCRATCH)
        for l in range(n + 1, count):
            other = point_at(plan, listed[block, l])
            value = value - load(m, k, plan[FACTOR] + l * (l + 1) // 2 + n) * load(m, k, other + IMPULSES + phase)
        store(m, k, point + IMPULSES + phase, value * load(m, k, plan[FACTOR] + n * (n + 1) // 2 + n))


@ti.func
def violations(m: ti.template(), k, plan: ti.template(), listed: ti.template(), block, count, phase, tolerance):
    """Marks points that pull, or sink in without pushing; their number, and the largest violation."""
    number = 0.0 * load(m, k, 0)
    worst = number
    for n in range(count):
        point = point_at(plan, listed[block, n])
        impulse = load(m, k, point + IMPULSES + phase)
        short = load(m, k, point + RIGHT)
        for l in range(count):
            lower, upper = ti.min(n, l), ti.max(n, l)
            entry = load(m, k, plan[MATRIX] + upper * (upper + 1) // 2 + lower)
            short = short - entry * load(m, k, point_at(plan, listed[block, l]) + IMPULSES + phase)
        pushes = load(m, k, point + MEMBER) > 0.5
        touches = load(m, k, point + DEEP) >= 0.0
        amount = select(pushes, 0.0 - impulse, select(touches, short, 0.0))
        wrong = amount > tolerance
        store(m, k, point + EXCESS, select(wrong, 1.0, 0.0 * amount))
        number = number + select(wrong, 1.0, 0.0)
        worst = larger(amount, worst)
    return number, worst


@ti.func
def choose_members(m: ti.template(), k, plan: ti.template(), listed: ti.template(), block, count, phase):
    """Begin with the points that pushed in the last step."""
    for n in range(count):
        point = point_at(plan, listed[block, n])
        store(m, k, point + MEMBER, select(load(m, k, point + IMPULSES + phase) > 0.0, 1.0, 0.0))


@ti.func
def solve_normals(
    m: ti.template(), k, plan: ti.template(), listed: ti.template(), block, count, phase, tolerance, most
):
    """Normal impulses, exactly: those push that must, and no other point sinks in.

    Block principal pivoting: all violators change sides at once; where that stops helping, the last one does (Murty).
    Source: Judice, Pires, Computers & Operations Research 21 (1994) 587.
    """
    fewest = 0.0 * load(m, k, 0) + 1e9
    patience = 0.0 * fewest + BLOCK_FLIPS
    left = most
    while left > 0:
        solve_members(m, k, plan, listed, block, count, phase)
        number, worst = violations(m, k, plan, listed, block, count, phase, tolerance)
        left -= 1
        if any_lane(number > 0.5):
            better = number < fewest
            patience = select(better, BLOCK_FLIPS, patience - 1.0)
            fewest = select(better, number, fewest)
            last_only = patience < 0.0
            pending = 0.0 * number + 1.0
            for back in range(count):
                point = point_at(plan, listed[block, count - 1 - back])
                wrong = load(m, k, point + EXCESS)
                flip = select(last_only, wrong * pending, wrong)
                pending = pending * (1.0 - wrong)
                member = load(m, k, point + MEMBER)
                store(m, k, point + MEMBER, member + flip * (1.0 - 2.0 * member))
            if left == 0:
                store(m, k, RESIDUAL, larger(worst, load(m, k, RESIDUAL)))
        else:
            left = 0
    for n in range(count):  # what rounding leaves of a point that does not push
        point = point_at(plan, listed[block, n])
        impulse = load(m, k, point + IMPULSES + phase)
        store(m, k, point + IMPULSES + phase, select(impulse > 0.0, impulse, 0.0))


@ti.func
def apply_normals(
    m: ti.template(),
    k,
    plan: ti.template(),
    points: ti.template(),
    paths: ti.template(),
    table: ti.template(),
    listed: ti.template(),
    block,
    count,
    phase,
):
    """Add normal impulses to the right-hand sides of hinges and base."""
    for n in range(count):
        b, point = points[listed[block, n]], point_at(plan, listed[block, n])
        impulse = load(m, k, point + IMPULSES + phase)
        for d in range(table[b * BODY_COLUMNS + PATH_LENGTH]):
            slot = body_at(plan, paths[b * plan[DEPTH] + d]) + CONTACT
            store(m, k, slot, load(m, k, slot) + impulse * load(m, k, point + HINGES + d))
        put(m, k, ROOT_RIGHT, spatial.plus_times(row(m, k, ROOT_RIGHT, 6), row(m, k, point + ROW, 6), impulse))
