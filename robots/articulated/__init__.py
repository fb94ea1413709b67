"""Articulated robots from MJCF and URDF files, on any ground or in water, moved by rhythms or by networks."""

from typing import TYPE_CHECKING

from taichi_sim.base.lazy import exported_names

if TYPE_CHECKING:
    from robots.articulated.loading import load_robot as load_robot
    from robots.articulated.reflexes import DriveReflexes as DriveReflexes
    from robots.articulated.rigid_motion import RigidMotion as RigidMotion
    from robots.articulated.robot import ArticulatedRobot as ArticulatedRobot
    from robots.articulated.simulation import ArticulatedResult as ArticulatedResult
    from robots.articulated.simulation import differentiate as differentiate
    from robots.articulated.simulation import simulate as simulate

__getattr__, __dir__, __all__ = exported_names(__name__)
