"""From the cotangents of a body's tables of constants to those of the numbers of its materials."""

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
    for group, material in enumerate(tables.group_material):
        inputs = [value[n][:, material] for n in VOXEL_FIELDS]
        for name, part in zip(
            VOXEL_FIELDS, pull_back(voxel_row, inputs, (edge,), [*constants[:, group].T]), strict=True
        ):
            found[name][:, material] += part
        for name, quantity in CHANNEL_FIELDS.items():
            found[name][:, material] += bases[:, group, quantity]
    for beam, ends in enumerate(tables.beam_materials):
        inputs = [value[n][:, end] for end in ends for n in BEAM_FIELDS]
        parts = pull_back(beam_row, inputs, (edge, time_step), [*beams[:, beam].T])
        for (name, end), part in zip([(n, end) for end in ends for n in BEAM_FIELDS], parts, strict=True):
            found[name][:, end] += part
    scale = np.zeros((batch, materials, 3))
    for group, material in enumerate(tables.group_material):
        scale[:, material] += bases[:, group, Quantity.SCALE : Quantity.SCALE + 3]
    return {**found, "scale": scale}
