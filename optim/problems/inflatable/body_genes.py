"""How a search writes the first variables of a design: heading, core pressures, what the robot is made of, bladders.

What it is made of are friction of its feet, moduli and rest sizes of its regions.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from optim.space import Variable
from robots.inflatable.actuation import ACTUATION, InflatableActuation
from robots.inflatable.body import PUBLISHED, InflatableGeometry
from robots.inflatable.design import Pressure, checked_pressure
from robots.inflatable.layout import EVERY_BLADDER, Layout, layout_from_mask, layout_mask
from robots.inflatable.materials import LEAST_MODULUS, MOST_MODULUS, RegionMaterials
from taichi_sim.base.arrays import Floats

if TYPE_CHECKING:
    from robots.inflatable.gradient import InflatableGradient

EMPTY_CORE = -4000.0  # the least pressure that graded gaits may ask for [Pa]; below zero the core is empty
MATERIAL_PARTS = ("friction", "modulus", "size")
GRIPPING, SLIDING = (0.5, 2.0), (1e-4, 0.5)  # friction that a search may ask for; rubber, and a smooth skid
SIZES = (0.95, 1.05)  # relative rest sizes that a search may ask for: fabric that differs by more wrinkles
STEP = 0.1  # of a mutation, in ranges
LAYOUT_STEP = 0.25  # a mutation adds or takes a bladder where a deviate exceeds 0.5: 4.6 % of the places


@dataclass(frozen=True)
class ShapeGenes:
    """The first variables of a point, shape (D,): what is None is free.

    Attributes:
        orientation: [degrees], or None.
        pressure: of the cores [Pa], or None.
        cores: of the body.
        least: pressure that a search may ask for [Pa]; below zero a core is empty.
    """

    orientation: float | None
    pressure: Pressure | None
    cores: int = 1
    least: float = 0.0

    @property
    def pressures(self) -> tuple[str, ...]:
        """Names of the pressures, were they free."""
        return ("pressure",) if self.cores == 1 else tuple(f"pressure_{core}" for core in range(1, self.cores + 1))

    def variables(self) -> list[Variable]:
        """``orientation``, then ``pressure``, or ``pressure_1`` and on; the steps are the published ones."""
        found = [] if self.orientation is not None else [Variable("orientation", 0.0, 90.0, step=9.0)]
        if self.pressure is None:
            found.extend(Variable(name, self.least, 12_000.0, step=1200.0) for name in self.pressures)
        return found

    @property
    def size(self) -> int:
        """Number of variables."""
        return (self.orientation is None) + self.cores * (self.pressure is None)

    def values(self, point: ArrayLike) -> tuple[Pressure, float]:
        """Pressure and orientation of a point."""
        values = np.asarray(point, float)[: self.size]
        orientation = float(values[0]) if self.orientation is None else self.orientation
        if self.pressure is not None:
            return self.pressure, orientation
        return checked_pressure(np.maximum(values[-self.cores :], 0.0)), orientation

    def slopes(self, run: "InflatableGradient", points: Floats) -> Floats:
        """d distance / d variable, shape (N, size), at points of shape (N, D); none by a core that is empty."""
        found = [run.orientation[:, None]] if self.orientation is None else []
        if self.pressure is None:
            inflated = points[:, self.size - self.cores : self.size] > 0
            found.append(run.pressure.reshape(inflated.shape) * inflated)
        return np.concatenate(found, axis=1) if found else np.zeros((len(points), 0))


@dataclass(frozen=True)
class MaterialGenes:
    """The variables of a point, shape (M,), that say what the robot is made of.

    Attributes:
        parts: which of ``MATERIAL_PARTS`` are free.
        geometry: of the body.
        actuation: whose friction feet have that are not free.
    """

    parts: tuple[str, ...] = ()
    geometry: InflatableGeometry = PUBLISHED
    actuation: InflatableActuation = ACTUATION

    def _bounds(self) -> Mapping[str, Sequence[tuple[str, float, float]]]:
        """Names and bounds of the genes of each part."""
        regions = self.geometry.region_names
        return {
            "friction": [
                (f"{kind}_{foot}", *b) for kind, b in (("grip", GRIPPING), ("slide", SLIDING)) for foot in (1, 2)
            ],
            "modulus": [(f"modulus_{region}", LEAST_MODULUS, MOST_MODULUS) for region in regions],
            "size": [(f"{way}_{region}", *SIZES) for way in ("width", "length") for region in regions],
        }

    def variables(self) -> list[Variable]:
        """``grip_1`` to ``slide_2``, ``modulus_skin`` and on, ``width_skin`` and on, ``length_skin`` and on."""
        genes = [gene for part, each in self._bounds().items() if part in self.parts for gene in each]
        return [Variable(name, low, high, step=STEP * (high - low)) for name, low, high in genes]

    @cached_property
    def size(self) -> int:
        """Number of variables."""
        return len(self.variables())

    def _tables(self, values: Floats) -> dict[str, Floats]:
        """The free parts of M values, by name."""
        shapes = {"friction": (2, 2), "modulus": (self.geometry.region_count,), "size": (2, self.geometry.region_count)}
        free = {name: shape for name, shape in shapes.items() if name in self.parts}
        ends = np.cumsum([int(np.prod(shape)) for shape in free.values()])
        parts = np.split(np.asarray(values, float), ends[:-1]) if free else []
        return {name: part.reshape(shape) for (name, shape), part in zip(free.items(), parts, strict=True)}

    def materials(self, values: Floats) -> RegionMaterials | None:
        """What the robot of M values is made of."""
        return RegionMaterials(**self._tables(values)) if self.parts else None  # type: ignore[arg-type]

    def genome(self, materials: RegionMaterials | None) -> list[float]:
        """Values that say materials, or those that the robot is built with, as near as the bounds allow."""
        built = {
            "friction": [[self.actuation.high_friction] * 2, [self.actuation.low_friction] * 2],
            "modulus": [1.0] * self.geometry.region_count,
            "size": [[1.0] * self.geometry.region_count] * 2,
        }
        given = {**built, **(materials.given if materials else {})}
        wanted = [value for part in MATERIAL_PARTS if part in self.parts for value in np.ravel(given[part]).tolist()]
        return [min(max(value, v.low), v.high) for v, value in zip(self.variables(), wanted, strict=True)]

    def slopes(self, run: "InflatableGradient", by_friction: Floats) -> Floats:
        """d distance / d variable, shape (N, M).

        Args:
            run: the derivatives of N robots.
            by_friction: derivatives of the friction of their feet by that of the designs, shape (N, 2, 2, 2), see
                ``Rubbing.slopes``.
        """
        found = []
        for part in MATERIAL_PARTS:
            if part in self.parts:
                by = getattr(run, part)
                by = np.einsum("nrsf,nrf->nsf", by_friction, by) if part == "friction" else by
                found.append(by.reshape(len(by), -1))
        return np.concatenate(found, axis=1) if found else np.zeros((len(run.levels), 0))


@dataclass(frozen=True)
class LayoutGenes:
    """The variables of a point, shape (8,), or none, that say which places have a bladder.

    They are whole numbers, not bits: a body either has a bladder or not, in relaxed points, too.

    Attributes:
        free: whether there are any.
        given: the layout, if not free; None is that of the geometry.
    """

    free: bool = False
    given: Layout | None = None

    @property
    def size(self) -> int:
        """Number of variables."""
        return len(EVERY_BLADDER) * self.free

    def variables(self) -> list[Variable]:
        """``has_bladder1`` to ``has_bladder8``, 0 or 1."""
        places = EVERY_BLADDER if self.free else ()
        return [Variable(f"has_bladder{place}", 0, 1, "integer", step=LAYOUT_STEP) for place in places]

    def layout(self, values: ArrayLike) -> Layout | None:
        """The layout of such values."""
        return layout_from_mask(np.asarray(values) > 0) if self.free else self.given

    def genome(self, bladders: Layout | None) -> list[float]:
        """Values that say a layout; None is all places."""
        return layout_mask(EVERY_BLADDER if bladders is None else bladders).astype(float).tolist() if self.free else []
