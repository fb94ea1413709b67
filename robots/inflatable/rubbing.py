"""Friction of a design's own feet under other conditions: a floor that rubs more or less, or friction that is drawn.

A terrain says what a floor's is; feet with friction of their own, see ``RegionMaterials``, have it on any floor.
"""

from dataclasses import dataclass, replace

import numpy as np

from robots.inflatable.design import InflatableDesign
from robots.inflatable.materials import MOST_FRICTION
from taichi_sim.base.arrays import Floats


@dataclass(frozen=True)
class Rubbing:
    """A change of the friction of feet; feet that slide never have more than while they grip.

    Attributes:
        gripping: factor of the friction while they grip.
        sliding: factor of the friction while they slide.
        least: smallest friction while they slide, before the factor.
    """

    gripping: float = 1.0
    sliding: float = 1.0
    least: float = 0.0

    def of(self, design: InflatableDesign) -> InflatableDesign:
        """The design with feet that rub so; the same if its feet have no friction of their own."""
        if design.materials is None or design.materials.friction is None or self == Rubbing():
            return design
        grip, slide = self._rows(design)
        return replace(design, materials=replace(design.materials, friction=(tuple(grip), tuple(slide))))

    def slopes(self, design: InflatableDesign) -> Floats:
        """Derivatives of the friction of :meth:`of` by the design's, shape (2, 2, 2): rows by rows, of each foot.

        All are 0 for feet without friction of their own.
        """
        found = np.zeros((2, 2, 2))
        if design.materials is None or design.materials.friction is None:
            return found
        own, (grip, _) = np.array(design.materials.friction), self._rows(design)
        found[0, 0] = np.where(grip < MOST_FRICTION, self.gripping, 0.0)
        held = self.sliding * np.maximum(own[1], self.least) > grip  # sliding as much as gripping, whatever they have
        found[1, 0] = np.where(held, found[0, 0], 0.0)
        found[1, 1] = np.where(held | (own[1] < self.least), 0.0, self.sliding)
        return found

    def _rows(self, design: InflatableDesign) -> Floats:
        """Friction of the two feet while they grip, then while they slide, shape (2, 2)."""
        assert design.materials is not None
        grip, slide = np.array(design.materials.friction)
        grip = np.minimum(self.gripping * grip, MOST_FRICTION)
        return np.array([grip, np.minimum(self.sliding * np.maximum(slide, self.least), grip)])
