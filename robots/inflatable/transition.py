"""Changes of shape between two gaits: what the core does, and whether the robot comes through it well.

The core of the physical robot takes 11.5 s from flat to round at 50 kPa and 4.7 s back at -80 kPa (Powers 2021, ch. 5;
Shah, Powers et al., Nature Machine Intelligence 3, 51-59, 2021); smaller changes are given as long.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from robots.inflatable.actuation import ACTUATION, InflatableActuation
from robots.inflatable.body import PUBLISHED, InflatableGeometry
from robots.inflatable.design import InflatableDesign
from robots.inflatable.schedule import BLADDERS, ROWS, GaitSchedule
from robots.inflatable.timing import full_stroke_steps
from taichi_sim.base.arrays import Floats
from taichi_sim.lattice import LatticeBody

INFLATION_TIME, VACUUM_TIME = 11.5, 4.7  # of the core, from flat to round and back [s]
SETTLING_TIME = 1.0  # after the change of pressure [s]
REACH = 0.625  # of the sum of two voxels' mean sizes: where contact begins, see taichi_sim.lattice.laws.contact
# Limits of a change of shape that went well.
SHAPE_ERROR = 5e-3  # [m]
FURTHEST = 0.5  # body lengths
DEEPEST = 0.75  # of a voxel


def change_of_shape(
    before: float,
    after: float,
    orientation: float,
    *,
    grip: float = 1.0,
    together: bool = False,
    times: tuple[float, float] = (INFLATION_TIME, VACUUM_TIME),
    geometry: InflatableGeometry = PUBLISHED,
    actuation: InflatableActuation = ACTUATION,
) -> InflatableDesign:
    """A gait of which the shape is the purpose: all bladders are emptied, the core goes from a pressure to another.

    Args:
        before: core pressure [Pa].
        after: likewise.
        orientation: heading [degrees], by which its way is measured.
        grip: of both feet, 0 (slide) to 1 (grip).
        together: whether bladders empty while the pressure changes, instead of before it.
        times: of the core, up and down [s].
        geometry: its time step says how many steps the measured times are.
        actuation: its rates say how long bladders take to empty.
    """
    change = round(times[0 if after > before else 1] / geometry.time_step)
    settle = round(SETTLING_TIME / geometry.time_step)
    emptying = full_stroke_steps(actuation) + 1
    motion, core, settling = [emptying, change], [before, after], [actuation.settle_steps, settle]
    if together:
        motion, core, settling = [max(emptying, change)], [after], [settle]
    columns = len(motion)
    levels = np.zeros((ROWS, columns))
    levels[BLADDERS:] = grip
    gait = GaitSchedule(levels, 1, np.array(core), np.array(motion), np.array(settling))
    return InflatableDesign(before, orientation, gait)


def shape_error(positions: Floats, target: Floats) -> float:
    """Mean distance of voxels from those of a target after the rigid motion that fits best is removed [m].

    Source: Kabsch, Acta Crystallographica A 32, 922-923, 1976.

    Args:
        positions: shape (V, 3).
        target: shape (V, 3).
    """
    here, there = positions - positions.mean(axis=0), target - target.mean(axis=0)
    return float(np.linalg.norm(here @ _rotation(here, there).T - there, axis=1).mean())


def turned_by(positions: Floats, start: Floats) -> float:
    """Angle of the rigid rotation that fits best from a start to some positions, shape (V, 3) each [degrees]."""
    turn = _rotation(start - start.mean(axis=0), positions - positions.mean(axis=0))
    return float(np.degrees(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1.0, 1.0))))


def _rotation(here: Floats, there: Floats) -> Floats:
    """The rotation that takes centred points nearest to others, shape (3, 3)."""
    u, _, vt = np.linalg.svd(here.T @ there)
    handed = np.diag([1.0, 1.0, np.sign(np.linalg.det(vt.T @ u.T))])
    turn: Floats = vt.T @ handed @ u.T
    return turn


def deepest_contact(body: LatticeBody, positions: Floats, sizes: Floats) -> float:
    """How far any two voxels that may collide are in each other, beyond where their contact begins, in voxels.

    The skins of the flat pouch rest a quarter of a voxel in each other.

    Args:
        body: the lattice.
        positions: of its voxels [m], shape (V, 3).
        sizes: rest sizes of the voxels [m], shape (V, 3).
    """
    topology = body.topology
    surface = topology.surface
    places, mean = positions[surface], sizes[surface].mean(axis=1)
    pairs = cKDTree(places).query_pairs(REACH * 2 * float(mean.max()), output_type="ndarray")
    pairs = pairs[~topology.excluded[pairs[:, 0], pairs[:, 1]]]
    if not len(pairs):
        return 0.0
    gap = np.linalg.norm(places[pairs[:, 0]] - places[pairs[:, 1]], axis=1)
    overlap = REACH * mean[pairs].sum(axis=1) - gap
    return float(max(overlap.max(), 0.0) / body.voxel_size)


@dataclass(frozen=True)
class TransitionJudgement:
    """How a change of shape went.

    Attributes:
        shape_error: mean distance of voxels from the target shape, rigid motion removed [m].
        moved: of the robot's middle, in the plane [body lengths].
        turned: of the body as a whole [degrees].
        deepest: see :func:`deepest_contact`; at any recorded time.
        diverged: whether the simulation did.
    """

    shape_error: float
    moved: float
    turned: float
    deepest: float
    diverged: bool

    def faults(self, shape_error: float = SHAPE_ERROR, furthest: float = FURTHEST) -> tuple[str, ...]:
        """What speaks against it, a line each; none if it went well.

        Args:
            shape_error: limit of it [m].
            furthest: that the robot may move [body lengths].
        """
        if self.diverged:
            return ("the simulation diverged",)
        found = []
        if not self.shape_error <= shape_error:
            found.append(f"ends {1e3 * self.shape_error:.1f} mm from the shape, more than {1e3 * shape_error:g}")
        if not self.moved <= furthest:
            found.append(f"the robot moves away by {self.moved:.2f} body lengths, more than {furthest:g}")
        if not self.deepest <= DEEPEST:
            found.append(f"voxels are {self.deepest:.2f} of their size in each other, more than {DEEPEST:g}")
        return tuple(found)
