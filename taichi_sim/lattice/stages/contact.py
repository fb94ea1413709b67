"""Contact between the voxels of a robot: places of surface voxels, the force of a pair, and its reverse.

See ``groups`` for what the arguments hold.
"""

from taichi_sim.autodiff.lanes import accumulate_all, load, load_all
from taichi_sim.autodiff.tracing import Condition, pull_back
from taichi_sim.lattice.laws import contact
from taichi_sim.lattice.materials import CONTACT_DAMPING, INVERSE_MASS, STIFFNESS
from taichi_sim.lattice.stages import columns, memory
from taichi_sim.runtime import ti


@ti.func
def group_of(s, t: ti.template()):
    """Place of surface voxel s's group in CONSTANT and CURRENT."""
    return t.surface[columns.SURFACE_COLUMNS * s + columns.SURFACE_GROUP]


@ti.func
def place_slots(s, t: ti.template()):
    """Slots of the position of surface voxel s."""
    voxel = t.plan[memory.VOXEL] + t.surface[columns.SURFACE_COLUMNS * s + columns.SURFACE_VOXEL]
    return voxel, voxel + 1, voxel + 2


@ti.func
def listed_slots(s, t: ti.template()):
    """Slots of where surface voxel s was when the neighbour list was built."""
    listed = t.plan[memory.LISTED] + 3 * s
    return listed, listed + 1, listed + 2


@ti.func
def motion_slots(base, s, t: ti.template()):
    """Slots of position and momentum of surface voxel s."""
    voxel = base + t.plan[memory.VOXEL] + t.surface[columns.SURFACE_COLUMNS * s + columns.SURFACE_VOXEL]
    momentum = voxel + memory.MOMENTUM
    return voxel, voxel + 1, voxel + 2, momentum, momentum + 1, momentum + 2


@ti.func
def size_slots(s1, s2, t: ti.template()):
    """Slots of the mean sizes of two surface voxels."""
    size = t.plan[memory.CURRENT] + memory.MEAN_SIZE
    return size + group_of(s1, t), size + group_of(s2, t)


@ti.func
def material_slots(s1, s2, t: ti.template()):
    """Slots of inverse masses, stiffnesses and damping coefficients of two surface voxels."""
    c1 = t.plan[memory.CONSTANT] + group_of(s1, t)
    c2 = t.plan[memory.CONSTANT] + group_of(s2, t)
    return (
        c1 + INVERSE_MASS,
        c2 + INVERSE_MASS,
        c1 + STIFFNESS,
        c2 + STIFFNESS,
        c1 + CONTACT_DAMPING,
        c2 + CONTACT_DAMPING,
    )


@ti.func
def surface_place(m: ti.template(), k, s, t: ti.template()):
    """Position and mean size of surface voxel s."""
    x, y, z = load_all(m, k, place_slots(s, t))
    return x, y, z, load(m, k, t.plan[memory.CURRENT] + memory.MEAN_SIZE + group_of(s, t))


@ti.func
def contact_force(m: ti.template(), k, s1, s2, dx, dy, dz, limit, near: ti.template(), t: ti.template()):
    """Force on the second of two surface voxels that touch where ``near``; the first feels the opposite."""
    _, _, _, px, py, pz = load_all(m, k, motion_slots(0, s1, t))
    _, _, _, qx, qy, qz = load_all(m, k, motion_slots(0, s2, t))
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


@ti.func
def were_near(u: ti.template(), s1, s2, t: ti.template()):
    """Where two surface voxels touched, decided as in the step itself."""
    x1, y1, z1, _, _, _ = load_all(u.record, u.r, motion_slots(u.old, s1, t))
    x2, y2, z2, _, _, _ = load_all(u.record, u.r, motion_slots(u.old, s2, t))
    size1, size2 = load_all(u.m, u.k, size_slots(s1, s2, t))
    limit = contact.reach(size1, size2)
    dx = x2 - x1
    dy = y2 - y1
    dz = z2 - z1
    return dx * dx + dy * dy + dz * dz < limit * limit


@ti.func
def contact_adjoint(u: ti.template(), s1, s2, near, t: ti.template()):
    """Reverse the contact of two surface voxels in the lanes where they are near."""
    f1 = load_all(u.a, u.k, force_slots(s1, t))
    f2 = load_all(u.a, u.k, force_slots(s2, t))
    seeds = (f2[0] - f1[0], f2[1] - f1[1], f2[2] - f1[2])
    parameters = size_slots(s1, s2, t) + material_slots(s1, s2, t)
    inputs = (
        load_all(u.record, u.r, motion_slots(u.old, s1, t))
        + load_all(u.record, u.r, motion_slots(u.old, s2, t))
        + load_all(u.m, u.k, parameters)
    )
    slots = motion_slots(0, s1, t) + motion_slots(0, s2, t) + parameters
    accumulate_all(u.a, u.k, slots, ti.static(pull_back(contact.pair_force, inputs, (Condition(near),), seeds)))


@ti.func
def force_slots(s, t: ti.template()):
    """Slots of the cotangents of the force on surface voxel s."""
    slot = t.plan[memory.FORCE] + 6 * (
        t.surface[columns.SURFACE_COLUMNS * s + columns.SURFACE_VOXEL] // memory.VOXEL_WIDTH
    )
    return slot, slot + 1, slot + 2
