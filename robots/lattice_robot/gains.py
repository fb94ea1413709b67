"""Factors of the amplitudes of drives, as they are drawn where levels are uncertain, and how far these reach."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

LEAST_PEAK = 1e-12  # of a wave: flatter ones count as this high


@dataclass(frozen=True)
class Gains:
    """Factors of the amplitudes of the regions or muscles of one drawn robot.

    Attributes:
        factors: one for each.
        largest: largest factor of any draw: with it all draws reckon their time steps, so that they share batches.
        limit: largest swing that factors may make.
    """

    factors: tuple[float, ...]
    largest: float = 1.0
    limit: float = math.inf

    def limited(self, amplitude: Any, peak: Any = 1.0) -> Any:
        """Clip multiplied amplitudes, which may be traced, of waves with peaks, so that no swing is above the limit."""
        if math.isinf(self.limit):
            return amplitude
        most = self.limit / np.maximum(peak, LEAST_PEAK)
        return np.clip(amplitude, -most, most)

    def reached(self, swing: Any) -> Any:
        """Compute the largest swing that any draw makes of swings, one or an array."""
        return np.maximum(np.minimum(swing * max(self.largest, *self.factors), self.limit), swing)
