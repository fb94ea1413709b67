"""Strains, contacts and pressure forces of a lattice in recorded poses.

Source: Hiller & Lipson, "Dynamic Simulation of Soft Multimaterial 3D-Printed Objects", Soft Robotics 1(1), 2014.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from scipy.spatial import cKDTree

from taichi_sim.base.arrays import Bools, Floats, Ints
from taichi_sim.ground.laws import penetration
from taichi_sim.lattice import LatticeBody, Relief
from taichi_sim.lattice.faces import FACE_CORNERS, corners
from taichi_sim.lattice.laws.contact import SPHERE_RADIUS


@dataclass(frozen=True, eq=False)
class LatticeStates:
    """The states of a lattice body in F frames.

    Attributes:
        body: the lattice, of V voxels and L links.
        positions: voxel centres [m], shape (F, V, 3).
        orientations: quaternions (w, x, y, z), shape (F, V, 4).
        extents: distances from each voxel's centre to its sides -x, +x, -y, ... [m], shape (F, V, 6).
        sizes: rest sizes of the voxels along their own axes [m], shape (F, V, 3).
        pressure: on the body's pressurised faces [Pa], one or shape (V,), or (F, V) where it changes.
        relief: uneven ground below; None for the flat floor z = -h/2 (h: the voxel size).
    """

    body: LatticeBody
    positions: Floats
    orientations: Floats
    extents: Floats
    sizes: Floats
    pressure: float | Floats = 0.0
    relief: Relief | None = None

    def part(self, frames: Ints | Sequence[int]) -> Self:
        """Copy with only some of the frames."""
        several: tuple[str, ...] = ("positions", "orientations", "extents", "sizes")
        several += ("pressure",) if np.ndim(self.pressure) == 2 else ()
        return replace(self, **{name: getattr(self, name)[frames] for name in several})

    def strains(self) -> Floats:
        """Axial strains of the links, as the engine computes them, shape (F, L).

        They are computed from the side of each link's first voxel, which lies r/2 (1 + eps 2 E2 / (E1 + E2)) from its
        centre, where r is its rest size, eps the strain, and E1 and E2 are Young's moduli of the two voxels.
        """
        minus, plus = self.body.topology.links.T
        axis = self.body.topology.link_axes
        moduli = np.array([m.youngs_modulus for m in self.body.materials])[self.body.material_index]
        share = 2 * moduli[plus] / (moduli[minus] + moduli[plus])
        return (2 * self.extents[:, minus, 2 * axis + 1] / self.sizes[:, minus, axis] - 1) / share

    def voxel_strains(self) -> Floats:
        """Mean strain of each voxel's links, shape (F, V); 0 for voxels without links."""
        links, count = self.body.topology.links, self.body.voxel_count
        strains = self.strains()
        sums = np.stack([np.bincount(links.ravel(), np.repeat(row, 2), count) for row in strains])
        return sums / np.maximum(np.bincount(links.ravel(), minlength=count), 1)

    def on_floor(self) -> Bools:
        """Whether voxels touch the ground, shape (F, V).

        A voxel of mean rest size s touches flat ground if its centre is at most s/2 above z = -h/2, where h is the
        voxel size of the body; on uneven ground the plane of the triangle below its centre counts.
        """
        if self.relief is not None:
            height, nz = self.relief.below(self.positions[..., 0], self.positions[..., 1])
            size, edge = self.sizes.mean(axis=-1), self.body.voxel_size
            return np.asarray(penetration(size, edge, self.positions[..., 2], height, nz) >= 0)
        return self.sizes.mean(axis=-1) / 2 - self.body.voxel_size / 2 >= self.positions[..., 2]

    def on_itself(self) -> Bools:
        """Whether voxels touch other voxels of the same robot, shape (F, V).

        Surface voxels collide as spheres whose radius is 0.625 times their mean rest size, except pairs that are at
        most five links apart.
        """
        topology = self.body.topology
        touching = np.zeros(self.positions.shape[:2], bool)
        if not len(topology.surface):
            return touching
        radii = SPHERE_RADIUS * self.sizes[:, topology.surface].mean(axis=-1)
        for f, (places, radius) in enumerate(zip(self.positions[:, topology.surface], radii, strict=True)):
            first, second = cKDTree(places).query_pairs(2 * radius.max(), output_type="ndarray").T
            apart = np.linalg.norm(places[first] - places[second], axis=1)
            hit = (apart < radius[first] + radius[second]) & ~topology.excluded[first, second]
            touching[f, topology.surface[np.concatenate([first[hit], second[hit]])]] = True
        return touching

    def contacts(self) -> Ints:
        """What voxels touch, shape (F, V): 0 nothing, 1 the floor, 2 other voxels of the same robot, 3 both."""
        return self.on_floor() + 2 * self.on_itself()

    def pressure_forces(self, frame: int) -> tuple[Floats, Floats]:
        """Pressure forces in a frame: centres of the faces [m] and forces on them [N], shape (N, 3) each.

        The force on a face is the pressure times the cross product of the face's edges.
        """
        normals = self.body.pressure_normals
        assert normals is not None
        voxels, axes = np.nonzero(normals)
        pose = (a[frame] for a in (self.positions, self.orientations, self.extents))
        side = 2 * axes + (normals[voxels, axes] > 0)
        face = corners(*pose)[voxels[:, None], FACE_CORNERS[side]]
        area = np.cross(face[:, 1] - face[:, 0], face[:, 3] - face[:, 0])
        pressure = np.broadcast_to(self.pressure, self.positions.shape[:2])[frame]
        return face.mean(axis=1), pressure[voxels, None] * area
