"""The stage of a voxel: floor, pressure, drag and integration. Its gauges are in ``gauges``.

See ``groups`` for what the arguments hold, ``voxel_adjoint`` for the reverse.
"""

from typing import Any, NamedTuple

from taichi_sim.autodiff.lanes import absolute, any_lane, consecutive, load, load_all, slots_at, store, store_all
from taichi_sim.autodiff.tracing import primitive, select
from taichi_sim.ground import laws as uneven
from taichi_sim.lattice import materials
from taichi_sim.lattice.laws import floor, fluid, motion
from taichi_sim.lattice.stages import columns, memory, relief
from taichi_sim.lattice.stages.groups import channels_of
from taichi_sim.runtime import element, emit, ti


@ti.func
def voxel_slot(v, t: ti.template()):
    """First slot of voxel v's motion."""
    return t.plan[memory.VOXEL] + v * memory.VOXEL_WIDTH


class Group(NamedTuple):
    """First slots of a voxel's group in CONSTANT, in CURRENT, and of the values of its channels."""

    constant: Any
    current: Any
    channels: Any


@primitive
def group_of(v: Any, t: columns.Shared) -> Group:
    """The group of voxel v."""
    group = element(t.voxel, emit(v * columns.VOXEL_COLUMNS + columns.GROUP))
    starts = element(t.plan, memory.CONSTANT) + group, element(t.plan, memory.CURRENT) + group
    return Group(*map(emit, (*starts, channels_of(v, t))))


@ti.func
def gauge_slot(v, t: ti.template()):
    """First slot of voxel v's strains."""
    return t.plan[memory.STRAIN] + t.voxel[v * columns.VOXEL_COLUMNS + columns.GAUGE]


@ti.func
def momentum_slots(g: ti.template()):
    """Slots of inverse mass and drag."""
    return g.constant + materials.INVERSE_MASS, g.current + memory.DRAG


@ti.func
def rotation_slots(g: ti.template()):
    """Slots of inverse inertia and drag against rotation."""
    return g.constant + materials.INVERSE_INERTIA, g.current + memory.ANGULAR_DRAG


@ti.func
def floor_slots(g: ti.template()):
    """Slots of mean size, stiffness and damping of contact, and kinetic friction."""
    contact = slots_at(g.constant, (materials.STIFFNESS, materials.CONTACT_DAMPING))
    return (g.current + memory.MEAN_SIZE,) + contact + (g.channels + columns.KINETIC_FRICTION,)


@ti.func
def face_slots(g: ti.template()):
    """Slots of rest sizes and pressure."""
    return consecutive(g.current + memory.SIZE, 3) + (g.channels + columns.PRESSURE,)


@ti.func
def drag_slots(g: ti.template()):
    """Slots of inverse mass, rest sizes, and both resistances of the fluid around a voxel."""
    sizes = consecutive(g.current + memory.SIZE, 3)
    return (g.constant + materials.INVERSE_MASS,) + sizes + slots_at(g.channels, columns.RESISTANCE)


@ti.func
def water_slots(g: ti.template()):
    """Slots of all that the force of water on a voxel depends on."""
    return drag_slots(g) + (g.current + memory.MEAN_SIZE,)


@ti.func
def volume_slots(g: ti.template()):
    """Slots of inverse mass, rest sizes and mean size."""
    return (g.constant + materials.INVERSE_MASS,) + consecutive(g.current + memory.SIZE, 4)


@ti.func
def print_slot(v, t: ti.template()):
    """Slot of how deep voxel v has pressed the ground; its momentum along the ground follows, in axes of that."""
    return t.plan[memory.PRINT] + v * memory.PRINT_WIDTH


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
def held(v, freedom: ti.template(), value, prescribed, t: ti.template()):
    """What becomes of a degree of freedom: its own value, or the prescribed one where the world holds it."""
    if ti.static(not t.packed):
        if t.voxel[v * columns.VOXEL_COLUMNS + columns.FIXED] & (1 << freedom) != 0:
            value = prescribed
    else:
        value = select(t.shape[v * columns.SHAPE_COLUMNS + columns.HELD + freedom] > 0.5, prescribed, value)
    return value


@primitive
def start_place(v: Any, t: Any) -> tuple[Any, ...]:
    """Where voxel v started [m]."""
    if not t.packed:
        return tuple(element(t.start, v, c) for c in range(3))
    return shape_of(v, columns.START, t)


@primitive
def shape_of(v: Any, column: int, t: Any) -> tuple[Any, ...]:
    """Three reals of a pack of voxels, see ``columns``."""
    return load_all(t.shape, emit(v * columns.SHAPE_COLUMNS), range(column, column + 3))


@ti.func
def held_turns(v, like, t: ti.template()):
    """1 for each rotation that the world holds, else 0, as reals of the kind of ``like``."""
    zero = 0.0 * like
    one = 1.0 + zero
    return held(v, 3, zero, one, t), held(v, 4, zero, one, t), held(v, 5, zero, one, t)


@ti.func
def table_displaced_volume(v, t: ti.template()):
    """:func:`displaced_volume` by the table of voxels."""
    wet = t.voxel[v * columns.VOXEL_COLUMNS + columns.WET]
    return ti.cast(wet // columns.BEHIND_WET, float) / columns.VOLUME


@primitive
def displaced_volume(v: Any, t: Any) -> Any:
    """How often its own volume a voxel displaces."""
    if not t.packed:
        return table_displaced_volume(v, t)
    return load(t.shape, emit(v * columns.SHAPE_COLUMNS), columns.DISPLACED)


@primitive
def wet_faces(v: Any, t: Any) -> tuple[Any, ...]:
    """How many faces along each axis a fluid or sand reaches."""
    if t.packed:
        return tuple(absolute(count) for count in shape_of(v, columns.WET_FACES, t))
    return table_wet_faces(v, t)


@ti.func
def table_wet_faces(v, t: ti.template()):
    """:func:`wet_faces` by the table of voxels."""
    return both_sides(v, 0, 1, t), both_sides(v, 1, 1, t), both_sides(v, 2, 1, t)


@primitive
def wet_sides(v: Any, t: Any) -> tuple[Any, ...]:
    """:func:`wet_faces`, and the sum of their normals."""
    if not t.packed:
        return table_wet_faces(v, t) + table_wet_normals(v, t)
    counts = [emit(count) for count in shape_of(v, columns.WET_FACES, t)]
    faces = tuple(emit(absolute(count)) for count in counts)
    return faces + tuple(count * (2.0 - face) for count, face in zip(counts, faces, strict=True))


@ti.func
def table_wet_normals(v, t: ti.template()):
    """Sum of the normals of a voxel's wet faces by the table of voxels."""
    return both_sides(v, 0, -1, t), both_sides(v, 1, -1, t), both_sides(v, 2, -1, t)


@ti.func
def both_sides(v, axis: ti.template(), sign: ti.template(), t: ti.template()):
    """1 if a voxel's upper side along an axis is wet, and so many more if the lower one is."""
    wet = t.voxel[v * columns.VOXEL_COLUMNS + columns.WET] >> (2 * axis)
    return ti.cast(((wet >> 1) & 1) + sign * (wet & 1), float)


@primitive
def pressed_faces(v: Any, t: Any) -> tuple[Any, ...]:
    """Half the number of links along each axis, and the normals of the voxel's pressurised faces."""
    if t.packed:
        return shape_of(v, columns.HALF_LINKS, t) + shape_of(v, columns.NORMALS, t)
    return table_pressed_faces(v, t)


@ti.func
def table_pressed_faces(v, t: ti.template()):
    """:func:`pressed_faces` by the table of voxels."""
    normal = v * columns.VOXEL_COLUMNS + columns.NORMAL
    links = link_count(v, 0, t), link_count(v, 1, t), link_count(v, 2, t)
    halves = 0.5 * ti.cast(links[0], float), 0.5 * ti.cast(links[1], float), 0.5 * ti.cast(links[2], float)
    nx, ny, nz = t.voxel[normal], t.voxel[normal + 1], t.voxel[normal + 2]
    return halves + (ti.cast(nx, float), ti.cast(ny, float), ti.cast(nz, float))


@ti.func
def link_count(v, axis: ti.template(), t: ti.template()):
    """How many of a voxel's two sides along an axis have a link."""
    side = v * columns.VOXEL_COLUMNS + columns.SIDE_LINK + 2 * axis
    return ti.cast(t.voxel[side] >= 0, ti.i32) + ti.cast(t.voxel[side + 1] >= 0, ti.i32)
