"""Cotangents of the numbers of a body's materials, from those of its tables of constants."""

from collections.abc import Sequence
from dataclasses import fields

import numpy as np

from taichi_sim.autodiff.tracing import pull_back
from taichi_sim.lattice.body import LatticeBody
from taichi_sim.lattice.materials import BEAM_FIELDS, CHANNEL_FIELDS, VOXEL_FIELDS, Material, beam_row, voxel_row
from taichi_sim.lattice.stages.tables import Tables


def material_gradients(
    bodies: Sequence[LatticeBody],
    tables: Tables,
    time_step: float,
    constants: np.ndarray,
    beams: np.ndarray,
    bases: np.ndarray,
) -> dict[str, np.ndarray]:
    """Derivatives by the fields of the materials, each of shape (B, M); ``scale`` has shape (B, M, 3).

    Args:
        bodies: one per robot.
        tables: of the batch.
        time_step: dt [s], held fixed.
        constants, beams: derivatives by ``tables.constant`` and ``tables.beam``.
        bases: derivatives by the channels at the start, shape (B, G, quantities).
    """
    edge, batch = bodies[0].voxel_size, len(bodies)
    numbers = [f.name for f in fields(Material) if f.name != "name"]
    value = {n: np.array([[getattr(m, n) for m in body.materials] for body in bodies], float) for n in numbers}
    found = {n: np.zeros_like(value[n]) for n in numbers}
    groups, ends = np.asarray(tables.group_material), np.asarray(tables.beam_materials).reshape(-1, 2)
    inputs = [value[n][:, groups] for n in VOXEL_FIELDS]
    parts = pull_back(voxel_row, inputs, (edge,), [*np.moveaxis(constants, -1, 0)])
    for name, part in zip(VOXEL_FIELDS, parts, strict=True):
        add_to_columns(found[name], groups, part)
    for name, quantity in CHANNEL_FIELDS.items():
        width = found[name][0, 0].size
        shares = bases[:, :, quantity : quantity + width]
        add_to_columns(found[name], groups, shares.reshape(*shares.shape[:2], *found[name].shape[2:]))
    inputs = [value[n][:, end] for end in ends.T for n in BEAM_FIELDS]
    parts = pull_back(beam_row, inputs, (edge, time_step, bodies[0].is_published), [*np.moveaxis(beams, -1, 0)])
    at_minus, at_plus = parts[: len(BEAM_FIELDS)], parts[len(BEAM_FIELDS) :]
    for name, minus, plus in zip(BEAM_FIELDS, at_minus, at_plus, strict=True):
        add_to_columns(found[name], ends.ravel(), np.stack([minus, plus], axis=-1).reshape(batch, -1))
    return found


def add_to_columns(totals: np.ndarray, columns: np.ndarray, shares: np.ndarray) -> None:
    """Add shares, shape (B, N, ...), to columns of totals, shape (B, M, ...), one after the other."""
    np.add.at(np.moveaxis(totals, 1, 0), columns, np.moveaxis(shares, 1, 0))
