"""How a search writes the heading of the inflatable robot, and its body's shape: the pressure of each core."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from optim.space import Variable
from robots.inflatable.design import Pressure, checked_pressure
from taichi_sim.base.arrays import Floats

if TYPE_CHECKING:
    from robots.inflatable.gradient import InflatableGradient

EMPTY_CORE = -4000.0  # the least pressure that graded gaits may ask for [Pa]; below zero the core is empty


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
        """How many there are."""
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
