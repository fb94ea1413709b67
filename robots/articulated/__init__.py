"""Articulated robots from MJCF and URDF files, walking on flat ground by rhythms or by networks of their own."""

from typing import TYPE_CHECKING

from taichi_sim.base.lazy import exported

if TYPE_CHECKING:
    from robots.articulated.robot import ArticulatedRobot, load_robot
    from robots.articulated.simulation import ArticulatedResult, differentiate, simulate

__all__ = ["ArticulatedResult", "ArticulatedRobot", "differentiate", "load_robot", "simulate"]

_DESCRIBED = ("ArticulatedRobot", "load_robot")
__getattr__ = exported(__name__, {n: f"{__name__}.{'robot' if n in _DESCRIBED else 'simulation'}" for n in __all__})
