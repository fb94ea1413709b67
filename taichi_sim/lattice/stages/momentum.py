"""How a voxel's momentum changes in a step, on level, uneven and yielding ground, in water and in the air, and back.

What a voxel did in a step is known from the states before and after it: its forces are not needed, as they enter
linearly, but on ground that yields, where they are found from its momenta. Whether it stuck or slid is as recorded.
See ``groups`` for what the arguments hold.
"""

from typing import Any

from taichi_sim.autodiff.lanes import any_lane, consecutive, load, load_all, select_all, store, store_all
from taichi_sim.autodiff.tracing import primitive, pull_back, select
from taichi_sim.ground import laws as uneven
from taichi_sim.lattice.laws import floor, fluid, motion
from taichi_sim.lattice.stages import columns, memory, relief
from taichi_sim.lattice.stages.undo import Undo, after, before, give, parameters_of, reverse, take_all
from taichi_sim.lattice.stages.voxel_slots import (
    Group,
    displaced_volume,
    floor_slots,
    momentum_slots,
    print_slot,
    volume_slots,
    voxel_slot,
    wet_sides,
)
from taichi_sim.runtime import emit, ti


@primitive
def volume_in_water(v: Any, k: Any, t: Any) -> tuple[Any, ...]:
    """How often its own volume a voxel displaces; the edge; the water's level, and its mass carried along."""
    level, _, carried = relief.water_of(k, t)
    return displaced_volume(v, t), t.edge, level, carried


@primitive
def step_for(m: Any, k: Any, v: Any, z: Any, g: Group, t: Any) -> Any:
    """Time step for which forces change the momentum of voxel v at height z: water slows it."""
    if not t.medium.water:
        return t.time_step
    return fluid.slowed_step(z, *load_all(m, k, volume_slots(g)), *volume_in_water(v, k, t), t.time_step)


@ti.func
def push(
    m: ti.template(),
    k,
    v,
    p: ti.template(),
    f: ti.template(),
    z,
    inverse_mass,
    g: ti.template(),
    t: ti.template(),
):
    """Momentum after a step under force F of voxel v at height z; the floor, and whether it sticks there."""
    px, py, pz = p
    depth = floor.penetration(load(m, k, g.current + memory.MEAN_SIZE), t.edge, z)
    stuck = 0.0 * inverse_mass
    on_floor = t.plan[memory.FLOOR_ON] != 0
    if on_floor:
        on_floor = any_lane(depth >= 0.0)
    if on_floor:
        level = (1.0 + stuck, stuck, stuck, 1.0 + stuck)
        px, py, pz, stuck = touch(m, k, v, p, f, depth, level, t.time_step, inverse_mass, g, t)
    else:
        px, py, pz = motion.accelerated(px, py, pz, *f, t.time_step)
    store(m, k, voxel_slot(v, t) + memory.STICKS, stuck)
    return px, py, pz


@ti.func
def push_on_relief(
    m: ti.template(),
    k,
    v,
    at: ti.template(),
    p: ti.template(),
    f: ti.template(),
    dt,
    inverse_mass,
    g: ti.template(),
    t: ti.template(),
):
    """:func:`push` of a voxel at a place over uneven ground, in a time step that water may have slowed."""
    px, py, pz = motion.accelerated(*p, *f, dt)
    stuck = 0.0 * inverse_mass
    leaves = 1
    size = load(m, k, g.current + memory.MEAN_SIZE)
    if relief.may_touch(size, at[2], t):
        height, nx, ny, nz, factor = uneven.ground(*at[:2], *relief.cell_under(*at[:2], k, t), relief.per_cell(t))
        depth = uneven.penetration(size, t.edge, at[2], height, nz)
        touches = depth >= 0.0
        if any_lane(touches):
            turned_p, turned_f = uneven.into_plane(*p, nx, ny, nz), uneven.into_plane(*f, nx, ny, nz)
            leaves = 0
            ax, ay, az, stuck = touch(m, k, v, turned_p, turned_f, depth, (factor, nx, ny, nz), dt, inverse_mass, g, t)
            bx, by, bz = uneven.out_of_plane(ax, ay, az, nx, ny, nz)
            px, py, pz = select(touches, bx, px), select(touches, by, py), select(touches, bz, pz)
    if ti.static(t.medium.granular):
        if leaves == 1:
            store(m, k, print_slot(v, t), 0.0 * inverse_mass)
    store(m, k, voxel_slot(v, t) + memory.STICKS, stuck)
    return px, py, pz


@ti.func
def touch(
    m: ti.template(),
    k,
    v,
    p: ti.template(),
    f: ti.template(),
    depth,
    plane: ti.template(),
    dt,
    inverse_mass,
    g: ti.template(),
    t: ti.template(),
):
    """Momentum after a step in contact with the ground, in the ground's axes, and whether the voxel sticks to it.

    ``plane`` is the factor of both coefficients of friction, and the normal.
    """
    factor, nx, ny, nz = plane
    px, py, pz = p
    fx, fy, fz = f
    size, stiffness, damping, friction = load_all(m, k, floor_slots(g))
    vx, vy, vz = px * inverse_mass, py * inverse_mass, pz * inverse_mass
    sticks = load(m, k, voxel_slot(v, t) + memory.STICKS)
    holds = factor * load(m, k, g.channels + columns.STATIC_FRICTION)
    friction = factor * friction
    normal = 0.0 * depth
    qx, qy = px, py
    if ti.static(t.medium.granular):
        pressed, limit = load(m, k, print_slot(v, t)), relief.yield_of(k, t)
        turn, sides = load_all(m, k, consecutive(voxel_slot(v, t) + memory.ORIENTATION, 4)), wet_sides(v, t)
        below = uneven.outer_share(*turn, 0.0 - nx, 0.0 - ny, 0.0 - nz, *sides)
        normal, most, pressed = uneven.giving_way(size, depth, pressed, stiffness, limit, below)
        fz = fz + select(depth >= 0.0, uneven.granular_push(normal, most, vz, damping, limit), 0.0)
        store(m, k, print_slot(v, t), select(depth >= 0.0, pressed, 0.0))
        holds = holds * normal
        qx, qy = qx + fx * dt, qy + fy * dt
        ahead = uneven.leading_share(qx, qy, *turn, nx, ny, nz, *sides)
        friction = uneven.granular_hold(friction * normal, size, depth, limit, ahead)
        normal = 1.0 + 0.0 * normal
    else:
        fz, normal = floor.floor_force(fz, vz, depth, stiffness, damping)
    loose = floor.breaks_loose(fx, fy, holds, normal)
    rx, ry = floor.slip_friction(vx, vy, friction, normal, depth, sticks)
    px, py, pz = motion.accelerated(px, py, pz, fx + rx, fy + ry, fz, dt)
    step = dt * inverse_mass
    rests = floor.comes_to_rest(px, py, rx, ry, px * step, py * step, inverse_mass)
    stuck = select(rests, 1.0, select(loose, 0.0, sticks))
    if ti.static(t.medium.granular):
        px, py, stuck = uneven.slid(px, py, stuck, qx, qy, friction * dt, relief.yield_of(k, t))
        # For the way back: a hold may take it from the voxel's momentum.
        store(m, k, print_slot(v, t) + 1, select(depth >= 0.0, px, 0.0))
        store(m, k, print_slot(v, t) + 2, select(depth >= 0.0, py, 0.0))
    stuck = select(depth >= 0.0, stuck, 0.0)
    px, py = floor.stopped(px, py, stuck)
    return px, py, pz, stuck


@ti.func
def force_slots(v, t: ti.template()):
    """Slots of the cotangents of the force on voxel v; those of the moment follow."""
    return consecutive(t.plan[memory.FORCE] + 6 * v, 3)


@primitive
def pushed(*given: Any) -> Any:
    """New momentum, from the old one, the force of all but floor and drag, and what else that depends on.

    ``given`` are momentum (3), force (3), inverse mass, drag; with a floor height, mean size, stiffness, damping and
    kinetic friction; then time step, edge, sticking before and after, and whether there is a floor.
    """
    px, py, pz, fx, fy, fz, inverse_mass, drag = given[:8]
    dt, edge, sticks, stuck, on_floor = given[-5:]
    fx, fy, fz = motion.damped_force(fx, fy, fz, px, py, pz, inverse_mass, drag, 0.0, 0.0, 0.0)
    if on_floor:
        z, size, *contact = given[8:13]
        depth = floor.penetration(size, edge, z)
        return touched((px, py, pz), (fx, fy, fz), inverse_mass, depth, contact, (sticks, stuck), dt)
    px, py, pz = motion.accelerated(px, py, pz, fx, fy, fz, dt)
    return *floor.stopped(px, py, stuck), pz


@primitive
def pushed_on_relief(*given: Any) -> Any:
    """:func:`pushed` of a voxel that touches uneven ground, and how deep it has pressed that now, if it yields.

    Its place (3) is given instead of its height; after the friction comes how deep it had pressed the ground, and of
    ground that yields the orientation (4) and the wet sides (6). Before the time step come the corner and table of the
    cell below, and the inverse width of a cell; at the end, the stress per depth at which the ground yields, or False.
    """
    *momentum, fx, fy, fz, inverse_mass, drag = given[:8]
    x, y, z, size, stiffness, damping, friction, pressed = given[8:16]
    dt, edge, sticks, stuck, limit = given[-5:]
    force = motion.damped_force(fx, fy, fz, *momentum, inverse_mass, drag, 0.0, 0.0, 0.0)
    turn, sides, cell = ((), (), given[16:-5]) if limit is False else (given[16:20], given[20:26], given[26:-5])
    height, *normal, factor = uneven.ground(x, y, *cell)
    depth = uneven.penetration(size, edge, z, height, normal[2])
    momentum, force = uneven.into_plane(*momentum, *normal), uneven.into_plane(*force, *normal)
    contact: Any = (stiffness, damping, factor * friction)
    yields: Any = ()
    if limit is not False:
        below = uneven.outer_share(*turn, *(0.0 - n for n in normal), *sides)
        bears, most, pressed = uneven.giving_way(size, depth, pressed, stiffness, limit, below)
        yields = bears, most, size, limit, (*turn, *normal, *sides)
    found = touched(momentum, force, inverse_mass, depth, contact, (sticks, stuck), dt, yields)
    return *uneven.out_of_plane(*found, *normal), pressed


@primitive
def touched(
    momentum: Any,
    force: Any,
    inverse_mass: Any,
    depth: Any,
    contact: Any,
    stuck: Any,
    dt: Any,
    yields: Any = (),
) -> Any:
    """New momentum of a voxel on the ground, in its axes.

    ``contact`` is its stiffness, damping and kinetic friction; ``stuck`` whether it stuck before and after; ``yields``
    of granular ground what it bears, at most, the voxel's size, the stress per depth, and how the voxel lies on it:
    its orientation, the normal of the ground and the wet sides.
    """
    px, py, pz = momentum
    fx, fy, fz = force
    stiffness, damping, friction = contact
    qx, qy = px + fx * dt, py + fy * dt
    if yields:
        bears, most, size, limit, lies = yields
        fz = fz + uneven.granular_push(bears, most, pz * inverse_mass, damping, limit)
        ahead = uneven.leading_share(qx, qy, *lies)
        friction = uneven.granular_hold(friction * bears, size, depth, limit, ahead)
        normal = 1.0 + 0.0 * bears
    else:
        fz, normal = floor.floor_force(fz, pz * inverse_mass, depth, stiffness, damping)
    rx, ry = floor.slip_friction(px * inverse_mass, py * inverse_mass, friction, normal, depth, stuck[0])
    px, py, pz = motion.accelerated(px, py, pz, fx + rx, fy + ry, fz, dt)
    if yields:
        px, py, _ = uneven.slid(px, py, stuck[1], qx, qy, friction * dt, limit)
    return *floor.stopped(px, py, stuck[1]), pz


@ti.func
def momentum_adjoint(u: ti.template(), v, g: ti.template(), t: ti.template(), seeds: ti.template()):
    """Reverse the change of momentum, floor and friction included; gives the cotangents of the force."""
    voxel = voxel_slot(v, t)
    x, y, z, sticks = before(u, (voxel, voxel + 1, voxel + 2, voxel + memory.STICKS))
    (stuck,) = after(u, (voxel + memory.STICKS,))
    slots = momentum_slots(g) + floor_slots(g)
    values = parameters_of(u, slots)
    zero = 0.0 * z
    momentum = before(u, consecutive(voxel + memory.MOMENTUM, 3))
    moving = momentum + (zero, zero, zero) + values[:2]
    dt = step_for(u.m, u.k, v, z, g, t)
    above = ti.static(pull_back(pushed, moving, (dt, t.edge, sticks, stuck, False), seeds))
    if ti.static(t.medium.relief):
        cell = ti.static(relief.cell_under(x, y, u.k, t))
        inverse = relief.per_cell(t)
        height, nx, ny, nz, factor = uneven.ground(x, y, *cell, inverse)
        depth = uneven.penetration(values[2], t.edge, z, height, nz)
        touches = depth >= 0.0
        if any_lane(touches):
            fx, fy, fz = zero, zero, zero
            if ti.static(t.medium.granular):
                fx, fy, fz = force_sideways(u, v, momentum, values, depth, (nx, ny, nz, factor), dt, t)
            pushing = momentum + (fx, fy, fz) + values[:2]
            inputs, fixed = pushing + (x, y, z) + values[2:], cell + (inverse, dt, t.edge, sticks, stuck)
            landed = ti.static(land_adjoint(u, v, inputs, fixed, seeds, t))
            p = select_all(touches, landed[:8], above)
            nothing = (zero, zero, zero, zero, zero, zero, zero)
            q = select_all(touches, landed[8:15], nothing)
            give(u, consecutive(voxel, 3) + slots, q[:3] + p[6:8] + q[3:])
            if ti.static(t.medium.granular):
                give(u, (print_slot(v, t),), (select(touches, landed[15], 0.0),))
                turning = select_all(touches, landed[16:20], (zero, zero, zero, zero))
                give(u, consecutive(voxel + memory.ORIENTATION, 4), turning)
            if ti.static(t.medium.water):
                slowed_adjoint(u, v, g, t, p[3:6], dt)
            give_force(u, v, g, t, p[:6])
        else:
            if ti.static(t.medium.granular):
                store_all(u.a, u.k, (print_slot(v, t),), (zero,))
            if ti.static(t.medium.water):
                slowed_adjoint(u, v, g, t, above[3:6], dt)
            give(u, slots[:2], above[6:8])
            give_force(u, v, g, t, above[:6])
    else:
        touches = floor.penetration(values[2], t.edge, z) >= 0.0
        on_floor = t.plan[memory.FLOOR_ON] != 0
        if on_floor:
            on_floor = any_lane(touches)
        if on_floor:  # on the floor terms add in another order, so lanes above it keep their own
            inputs = moving + (z,) + values[2:]
            landed = ti.static(pull_back(pushed, inputs, (t.time_step, t.edge, sticks, stuck, True), seeds))
            whole = above + (zero, zero, zero, zero, zero)
            p = select_all(touches, landed, whole)
            give(u, (voxel + 2,) + slots, p[8:9] + p[6:8] + p[9:])
            give_force(u, v, g, t, p[:6])
        else:
            give(u, slots[:2], above[6:8])
            give_force(u, v, g, t, above[:6])


@primitive
def land_adjoint(u: Undo, v: Any, inputs: Any, fixed: Any, seeds: Any, t: Any) -> Any:
    """Reverse :func:`pushed_on_relief` by inputs and, where the ground yields, by its print and the orientation."""
    if not t.medium.granular:
        return pull_back(pushed_on_relief, (*inputs, 0.0 * inputs[0]), (*fixed, False), (*seeds, None))
    slot = (emit(print_slot(v, t)),)
    pressed, seed, limit = before(u, slot), take_all(u, slot), relief.yield_of(u.k, t)
    turn, sides = before(u, consecutive(voxel_slot(v, t) + memory.ORIENTATION, 4)), wet_sides(v, t)
    return pull_back(pushed_on_relief, (*inputs, *pressed, *turn), (*sides, *fixed, limit), (*seeds, *seed))


@ti.func
def force_sideways(
    u: ti.template(),
    v,
    momentum: ti.template(),
    values: ti.template(),
    depth,
    plane: ti.template(),
    dt,
    t: ti.template(),
):
    """Force along ground that yields [N] of all but it and drag, from the momentum before the step and what it left.

    ``values`` are inverse mass, drag, size, stiffness, damping and friction; ``plane`` is the normal of the ground and
    its factor of friction. Of what came to rest it is that which would have stopped it without the ground.
    """
    nx, ny, nz, factor = plane
    inverse_mass, drag, size, stiffness, _, friction = values
    (pressed,) = before(u, (print_slot(v, t),))
    limit = relief.yield_of(u.k, t)
    turn, sides = before(u, consecutive(voxel_slot(v, t) + memory.ORIENTATION, 4)), wet_sides(v, t)
    below = uneven.outer_share(*turn, 0.0 - nx, 0.0 - ny, 0.0 - nz, *sides)
    bears, _, _ = uneven.giving_way(size, depth, pressed, stiffness, limit, below)
    ax, ay = after(u, consecutive(print_slot(v, t) + 1, 2))
    ahead = uneven.leading_share(ax, ay, *turn, nx, ny, nz, *sides)
    holds = uneven.granular_hold(factor * friction * bears, size, depth, limit, ahead)
    qx, qy = uneven.without_friction(ax, ay, holds * dt)
    px, py, _ = uneven.into_plane(*momentum, nx, ny, nz)
    slowing = drag * inverse_mass
    fx, fy = (qx - px) / dt + slowing * px, (qy - py) / dt + slowing * py
    return uneven.out_of_plane(fx, fy, 0.0 * depth, nx, ny, nz)


@ti.func
def slowed_adjoint(u: ti.template(), v, g: ti.template(), t: ti.template(), seeds: ti.template(), dt):
    """Reverse how water slows a voxel: what changed its momentum did so for the slowed time step.

    ``seeds`` are the cotangents of the force; of a voxel that moves freely, those of its momentum times the time step.
    """
    slots = consecutive(voxel_slot(v, t) + memory.MOMENTUM, 3)
    x, y, z = before(u, slots)
    px, py, pz = after(u, slots)
    seed = (seeds[0] * (px - x) + seeds[1] * (py - y) + seeds[2] * (pz - z)) / (dt * dt)
    around = volume_in_water(v, u.k, t) + (t.time_step,)
    reverse(u, fluid.slowed_step, (voxel_slot(v, t) + 2,), volume_slots(g), around, (seed,))


@ti.func
def give_force(u: ti.template(), v, g: ti.template(), t: ti.template(), found: ti.template()):
    """Store the cotangents of momentum and force; those of the external force add to its group's."""
    store_all(u.a, u.k, consecutive(voxel_slot(v, t) + memory.MOMENTUM, 3), found[:3])
    store_all(u.a, u.k, force_slots(v, t), found[3:])
    give(u, consecutive(g.current + memory.PUSH, 3), found[3:])
