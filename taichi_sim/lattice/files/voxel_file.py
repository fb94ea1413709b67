"""Content of a file of a voxel robot: its body, its loads, its heat."""

from dataclasses import dataclass, field

import numpy as np

from taichi_sim.base.arrays import Bytes, Floats
from taichi_sim.lattice.body import LatticeBody
from taichi_sim.lattice.program import ProgramBuilder, Quantity

MOST_VOXELS = 1_000_000
LARGEST = 50_000_000  # bytes of a file


@dataclass(frozen=True, eq=False)
class Heat:
    """Periodic temperature T = mean + amplitude sin(2 pi (t / period + phase)), relative to the stress-free one.

    Edges of a voxel grow by 1 + alpha T, alpha its material's ``thermal_expansion``.

    Attributes:
        amplitude: [K].
        period: [s].
        phase: phase of each voxel [periods], shape (V,).
        mean: [K].
    """

    amplitude: float
    period: float
    phase: Floats
    mean: float = 0.0


@dataclass(frozen=True, eq=False)
class VoxelFile:
    """A voxel robot that was read from a file.

    Attributes:
        body: its regions, unless the file numbers them, are the voxels that have material, loads and phase in common.
        colours: red, green, blue and alpha of every material, 0 to 255, shape (M, 4).
        force: on every voxel [N], world frame, shape (V, 3).
        moment: on every voxel [N m], world frame, shape (V, 3).
        displacement: translations [m] and rotations [rad, rotation vector] of fixed voxels, shape (V, 6).
        heat: the temperature that drives it, if any.
        gravity: along -z [m/s^2]; None if the file says nothing.
        floor: whether there is a floor; None if the file says nothing.
        time_step_fraction: part of ``body.recommended_time_step`` that the file wants, for the ``time_step`` of a
            ``LatticeEngine``; robots made of files have a safety of their own. None if the file says nothing.
        ignored: entries of the file that the lattice does not support.
    """

    body: LatticeBody
    colours: Bytes
    force: Floats
    moment: Floats
    displacement: Floats
    heat: Heat | None = None
    gravity: float | None = None
    floor: bool | None = None
    time_step_fraction: float | None = None
    ignored: tuple[str, ...] = field(default=())

    @classmethod
    def of_body(cls, body: LatticeBody) -> "VoxelFile":
        """Make the record of a body alone, in grey, without loads."""
        colours = np.tile(np.array([180, 180, 180, 255], np.uint8), (len(body.materials), 1))
        none = np.zeros((body.voxel_count, 3))
        return cls(body, colours, none, none, np.zeros((body.voxel_count, 6)))

    def apply_loads(self, builder: ProgramBuilder, step: int = 0) -> None:
        """Add the forces, moments and displacements to a program, from a step on.

        Raises:
            ValueError: if voxels of a region have different loads.
        """
        for quantity, values in (
            (Quantity.FORCE, self.force),
            (Quantity.MOMENT, self.moment),
            (Quantity.TRANSLATION, self.displacement[:, :3]),
            (Quantity.ROTATION, self.displacement[:, 3:]),
        ):
            for region in np.unique(self.body.regions[values.any(axis=1)]):  # type: ignore[index]
                found = np.unique(values[self.body.regions == region], axis=0)
                if len(found) > 1:
                    raise ValueError(f"regions: the voxels of region {region} do not have their loads in common")
                for axis in np.flatnonzero(found[0]).tolist():
                    builder.set(quantity + axis, found[0, axis], regions=[region], step=step)


def decoded(content: bytes) -> str:
    """Decode the text of a file: UTF-8, or else Latin-1, which VoxCAD writes."""
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")
