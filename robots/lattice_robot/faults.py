"""Points of a lattice robot that are no robots, and those at which differences and gradients mislead."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from robots.lattice_robot.drive import driven_voxels
from taichi_sim.base.arrays import Bools, Floats

if TYPE_CHECKING:
    from robots.lattice_robot.robot import LatticeRobot

AT_REST = 1e-9  # of its largest swing: how far from rest a wave may begin
SMALLEST = 0.1  # edge of a driven voxel, parts of the lattice's


def fault_of(robot: "LatticeRobot", point: ArrayLike) -> str:
    """Why a point, shape (P,), is no robot; empty if it is one."""
    for drive, every in zip(robot.drives, robot.nodes(robot.points(point)), strict=True):
        nodes = every[0].reshape(-1, every.shape[-1])
        least = float(nodes.min())
        if drive.quantity == "temperature":
            alphas = np.array([m.thermal_expansion for m in robot.body.materials])[robot.body.material_index]
            least = float((1 + np.outer(alphas[driven_voxels(drive, robot.body)], nodes.reshape(-1))).min())
        if drive.quantity == "scale" and robot.reflexes is not None:
            least = robot.reflexes.least(nodes, np.repeat(drive.shares, len(drive.regions)))
        if drive.quantity in ("scale", "temperature") and least < SMALLEST:
            return f"{drive.name} shrinks to {least:.3g} of a voxel; {SMALLEST} is the least"
        if drive.quantity == "friction" and least < 0:
            return f"{drive.name} has a friction of {least:.3g}; 0 is the least"
    return ""


def settles_at_rest(robot: "LatticeRobot", points: Floats) -> Bools:
    """At which points, shape (N, P), nothing moves while the robot settles, because waves begin at rest.

    Waves of phase 0 or 0.5 do. Such a robot settles to a tie: which voxel slips first is decided by rounding, and the
    derivatives of its settling grow without bound.
    """
    tied, moved = np.full(len(points), robot.settling > 0), np.zeros(len(points), bool)
    for drive, nodes in zip(robot.drives, robot.nodes(points), strict=True):
        if drive.quantity != "friction":
            swing = np.abs(nodes - robot.rest_of(drive)[..., None]).max(axis=(1, 2))
            tied &= swing[:, 0] <= AT_REST * swing.max(axis=1)
            moved |= swing.max(axis=1) > 0
    return tied & moved


def caution_of(robot: "LatticeRobot", point: ArrayLike) -> str:
    """A warning where differences mislead at a point, shape (P,), as nothing moves while it settles; else empty."""
    if not settles_at_rest(robot, robot.points(point))[0]:
        return ""
    phases = [name for drive in robot.drives for name in drive.free if name.startswith(f"{drive.name}_phase")]
    which = ", ".join(phases or [f"that of {drive.name}" for drive in robot.drives])
    return (
        f"phases: all are 0 or 0.5 ({which}), so nothing moves while the robot settles, to a tie: differences see "
        "jumps there, and gradients are taken just beside it; start at other phases"
    )
