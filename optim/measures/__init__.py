"""Measures of bodies, controllers and searches, and statistics. Knows neither robots nor physics."""

from optim.measures.homeostasis import homeostasis
from optim.measures.overlap import learnability, resistance

interference = resistance  # the name in version 1.0, kept for the code of users

__all__ = ["homeostasis", "interference", "learnability", "resistance"]
