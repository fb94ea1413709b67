"""Soft walkers: bodies of passive and active voxels, their material, and their lattice.

Source: Cheney, MacCurdy, Clune & Lipson, "Unshackling evolution: evolving soft robots with multiple materials and a
powerful generative encoding", GECCO 2013: active voxels swell and shrink in time, some in antiphase; nothing else moves
the robot. The same robots as those of evosoro and voxcraft-sim.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from robots.world import Terrain
from taichi_sim.base.arrays import Ints
from taichi_sim.base.files import read_record, write_record
from taichi_sim.lattice import LatticeBody, Material

EMPTY, PASSIVE, ACTIVE, ANTIPHASE = range(4)
KINDS = ("empty", "passive", "active", "antiphase")
LEAST_VOXELS = 4
DESIGN_FORMAT = "morpholab-walker-design-1"


@dataclass(frozen=True, eq=False)
class WalkerDesign:
    """What every place of a lattice holds.

    Attributes:
        materials: ``EMPTY`` (0), ``PASSIVE`` (1), ``ACTIVE`` (2) or ``ANTIPHASE`` (3), whole numbers of shape
            (X, Y, Z), read-only; the robot is to walk along +x, and +z is up.
    """

    materials: NDArray[np.int8]

    def __post_init__(self) -> None:
        given = np.asarray(self.materials)
        if given.ndim != 3 or not given.size:
            raise ValueError(f"materials: shape {given.shape} is not allowed; give (X, Y, Z), each at least 1")
        wrong = np.argwhere(~np.isin(given, range(len(KINDS))))
        if wrong.size:
            x, y, z = wrong[0].tolist()
            allowed = ", ".join(f"{number} {kind}" for number, kind in enumerate(KINDS))
            raise ValueError(f"materials: {given[x, y, z]} of voxel ({x}, {y}, {z}) is not allowed; give {allowed}")
        materials = given.astype(np.int8)
        materials.setflags(write=False)
        object.__setattr__(self, "materials", materials)

    @property
    def fault(self) -> str:
        """Why it is no robot; empty if it is one."""
        kinds = self.connected[1]
        if not len(kinds):
            return "the body is empty"
        if len(kinds) < LEAST_VOXELS:
            return f"the body has {len(kinds)} connected voxels; it needs {LEAST_VOXELS}"
        return "" if (kinds != PASSIVE).any() else "the body has no active voxel"

    @cached_property
    def connected(self) -> tuple[Ints, NDArray[np.int8]]:
        """The largest part whose voxels share faces (the first of equals), moved to the corner of the lattice.

        Returns:
            Places, shape (V, 3), and kinds, shape (V,).
        """
        part, count = ndimage.label(self.materials != EMPTY)  # neighbours by faces
        if not count:
            return np.zeros((0, 3), np.int64), np.zeros(0, np.int8)
        largest = part == 1 + np.argmax(np.bincount(part.ravel())[1:])
        places = np.argwhere(largest)
        return places - places.min(axis=0), self.materials[largest]


def save_walker(design: WalkerDesign, path: str | PathLike[str]) -> None:
    """Write a design as JSON: layers from the ground up, of each the rows in order of y, a digit a voxel."""
    layers = np.moveaxis(design.materials, [2, 1, 0], [0, 1, 2]).tolist()
    write_record(path, DESIGN_FORMAT, {"layers": [["".join(map(str, row)) for row in layer] for layer in layers]})


def load_walker(path: str | PathLike[str]) -> WalkerDesign:
    """Read a design written by :func:`save_walker`.

    Raises:
        ValueError: one line that names the file and what is wrong with it.
    """
    return read_record(path, DESIGN_FORMAT, _design_of)


def _design_of(record: dict[str, Any]) -> WalkerDesign:
    layers = [[[int(digit) for digit in row] for row in layer] for layer in record["layers"]]
    if len({(len(layer), len(row)) for layer in layers for row in layer}) != 1:
        raise ValueError("layers: they differ in size; give equally many rows, equally long")
    return WalkerDesign(np.moveaxis(np.array(layers), [0, 1, 2], [2, 1, 0]))


@dataclass(frozen=True)
class WalkerTissue:
    """What all voxels are made of: a very soft silicone.

    Attributes:
        voxel_size: h [m].
        youngs_modulus: [Pa].
        density: [kg/m^3].
        static_friction: Coulomb coefficient against the floor.
        kinetic_friction: likewise, while a voxel slides.
        internal_damping: damping ratio of links.
        collision_damping: damping ratio of contacts.
        time_step_safety: the largest stable time step is divided by this.
    """

    voxel_size: float = 0.02
    youngs_modulus: float = 5e4
    density: float = 1000.0
    static_friction: float = 1.0
    kinetic_friction: float = 0.5
    internal_damping: float = 1.0
    collision_damping: float = 1.0
    time_step_safety: float = 1.3

    def __post_init__(self) -> None:
        for field in ("voxel_size", "youngs_modulus", "density", "time_step_safety"):
            if not (math.isfinite(value := getattr(self, field)) and value > 0):
                raise ValueError(f"{field}: {value!r} is not allowed; it must be positive")
        _ = self.material  # which checks the rest

    def on(self, terrain: Terrain) -> "WalkerTissue":
        """With the friction of a terrain, where it has one.

        Raises:
            ValueError: if the terrain gives a friction for feet that slide.
        """
        if terrain.low_friction is not None:
            raise ValueError(f"low_friction: {terrain.low_friction} is not allowed; a walker has no sliding feet")
        if (friction := terrain.high_friction) is None:
            return self
        return replace(self, static_friction=friction, kinetic_friction=friction)

    @property
    def time_step(self) -> float:
        """The largest dt [s]; that of two joined voxels is that of all bodies."""
        pair = self.body(np.array([[0, 0, 0], [1, 0, 0]]), np.zeros(2, np.int64))
        return pair.recommended_time_step / self.time_step_safety

    def body(self, places: Ints, regions: Ints) -> LatticeBody:
        """The lattice of voxels at these places, shape (V, 3), with these labels, shape (V,)."""
        return LatticeBody(places, (self.material,), np.zeros(len(places), int), self.voxel_size, regions)

    @property
    def material(self) -> Material:
        """Of the lattice."""
        return Material(
            self.youngs_modulus,
            self.density,
            static_friction=self.static_friction,
            kinetic_friction=self.kinetic_friction,
            internal_damping=self.internal_damping,
            collision_damping=self.collision_damping,
        )
