"""The stage of a link, the beam between two voxels, and its reverse: from their poses to the forces on both, and back.

See ``groups`` for what the arguments hold.
"""

from typing import Any, NamedTuple

from taichi_sim.autodiff.lanes import (
    all_lanes,
    assign_all,
    consecutive,
    load,
    load_all,
    slots_at,
    store,
    store_all,
    variables,
)
from taichi_sim.autodiff.tracing import primitive, pull_back, select
from taichi_sim.lattice import materials
from taichi_sim.lattice.laws import link as laws
from taichi_sim.lattice.stages import columns, memory
from taichi_sim.lattice.stages.undo import before, cotangents_of, give, in_parts, parameters_of, reverse
from taichi_sim.runtime import emit, ti

BENDING = (materials.STIFF, materials.DAMP_MINUS, materials.DAMP_PLUS, materials.TWIST, materials.TWIST_ROOT)


@ti.func
def pose_slots(l, t: ti.template()):
    """Slots of the positions and orientations of a link's two voxels, components along its axis first."""
    row, axes = l * columns.LINK_COLUMNS, link_axes(l, t)
    minus, plus = t.link[row + columns.LINK_MINUS], t.link[row + columns.LINK_PLUS]
    return turned_pose(t.plan[memory.VOXEL] + minus, axes) + turned_pose(t.plan[memory.VOXEL] + plus, axes)


@ti.func
def turned_pose(voxel, axes: ti.template()):
    """Slots of the position and orientation of the voxel at a slot, components along an axis first."""
    a, b, c = axes
    turn = voxel + memory.ORIENTATION
    return voxel + a, voxel + b, voxel + c, turn, turn + 1 + a, turn + 1 + b, turn + 1 + c


@ti.func
def past_slot(l, t: ti.template()):
    """First slot of what a link remembers of the last step: offset and rotation vector, and its regime."""
    return t.plan[memory.LINK] + l * memory.LINK_WIDTH


@ti.func
def rest_slot(l, t: ti.template()):
    """Slot of a link's rest length; that of its inverse is the next."""
    return t.plan[memory.REST] + t.link[l * columns.LINK_COLUMNS + columns.LINK_REST]


@ti.func
def beam_slot(l, t: ti.template()):
    """First slot of the constants of a link's beam."""
    return t.plan[memory.BEAM] + t.link[l * columns.LINK_COLUMNS + columns.LINK_BEAM]


@ti.func
def bending_slots(beam):
    """Slots of the constants of a beam that its forces need besides the axial one's."""
    return slots_at(beam, BENDING)


@ti.func
def axial_slots(rest, beam):
    """Slots of a link's rest length and its inverse, and of its axial and transverse stiffness."""
    return rest, rest + 1, beam + materials.AXIAL, beam + materials.TRANSVERSE


@ti.func
def transverse_slots(l, t: ti.template()):
    """Slots of the two transverse strains of either voxel of a link."""
    row = l * columns.LINK_COLUMNS
    first = t.link[row + columns.LINK_FIRST] * columns.VOXEL_COLUMNS
    second = t.link[row + columns.LINK_SECOND] * columns.VOXEL_COLUMNS
    s1 = t.plan[memory.STRAIN] + t.voxel[first + columns.GAUGE] + 3
    s2 = t.plan[memory.STRAIN] + t.voxel[second + columns.GAUGE] + 3
    _, b, c = link_axes(l, t)
    return s1 + b, s1 + c, s2 + b, s2 + c


@primitive
def transverse_strains(m: Any, k: Any, l: Any, t: Any) -> Any:
    """The two transverse strains of either voxel of a link."""
    return t.transverse(m, k, l) if t.packed else load_all(m, k, transverse_slots(l, t))


@ti.func
def link_axes(l, t: ti.template()):
    """Components along and across a link's axis."""
    row = l * columns.LINK_COLUMNS
    return t.link[row + columns.LINK_ALONG], t.link[row + columns.LINK_SIDE_1], t.link[row + columns.LINK_SIDE_2]


@ti.func
def end_slots(first, axes: ti.template()):
    """Slots of three components of a force, then of a moment, that begin at a slot; along the link's axis first."""
    a, b, c = first + axes[0], first + axes[1], first + axes[2]
    return a, b, c, a + 3, b + 3, c + 3


@ti.func
def is_straight(before, x, y, z, rest):
    """Mask of the lanes whose link is and was in the small-angle regime."""
    return laws.stays_small(x, y, z, rest) & (before == laws.SMALL)


class LinkInputs(NamedTuple):
    """What a link's forces depend on, all but what is fixed.

    Attributes:
        minus, plus: poses of its two voxels.
        past: offset and rotation vector of the last step.
        axial: rest length, its inverse, axial and transverse stiffness.
        bending: the other constants of its beam.
        section: squeeze and area by Poisson's effect.
    """

    minus: Any
    plus: Any
    past: Any
    axial: Any
    bending: Any
    section: Any


LINK_WIDTHS = LinkInputs(minus=7, plus=7, past=6, axial=4, bending=len(BENDING), section=2)


class Strained(NamedTuple):
    """How a link is strained: offset and rotation vector (6), half their changes, strain, regime, turn onto its axis.

    The last, (regime, w, y, z), is empty for links that are and were in the regime of small angles.
    """

    strains: Any
    changes: Any
    tension: Any
    regime: Any


@primitive
def strained(relative: Any, past: Any, rest: Any, inverse: Any, before: Any, turned: bool) -> Strained:
    """How a link is strained whose "+" voxel is at a pose in the frame of its "-" voxel.

    Args:
        relative: offset and orientation of the "+" voxel.
        past: offset and rotation vector of the last step.
        rest, inverse: rest length and its inverse.
        before: the last regime.
        turned: whether the link may be, or have been, in another regime than that of small angles.
    """
    half: Any = 0.5
    regime: Any = ()
    if turned:
        found = variables(laws.turned_strains(*relative, rest, before))
        strains, regime = found[:6], found[6:]
        half = laws.memory_weight(before, regime[0])
    else:
        strains = variables(laws.straight_strains(*relative, rest))
    changes = variables(laws.half_changes(half, *strains, *past))
    return Strained(strains, changes, emit(laws.strain(strains[0], inverse)), regime)


@primitive
def answer(found: Strained, bending: Any, pull: Any, edge: Any, alike: Any) -> Any:
    """A strained link's forces (F, M, G, N) in the frame of its "-" voxel; see ``laws.end_forces`` for ``alike``."""
    law = laws.turned_forces if found.regime else laws.straight_forces
    return law(edge, *bending, pull, *found.strains[1:], *found.changes, *found.regime, alike)


@primitive
def on_voxels(ends: Any, minus: Any, plus: Any, alike: Any, balances: bool) -> Any:
    """A link's forces (F, M, G, N) in the world, from those in the frame of its "-" voxel."""
    ends = laws.in_world(*minus[3:], *ends, alike)
    if balances:
        (x1, y1, z1), (x2, y2, z2) = minus[:3], plus[:3]
        ends = laws.balanced(x2 - x1, y2 - y1, z2 - z1, *ends)
    return ends


@ti.func
def link_stage(m: ti.template(), k, l, t: ti.template()):
    """What link l adds to its "-" voxel, force F and moment M, and takes from its "+" voxel, G and N: (F, M, G, N).

    World frame, components along the link's axis first.
    """
    poses = load_all(m, k, pose_slots(l, t))
    return link_forces(m, k, l, poses[:7], poses[7:], 1, t)


@ti.func
def link_forces(m: ti.template(), k, l, first: ti.template(), second: ti.template(), full, t: ti.template()):
    """:func:`link_stage` of voxels of these poses; lanes without a link, if not ``full``, are straight and at rest."""
    x, y, z, qw, qx, qy, qz = laws.relative_pose(*first, *second)
    if ti.static(t.packed):
        if full == 0:
            there = load(t.lanes.there, l, 0)
            x = select(there > 0.5, x, load(m, k, rest_slot(l, t)))
            y, z, qw = select(there > 0.5, y, 0.0), select(there > 0.5, z, 0.0), select(there > 0.5, qw, 1.0)
    alike = t.link[l * columns.LINK_COLUMNS + columns.LINK_SYMMETRIC]
    ends = bend(m, k, l, x, y, z, qw, qx, qy, qz, alike, t)
    return on_voxels(ends, first, second, alike, t.medium.balances)


@ti.func
def bend(m: ti.template(), k, l, x, y, z, qw, qx, qy, qz, alike, t: ti.template()):
    """The beam to a voxel at (x, y, z) with orientation q, all in the frame of the "-" voxel: (F, M, G, N)."""
    past, rest = past_slot(l, t), rest_slot(l, t)
    length, before = load_all(m, k, (rest, past + memory.REGIME))
    relative = ti.static((x, y, z, qw, qx, qy, qz))
    ends = ti.static(variables([x] * 12))
    if all_lanes(is_straight(before, x, y, z, length)):  # most links of a healthy robot
        found = ti.static(strained_now(m, k, past, relative, length, rest, before, False))
        store_all(m, k, consecutive(past, 6), found.strains)
        pull = axial_force(m, k, l, found.tension, t)
        bending = load_all(m, k, bending_slots(beam_slot(l, t)))
        assign_all(ends, answer(found, bending, pull, t.edge, alike))
    else:
        found = ti.static(strained_now(m, k, past, relative, length, rest, before, True))
        store_all(m, k, consecutive(past, 7), found.strains + found.regime[:1])
        pull = axial_force(m, k, l, found.tension, t)
        bending = load_all(m, k, bending_slots(beam_slot(l, t)))
        assign_all(ends, answer(found, bending, pull, t.edge, alike))
    return ti.static(tuple(ends))


@primitive
def strained_now(m: Any, k: Any, past: Any, relative: Any, length: Any, rest: Any, before: Any, turned: bool) -> Any:
    """:func:`strained`, with what the link remembers from its memory."""
    return strained(relative, load_all(m, k, consecutive(past, 6)), length, load(m, k, rest + 1), before, turned)


@ti.func
def axial_force(m: ti.template(), k, l, tension, t: ti.template()):
    """Stress times cross-section of a link [N]; an absurd strain marks the robot as diverged."""
    if not all_lanes(tension <= laws.DIVERGED_STRAIN):
        mark = t.plan[memory.MONITOR] + memory.DIVERGED
        store(m, k, mark, select(tension <= laws.DIVERGED_STRAIN, load(m, k, mark), 1.0))
    beam = beam_slot(l, t)
    axial = load(m, k, beam + materials.AXIAL)
    force = laws.axial_force(tension, axial, 0.0, 0.0, 0.0, False)
    if t.plan[memory.POISSON_ON] != 0:
        section = laws.cross_section(*transverse_strains(m, k, l, t))
        force = laws.axial_force(tension, axial, load(m, k, beam + materials.TRANSVERSE), *section, True)
    return force


@primitive
def whole_link(*given: Any) -> Any:
    """What the stage does, as one function of all that it depends on, to trace it backwards: (F, M, G, N), new memory.

    ``given`` are the numbers of ``LinkInputs``, edge, the last regime, whether links are balanced, and whether the link
    may be, or have been, in another regime than that of small angles.
    """
    *numbers, edge, before, balances, turned = given
    link = in_parts(LINK_WIDTHS, numbers)
    rest, inverse, axial, transverse = link.axial
    relative = laws.relative_pose(*link.minus, *link.plus)
    found = strained(relative, link.past, rest, inverse, before, turned)
    pull = laws.axial_force(found.tension, axial, transverse, *link.section, True)
    # Not alike: sums of G's cotangents and F's have the order of links of any kind.
    ends = answer(found, link.bending, pull, edge, 0)
    return (*on_voxels(ends, link.minus, link.plus, 0, balances), *found.strains)


@ti.func
def link_adjoint(u: ti.template(), l, t: ti.template()):
    """Reverse link l: reads the cotangents of its voxels' forces (FORCE) and of its new memory (LINK)."""
    poses, axes = before(u, pose_slots(l, t)), link_axes(l, t)
    first = t.link[l * columns.LINK_COLUMNS + columns.LINK_FIRST]
    second = t.link[l * columns.LINK_COLUMNS + columns.LINK_SECOND]
    gained = cotangents_of(u, end_slots(t.plan[memory.FORCE] + 6 * first, axes))
    lost = cotangents_of(u, end_slots(t.plan[memory.FORCE] + 6 * second, axes))
    give_link(u, l, t, link_cotangents(u, l, poses, gained, lost, 1, t))


@ti.func
def link_cotangents(
    u: ti.template(), l, poses: ti.template(), gained: ti.template(), lost: ti.template(), there, t: ti.template()
):
    """Cotangents of poses, memory and constants of link l, and of squeeze and area by Poisson's effect.

    ``gained`` and ``lost`` are those of the forces on its voxels; where it is not ``there``, all must be zero.
    """
    slot, rest, beam = past_slot(l, t), rest_slot(l, t), beam_slot(l, t)
    past = consecutive(slot, 6)
    constants = parameters_of(u, axial_slots(rest, beam) + bending_slots(beam))
    seeds = gained + ti.static(tuple([0.0 - x for x in lost])) + cotangents_of(u, past)
    squeeze = 0.0 * constants[0]
    area = 1.0 + squeeze
    if t.plan[memory.POISSON_ON] != 0:
        squeeze, area = laws.cross_section(*recorded_strains(u, l, t))
    inputs = poses + before(u, past) + constants + (squeeze, area)
    (regime,) = before(u, (slot + memory.REGIME,))
    x, y, z, _, _, _, _ = laws.relative_pose(*poses)
    straight = is_straight(regime, x, y, z, constants[0])
    if ti.static(not isinstance(there, int)):
        straight = straight | (there < 0.5)
    g = ti.static(variables(inputs))
    if all_lanes(straight):
        assign_all(g, ti.static(pull_back(whole_link, inputs, (t.edge, regime, t.medium.balances, False), seeds)))
    else:
        assign_all(g, ti.static(pull_back(whole_link, inputs, (t.edge, regime, t.medium.balances, True), seeds)))
    return ti.static(tuple(g))


@primitive
def recorded_strains(u: Any, l: Any, t: Any) -> Any:
    """The transverse strains of a link's voxels before the step that is undone."""
    return t.transverse(u.record, emit(u.r + u.old), l) if t.packed else before(u, transverse_slots(l, t))


@ti.func
def give_link(u: ti.template(), l, t: ti.template(), cotangents: ti.template()):
    """Add the cotangents of a link's inputs to those of state and constants."""
    found = ti.static(in_parts(LINK_WIDTHS, cotangents))
    give(u, pose_slots(l, t), found.minus + found.plus)
    store_all(u.a, u.k, consecutive(past_slot(l, t), 6), found.past)  # those of the new memory have been taken
    rest, beam = rest_slot(l, t), beam_slot(l, t)
    give(u, axial_slots(rest, beam) + bending_slots(beam), found.axial + found.bending)
    if t.plan[memory.POISSON_ON] != 0:
        reverse(u, laws.cross_section, transverse_slots(l, t), (), (), found.section)
