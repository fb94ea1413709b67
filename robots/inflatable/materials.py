"""What the regions of an inflatable robot are made of, where a design differs from its geometry.

Young's moduli and rest sizes are relative to those of the geometry, so one description fits every geometry with as
many cores, and robots that were fitted to a rig. The bounds keep to what can be built: a fabric or silicone of half the
modulus to 1.4 times the modulus, which the published time step still resolves, cut 15 % smaller or larger than its
neighbours expect.
"""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from taichi_sim.base.arrays import Floats
from taichi_sim.base.checks import number

LEAST_MODULUS, MOST_MODULUS = 0.5, 1.4  # of that of the geometry
LEAST_SIZE, MOST_SIZE = 0.85, 1.15  # of the rest size of the geometry, across and along the pouch
MOST_FRICTION = 4.0

Row = tuple[float, ...]


@dataclass(frozen=True)
class RegionMaterials:
    """Materials of a design: friction of the feet, and modulus and rest size of each region; None keeps the geometry's.

    Attributes:
        friction: Coulomb coefficients, static and kinetic, of feet 1 and 2 while they grip, then of the two while they
            slide, 0 to 4; they replace those of the robot and of the terrain.
        modulus: Young's modulus of the regions, relative to that of the geometry, shape (R,), 0.5 to 1.4.
        size: rest size of the regions across the pouch, then along it, relative to that of the geometry, shape (2, R),
            0.85 to 1.15. Bladders keep their thickness.

    Raises:
        ValueError: for numbers or shapes that are not allowed, or sliding feet with more friction than gripping ones.
    """

    friction: tuple[Row, Row] | None = None
    modulus: Row | None = None
    size: tuple[Row, Row] | None = None

    def __post_init__(self) -> None:
        if self.friction is not None:
            rows = _rows("friction", self.friction, 0.0, MOST_FRICTION, 2)
            if rows.shape != (2, 2):
                raise ValueError(f"friction: shape {rows.shape} is not allowed; give (2, 2): gripping, then sliding")
            if (rows[1] > rows[0]).any():
                foot = int(np.argmax(rows[1] > rows[0]))
                high, low = rows[:, foot]
                raise ValueError(f"friction: {low:g} of sliding foot {foot + 1} is not allowed; at most {high:g}")
            object.__setattr__(self, "friction", _frozen(rows))
        if self.modulus is not None:
            object.__setattr__(
                self, "modulus", _frozen(_rows("modulus", [self.modulus], LEAST_MODULUS, MOST_MODULUS, 1))[0]
            )
        if self.size is not None:
            object.__setattr__(self, "size", _frozen(_rows("size", self.size, LEAST_SIZE, MOST_SIZE, 2)))

    @property
    def given(self) -> dict[str, Any]:
        """Numbers that differ from the geometry's, as lists by name."""
        tables = {name: getattr(self, name) for name in ("friction", "modulus", "size")}
        return {name: np.array(table).tolist() for name, table in tables.items() if table is not None}

    @classmethod
    def of(cls, record: Any) -> Self:
        """Build materials from what :attr:`given` returned.

        Raises:
            ValueError: if names are unknown or numbers not allowed.
        """
        if not isinstance(record, dict) or (unknown := sorted(set(record) - {"friction", "modulus", "size"})):
            named = "they" if not isinstance(record, dict) else repr(unknown[0])
            raise ValueError(f"materials: {named} cannot be read; they are friction, modulus and size")
        return cls(**record)


def _rows(field: str, given: Any, low: float, high: float, count: int) -> Floats:
    """Equally long rows of numbers."""
    try:
        rows = np.array(given, float)
    except (TypeError, ValueError):
        raise ValueError(f"{field}: {given!r} is not allowed; give numbers from {low:g} to {high:g}") from None
    if rows.ndim != 2 or rows.shape[0] != count or not rows.shape[1]:
        raise ValueError(f"{field}: shape {rows.shape} is not allowed; give {count} rows of numbers")
    for value in rows.ravel():
        number(field, float(value), low, high)
    return rows


def _frozen(rows: Floats) -> Any:
    return tuple(tuple(row) for row in rows.tolist())
