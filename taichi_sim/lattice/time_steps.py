"""Largest stable time steps of links, contacts and the floor, by the materials of the voxels that they join.

A step is v' = v - (K x + C v) dt / m, x' = x + v' dt. A mode of stiffness rate k = K / m and damping rate c = C / m is
stable while k dt^2 + 2 c dt <= 4 (Jury's criterion). Bounds below solve that, or what is stricter, for dt.
"""

import math

from taichi_sim.lattice import materials
from taichi_sim.lattice.laws import contact
from taichi_sim.lattice.materials import Material, axial_stiffness_modulus, voxel_constants, voxel_mass

# Largest eigenvalue of all links around a voxel, in stiffnesses of one link over its mass, for which the published step
# 1 / (2 pi w) is stable at damping ratio 1; divided into 4. A block needs up to 15: hence the safety of 1.3 of robots.
_QUARTER = (1 + 1 / (2 * math.pi)) ** 2 - 1
HALF = 0.5  # edges: voxels that do not get smaller need no shorter time steps
_TURNING = math.sqrt(6) / 2  # of 2 sqrt(I a1) h / I over 4 sqrt(a1 / m), with the inertia I = m h^2 / 6 of a voxel
# Sum of the squared cosines to the vertical of the four voxels between which another one rests, as spheres do.
_PIT = 4 * (1 - 0.5 / (2 * contact.SPHERE_RADIUS) ** 2)


def link_step(minus: Material, plus: Material, edge: float, own: bool = False) -> float:
    """Largest stable time step of a link between two voxels of edge h in a block of them [s].

    With w = sqrt(a1 / m), a link's stiffness over the mass of an end, a mode of the lattice has k = L w^2 and, as that
    end is damped by zeta sqrt(a1 m) at most, c = L zeta w: it is stable for w dt <= sqrt(zeta^2 + 4 / L) - zeta. Up to
    zeta = 1 the step is the published 1 / (2 pi w); beyond, that for the same L. Damping against the world, of ratio
    zeta_0, adds 2 sqrt(6) zeta_0 w to c where voxels turn; up to a ratio of 1 safety factors allow for it. Zeta is the
    damping of both materials relative to an end's mass, or the end's ``own`` (``materials.beam_row``).
    """
    stiffness = axial_stiffness_modulus(minus, plus) * edge
    found = math.inf
    mean = 0.5 * (minus.internal_damping + plus.internal_damping)
    for end, other in ((minus, plus), (plus, minus)):
        step = 1 / (2 * math.pi * math.sqrt(stiffness / voxel_mass(end, edge)))
        shared = mean * math.sqrt(2 * other.density / (end.density + other.density))
        zeta = end.internal_damping if own else shared
        if end.global_damping > 1:
            zeta = max(zeta, 1.0) + end.global_damping * _TURNING * _QUARTER
        if zeta > 1:
            step *= 2 * math.pi * _QUARTER / (zeta + math.sqrt(zeta * zeta + _QUARTER))
        found = min(found, step)
    return found


def afloat(size: float) -> float:
    """Factor by which time steps shrink where links are balanced, as they are where bodies may float.

    A balanced link turns its voxels by its force times its length, where the published law has the edge of the lattice:
    so damping turns a voxel as much more as its links are longer, and is what limits the step. Of periodic blocks in
    which all voxels have one rest size, this is 5 % more than what their largest eigenvalue needs, for sizes of 1 to
    1.5, any damping ratio of 0.5 to 2 and any Poisson's ratio.

    Args:
        size: largest rest size of voxels [edges].
    """
    return 0.2 + max(size, 1.0) ** 2


def shrunk(size: float) -> float:
    """Factor by which time steps shrink where voxels do, whose links get stiffer as they get shorter.

    Beside voxels of other sizes those below half an edge would gain energy. By measurement sizes of 0.4, 0.3 and 0.2
    take steps shorter by 1.15, 1.5 and 1.75; this is 1.25, 1.67 and 2.5.

    Args:
        size: smallest rest size of voxels [edges].
    """
    return max(HALF / size, 1.0)


def floor_step(material: Material, edge: float) -> float:
    """Largest time step in which the floor throws no voxel back faster than it came, links left out [s]."""
    row = voxel_constants(material, edge)
    damping = row[materials.CONTACT_DAMPING] + material.global_damping * row[materials.CRITICAL_TRANSLATION]
    return _bounce_step(row[materials.STIFFNESS] * row[materials.INVERSE_MASS], damping * row[materials.INVERSE_MASS])


def contact_step(first: Material, second: Material, edge: float, held: tuple[bool, bool] = (False, False)) -> float:
    """Largest time step in which voxels of two bodies that touch never part faster than they met [s].

    Of the force law, ``laws.contact.repulsion``, the mean damping is what matters: beside a heavy, stiff voxel it stops
    a light one many times over. The lighter voxel may lie between four of the other kind, each of which has it alone.
    """
    rows = [voxel_constants(each, edge) for each in (first, second)]
    inverses = (0.0 if fixed else row[materials.INVERSE_MASS] for row, fixed in zip(rows, held, strict=True))
    lighter, heavier = sorted(inverses, reverse=True)
    inverse = _PIT * lighter + heavier
    columns = materials.STIFFNESS, materials.CONTACT_DAMPING
    stiffness, damping = contact.of_both(*(row[column] for column in columns for row in rows))
    return _bounce_step(stiffness * inverse, damping * inverse)


def _bounce_step(stiffness: float, damping: float) -> float:
    """Largest dt [s] with k dt^2 + c dt <= 2, for the rates k [1/s^2] and c [1/s]; infinite where nothing moves.

    A voxel that meets another at v is at most v dt deep when it first feels it, and leaves that step at
    (k dt^2 + c dt - 1) v: no faster than it came. Contact that lasts is then stable, too.
    """
    if stiffness == 0:
        return math.inf
    return float(4 / (damping + math.sqrt(damping * damping + 8 * stiffness)))
