"""Reverse of the stage of a voxel and of its gauges.

What a voxel did in a step is known from the states before and after it: its forces are not needed, as they enter
linearly, but on ground that yields, where they are found from its momenta. Whether it stuck or slid is as recorded.
See ``groups`` for what the arguments hold.
"""

from typing import Any

from taichi_sim.autodiff.lanes import any_lane, consecutive, select_all, slots_at, store_all
from taichi_sim.autodiff.tracing import primitive, pull_back, select
from taichi_sim.ground import laws as uneven
from taichi_sim.lattice import materials
from taichi_sim.lattice.laws import floor, fluid, motion
from taichi_sim.lattice.laws import link as beams
from taichi_sim.lattice.stages import columns, gauges, memory, relief
from taichi_sim.lattice.stages import voxel as stage
from taichi_sim.lattice.stages.undo import Undo, after, before, cotangents_of, give, parameters_of, reverse, take_all
from taichi_sim.lattice.stages.voxel import held, voxel_slot
from taichi_sim.runtime import emit, ti


@ti.func
def force_slots(v, t: ti.template()):
    """Slots of the cotangents of the force on voxel v; those of the moment follow."""
    return consecutive(t.plan[memory.FORCE] + 6 * v, 3)


@ti.func
def voxel_adjoint(u: ti.template(), v, t: ti.template()):
    """Reverse voxel v: from the cotangents of its new state to those of its old one and of its force and moment."""
    voxel = voxel_slot(v, t)
    g = ti.static(stage.group_of(v, t))
    inverses = (g.constant + materials.INVERSE_MASS, g.constant + materials.INVERSE_INERTIA)
    inverse_mass, inverse_inertia = parameters_of(u, inverses)
    bits = t.voxel[v * columns.VOXEL_COLUMNS + columns.FIXED]
    cx, cy, cz, cw, ca, cb, cc = cotangents_of(u, consecutive(voxel, 7))
    gx, gy, gz, hx, hy, hz = cotangents_of(u, consecutive(voxel + memory.MOMENTUM, 6))
    pose = before(u, consecutive(voxel, 7))
    momenta = after(u, consecutive(voxel + memory.MOMENTUM, 6))
    zero = 0.0 * inverse_mass
    if bits != 0:
        moved = held(v, 0, zero, cx, t), held(v, 1, zero, cy, t), held(v, 2, zero, cz, t)
        give(u, slots_at(g.channels, columns.TRANSLATION), moved)
        cx, cy, cz = held(v, 0, cx, zero, t), held(v, 1, cy, zero, t), held(v, 2, cz, zero, t)
        if bits >= 8:
            free = motion.rotate_by_momentum(*pose[3:], *momenta[3:], t.time_step * inverse_inertia)
            cw, ca, cb, cc = held_adjoint(u, v, g, free, t, (cw, ca, cb, cc))
    inputs = pose + momenta + (inverse_mass, inverse_inertia)
    p = ti.static(pull_back(motion.placed, inputs, (t.time_step,), (cx, cy, cz, cw, ca, cb, cc)))
    gx, gy, gz = gx + p[7], gy + p[8], gz + p[9]
    hx, hy, hz = hx + p[10], hy + p[11], hz + p[12]
    if bits != 0:
        gx, gy, gz = held(v, 0, gx, zero, t), held(v, 1, gy, zero, t), held(v, 2, gz, zero, t)
        hx, hy, hz = held(v, 3, hx, zero, t), held(v, 4, hy, zero, t), held(v, 5, hz, zero, t)
    give(u, inverses, p[13:])
    rotation_adjoint(u, v, g, t, (hx, hy, hz))
    store_all(u.a, u.k, consecutive(voxel, 7), p[:7])
    momentum_adjoint(u, v, g, t, (gx, gy, gz))
    if t.voxel[v * columns.VOXEL_COLUMNS + columns.FEELS_PRESSURE] != 0:
        state = consecutive(voxel + memory.ORIENTATION, 4) + consecutive(stage.gauge_slot(v, t), 3)
        seeds = cotangents_of(u, force_slots(v, t))
        reverse(u, motion.face_force, state, stage.face_slots(g), stage.pressed_faces(v, t), seeds)
    if t.plan[memory.FLUID_ON] != 0:
        state = consecutive(voxel + memory.ORIENTATION, 7)  # the momentum follows the orientation
        seeds = cotangents_of(u, force_slots(v, t))
        reverse(u, fluid.drag, state, stage.drag_slots(g), stage.wet_faces(v, t), seeds)
    if ti.static(t.medium.water):
        state = consecutive(voxel + memory.ORIENTATION, 7) + (voxel + 2,)
        seeds = cotangents_of(u, force_slots(v, t))
        reverse(u, fluid.water_force, state, stage.water_slots(g), stage.around_in_water(v, u.k, t), seeds)


@ti.func
def held_adjoint(u: ti.template(), v, g: ti.template(), free: ti.template(), t: ti.template(), seeds: ti.template()):
    """Reverse the hold on a voxel's rotation; the cotangents of its free orientation."""
    slots = slots_at(g.channels, columns.ROTATION)
    inputs = free + parameters_of(u, slots)
    found = ti.static(pull_back(motion.held_rotation, inputs, stage.held_turns(v, inputs[4], t), seeds))
    give(u, slots, found[4:])
    return found[0], found[1], found[2], found[3]


@primitive
def turned(*given: Any) -> Any:
    """New angular momentum, from the old one, the moment, inverse inertia and drag; the time step follows."""
    lx, ly, lz, mx, my, mz, inverse_inertia, drag, dt = given
    return motion.accelerated(lx, ly, lz, *motion.damped_moment(mx, my, mz, lx, ly, lz, inverse_inertia, drag), dt)


@ti.func
def rotation_adjoint(u: ti.template(), v, g: ti.template(), t: ti.template(), seeds: ti.template()):
    """Reverse the change of angular momentum; gives the cotangents of the moment."""
    momentum = consecutive(voxel_slot(v, t) + memory.ANGULAR_MOMENTUM, 3)
    old = before(u, momentum)
    zero = 0.0 * old[0]
    inputs = old + (zero, zero, zero) + parameters_of(u, stage.rotation_slots(g))
    found = ti.static(pull_back(turned, inputs, (t.time_step,), seeds))
    store_all(u.a, u.k, momentum, found[:3])
    store_all(u.a, u.k, consecutive(t.plan[memory.FORCE] + 6 * v + 3, 3), found[3:6])
    give(u, slots_at(g.channels, columns.MOMENT) + stage.rotation_slots(g), found[3:])


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
    slots = stage.momentum_slots(g) + stage.floor_slots(g)
    values = parameters_of(u, slots)
    zero = 0.0 * z
    momentum = before(u, consecutive(voxel + memory.MOMENTUM, 3))
    moving = momentum + (zero, zero, zero) + values[:2]
    dt = stage.step_for(u.m, u.k, v, z, g, t)
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
                give(u, (stage.print_slot(v, t),), (select(touches, landed[15], 0.0),))
                turning = select_all(touches, landed[16:20], (zero, zero, zero, zero))
                give(u, consecutive(voxel + memory.ORIENTATION, 4), turning)
            if ti.static(t.medium.water):
                slowed_adjoint(u, v, g, t, p[3:6], dt)
            give_force(u, v, g, t, p[:6])
        else:
            if ti.static(t.medium.granular):
                store_all(u.a, u.k, (stage.print_slot(v, t),), (zero,))
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
    slot = (emit(stage.print_slot(v, t)),)
    pressed, seed, limit = before(u, slot), take_all(u, slot), relief.yield_of(u.k, t)
    turn, sides = before(u, consecutive(stage.voxel_slot(v, t) + memory.ORIENTATION, 4)), stage.wet_sides(v, t)
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
    (pressed,) = before(u, (stage.print_slot(v, t),))
    limit = relief.yield_of(u.k, t)
    turn, sides = before(u, consecutive(voxel_slot(v, t) + memory.ORIENTATION, 4)), stage.wet_sides(v, t)
    below = uneven.outer_share(*turn, 0.0 - nx, 0.0 - ny, 0.0 - nz, *sides)
    bears, _, _ = uneven.giving_way(size, depth, pressed, stiffness, limit, below)
    ax, ay = after(u, consecutive(stage.print_slot(v, t) + 1, 2))
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
    around = stage.volume_in_water(v, u.k, t) + (t.time_step,)
    reverse(u, fluid.slowed_step, (voxel_slot(v, t) + 2,), stage.volume_slots(g), around, (seed,))


@ti.func
def give_force(u: ti.template(), v, g: ti.template(), t: ti.template(), found: ti.template()):
    """Store the cotangents of momentum and force; those of the external force add to its group's."""
    store_all(u.a, u.k, consecutive(voxel_slot(v, t) + memory.MOMENTUM, 3), found[:3])
    store_all(u.a, u.k, force_slots(v, t), found[3:])
    give(u, consecutive(g.current + memory.PUSH, 3), found[3:])


@ti.func
def gauge_adjoint(u: ti.template(), v, t: ti.template()):
    """Reverse a voxel's gauges: takes the cotangents of its new strains to those of its links' new memory."""
    gx, gy, gz = strain_cotangents(u, v, t)
    axis_adjoint(u, v, 0, gx, t)
    axis_adjoint(u, v, 1, gy, t)
    axis_adjoint(u, v, 2, gz, t)


@ti.func
def strain_cotangents(u: ti.template(), v, t: ti.template()):
    """Cotangents of a voxel's new strains, those with Poisson's effect included."""
    gauge = consecutive(stage.gauge_slot(v, t), 3)
    gx, gy, gz = take_all(u, gauge)
    if t.plan[memory.POISSON_ON] != 0:
        nu = ti.static(stage.group_of(v, t)).constant + materials.NU
        inputs = after(u, gauge) + parameters_of(u, (nu,))
        seeds = take_all(u, consecutive(gauge[0] + 3, 3))
        found = ti.static(pull_back(motion.poisson_strains, inputs, gauges.tensions(u.m, u.k, v, t), seeds))
        gx, gy, gz = gx + found[0], gy + found[1], gz + found[2]
        give(u, (nu,), found[3:])
    return gx, gy, gz


@ti.func
def axis_adjoint(u: ti.template(), v, axis: ti.template(), seed, t: ti.template()):
    """Reverse :func:`gauges.axis_strain`."""
    if stage.link_count(v, axis, t) == 2:
        seed = 0.5 * seed
    now = ti.static(u._replace(old=u.new))  # the links are done
    for side in ti.static(range(2)):
        l = t.voxel[v * columns.VOXEL_COLUMNS + columns.SIDE_LINK + 2 * axis + side]
        if l >= 0:
            extension = t.plan[memory.LINK] + l * memory.LINK_WIDTH
            reverse(now, beams.shared_strain, (extension,), gauges.share_slots(l, side, t), (), (seed,))
