"""Uneven ground for robots of any physics: heights on a grid, laws of contact with it, and its tables in kernels."""

from taichi_sim.ground.relief import Relief

__all__ = ["Relief"]
