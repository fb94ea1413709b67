"""Freeform robots: grids of cells whose presence, tissues and muscles are designed by their gradients."""

from typing import TYPE_CHECKING

from taichi_sim.base.lazy import exported_names

if TYPE_CHECKING:
    from robots.freeform.grid import Grid as Grid
    from robots.freeform.palette import Palette as Palette
    from robots.freeform.palette import Tissue as Tissue
    from robots.freeform.robot import FreeformActuation as FreeformActuation
    from robots.freeform.robot import FreeformRobot as FreeformRobot

__getattr__, __dir__, __all__ = exported_names(__name__)
