"""Quadrupeds that walk, roll, or both: legged, wheeled and whegged.

Source: dissertation, chapter 2 ("The robots"). All numbers are those of the published experiment; where its text
differs, ``TEXT`` holds the text's variant. A robot starts a little inside the ground, which pushes it out.
"""

from typing import TYPE_CHECKING

from taichi_sim.base.lazy import exported

if TYPE_CHECKING:
    from robots.quadruped.body import (
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
        Variant,
    )
    from robots.quadruped.simulation import QuadrupedResult, differentiate, engine, simulate

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
    "Kind",
    "Quadruped",
    "QuadrupedResult",
    "Variant",
    "differentiate",
    "engine",
    "simulate",
]

_AT_WORK = ("QuadrupedResult", "differentiate", "engine", "simulate")
__getattr__ = exported(__name__, {n: f"{__name__}.{'simulation' if n in _AT_WORK else 'body'}" for n in __all__})
