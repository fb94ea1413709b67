"""Measures of bodies, controllers and searches, and statistics. Knows neither robots nor physics."""

from optim.measures.homeostasis import homeostasis
from optim.measures.overlap import learnability, resistance

__all__ = ["homeostasis", "learnability", "resistance"]
