"""Changes of shape between two gaits: the design that changes the core pressure, and a judgement of the result.

The core of the physical robot takes 11.5 s from flat to round at 50 kPa and 4.7 s back at -80 kPa (Powers 2021, ch. 5;
Shah, Powers et al., Nature Machine Intelligence 3, 51-59, 2021); smaller changes get the same times.
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
REACH = 0.625  # times the sum of two voxels' mean sizes: distance of contact, see taichi_sim.lattice.laws.contact
# Limits of a successful change of shape.
SHAPE_ERROR = 5e-3  # [m]
FURTHEST = 0.5  # [body lengths]
DEEPEST = 0.75  # [voxels]


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
    """Design that changes the shape: all bladders are emptied, and the core changes its pressure.

    Args:
        before: core pressure at the beginning [Pa].
        after: core pressure at the end [Pa].
        orientation: heading along which distance is measured [degrees].
        grip: level of both feet, 0 (slide) to 1 (grip).
        together: whether bladders empty while the pressure changes, instead of before it.
        times: times in which the core is inflated and evacuated [s].
        geometry: geometry whose time step converts times to steps.
        actuation: actuation whose rates determine how long bladders take to empty.
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
    """Mean distance of voxels from those of a target shape after the best-fitting rigid motion [m].

    Source: Kabsch, Acta Crystallographica A 32, 922-923, 1976.

    Args:
        positions: positions of the voxels [m], shape (V, 3).
        target: positions in the target shape [m], shape (V, 3).
    """
    here, there = positions - positions.mean(axis=0), target - target.mean(axis=0)
    return float(np.linalg.norm(here @ _rotation(here, there).T - there, axis=1).mean())


def turned_by(positions: Floats, start: Floats) -> float:
    """Angle of the best-fitting rotation from start to final positions, shape (V, 3) each [degrees]."""
    turn = _rotation(start - start.mean(axis=0), positions - positions.mean(axis=0))
    return float(np.degrees(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1.0, 1.0))))


def _rotation(here: Floats, there: Floats) -> Floats:
    """Rotation matrix, shape (3, 3), that fits centred points ``here`` best to centred points ``there``."""
    u, _, vt = np.linalg.svd(here.T @ there)
    handed = np.diag([1.0, 1.0, np.sign(np.linalg.det(vt.T @ u.T))])
    turn: Floats = vt.T @ handed @ u.T
    return turn


def deepest_contact(body: LatticeBody, positions: Floats, sizes: Floats) -> float:
    """Largest overlap of any two voxels that may collide, from the distance at which contact begins [voxels].

    The skins of the flat pouch overlap by a quarter of a voxel at rest.

    Args:
        body: the lattice.
        positions: positions of its voxels [m], shape (V, 3).
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
    """Judgement of a change of shape.

    Attributes:
        shape_error: mean distance of voxels from the target shape after the best-fitting rigid motion [m].
        moved: displacement of the robot's middle in the plane [body lengths].
        turned: rotation of the whole body [degrees].
        deepest: largest :func:`deepest_contact` at any recorded time [voxels].
        diverged: whether the simulation diverged.
    """

    shape_error: float
    moved: float
    turned: float
    deepest: float
    diverged: bool

    def faults(self, shape_error: float = SHAPE_ERROR, furthest: float = FURTHEST) -> tuple[str, ...]:
        """Reasons why the change did not succeed, one line each; empty if it did.

        Args:
            shape_error: largest accepted shape error [m].
            furthest: largest accepted displacement [body lengths].
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
