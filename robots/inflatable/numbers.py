"""The numbers of a design that change continuously, by which it is differentiated."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from robots.inflatable.design import InflatableDesign
from taichi_sim.autodiff.arrays import Array

Scalar = float | Array


@dataclass(frozen=True, eq=False)
class Numbers:
    """The numbers of a design that a program is made of; any may be traced to carry derivatives.

    Attributes:
        pressure: of the core, or of each of several [Pa].
        orientation: heading [degrees].
        levels: of bladders and feet, shape (10, T).
        core_pressure: of columns [Pa], shape (T,) or (N, T), or None.
        pace: of strokes, shape (8, T), or None.
        friction: of feet that grip, then of feet that slide, shape (2, 2), or None.
        size: of the regions across the pouch, then along it, relative, shape (2, R), or None.
    """

    pressure: Scalar | tuple[Scalar, ...]
    orientation: Scalar
    levels: Array
    core_pressure: Array | None = None
    pace: Array | None = None
    friction: Array | None = None
    size: Array | None = None

    @classmethod
    def of(cls, design: InflatableDesign) -> "Numbers":
        """The numbers of a design."""
        gait = design.schedule
        made = {} if design.materials is None else design.materials.given
        friction, size = (np.array(made[name]) if name in made else None for name in ("friction", "size"))
        return cls(design.pressure, design.orientation, gait.levels, gait.core_pressure, gait.pace, friction, size)

    @property
    def given(self) -> dict[str, Any]:
        """The numbers that a design has, by name."""
        return {name: value for name, value in vars(self).items() if value is not None}


def numbers_of(design: InflatableDesign) -> dict[str, Any]:
    """All numbers of a design by which it is differentiated, by name."""
    modulus = None if design.materials is None else design.materials.modulus
    return {**Numbers.of(design).given, **({} if modulus is None else {"modulus": modulus})}
