"""How soft robots moved, as measures of a user's own see it."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from robots.control.cyclic import LAST_CYCLE
from robots.lattice_robot.measures import MEASURES, OF_PROPS, TARGETED, Constants, Law, Record
from robots.own_measures import OwnMeasure, sealed
from taichi_sim.base.arrays import Floats
from taichi_sim.lattice import LatticeBody

TOLD_ANYWAY = frozenset(each.name for each in (*MEASURES, TARGETED, *OF_PROPS)) | {"cells", "channels"}


@dataclass(frozen=True, eq=False)
class SoftMotion:
    """Motion of B soft robots of V voxels, without the props around them, from which users' own measures are computed.

    Arrays may be traced for derivatives: a law computes with operators and with the functions of NumPy that
    ``taichi_sim.autodiff.arrays`` knows, and takes plain arrays just as well.

    Attributes:
        times: times of T moments of the last cycle, 65 or what steps allow, from where it begins [s], shape (T,).
        positions: of voxel centres in these moments [m], shape (B, T, V, 3).
        sizes: rest size of every voxel along its own axes in these moments [m], shape (B, T, V, 3).
        strains: of every link in these moments, shape (B, T, L).
        start: voxel centres before anything moved [m], shape (B, V, 3).
        began: voxel centres where cycles begin to count, after the first one [m], shape (B, V, 3).
        ended: voxel centres after the last cycle [m], shape (B, V, 3).
        masses: of voxels [kg], shape (B, V).
        duration: of the cycles that count [s].
        heading: unit vector of the direction of travel, shape (3,).
        length: in which speeds are told [m].
        body: the first robot's, whose voxels and links are those of all.
    """

    times: Floats
    positions: Any
    sizes: Any
    strains: Any
    start: Floats
    began: Any
    ended: Any
    masses: Any
    duration: float
    heading: Floats
    length: float
    body: LatticeBody

    @classmethod
    def of(cls, record: Record, constants: Constants) -> "SoftMotion":
        """Make the motion of robots without props from a record."""
        body, times = constants.body, constants.moments
        moments = np.flatnonzero(np.append(True, np.diff(times) > 0))  # none twice
        recorded = LAST_CYCLE.start + moments
        start = np.tile(body.start_positions, (len(constants.density), 1, 1))
        start[:, :, 2] += constants.raised
        return cls(
            times[moments],
            sealed(record.positions[:, recorded]),
            sealed(record.sizes[:, recorded]),
            sealed(record.strains[:, recorded]),
            start,
            sealed(record.positions[:, 0]),
            sealed(record.positions[:, 1]),
            constants.density * body.voxel_size**3,
            constants.duration,
            constants.direction,
            constants.length,
            body,
        )

    def centres(self, positions: Any) -> Any:
        """Compute centres of mass [m], shape (B, ..., 3), from voxel centres, shape (B, ..., V, 3)."""
        shares = [masses / masses.sum() for masses in self.masses]
        along = [
            np.stack([row @ share for row, share in zip(positions[..., axis], shares, strict=True)])
            for axis in range(3)
        ]
        return np.stack(along, axis=-1)


def law_of(own: OwnMeasure) -> Law:
    """The law of a measure of a user's own, as those of the lab's are called."""

    def law(record: Record, constants: Constants) -> Any:
        return own.values(SoftMotion.of(record, constants), len(constants.density))

    return law
