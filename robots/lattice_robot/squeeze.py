"""Axial forces of links with Poisson's effect, by the lattice's laws, from recorded strains."""

from typing import Any

import numpy as np

from taichi_sim.base.arrays import Bools, Floats
from taichi_sim.lattice import LatticeBody
from taichi_sim.lattice.laws import link as beams
from taichi_sim.lattice.materials import AXIAL, SHARE_MINUS, SHARE_PLUS, TRANSVERSE, beam_row


def squeezed_forces(body: LatticeBody, strains: Any, modulus: Any, ratio: Any, pulled: Any) -> Any:
    """Axial forces of links [N], shape (B, T, L); arrays may be traced.

    The engine takes transverse strains from the step before; here they are those of the same time.

    Args:
        body: whose links they are, without forces from outside but for weight.
        strains: of every link, shape (B, T, L).
        modulus, ratio: Young's modulus [Pa] and Poisson's ratio of each voxel, shape (B, V).
        pulled: along which axes weight pulls voxels, broadcast to shape (B, 3).
    """
    links, axes = body.topology.links, body.topology.link_axes
    ends = [part[:, end] for end in links.T for part in (modulus, ratio)]
    row = beam_row(ends[0], 1.0, ends[1], 0.0, ends[2], 1.0, ends[3], 0.0, body.voxel_size, 1.0, False)
    axial, transverse, shares = row[AXIAL], row[TRANSVERSE], (row[SHARE_PLUS], row[SHARE_MINUS])
    own = [_voxel_strains(body, axis, strains, shares) for axis in range(3)]
    tense = [_in_tension(body, axis, np.broadcast_to(pulled, (len(strains), 3))) for axis in range(3)]
    every = np.stack(_poisson_strains(own, tense, ratio[:, None]), axis=-1)
    sides = [every[:, :, end, axis] for end in links.T for axis in ((axes + 1) % 3, (axes + 2) % 3)]
    squeeze, area = beams.cross_section(*sides)
    return beams.axial_force(strains, axial[:, None], transverse[:, None], squeeze, area, True)


def _poisson_strains(strains: list[Any], tense: list[Floats], ratio: Any) -> list[Any]:
    """``motion.poisson_strains`` over arrays, whose power is NumPy's."""
    stretched: Any = 1.0
    for strain, is_tense in zip(strains, tense, strict=True):
        stretched = stretched + np.where(is_tense > 0.5, strain, 0.0)
    gave = np.maximum(stretched, 1e-2) ** (0.0 - ratio) - 1.0
    return [np.where(is_tense > 0.5, strain, gave) for strain, is_tense in zip(strains, tense, strict=True)]


def _voxel_strains(body: LatticeBody, axis: int, strains: Any, shares: tuple[Any, Any]) -> Any:
    """Mean of the shares of voxels in the strains of their links along an axis, shape (B, T, V)."""
    total: Any = 0.0
    sides = body.topology.side_links[:, 2 * axis : 2 * axis + 2].T
    for side, share in zip(sides, shares, strict=True):  # a voxel is the "+" end of the link on its negative side
        total = total + np.where(side >= 0, (strains * share[:, None])[:, :, side], 0.0)
    return total / np.maximum(_link_counts(body, axis), 1)


def _in_tension(body: LatticeBody, axis: int, pulled: Bools) -> Floats:
    """1 for voxels with two links along an axis, or one and something to pull against, else 0, shape (B, 1, V)."""
    counts, held = _link_counts(body, axis), np.asarray(body.fixed)[:, axis]
    found: Floats = ((counts == 2) | ((counts == 1) & (held | pulled[:, axis, None]))).astype(float)[:, None]
    return found


def _link_counts(body: LatticeBody, axis: int) -> Any:
    """How many links voxels have along an axis, shape (V,)."""
    return (body.topology.side_links[:, 2 * axis : 2 * axis + 2] >= 0).sum(axis=1)
