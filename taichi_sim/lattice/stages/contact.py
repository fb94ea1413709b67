"""Contact between the voxels of a robot: places of surface voxels, the force of a pair, and its reverse.

See ``groups`` for what the arguments hold.
"""

from typing import Any

from taichi_sim.autodiff.lanes import consecutive, load, load_all, slots_at
from taichi_sim.autodiff.tracing import Condition, primitive
from taichi_sim.lattice.laws import contact
from taichi_sim.lattice.materials import CONTACT_DAMPING, INVERSE_MASS, STIFFNESS
from taichi_sim.lattice.stages import columns, memory
from taichi_sim.lattice.stages.undo import cotangents_of, reverse
from taichi_sim.runtime import ti

CONTACT_COLUMNS = (INVERSE_MASS, STIFFNESS, CONTACT_DAMPING)  # of the constants of a group


@ti.func
def group_of(s, t: ti.template()):
    """Place of surface voxel s's group in CONSTANT and CURRENT."""
    return t.surface[columns.SURFACE_COLUMNS * s + columns.SURFACE_GROUP]


@ti.func
def place_slots(s, t: ti.template()):
    """Slots of the position of surface voxel s."""
    return consecutive(t.plan[memory.VOXEL] + t.surface[columns.SURFACE_COLUMNS * s + columns.SURFACE_VOXEL], 3)


@ti.func
def listed_slots(s, t: ti.template()):
    """Slots of where surface voxel s was when the neighbour list was built."""
    return consecutive(t.plan[memory.LISTED] + 3 * s, 3)


@ti.func
def motion_slots(s, t: ti.template()):
    """Slots of position and momentum of surface voxel s."""
    place = place_slots(s, t)
    return place + consecutive(place[0] + memory.MOMENTUM, 3)


@ti.func
def size_slots(s1, s2, t: ti.template()):
    """Slots of the mean sizes of two surface voxels."""
    size = t.plan[memory.CURRENT] + memory.MEAN_SIZE
    return size + group_of(s1, t), size + group_of(s2, t)


@ti.func
def material_slots(s1, s2, t: ti.template()):
    """Slots of inverse masses, stiffnesses and damping coefficients of two surface voxels."""
    w1, k1, c1 = slots_at(t.plan[memory.CONSTANT] + group_of(s1, t), CONTACT_COLUMNS)
    w2, k2, c2 = slots_at(t.plan[memory.CONSTANT] + group_of(s2, t), CONTACT_COLUMNS)
    return w1, w2, k1, k2, c1, c2


@ti.func
def surface_place(m: ti.template(), k, s, t: ti.template()):
    """Position and mean size of surface voxel s."""
    x, y, z = load_all(m, k, place_slots(s, t))
    return x, y, z, load(m, k, t.plan[memory.CURRENT] + memory.MEAN_SIZE + group_of(s, t))


@ti.func
def contact_force(m: ti.template(), k, s1, s2, dx, dy, dz, limit, near: ti.template(), t: ti.template()):
    """Force on the second of two surface voxels that touch where ``near``; the first feels the opposite."""
    _, _, _, px, py, pz = load_all(m, k, motion_slots(s1, t))
    _, _, _, qx, qy, qz = load_all(m, k, motion_slots(s2, t))
    w1, w2, k1, k2, c1, c2 = load_all(m, k, material_slots(s1, s2, t))
    return contact.force_between(dx, dy, dz, limit, px, py, pz, qx, qy, qz, w1, w2, k1, k2, c1, c2, near)


@ti.func
def squared_move(m: ti.template(), k, s, x, y, z, t: ti.template()):
    """Squared distance of surface voxel s, now at (x, y, z), from where it was when the neighbour list was built."""
    lx, ly, lz = load_all(m, k, listed_slots(s, t))
    dx = x - lx
    dy = y - ly
    dz = z - lz
    return dx * dx + dy * dy + dz * dz


@primitive
def decided(near: Any) -> Condition:
    """Where voxels are near, as laws that are traced take it."""
    return Condition(near)


@ti.func
def contact_adjoint(u: ti.template(), s1, s2, near, t: ti.template()):
    """Reverse the contact of two surface voxels in the lanes where they are near."""
    f1 = cotangents_of(u, force_slots(s1, t))
    f2 = cotangents_of(u, force_slots(s2, t))
    seeds = (f2[0] - f1[0], f2[1] - f1[1], f2[2] - f1[2])
    state, parameters = motion_slots(s1, t) + motion_slots(s2, t), size_slots(s1, s2, t) + material_slots(s1, s2, t)
    reverse(u, contact.pair_force, state, parameters, (decided(near),), seeds)


@ti.func
def force_slots(s, t: ti.template()):
    """Slots of the cotangents of the force on surface voxel s."""
    voxel = t.surface[columns.SURFACE_COLUMNS * s + columns.SURFACE_VOXEL] // memory.VOXEL_WIDTH
    return consecutive(t.plan[memory.FORCE] + 6 * voxel, 3)
