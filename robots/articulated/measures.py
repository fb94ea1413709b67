"""Measures of articulated robots: how far they come, what their drives spend, and what they are made of."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from robots.robot import Measure
from taichi_sim.base.arrays import Floats
from taichi_sim.rigid import Tree
from taichi_sim.rigid.model.actuation import largest_torque

MEASURES = (
    Measure("speed", "m/s", "speed along its heading"),
    Measure("distance", "m", "distance along its heading"),
    Measure("energy", "J", "work of its drives"),
    Measure("mass", "kg", "mass"),
    Measure("torque_limits", "N m", "largest torques of its drives, added"),
)
# Own measures of earlier versions may have these names, and then stand in their place.
NEWER = "energy", "mass", "torque_limits"


def _mass(tree: Tree) -> float:
    return float(tree.masses.sum())


def _torque_limits(tree: Tree) -> float:
    return sum(largest_torque(hinge.motor) for hinge in tree.hinges if hinge.motor is not None)


# Those that follow from how a robot is made, whatever it does.
OF_TREES: Mapping[str, Callable[[Tree], float]] = {"mass": _mass, "torque_limits": _torque_limits}


def measures_of(tree: Tree) -> tuple[Measure, ...]:
    """Measures of a robot: its torque limits only if each of its drives has a largest torque."""
    limited = np.isfinite(_torque_limits(tree))
    return tuple(measure for measure in MEASURES if limited or measure.name != "torque_limits")


def of_trees(name: str, trees: Sequence[Tree], count: int) -> Floats:
    """One of ``OF_TREES`` for robots that have a tree each, or all the same, (count,)."""
    values = np.array([OF_TREES[name](tree) for tree in trees])
    return np.broadcast_to(values, count).copy()
