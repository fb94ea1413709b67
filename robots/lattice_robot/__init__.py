"""Robots of the user's own: any lattice body, driven in groups of its regions, free where a search may change it."""

from typing import TYPE_CHECKING

from taichi_sim.base.lazy import exported

if TYPE_CHECKING:
    from robots.lattice_robot.drive import Drive, Free
    from robots.lattice_robot.record import save_robot
    from robots.lattice_robot.robot import LatticeRobot
    from robots.lattice_robot.simulation import LatticeRobotResult, differentiate, simulate
    from robots.lattice_robot.sources import load_robot, robot_of_voxel_file

__all__ = [
    "Drive",
    "Free",
    "LatticeRobot",
    "LatticeRobotResult",
    "differentiate",
    "load_robot",
    "robot_of_voxel_file",
    "save_robot",
    "simulate",
]

_MODULES = {
    "drive": ("Drive", "Free"),
    "record": ("save_robot",),
    "robot": ("LatticeRobot",),
    "simulation": ("LatticeRobotResult", "differentiate", "simulate"),
    "sources": ("load_robot", "robot_of_voxel_file"),
}
__getattr__ = exported(__name__, {name: f"{__name__}.{module}" for module, names in _MODULES.items() for name in names})
