"""What a search may change of a lattice robot: values of its drives, weights of its reflexes, moduli of its materials.

A point has them in this order.
"""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from robots.lattice_robot.drive import CYCLES, Drive, Free
from robots.lattice_robot.reflexes import Reflexes
from robots.robot import Parameter
from taichi_sim.base.arrays import Floats
from taichi_sim.lattice import LatticeBody

STEP = 0.1  # of a mutation, part of a parameter's range


@dataclass(frozen=True, eq=False)
class DesignSpace:
    """The parameters of a lattice robot, and what a point says of each of its parts.

    Attributes:
        body: of the robot.
        drives: of its regions.
        moduli: Young's moduli of materials that are free [Pa], by the materials' names or numbers from 0.
        reflexes: whose weights are free unless they are given, or None.
        highest: Young's moduli [Pa] of the first materials that time steps suit; none: the materials' own.
    """

    body: LatticeBody
    drives: tuple[Drive, ...]
    moduli: Mapping[str | int, Free]
    reflexes: Reflexes | None
    highest: tuple[float, ...] = ()

    @cached_property
    def free_moduli(self) -> dict[int, Free]:
        """Free Young's moduli [Pa] by the numbers of their materials.

        Raises:
            ValueError: for a material that the body does not have, and moduli that may be 0 or less.
        """
        names = [m.name for m in self.body.materials]
        found = {}
        for key, free in self.moduli.items():
            index = names.index(key) if key in names else key
            if not isinstance(index, int) or not 0 <= index < len(names):
                raise ValueError(f"moduli: {key!r} is unknown; give a material's name, or 0 to {len(names) - 1}")
            if not free.low > 0:
                raise ValueError(f"moduli: {free.low:g} of {key!r} is not allowed; it must be positive")
            found[index] = free
        return found

    @cached_property
    def free(self) -> dict[str, Free]:
        """All that a search may change, by name, in the order of points."""
        found: dict[str, Free] = {}
        for drive in self.drives:
            found |= drive.free
        found |= {f"reflex_{n + 1}": self._weight for n in range(self._free_weights)}
        names = [m.name for m in self.body.materials]
        return found | {f"{names[n] or f'material_{n}'}_modulus": free for n, free in self.free_moduli.items()}

    @cached_property
    def felt_regions(self) -> tuple[int, ...]:
        """Regions whose scale is driven, which reflexes feel and answer."""
        return tuple(dict.fromkeys(r for drive in self.drives if drive.quantity == "scale" for r in drive.regions))

    @property
    def _weight(self) -> Free:
        assert self.reflexes is not None
        return Free(-self.reflexes.limit, self.reflexes.limit, 0.0)

    @property
    def _free_weights(self) -> int:
        """How many weights of reflexes are free."""
        if self.reflexes is None or self.reflexes.weights is not None:
            return 0
        return self.reflexes.weight_count(self.body, self.felt_regions)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """The free variables; a phase that may be all of a cycle is an angle."""
        units = {name: unit for drive in self.drives for name, unit in drive.units.items()}
        moduli = list(self.free)[len(self.free) - len(self.free_moduli) :]
        units |= dict.fromkeys(moduli, "Pa")
        return tuple(
            Parameter(
                name,
                free.low,
                free.high,
                "angle" if units.get(name) == CYCLES and free.high - free.low == 1 else "continuous",
                STEP * (free.high - free.low),
                start=free.middle,
                unit=units.get(name, ""),
            )
            for name, free in self.free.items()
        )

    def shares(self, points: Any) -> list[Any]:
        """The parts of points, shape (N, P), that belong to each drive."""
        ends = np.cumsum([len(drive.free) for drive in self.drives]).tolist()
        return [points[:, first:end] for first, end in zip([0, *ends], ends, strict=False)]

    def weights_of(self, points: Floats) -> Floats:
        """Weights of the reflexes at points, shape (N, K)."""
        if self.reflexes is not None and self.reflexes.weights is not None:
            return np.tile(self.reflexes.weights, (len(points), 1))
        end = points.shape[1] - len(self.free_moduli)
        return points[:, end - self._free_weights : end]

    def bodies(self, points: Floats) -> list[LatticeBody]:
        """The body of each point; one object if no modulus is free."""
        moduli = points[:, points.shape[1] - len(self.free_moduli) :]
        if not self.free_moduli:
            return [self.body] * len(points)
        return [self._of_moduli(row) for row in moduli]

    @property
    def stiffest(self) -> LatticeBody:
        """The body with its free moduli at their highest, or that of the search which it comes from."""
        if self.moduli:
            return self._of_moduli([free.high for free in self.free_moduli.values()])
        materials = list(self.body.materials)
        for index, modulus in enumerate(self.highest):
            materials[index] = dataclasses.replace(materials[index], youngs_modulus=modulus)
        return self.body.with_materials(materials) if self.highest else self.body

    def _of_moduli(self, moduli: ArrayLike) -> LatticeBody:
        materials = list(self.body.materials)
        for index, modulus in zip(self.free_moduli, np.asarray(moduli, float).tolist(), strict=True):
            materials[index] = dataclasses.replace(materials[index], youngs_modulus=modulus)
        return self.body.with_materials(materials)
