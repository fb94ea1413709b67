"""Forwards to ``robots.world``: the import path of version 1.0."""

from robots.world import (
    FLUID_FIELDS,
    FRICTION_DRAG,
    PRESSURE_DRAG,
    STEEPEST,
    WATER_DENSITY,
    Medium,
    Terrain,
    one_each,
)

__all__ = [
    "FLUID_FIELDS",
    "FRICTION_DRAG",
    "PRESSURE_DRAG",
    "STEEPEST",
    "WATER_DENSITY",
    "Medium",
    "Terrain",
    "one_each",
]
