"""Tissues of the cells of freeform robots, and mixtures of tissues between designs."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import flag, number, numbers
from taichi_sim.lattice import LatticeBody, Material

# Of a cell that is all but gone: parts of its modulus and density. Heavier than it is soft, so that it is not too quick
# for the time step of a cell that is there.
LEAST_MODULUS, LEAST_DENSITY = 1e-3, 2e-2
POWER = (
    3.0  # of the presence, to which the modulus is proportional (SIMP: Bendsoe & Sigmund, Topology optimization, 2003)
)
MIXED = (  # numbers of materials that mixtures have
    "youngs_modulus",
    "density",
    "poissons_ratio",
    "static_friction",
    "kinetic_friction",
    "internal_damping",
    "global_damping",
    "collision_damping",
)
SILICONE = Material(
    1e5, 1e3, static_friction=1.0, kinetic_friction=0.8, internal_damping=1.0, collision_damping=1.0, name="silicone"
)


@dataclass(frozen=True)
class Tissue:
    """A tissue that cells may be made of: a material that is a muscle or passive.

    Attributes:
        material: material of the cell, with scale 1 and without thermal expansion or temperature.
        muscle: whether the cell swells and shrinks; else it is passive, such as a bone or a payload.

    Raises:
        ValueError: for a material with another scale, thermal expansion or temperature.
    """

    material: Material = SILICONE
    muscle: bool = True

    def __post_init__(self) -> None:
        usual = Material(1.0, 1.0)
        for name in ("scale", "thermal_expansion", "temperature"):
            if (value := getattr(self.material, name)) != getattr(usual, name):
                raise ValueError(f"{name}: {value} of a tissue is not allowed; muscles alone change sizes")


@dataclass(frozen=True)
class Palette:
    """The tissues that the cells of a freeform robot may be made of.

    Attributes:
        tissues: at least one, at least one of them a muscle.

    Raises:
        ValueError: if there is no tissue, or none is a muscle.
    """

    tissues: tuple[Tissue, ...] = (Tissue(),)

    def __post_init__(self) -> None:
        object.__setattr__(self, "tissues", tuple(self.tissues))
        if not self.tissues:
            raise ValueError("palette: there are no tissues; give at least one")
        if not any(tissue.muscle for tissue in self.tissues):
            raise ValueError("palette: no tissue is a muscle; give at least one")

    def __len__(self) -> int:
        return len(self.tissues)

    @property
    def materials(self) -> tuple[Material, ...]:
        """Materials of the tissues, in their order."""
        return tuple(tissue.material for tissue in self.tissues)

    @property
    def muscles(self) -> Floats:
        """Array with 1 for each tissue that is a muscle and 0 for others, shape (T,)."""
        return np.array([float(tissue.muscle) for tissue in self.tissues])

    def time_step(self, edge: float) -> float:
        """Return the largest stable time step [s] of bodies of these tissues with cells of edge h [m]."""
        kinds = range(len(self))
        line = np.array([(place, 0, 0) for place in range(len(self) ** 2 * 2)])
        pairs = np.array([kind for first in kinds for second in kinds for kind in (first, second)])
        return LatticeBody(line, self.materials, pairs, edge).recommended_time_step

    def mixtures(self, presence: Any, weights: Any) -> dict[str, Any]:
        """Compute material properties of mixed cells by name, shape (N, V); arrays may be traced for derivatives.

        Args:
            presence: presence of each cell, 0 to 1, shape (N, V).
            weights: parts of each tissue, which add up to 1, shape (N, V, T).
        """
        found = {name: (weights * np.array([getattr(m, name) for m in self.materials])).sum(axis=2) for name in MIXED}
        stiff = LEAST_MODULUS + (1 - LEAST_MODULUS) * presence**POWER
        heavy = LEAST_DENSITY + (1 - LEAST_DENSITY) * presence
        return found | {"youngs_modulus": stiff * found["youngs_modulus"], "density": heavy * found["density"]}

    def body(self, body: LatticeBody, numbers: dict[str, Floats]) -> LatticeBody:
        """Give each voxel of a body its own material, from material properties by name, shape (V,)."""
        each = np.stack([numbers[name] for name in MIXED], axis=1).tolist()
        first = self.materials[0]
        return body.with_materials(replace(first, **dict(zip(MIXED, row, strict=True))) for row in each)


def palette_of(records: Sequence[dict[str, Any]]) -> Palette:
    """The palette of records, each the fields of a material and whether it is a ``muscle``.

    Raises:
        ValueError: for unknown fields, or what is not allowed.
    """
    known = {each.name for each in fields(Material)} | {"muscle"}
    tissues = []
    for record in records:
        if unknown := record.keys() - known:
            raise ValueError(f"palette: {', '.join(sorted(unknown))} unknown; a tissue has {', '.join(sorted(known))}")
        muscle = flag("muscle", record.get("muscle", True))
        given = {name: _value(name, value) for name, value in record.items() if name != "muscle"}
        tissues.append(Tissue(Material(**{**_usual(), **given}), muscle))
    return Palette(tuple(tissues))


def _value(name: str, given: Any) -> Any:
    """A number of a material, its name, or the three numbers of its scale."""
    if name == "name":
        return str(given)
    return tuple(numbers(name, given, 3).tolist()) if name == "scale" else number(name, given)


def _usual() -> dict[str, Any]:
    return {each.name: getattr(SILICONE, each.name) for each in fields(Material) if each.name != "name"}
