"""Cotangents of the numbers of a body's materials, from those of its tables of constants."""

from collections.abc import Sequence
from dataclasses import fields

import numpy as np

from taichi_sim.autodiff.tracing import pull_back
from taichi_sim.lattice.body import LatticeBody
from taichi_sim.lattice.materials import Material, beam_row, voxel_row
from taichi_sim.lattice.program import Quantity
from taichi_sim.lattice.stages.tables import Tables

# What the laws of the tables depend on, in the order of their arguments.
VOXEL_FIELDS = ("youngs_modulus", "density", "collision_damping", "thermal_expansion", "poissons_ratio")
BEAM_FIELDS = ("youngs_modulus", "density", "poissons_ratio", "internal_damping")
CHANNEL_FIELDS = {
    "temperature": Quantity.TEMPERATURE,
    "static_friction": Quantity.STATIC_FRICTION,
    "kinetic_friction": Quantity.KINETIC_FRICTION,
    "global_damping": Quantity.GLOBAL_DAMPING,
}


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
    edge, batch, materials = bodies[0].voxel_size, len(bodies), len(bodies[0].materials)
    numbers = [f.name for f in fields(Material) if f.name not in ("name", "scale")]
    value = {n: np.array([[getattr(m, n) for m in body.materials] for body in bodies], float) for n in numbers}
    found = {n: np.zeros((batch, materials)) for n in numbers}
    groups, ends = np.asarray(tables.group_material), np.asarray(tables.beam_materials).reshape(-1, 2)
    inputs = [value[n][:, groups] for n in VOXEL_FIELDS]
    parts = pull_back(voxel_row, inputs, (edge,), [*np.moveaxis(constants, -1, 0)])
    for name, part in zip(VOXEL_FIELDS, parts, strict=True):
        add_to_columns(found[name], groups, part)
    for name, quantity in CHANNEL_FIELDS.items():
        add_to_columns(found[name], groups, bases[:, :, quantity])
    inputs = [value[n][:, end] for end in ends.T for n in BEAM_FIELDS]
    parts = pull_back(beam_row, inputs, (edge, time_step), [*np.moveaxis(beams, -1, 0)])
    for name, minus, plus in zip(BEAM_FIELDS, parts, parts[len(BEAM_FIELDS) :], strict=False):
        add_to_columns(found[name], ends.ravel(), np.stack([minus, plus], axis=-1).reshape(batch, -1))
    scale = np.zeros((batch, materials, 3))
    add_to_columns(scale, groups, bases[:, :, Quantity.SCALE : Quantity.SCALE + 3])
    return {**found, "scale": scale}


def add_to_columns(totals: np.ndarray, columns: np.ndarray, shares: np.ndarray) -> None:
    """Add shares, shape (B, N, ...), to columns of totals, shape (B, M, ...), one after the other."""
    np.add.at(np.moveaxis(totals, 1, 0), columns, np.moveaxis(shares, 1, 0))
