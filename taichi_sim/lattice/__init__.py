"""Simulation of soft bodies as lattices of voxels joined by beams, after Voxelyze (Hiller & Lipson 2014)."""

from taichi_sim.ground.relief import Relief, Water
from taichi_sim.lattice.body import LatticeBody
from taichi_sim.lattice.engine import LatticeEngine, LatticeResult, LatticeState
from taichi_sim.lattice.feedback import Decision, Feedback, Felt
from taichi_sim.lattice.files.arrays import body_from_array
from taichi_sim.lattice.gradient import LatticeGradient, Tape
from taichi_sim.lattice.materials import Material
from taichi_sim.lattice.program import LatticeProgram, ProgramBuilder, Quantity

__all__ = [
    "Decision",
    "Feedback",
    "Felt",
    "LatticeBody",
    "LatticeEngine",
    "LatticeGradient",
    "LatticeProgram",
    "LatticeResult",
    "LatticeState",
    "Material",
    "ProgramBuilder",
    "Quantity",
    "Relief",
    "Tape",
    "Water",
    "body_from_array",
]
