"""Lattice robots: soft robots that users define as any lattice body, with muscles that a search may change."""

from typing import TYPE_CHECKING

from taichi_sim.base.lazy import exported_names

if TYPE_CHECKING:
    from robots.lattice_robot.drive import Drive as Drive
    from robots.lattice_robot.drive import Free as Free
    from robots.lattice_robot.mesh_robot import MarkedRegion as MarkedRegion
    from robots.lattice_robot.mesh_robot import robot_of_mesh as robot_of_mesh
    from robots.lattice_robot.on_rig import played_robot as played_robot
    from robots.lattice_robot.record import save_robot as save_robot
    from robots.lattice_robot.reflexes import Reflexes as Reflexes
    from robots.lattice_robot.robot import LatticeRobot as LatticeRobot
    from robots.lattice_robot.simulation import LatticeRobotResult as LatticeRobotResult
    from robots.lattice_robot.simulation import differentiate as differentiate
    from robots.lattice_robot.simulation import simulate as simulate
    from robots.lattice_robot.soft_motion import SoftMotion as SoftMotion
    from robots.lattice_robot.sources import load_robot as load_robot
    from robots.lattice_robot.sources import robot_of_voxel_file as robot_of_voxel_file

__getattr__, __dir__, __all__ = exported_names(__name__)
