"""A vehicle on two driven wheels and a castor, steered by two light sensors, as an articulated body on the ground.

Source: dissertation, chapter 3, "The empirical model"; the defaults are the published base parameters, found by a
search of its authors. The vehicle drives along its own y; x is to its right. Lights are points of light here: that the
published ones are balls, which stop the vehicle, does not matter, as it succeeds before it touches them.
"""

from typing import TYPE_CHECKING

from taichi_sim.base.lazy import exported

if TYPE_CHECKING:
    from robots.rover.body import (
        BEST,
        CANONICAL,
        GRAVITY,
        LIGHT_HEIGHT,
        LIGHT_RADIUS,
        LIGHTS,
        ROUNDING,
        SENSES,
        SLIP,
        STEPS,
        TIME_STEP,
        WHEEL_SETBACK,
        WIDTH,
        Rover,
        Site,
        Sites,
    )
    from robots.rover.simulation import RoverResult, controllers, differentiate, engine, simulate

__all__ = [
    "BEST",
    "CANONICAL",
    "GRAVITY",
    "LIGHTS",
    "LIGHT_HEIGHT",
    "LIGHT_RADIUS",
    "ROUNDING",
    "SENSES",
    "SLIP",
    "STEPS",
    "TIME_STEP",
    "WHEEL_SETBACK",
    "WIDTH",
    "Rover",
    "RoverResult",
    "Site",
    "Sites",
    "controllers",
    "differentiate",
    "engine",
    "simulate",
]

_AT_WORK = ("RoverResult", "controllers", "differentiate", "engine", "simulate")
__getattr__ = exported(__name__, {n: f"{__name__}.{'simulation' if n in _AT_WORK else 'body'}" for n in __all__})
