"""The stage of a voxel, and its reverse: pressure, drag, water, ground and integration. Its gauges are in ``gauges``.

See ``groups`` for what the arguments hold.
"""

from typing import Any

from taichi_sim.autodiff.lanes import consecutive, load_all, slots_at, store_all
from taichi_sim.autodiff.tracing import primitive, pull_back
from taichi_sim.lattice import materials
from taichi_sim.lattice.laws import fluid, motion
from taichi_sim.lattice.stages import columns, memory, relief
from taichi_sim.lattice.stages.momentum import force_slots, momentum_adjoint, push, push_on_relief, step_for
from taichi_sim.lattice.stages.undo import after, before, cotangents_of, give, parameters_of, reverse
from taichi_sim.lattice.stages.voxel_slots import (
    displaced_volume,
    drag_slots,
    face_slots,
    gauge_slot,
    group_of,
    held,
    held_turns,
    momentum_slots,
    pressed_faces,
    rotation_slots,
    start_place,
    voxel_slot,
    water_slots,
    wet_faces,
)
from taichi_sim.runtime import ti


@primitive
def around_in_water(v: Any, k: Any, t: Any) -> tuple[Any, ...]:
    """Wet faces along each axis, how often its own volume a voxel displaces; the edge; the water's level and weight."""
    level, weight, _ = relief.water_of(k, t)
    return *wet_faces(v, t), displaced_volume(v, t), t.edge, level, weight


@ti.func
def voxel_stage(m: ti.template(), k, v, fx, fy, fz, mx, my, mz, cx, cy, cz, t: ti.template()):
    """Integrate voxel v under the forces F and moments M of its links and the contact force c, world; its new place."""
    voxel = voxel_slot(v, t)
    g = ti.static(group_of(v, t))
    x, y, z, qw, qx, qy, qz = load_all(m, k, consecutive(voxel, 7))
    px, py, pz = load_all(m, k, consecutive(voxel + memory.MOMENTUM, 3))
    if t.voxel[v * columns.VOXEL_COLUMNS + columns.FEELS_PRESSURE] != 0:
        gauges, normals = load_all(m, k, consecutive(gauge_slot(v, t), 3)), pressed_faces(v, t)
        ax, ay, az = motion.face_force(qw, qx, qy, qz, *gauges, *load_all(m, k, face_slots(g)), *normals)
        fx, fy, fz = fx + ax, fy + ay, fz + az
    if t.plan[memory.FLUID_ON] != 0:
        given = load_all(m, k, drag_slots(g))
        ax, ay, az = fluid.drag(qw, qx, qy, qz, px, py, pz, *given, *wet_faces(v, t))
        fx, fy, fz = fx + ax, fy + ay, fz + az
    if ti.static(t.medium.water):
        given = load_all(m, k, water_slots(g))
        ax, ay, az = fluid.water_force(qw, qx, qy, qz, px, py, pz, z, *given, *around_in_water(v, k, t))
        fx, fy, fz = fx + ax, fy + ay, fz + az
    dt = step_for(m, k, v, z, g, t)
    ax, ay, az = load_all(m, k, consecutive(g.current + memory.PUSH, 3))
    inverse_mass, drag = load_all(m, k, momentum_slots(g))
    fx, fy, fz = motion.damped_force(fx + ax, fy + ay, fz + az, px, py, pz, inverse_mass, drag, cx, cy, cz)
    if ti.static(t.medium.relief):
        px, py, pz = push_on_relief(m, k, v, (x, y, z), (px, py, pz), (fx, fy, fz), dt, inverse_mass, g, t)
    else:
        px, py, pz = push(m, k, v, (px, py, pz), (fx, fy, fz), z, inverse_mass, g, t)
    lx, ly, lz = load_all(m, k, consecutive(voxel + memory.ANGULAR_MOMENTUM, 3))
    ax, ay, az = load_all(m, k, slots_at(g.channels, columns.MOMENT))
    inverse_inertia, drag = load_all(m, k, rotation_slots(g))
    mx, my, mz = motion.damped_moment(mx + ax, my + ay, mz + az, lx, ly, lz, inverse_inertia, drag)
    lx, ly, lz = motion.accelerated(lx, ly, lz, mx, my, mz, t.time_step)
    bits = t.voxel[v * columns.VOXEL_COLUMNS + columns.FIXED]
    if bits != 0:
        zero = 0.0 * inverse_mass
        px, py, pz = held(v, 0, px, zero, t), held(v, 1, py, zero, t), held(v, 2, pz, zero, t)
        lx, ly, lz = held(v, 3, lx, zero, t), held(v, 4, ly, zero, t), held(v, 5, lz, zero, t)
    x, y, z, qw, qx, qy, qz = motion.placed(
        x, y, z, qw, qx, qy, qz, px, py, pz, lx, ly, lz, inverse_mass, inverse_inertia, t.time_step
    )
    if bits != 0:
        ax, ay, az = load_all(m, k, slots_at(g.channels, columns.TRANSLATION))
        sx, sy, sz = start_place(v, t)
        x, y, z = held(v, 0, x, sx + ax, t), held(v, 1, y, sy + ay, t), held(v, 2, z, sz + az, t)
        if bits >= 8:
            turn = load_all(m, k, slots_at(g.channels, columns.ROTATION))
            qw, qx, qy, qz = motion.held_rotation(qw, qx, qy, qz, *turn, *held_turns(v, inverse_mass, t))
    store_all(m, k, consecutive(voxel, 7), (x, y, z, qw, qx, qy, qz))
    store_all(m, k, consecutive(voxel + memory.MOMENTUM, 6), (px, py, pz, lx, ly, lz))
    return x, y, z


@ti.func
def voxel_adjoint(u: ti.template(), v, t: ti.template()):
    """Reverse voxel v: from the cotangents of its new state to those of its old one and of its force and moment."""
    voxel = voxel_slot(v, t)
    g = ti.static(group_of(v, t))
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
        state = consecutive(voxel + memory.ORIENTATION, 4) + consecutive(gauge_slot(v, t), 3)
        seeds = cotangents_of(u, force_slots(v, t))
        reverse(u, motion.face_force, state, face_slots(g), pressed_faces(v, t), seeds)
    if t.plan[memory.FLUID_ON] != 0:
        state = consecutive(voxel + memory.ORIENTATION, 7)  # the momentum follows the orientation
        seeds = cotangents_of(u, force_slots(v, t))
        reverse(u, fluid.drag, state, drag_slots(g), wet_faces(v, t), seeds)
    if ti.static(t.medium.water):
        state = consecutive(voxel + memory.ORIENTATION, 7) + (voxel + 2,)
        seeds = cotangents_of(u, force_slots(v, t))
        reverse(u, fluid.water_force, state, water_slots(g), around_in_water(v, u.k, t), seeds)


@ti.func
def held_adjoint(u: ti.template(), v, g: ti.template(), free: ti.template(), t: ti.template(), seeds: ti.template()):
    """Reverse the hold on a voxel's rotation; the cotangents of its free orientation."""
    slots = slots_at(g.channels, columns.ROTATION)
    inputs = free + parameters_of(u, slots)
    found = ti.static(pull_back(motion.held_rotation, inputs, held_turns(v, inputs[4], t), seeds))
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
    inputs = old + (zero, zero, zero) + parameters_of(u, rotation_slots(g))
    found = ti.static(pull_back(turned, inputs, (t.time_step,), seeds))
    store_all(u.a, u.k, momentum, found[:3])
    store_all(u.a, u.k, consecutive(t.plan[memory.FORCE] + 6 * v + 3, 3), found[3:6])
    give(u, slots_at(g.channels, columns.MOMENT) + rotation_slots(g), found[3:])
