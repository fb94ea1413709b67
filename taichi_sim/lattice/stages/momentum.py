"""How a voxel's momentum changes in a step, on level, uneven and yielding ground, in water and in the air, and back.

What a voxel did in a step is known from the states before and after it: its forces are not needed, as they enter
linearly, but on ground that yields, where they are found from its momenta. Whether it stuck or slid is as recorded.
See ``groups`` for what the arguments hold.
"""

from typing import Any, NamedTuple

from taichi_sim.autodiff.lanes import (
    any_lane,
    consecutive,
    load,
    load_all,
    select_all,
    store,
    store_all,
    variables,
)
from taichi_sim.autodiff.tracing import primitive, select
from taichi_sim.ground import laws as uneven
from taichi_sim.lattice.laws import floor, fluid, motion
from taichi_sim.lattice.stages import columns, memory, relief
from taichi_sim.lattice.stages.ground import Sand, borne, ploughed, slid, slide
from taichi_sim.lattice.stages.undo import Undo, after, before, give, parameters_of, pull_back_parts, reverse, take_all
from taichi_sim.lattice.stages.voxel_slots import (
    Group,
    bearing_slots,
    displaced_volume,
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


@primitive
def sand_under(m: Any, k: Any, v: Any, normal: Any, t: Any) -> Any:
    """The :class:`Sand` under voxel v; empty where the ground does not yield."""
    if not t.medium.granular:
        return ()
    pressed = emit(load(m, k, print_slot(v, t)))
    turn = tuple(variables(load_all(m, k, consecutive(voxel_slot(v, t) + memory.ORIENTATION, 4))))
    return Sand(relief.yield_of(k, t), pressed, turn, tuple(variables(wet_sides(v, t))), normal)


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
    size, stiffness, damping, friction = load_all(m, k, bearing_slots(g))
    sticks = load(m, k, voxel_slot(v, t) + memory.STICKS)
    holds = factor * load(m, k, g.channels + columns.STATIC_FRICTION)
    bearing = ti.static((size, stiffness, damping, emit(factor * friction)))
    sand = ti.static(sand_under(m, k, v, (nx, ny, nz), t))
    found = ti.static(slide(p, f, inverse_mass, depth, bearing, sticks, dt, sand))
    loose = floor.breaks_loose(*found.pull, holds, found.bears)
    px, py, pz = found.momentum
    step = dt * inverse_mass
    rests = floor.comes_to_rest(px, py, *found.friction, px * step, py * step, inverse_mass)
    stuck = select(rests, 1.0, select(loose, 0.0, sticks))
    px, py, stuck = slid(found, stuck, sand)
    if ti.static(t.medium.granular):
        store(m, k, print_slot(v, t), select(depth >= 0.0, found.pressed, 0.0))
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


class Pushed(NamedTuple):
    """What a voxel's momentum after a step depends on, all but what is fixed.

    Attributes:
        momentum: that before.
        force: on it, of all but the ground and drag.
        slowing: its inverse mass and drag.
        place: on level ground its height, on uneven ground its position; in the air empty, as what follows.
        bearing: its size, stiffness and damping of contact, and kinetic friction.
        pressed: how deep it had pressed ground that yields; on other ground empty, as what follows.
        turn: its orientation.
    """

    momentum: Any
    force: Any
    slowing: Any
    place: Any = ()
    bearing: Any = ()
    pressed: Any = ()
    turn: Any = ()


class Fixed(NamedTuple):
    """What its momentum depends on besides, and what is not differentiated by.

    Attributes:
        step: time step and edge.
        sticking: whether it stuck before, and does now.
        cell: of uneven ground the corner and table of the cell below, and the inverse width of a cell; else empty.
        sand: stress per depth at which the ground yields, and the wet sides; of other ground empty.
    """

    step: Any
    sticking: Any
    cell: Any = ()
    sand: Any = ()


@primitive
def damped(given: Pushed) -> Any:
    """Force on a voxel, drag included."""
    return variables(motion.damped_force(*given.force, *given.momentum, *given.slowing, 0.0, 0.0, 0.0))


@primitive
def moved_in_the_air(given: Pushed, fixed: Fixed) -> Any:
    """New momentum of a voxel that touches nothing."""
    px, py, pz = motion.accelerated(*given.momentum, *damped(given), fixed.step[0])
    return *floor.stopped(px, py, fixed.sticking[1]), pz


@primitive
def moved_on_the_floor(given: Pushed, fixed: Fixed) -> Any:
    """New momentum of a voxel that touches level ground."""
    depth = floor.penetration(given.bearing[0], fixed.step[1], *given.place)
    return moved_on(given.momentum, damped(given), given, fixed, depth)[:3]


@primitive
def moved_on_relief(given: Pushed, fixed: Fixed) -> Any:
    """New momentum of a voxel that touches uneven ground, and how deep it has pressed that now, if it yields."""
    (x, y, z), force = given.place, damped(given)
    height, *normal, factor = uneven.ground(x, y, *fixed.cell)
    depth = uneven.penetration(given.bearing[0], fixed.step[1], z, height, normal[2])
    momentum, force = uneven.into_plane(*given.momentum, *normal), uneven.into_plane(*force, *normal)
    *bearing, friction = given.bearing
    given = given._replace(bearing=(*bearing, factor * friction))
    sand = Sand(fixed.sand[0], given.pressed[0], given.turn, fixed.sand[1:], normal) if fixed.sand else ()
    *found, pressed = moved_on(momentum, force, given, fixed, depth, sand)
    moves = uneven.out_of_plane(*found, *normal)
    return (*moves, pressed) if sand else moves


@primitive
def moved_on(momentum: Any, force: Any, given: Pushed, fixed: Fixed, depth: Any, sand: Any = ()) -> Any:
    """New momentum of a voxel on the ground, in its axes, and how deep it has pressed that."""
    sticks, stuck = fixed.sticking
    found = slide(momentum, force, given.slowing[0], depth, given.bearing, sticks, fixed.step[0], sand)
    px, py, _ = slid(found, stuck, sand)
    return *floor.stopped(px, py, stuck), found.momentum[2], found.pressed


@ti.func
def momentum_adjoint(u: ti.template(), v, g: ti.template(), t: ti.template(), seeds: ti.template()):
    """Reverse the change of momentum, ground and friction included; gives the cotangents of the force."""
    voxel = voxel_slot(v, t)
    x, y, z, sticks = before(u, (voxel, voxel + 1, voxel + 2, voxel + memory.STICKS))
    (stuck,) = after(u, (voxel + memory.STICKS,))
    bearing = parameters_of(u, bearing_slots(g))
    zero = 0.0 * z
    momentum = before(u, consecutive(voxel + memory.MOMENTUM, 3))
    moving = ti.static(Pushed(momentum, (zero, zero, zero), parameters_of(u, momentum_slots(g))))
    dt = step_for(u.m, u.k, v, z, g, t)
    fixed = ti.static(Fixed((dt, t.edge), (sticks, stuck)))
    above = ti.static(pull_back_parts(moved_in_the_air, moving, fixed, seeds))
    if ti.static(t.medium.relief):
        cell, inverse = ti.static(relief.cell_under(x, y, u.k, t)), relief.per_cell(t)
        height, nx, ny, nz, factor = uneven.ground(x, y, *cell, inverse)
        depth = uneven.penetration(bearing[0], t.edge, z, height, nz)
        touches = depth >= 0.0
        if any_lane(touches):
            landing = ti.static(moving._replace(place=(x, y, z), bearing=bearing))
            below = ti.static(fixed._replace(cell=cell + (inverse,)))
            landed = ti.static(land_adjoint(u, v, landing, below, (depth, nx, ny, nz, factor), seeds, t))
            give_pushed(u, v, g, chosen(touches, landed, above), dt, t)
        else:
            if ti.static(t.medium.granular):
                store_all(u.a, u.k, (print_slot(v, t),), (zero,))
            give_pushed(u, v, g, above, dt, t)
    else:
        touches = floor.penetration(bearing[0], t.edge, z) >= 0.0
        on_floor = t.plan[memory.FLOOR_ON] != 0
        if on_floor:
            on_floor = any_lane(touches)
        if on_floor:  # on the floor terms add in another order, so lanes above it keep their own
            landing = ti.static(moving._replace(place=(z,), bearing=bearing))
            landed = ti.static(pull_back_parts(moved_on_the_floor, landing, fixed, seeds))
            give_pushed(u, v, g, chosen(touches, landed, above), dt, t)
        else:
            give_pushed(u, v, g, above, dt, t)


@primitive
def land_adjoint(u: Undo, v: Any, given: Pushed, fixed: Fixed, ground: Any, seeds: Any, t: Any) -> Pushed:
    """Cotangents of what the momentum of a voxel on uneven ground depends on.

    ``ground`` is the voxel's depth, and the normal of the ground and its factor of friction.
    """
    if not t.medium.granular:
        return pull_back_parts(moved_on_relief, given, fixed, seeds)
    slot = (emit(print_slot(v, t)),)
    turn = before(u, consecutive(voxel_slot(v, t) + memory.ORIENTATION, 4))
    limit, sides = relief.yield_of(u.k, t), wet_sides(v, t)
    (pressed,), left = before(u, slot), after(u, consecutive(slot[0] + 1, 2))
    depth, *normal, factor = ground
    sand = Sand(limit, pressed, turn, sides, normal)
    force = force_sideways(given, left, depth, factor, fixed, sand)
    given = given._replace(force=force, pressed=(pressed,), turn=turn)
    return pull_back_parts(moved_on_relief, given, fixed._replace(sand=(limit, *sides)), (*seeds, *take_all(u, slot)))


@primitive
def force_sideways(given: Pushed, left: Any, depth: Any, factor: Any, fixed: Fixed, sand: Sand) -> Any:
    """Force along sand [N] of all but it and drag, from the momentum along it before the step and that it ``left``.

    ``factor`` is that of the ground's friction. Of what came to rest it is that which would have stopped it without
    the ground.
    """
    dt = fixed.step[0]
    inverse_mass, drag = given.slowing
    size, stiffness, _, friction = given.bearing
    bears, _, _ = borne(depth, size, stiffness, sand)
    hold = ploughed(*left, emit(factor * friction * bears), depth, size, sand)
    qx, qy = variables(uneven.without_friction(*left, hold * dt))
    px, py, _ = variables(uneven.into_plane(*given.momentum, *sand.normal))
    slowing = emit(drag * inverse_mass)
    fx, fy = variables(((qx - px) / dt + slowing * px, (qy - py) / dt + slowing * py))
    return tuple(variables(uneven.out_of_plane(fx, fy, 0.0 * depth, *sand.normal)))


@primitive
def chosen(touches: Any, landed: Pushed, above: Pushed) -> Pushed:
    """Cotangents of lanes that touch the ground, and of those that do not."""
    zero = emit(0.0 * above.momentum[0])
    pairs = zip(landed, above, strict=True)
    return Pushed(*(select_all(touches, there, away or [zero] * len(there)) for there, away in pairs))


@primitive
def give_pushed(u: Undo, v: Any, g: Group, found: Pushed, dt: Any, t: Any) -> None:
    """Store the cotangents of momentum and force, add the others, and those of a push to its group's."""
    voxel = emit(voxel_slot(v, t))
    give(u, momentum_slots(g), found.slowing)
    if found.place:
        give(u, consecutive(voxel, 3)[-len(found.place) :], found.place)
        give(u, bearing_slots(g), found.bearing)
    if found.turn:
        give(u, (print_slot(v, t),), found.pressed)
        give(u, consecutive(voxel + memory.ORIENTATION, 4), found.turn)
    if t.medium.water:
        slowed_adjoint(u, v, g, t, found.force, dt)
    store_all(u.a, u.k, consecutive(voxel + memory.MOMENTUM, 3), found.momentum)
    store_all(u.a, u.k, force_slots(v, t), found.force)
    give(u, consecutive(g.current + memory.PUSH, 3), found.force)


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
