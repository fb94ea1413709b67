"""Quadrupeds that walk, roll, or both: legged, wheeled and whegged.

Source: dissertation, chapter 2 ("The robots"). All numbers are those of the published experiment; where its text
differs, ``TEXT`` holds the text's variant. A robot starts a little inside the ground, which pushes it out.
"""

from typing import TYPE_CHECKING

from taichi_sim.base.arrays import Floats
from taichi_sim.base.lazy import exported_from

if TYPE_CHECKING:
    from robots.quadruped.robot import (
        AS_RUN,
        ENVIRONMENTS,
        GRAVITY,
        LEGGED,
        LEGS,
        LIGHT_HEIGHT,
        MOTORS,
        SENSORS,
        SLIP,
        STEPS,
        TEXT,
        TIME_STEP,
        TWO_ENVIRONMENTS,
        VARIANTS,
        WHEELED,
        WHEGGED,
        Kind,
        Quadruped,
        QuadrupedResult,
        Variant,
        differentiate,
        engine,
        simulate,
    )

__all__ = [
    "AS_RUN",
    "ENVIRONMENTS",
    "GRAVITY",
    "LEGGED",
    "LEGS",
    "LIGHT_HEIGHT",
    "MOTORS",
    "SENSORS",
    "SLIP",
    "STEPS",
    "TEXT",
    "TIME_STEP",
    "TWO_ENVIRONMENTS",
    "VARIANTS",
    "WHEELED",
    "WHEGGED",
    "Floats",
    "Kind",
    "Quadruped",
    "QuadrupedResult",
    "Variant",
    "differentiate",
    "engine",
    "simulate",
]

__getattr__ = exported_from(__name__, "robots.quadruped.robot", __all__)
