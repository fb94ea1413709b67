"""Braitenberg vehicles, as in chapters 3 and 4 of the dissertation."""

from typing import TYPE_CHECKING

from taichi_sim.base.lazy import exported

if TYPE_CHECKING:
    from robots.braitenberg.body import BASELINE, DESIGNS, VehicleBody
    from robots.braitenberg.experiment import (
        PUBLISHED,
        STARTS,
        TEXT_OF_CHAPTER_3,
        TEXT_OF_CHAPTER_4,
        contralateral,
        simulate,
        trace,
        weight_grid,
    )
    from robots.braitenberg.sweeps import Sweep, read_sweep, sweep
    from taichi_sim.vehicle import Rollouts, Traces, VehicleTask

__all__ = [
    "BASELINE",
    "DESIGNS",
    "PUBLISHED",
    "STARTS",
    "TEXT_OF_CHAPTER_3",
    "TEXT_OF_CHAPTER_4",
    "Rollouts",
    "Sweep",
    "Traces",
    "VehicleBody",
    "VehicleTask",
    "contralateral",
    "read_sweep",
    "simulate",
    "sweep",
    "trace",
    "weight_grid",
]

_MODULES = {
    "robots.braitenberg.body": ("BASELINE", "DESIGNS", "VehicleBody"),
    "robots.braitenberg.sweeps": ("Sweep", "read_sweep", "sweep"),
    "taichi_sim.vehicle": ("Rollouts", "Traces", "VehicleTask"),
}
_PLACES = {name: module for module, names in _MODULES.items() for name in names}
__getattr__ = exported(__name__, dict.fromkeys(__all__, "robots.braitenberg.experiment") | _PLACES)
