"""Where the values of a voxel lie in memory, and what the tables say of it: faces, links, what the world holds.

See ``groups`` for what the arguments hold.
"""

from typing import Any, NamedTuple

from taichi_sim.autodiff.lanes import absolute, consecutive, load, load_all, slots_at
from taichi_sim.autodiff.tracing import primitive, select
from taichi_sim.lattice import materials
from taichi_sim.lattice.stages import columns, memory
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
def bearing_slots(g: ti.template()):
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
    """Which sides of a voxel along an axis are wet: 1 for the upper one, plus ``sign`` for the lower one."""
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
