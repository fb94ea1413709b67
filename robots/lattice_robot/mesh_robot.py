"""A lattice robot of meshes: one for the body, and others that mark its materials and muscles."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from robots.lattice_robot.drive import Drive, Free, Value
from taichi_sim.base.arrays import Ints
from taichi_sim.base.checks import MOST_FRICTION, number, positive

if TYPE_CHECKING:
    from robots.lattice_robot.robot import LatticeRobot
    from taichi_sim.lattice import Material
    from taichi_sim.lattice.files.mesh import VoxelisedMesh

MILLIMETRE = 1e-3  # unit of files of meshes, unless told otherwise [m]
SLIDING = 0.8  # kinetic friction, part of the static one
AMPLITUDE = Free(0.0, 0.2)  # of muscles, unless told otherwise
AT_REST = Drive("rest", (0,))  # of a body without muscles
_MATERIAL, _WAVE = ("modulus", "density", "friction"), ("amplitude", "phase")


@dataclass(frozen=True)
class MarkedRegion:
    """A part of a body that a mesh marks as a material, a muscle, or both; by default a muscle.

    Attributes:
        name: name of the material or muscle.
        file: file of the mesh.
        material: Young's modulus [Pa], density [kg/m^3] and static friction, where they differ from the body's.
        amplitude: amplitude of the muscle's edges [voxel edges]; None unless it was given.
        phase: phase of the muscle [cycles]; None unless it was given.
    """

    name: str
    file: Path
    material: Mapping[str, float] = field(default_factory=dict)
    amplitude: Value | None = None
    phase: Value | None = None

    @property
    def is_muscle(self) -> bool:
        """Whether the marked voxels are driven."""
        return not self.material or self.amplitude is not None or self.phase is not None

    @classmethod
    def from_text(cls, text: str) -> "MarkedRegion":
        """Parse a region such as ``legs=legs.stl,amplitude=0:0.3,phase=0:1`` or ``feet=feet.stl,modulus=1e6``.

        Raises:
            ValueError: for other names, and values that are no numbers or ranges LOW:HIGH.
        """
        head, *parts = text.split(",")
        name, _, file = head.partition("=")
        if not name.strip() or not file:
            raise ValueError(f"region: {text!r} is not allowed; give NAME=FILE, such as legs=legs.stl")
        given: dict[str, Value] = {}
        for part in parts:
            key, _, value = part.partition("=")
            if key not in (*_MATERIAL, *_WAVE) or key in given:
                known = ", ".join((*_MATERIAL, *_WAVE))
                raise ValueError(f"region: {part!r} of {name} is not allowed; give values of {known}, each once")
            given[key] = _value(f"{name}_{key}", value, ranges=key in _WAVE)
        material = {key: positive(f"{name}_{key}", given[key]) for key in _MATERIAL if key in given}
        return cls(name.strip(), Path(file), material, given.get("amplitude"), given.get("phase"))


def _value(field_name: str, text: str, ranges: bool) -> Value:
    try:
        parts = [float(part) for part in text.split(":")]
    except ValueError:
        parts = []
    if len(parts) not in (1, 1 + ranges) or not all(map(math.isfinite, parts)):
        told = "a number, or a range LOW:HIGH" if ranges else "a number"
        raise ValueError(f"{field_name}: {text!r} is not allowed; give {told}")
    return parts[0] if len(parts) == 1 else Free(*parts)


def robot_of_mesh(
    path: str | PathLike[str],
    pitch: float,
    regions: Sequence[MarkedRegion],
    *,
    scale: float = MILLIMETRE,
    modulus: float = 1e5,
    density: float = 1e3,
    friction: float = 1.0,
    **settings: Any,
) -> "LatticeRobot":
    """Make a lattice robot whose body fills a mesh with voxels; exported surfaces and moulds lie where the mesh does.

    Where regions overlap, the last one counts, of materials and of muscles apart.

    Args:
        path: a file of a mesh that trimesh reads.
        pitch: edge of the voxels, in the mesh's unit.
        regions: meshes of the same unit and coordinates that mark materials and muscles; a body without muscles rests.
        scale: metres per unit of the meshes.
        modulus: Young's modulus of voxels that no region gives one [Pa].
        density: density of voxels that no region gives one [kg/m^3].
        friction: static friction of voxels that no region gives one; kinetic friction is ``SLIDING`` times static.
        settings: further fields of ``LatticeRobot``.

    Raises:
        ValueError: one line that names the field, the value and what is allowed.
    """
    from robots.lattice_robot.robot import LatticeRobot
    from taichi_sim.lattice import Material, body_from_array
    from taichi_sim.lattice.files.mesh import voxelise

    _check_regions(regions)
    base = Material(
        positive("modulus", modulus),
        positive("density", density),
        static_friction=number("friction", friction, 0.0, MOST_FRICTION),
        kinetic_friction=SLIDING * friction,
        name="body",
    )
    found = voxelise(path, pitch, scale=scale)
    materials, kinds, labels = _marks(regions, found, scale, base)
    rest = int((labels[found.filled] == 0).any())  # voxels of no muscle are region 0
    muscles = [region for region in regions if region.is_muscle]
    drives = [_drive(region, rest + place, place / len(muscles)) for place, region in enumerate(muscles)] or [AT_REST]
    body = body_from_array(kinds, materials, found.pitch, regions=np.maximum(labels - 1 + rest, 0))
    # Robots stand on the floor, so the body may be moved down.
    origin = (found.origin + found.pitch * body.voxels[:, 2].min() * np.array([0, 0, 1])).tolist()
    usual = {"name": Path(path).stem, "origin": tuple(origin), **({} if muscles else {"cycles": 1})}
    return LatticeRobot(body, tuple(drives), **{**usual, **settings})


def _check_regions(regions: Sequence[MarkedRegion]) -> None:
    """Refuse regions of which two have a name."""
    names = [region.name for region in regions]
    if len(set(names)) < len(names):
        raise ValueError(f"region: names {', '.join(names)} do not all differ; give each its own")


def _marks(
    regions: Sequence[MarkedRegion], found: "VoxelisedMesh", scale: float, base: "Material"
) -> "tuple[list[Material], Ints, Ints]":
    """What regions mark on a grid: all materials, which of them each cell has from 1 on, and which muscle it is, or 0.

    Raises:
        ValueError: for a muscle of which later regions leave nothing.
    """
    materials, kinds, labels = [base], np.where(found.filled, 1, 0), np.zeros(found.filled.shape, int)
    muscles = 0
    for region in regions:
        marked = _marked(region, found, scale)
        if region.material:
            materials.append(_changed(base, region))
            kinds[marked] = len(materials)
        if region.is_muscle:
            muscles += 1
            labels[marked] = muscles
    for label, region in enumerate((region for region in regions if region.is_muscle), 1):
        if not (labels == label).any():
            raise ValueError(f"region: later regions mark all voxels of {region.name}; leave it out, or give it last")
    return materials, kinds, labels


def _marked(region: MarkedRegion, body: "VoxelisedMesh", scale: float) -> Any:
    from taichi_sim.lattice.files.mesh import inside

    marked = inside(region.file, body, scale=scale) & body.filled
    if not marked.any():
        raise ValueError(f"region: {region.file} of {region.name} has no voxel's centre inside; check where it lies")
    return marked


def _changed(base: "Material", region: MarkedRegion) -> "Material":
    given = region.material
    friction = given.get("friction", base.static_friction)
    return replace(
        base,
        youngs_modulus=given.get("modulus", base.youngs_modulus),
        density=given.get("density", base.density),
        static_friction=friction,
        kinetic_friction=SLIDING * friction,
        name=region.name,
    )


def _drive(region: MarkedRegion, label: int, part: float) -> Drive:
    """The drive of a muscle; phases that are not given are free, and start apart from each other, none at rest."""
    phase: Value = Free(0.0, 1.0, (0.25 + part) % 1.0) if region.phase is None else region.phase
    return Drive(
        region.name, (label,), amplitude=AMPLITUDE if region.amplitude is None else region.amplitude, phase=phase
    )
