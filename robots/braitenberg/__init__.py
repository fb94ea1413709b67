"""Braitenberg vehicles, as in chapters 3 and 4 of the dissertation."""

from typing import TYPE_CHECKING

from taichi_sim.base.lazy import exported_names

if TYPE_CHECKING:
    from robots.braitenberg.body import BASELINE as BASELINE
    from robots.braitenberg.body import DESIGNS as DESIGNS
    from robots.braitenberg.body import VehicleBody as VehicleBody
    from robots.braitenberg.experiment import PUBLISHED as PUBLISHED
    from robots.braitenberg.experiment import STARTS as STARTS
    from robots.braitenberg.experiment import TEXT_OF_CHAPTER_3 as TEXT_OF_CHAPTER_3
    from robots.braitenberg.experiment import TEXT_OF_CHAPTER_4 as TEXT_OF_CHAPTER_4
    from robots.braitenberg.experiment import contralateral as contralateral
    from robots.braitenberg.experiment import simulate as simulate
    from robots.braitenberg.experiment import trace as trace
    from robots.braitenberg.experiment import weight_grid as weight_grid
    from robots.braitenberg.sweeps import Sweep as Sweep
    from robots.braitenberg.sweeps import read_sweep as read_sweep
    from robots.braitenberg.sweeps import sweep as sweep
    from taichi_sim.vehicle import Rollouts as Rollouts
    from taichi_sim.vehicle import Traces as Traces
    from taichi_sim.vehicle import VehicleTask as VehicleTask

__getattr__, __dir__, __all__ = exported_names(__name__)
