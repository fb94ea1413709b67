"""Forwards to ``optim.problems.lattice_robot``: the import path of version 1.0."""

from optim.problems.lattice_robot import OPTIONS, LatticeRobotProblem

__all__ = ["OPTIONS", "LatticeRobotProblem"]
