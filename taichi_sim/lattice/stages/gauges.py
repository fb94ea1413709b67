"""Gauges of a voxel: they read its strain when its links are done, for the next step's pressure and Poisson's effect.

See ``groups`` for what the arguments hold.
"""

from taichi_sim.autodiff.lanes import consecutive, load, load_all, slots_at, store_all
from taichi_sim.autodiff.tracing import pull_back, select
from taichi_sim.lattice import materials
from taichi_sim.lattice.laws import link as beams
from taichi_sim.lattice.laws import motion
from taichi_sim.lattice.stages import columns, memory
from taichi_sim.lattice.stages.groups import channels_of
from taichi_sim.lattice.stages.link import beam_slot, rest_slot
from taichi_sim.lattice.stages.undo import after, give, parameters_of, reverse, take_all
from taichi_sim.lattice.stages.voxel_slots import gauge_slot, group_of, link_count
from taichi_sim.runtime import ti


@ti.func
def share_slots(l, side: ti.template(), t: ti.template()):
    """Slots of the inverse rest length of a link and of the share that the voxel on one side has in its strain."""
    share = beam_slot(l, t) + (materials.SHARE_PLUS if side == 0 else materials.SHARE_MINUS)
    return rest_slot(l, t) + 1, share


@ti.func
def gauge_stage(m: ti.template(), k, v, t: ti.template()):
    """Strains of a voxel whose links are all done, for the next step's pressure and Poisson's effect."""
    ex, ey, ez = axis_strain(m, k, v, 0, t), axis_strain(m, k, v, 1, t), axis_strain(m, k, v, 2, t)
    keep_strains(m, k, v, ex, ey, ez, t)


@ti.func
def keep_strains(m: ti.template(), k, v, ex, ey, ez, t: ti.template()):
    """Store the strains of a voxel, and what Poisson's effect makes of them."""
    gauge = gauge_slot(v, t)
    store_all(m, k, consecutive(gauge, 3), (ex, ey, ez))
    if t.plan[memory.POISSON_ON] != 0:
        nu = load(m, k, ti.static(group_of(v, t)).constant + materials.NU)
        strains = motion.poisson_strains(ex, ey, ez, nu, *tensions(m, k, v, t))
        store_all(m, k, consecutive(gauge + 3, 3), strains)


@ti.func
def axis_strain(m: ti.template(), k, v, axis: ti.template(), t: ti.template()):
    """Mean of a voxel's shares in the strains of its links along an axis."""
    total = 0.0 * load(m, k, t.plan[memory.CONSTANT])
    for side in ti.static(range(2)):
        l = t.voxel[v * columns.VOXEL_COLUMNS + columns.SIDE_LINK + 2 * axis + side]
        if l >= 0:
            extension = load(m, k, t.plan[memory.LINK] + l * memory.LINK_WIDTH)
            total = total + beams.shared_strain(extension, *load_all(m, k, share_slots(l, side, t)))
    if link_count(v, axis, t) == 2:
        total = 0.5 * total
    return total


@ti.func
def tensions(m: ti.template(), k, v, t: ti.template()):
    """Whether each axis of a voxel is in tension, see :func:`in_tension`."""
    return in_tension(m, k, v, 0, t), in_tension(m, k, v, 1, t), in_tension(m, k, v, 2, t)


@ti.func
def in_tension(m: ti.template(), k, v, axis: ti.template(), t: ti.template()):
    """1 for two links, or one and something to pull against: a held degree of freedom or an external force; else 0."""
    acceleration, force = load_all(m, k, slots_at(channels_of(v, t), ti.static(columns.PULLING[axis])))
    pull = force + acceleration
    tension = 0.0 * pull
    if ti.static(t.packed):
        row = v * columns.SHAPE_COLUMNS + axis
        alone = select(t.shape[row + columns.SINGLE] > 0.5, pull, tension)
        tension = select(alone != 0.0, tension + 1.0, tension + t.shape[row + columns.TENSE])
    else:
        count = link_count(v, axis, t)
        if count == 2:
            tension = tension + 1.0
        elif count == 1:
            if t.voxel[v * columns.VOXEL_COLUMNS + columns.FIXED] & (1 << axis) != 0:
                tension = tension + 1.0
            else:
                tension = select(pull != 0.0, 1.0, tension)
    return tension


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
    gauge = consecutive(gauge_slot(v, t), 3)
    gx, gy, gz = take_all(u, gauge)
    if t.plan[memory.POISSON_ON] != 0:
        nu = ti.static(group_of(v, t)).constant + materials.NU
        inputs = after(u, gauge) + parameters_of(u, (nu,))
        seeds = take_all(u, consecutive(gauge[0] + 3, 3))
        found = ti.static(pull_back(motion.poisson_strains, inputs, tensions(u.m, u.k, v, t), seeds))
        gx, gy, gz = gx + found[0], gy + found[1], gz + found[2]
        give(u, (nu,), found[3:])
    return gx, gy, gz


@ti.func
def axis_adjoint(u: ti.template(), v, axis: ti.template(), seed, t: ti.template()):
    """Reverse :func:`axis_strain`."""
    if link_count(v, axis, t) == 2:
        seed = 0.5 * seed
    now = ti.static(u._replace(old=u.new))  # the links are done
    for side in ti.static(range(2)):
        l = t.voxel[v * columns.VOXEL_COLUMNS + columns.SIDE_LINK + 2 * axis + side]
        if l >= 0:
            extension = t.plan[memory.LINK] + l * memory.LINK_WIDTH
            reverse(now, beams.shared_strain, (extension,), share_slots(l, side, t), (), (seed,))
